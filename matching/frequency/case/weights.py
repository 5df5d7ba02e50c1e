"""Weights on changes: what holds much of a target mode's energy moves with little weight, what holds little is fixed.

Shares are the modal sensitivity coefficients of the paper's Eqs. 6 and 7, summed over mirror images. Quantities of
the residual vehicle are judged by the vehicle's target modes, adapters and rotors by the rig mode of the same symmetry
that is most like the target on what both share, ratios and the loop's own quantities always move.
"""

from __future__ import annotations

import numpy as np

from matching.frequency.case.case import Case, Move
from modelling.modal.modes import modes
from modelling.modal.result import Mode, Modes
from modelling.modal.tracking import mac

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
    vehicle, rig = modes(case.vehicle), modes(case.rig)
    shared = [
        part.name for part in case.rig.inertias if part.name in {inertia.name for inertia in case.vehicle.inertias}
    ]
    counterpart_modes: list[Mode | None] = []
    for target in case.targets:
        wanted = vehicle[target.mode - 1]
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


def share(case: Case, move: Move, vehicle: Modes, rig_modes: list[Mode | None]) -> float:
    """Largest share of a target mode's energy that a quantity and its mirror image hold, 0 … 1; the loop's own: 1."""
    if move.name.startswith("loop.") or move.name.endswith(".ratio"):
        return 1.0
    on_vehicle = move.name.startswith("residual_vehicle.")
    judged = (
        [vehicle[target.mode - 1] for target in case.targets] if on_vehicle else [mode for mode in rig_modes if mode]
    )
    best = 0.0
    for mode in judged:
        total = 0.0
        for name in move.together:
            place, _, key = name.split(".", 1)[1].rpartition(".")
            total += (mode.kinetic if key in ("J", "drag") else mode.potential).get(place, 0.0)
        best = max(best, total)
    return best
