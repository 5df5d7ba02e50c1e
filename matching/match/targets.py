"""Target modes of a case, and what a quantity holds of their energy: the weights on its changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy

from matching.match.case import Case, Move
from modelling.errors import InputError
from modelling.modal.modes import damped_modes, modes
from modelling.modal.result import Mode, Modes
from modelling.modal.sensitivity import mac

# --- Target modes.

FARTHEST_DAMPED = float(np.log(1.5))  # between a mode's damped and undamped frequency, logarithm
LEAST_SCORE = 1e-3  # of any pair that may be one mode, so that as many as possible are paired


def target_modes(case: Case) -> list[tuple[Mode, Mode]]:
    """For every target the undamped vehicle mode it numbers and the damped mode it is.

    Each damped mode is one undamped mode: both are paired as a whole, by shape and frequency, since neighbours that lie
    1 % apart may come in another order, or mix, once they are damped.
    """
    plain, damped = modes(case.vehicle), damped_modes(case.vehicle)
    counterpart = _paired(plain, damped, {f"inertias.{part.name}": part.J.value for part in case.vehicle.inertias})
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


def _paired(plain: Modes, damped: Modes, inertia: Mapping[str, float]) -> dict[int, Mode]:
    """The damped mode of every undamped one that has one, by the number of the latter."""
    elastic = [mode for mode in plain if mode.frequency > 0]
    swinging = [mode for mode in damped if mode.frequency > 0 and mode.damping_ratio < 1]
    score = np.zeros((len(elastic), len(swinging)))
    for row, first in enumerate(elastic):
        for column, second in enumerate(swinging):
            far = abs(np.log(second.frequency / first.frequency))
            if first.symmetry == second.symmetry and far <= FARTHEST_DAMPED:
                score[row, column] = LEAST_SCORE + weighted_mac(first.shape, second.shape, inertia) * np.exp(-far)
    places = zip(*scipy.optimize.linear_sum_assignment(score, maximize=True), strict=True)
    return {elastic[row].number: swinging[column] for row, column in places if score[row, column] > 0}


def weighted_mac(first: Mapping[str, complex], second: Mapping[str, complex], inertia: Mapping[str, float]) -> float:
    """Modal assurance criterion over what both shapes hold, each coordinate weighted by its inertia, kg·m² (else 1)."""
    names = [name for name in first if name in second]
    weight = np.sqrt([inertia.get(name, 1.0) for name in names])
    a, b = (weight * np.array([shape[name] for name in names]) for shape in (first, second))
    return float(abs(np.vdot(a, b)) ** 2 / max(np.vdot(a, a).real * np.vdot(b, b).real, 1e-300))


# --- Weights on changes: what holds much of a target mode's energy moves with little weight, what holds little is
# fixed.
#
# Shares are the modal sensitivity coefficients of the paper's Eqs. 6 and 7, summed over mirror images. Quantities of
# the residual vehicle are judged by the vehicle's target modes, adapters and rotors by the rig mode of the same
# symmetry that is most like the target on what both share, ratios and the loop's own quantities always move.

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


def counterparts(case: Case) -> list[Mode | None]:
    """For every target the rig mode that answers to it: same symmetry, most alike on the shared inertias, or None."""
    rig = modes(case.rig)
    shared = [
        part.name for part in case.rig.inertias if part.name in {inertia.name for inertia in case.vehicle.inertias}
    ]
    counterpart_modes: list[Mode | None] = []
    for wanted, _ in target_modes(case):
        shape = np.array([[wanted.shape.get(f"inertias.{name}", 0.0)] for name in shared])
        elastic = [mode for mode in rig if mode.frequency > 0 and mode.symmetry == wanted.symmetry]
        if not elastic:
            counterpart_modes.append(None)
            continue
        if np.abs(shape).max(initial=0.0) < 1e-6:  # it leaves the shared part at rest: the lowest of its symmetry
            counterpart_modes.append(elastic[0])
            continue
        macs = [
            float(mac(shape, np.array([[mode.shape.get(f"inertias.{name}", 0.0)] for name in shared]))[0, 0])
            for mode in elastic
        ]
        counterpart_modes.append(
            elastic[int(np.argmax(np.array(macs) > 0.8)) if max(macs) > 0.8 else int(np.argmax(macs))]
        )
    return counterpart_modes


def _nearest(found: Modes, wanted: Sequence[Mode]) -> list[Mode]:
    """Of the elastic modes of a vehicle those of the wanted symmetries that come nearest in frequency."""
    elastic = [mode for mode in found if mode.frequency > 0]
    alike = ([mode for mode in elastic if mode.symmetry == one.symmetry] for one in wanted)
    return [
        min(some, key=lambda mode: abs(np.log(mode.frequency / one.frequency)))
        for one, some in zip(wanted, alike, strict=True) if some
    ]  # fmt: skip


def share(case: Case, move: Move, vehicle: Modes, rig_modes: list[Mode | None]) -> float:
    """Largest share of a target mode's energy that a quantity and its mirror image hold, 0 … 1; the loop's own: 1."""
    if move.name.startswith("loop.") or move.name.endswith(".ratio"):
        return 1.0
    if move.name.startswith("residual_vehicle."):
        judged = [vehicle[target.mode - 1] for target in case.targets]
        if case.simple_vehicle is not None:
            judged = _nearest(modes(case.simple_vehicle), judged)
    else:
        judged = [mode for mode in rig_modes if mode]
    best = 0.0
    for mode in judged:
        total = 0.0
        for name in move.together:
            place, _, key = name.split(".", 1)[1].rpartition(".")
            total += (mode.kinetic if key in ("J", "drag") else mode.potential).get(place, 0.0)
        best = max(best, total)
    return best
