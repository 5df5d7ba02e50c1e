"""Target modes of a case, and what a quantity holds of their energy: the weights on its changes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from matching.match.case import Case, Move
from modelling.errors import InputError
from modelling.modal.modes import damped_modes, modes
from modelling.modal.pairing import closeness, counterparts, damped_counterparts, pairs
from modelling.modal.result import Mode, Modes
from modelling.system import System

# --- Target modes.


def target_modes(case: Case) -> list[tuple[Mode, Mode]]:
    """For every target the undamped vehicle mode it numbers and the damped mode it is.

    Each damped mode is one undamped mode: both are paired as a whole, by shape and frequency, since neighbours that lie
    1 % apart may come in another order, or mix, once they are damped.
    """
    plain, damped = modes(case.vehicle), damped_modes(case.vehicle)
    counterpart = damped_counterparts(
        plain, damped, {f"inertias.{part.name}": part.J.value for part in case.vehicle.inertias}
    )
    pairs = []
    for number, target in enumerate(case.targets, 1):
        where = f"{case.path}: targets[{number}].mode"
        if target.mode > len(plain):
            raise InputError(where, f"the vehicle has {len(plain)} modes", "see 'rigmatch modes' of the vehicle file")
        wanted = plain[target.mode - 1]
        if wanted.frequency == 0:
            raise InputError(where, f"mode {target.mode} is a rigid motion", "name an elastic mode")
        best = counterpart.get(wanted.number)
        if best is None:
            raise InputError(
                where,
                f"mode {target.mode} ({wanted.frequency:.3g} Hz) is overdamped in the vehicle",
                "name a mode that swings",
            )
        pairs.append((wanted, best))
    return pairs


# --- Weights on changes: what holds much of a target mode's energy moves with little weight, what holds little is
# fixed.
#
# Shares are the modal sensitivity coefficients of the paper's Eqs. 6 and 7, summed over mirror images. Quantities of
# the residual vehicle are judged by the vehicle's target modes, adapters and rotors by the modes of the rig without
# control that move the shared parts like these, ratios and the loop's own quantities always move.

LEAST_SHARE_TO_MOVE = 0.01  # of a target mode's energy: with less a quantity is fixed, not identified accurately


def change_weight(part: float) -> float:
    """Weight of a change of what holds this share of a target mode's energy."""
    return float(1 / max(part, LEAST_SHARE_TO_MOVE))


def released_moves(case: Case, shares: np.ndarray) -> list[Move]:
    """What of a case's moves is released, by the shares (moves,) of :func:`shares_of`."""
    return [move for move, part in zip(case.moves, shares, strict=True) if part >= LEAST_SHARE_TO_MOVE]


def shares_of(case: Case, vehicle: Modes, rig_modes: list[Mode | None]) -> np.ndarray:
    """Share of each of a case's moves (moves,)."""
    return np.array([share(case, move, vehicle, rig_modes) for move in case.moves])


def on_rig(case: Case) -> list[Mode | None]:
    """For every target the mode of the rig without control that moves the shared parts like it; None without one."""
    numbers = [wanted.number for wanted, _ in target_modes(case)]
    became = counterparts(case.vehicle, case.rig, list(dict.fromkeys(numbers)))
    return [became.get(number) for number in numbers]


def _of_simple_vehicle(vehicle: System, wanted: Sequence[Mode]) -> list[Mode]:
    """Modes of a residual vehicle of the user's own, whose parts have other names, paired with the wanted ones by
    frequency and symmetry."""
    elastic = [mode for mode in modes(vehicle) if mode.frequency > 0]
    near = closeness(*np.meshgrid([m.frequency for m in wanted], [m.frequency for m in elastic], indexing="ij"))
    alike = np.array([[one.symmetry == other.symmetry for other in elastic] for one in wanted], bool)
    alike = alike.reshape(near.shape)
    return [elastic[column] for _, column in pairs(np.where(alike, near, 0.0))]


def share(case: Case, move: Move, vehicle: Modes, rig_modes: list[Mode | None]) -> float:
    """Largest share of a target mode's energy that a quantity and its mirror image hold, 0 … 1; the loop's own: 1."""
    if move.name.startswith("loop.") or move.name.endswith(".ratio"):
        return 1.0
    if move.name.startswith("residual_vehicle."):
        judged = [vehicle[target.mode - 1] for target in case.targets]
        if case.simple_vehicle is not None:
            judged = _of_simple_vehicle(case.simple_vehicle, judged)
    else:
        judged = [mode for mode in rig_modes if mode]
        if not judged:  # no mode of the rig tells what matters: nothing is fixed
            return 1.0
    best = 0.0
    for mode in judged:
        total = 0.0
        for name in move.together:
            place, _, key = name.split(".", 1)[1].rpartition(".")
            total += (mode.kinetic if key in ("J", "drag") else mode.potential).get(place, 0.0)
            if name.removeprefix("rig.") in case.rig.dimensions:
                total += _of_its_inertia(case.rig, place.removeprefix("shafts."), mode)
        best = max(best, total)
    return best


def _of_its_inertia(rig: System, name: str, mode: Mode) -> float:
    """Share of a mode's energy that moves the inertia of a shaft itself, half of it at each end."""
    shaft = next(part for part in rig.shafts if part.name == name)
    half = 0.0 if shaft.drawing is None else shaft.drawing.inertia.value / 2
    places = [f"inertias.{end}" for end in shaft.between]
    return sum(mode.kinetic.get(place, 0.0) * half / rig.parameters[f"{place}.J"].value for place in places)
