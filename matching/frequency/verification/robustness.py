"""What must be known how well: the rig differs from what the controller was tuned for, one quantity at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from matching.frequency.loop.encirclements import modulus_margin
from matching.frequency.loop.exact_loop import ExactLoop
from matching.frequency.loop.linear_body import body
from matching.frequency.loop.parts import Parts, watched
from matching.frequency.loop.poles import closed_matrix, neutral_motions, resting_and_right
from matching.frequency.response.band import BandNodes
from matching.frequency.response.response_error import log_squares, pooled
from matching.frequency.response.responses import ComparedBed
from modelling.bed.feed_forward import FeedForward
from modelling.model.mirror import mirror_image

RELATIVE_CHANGE = 0.05  # of a stiffness or inertia: what is usually known of one that was not identified
DEAD_TIME_CHANGE = 5e-4  # s: half a sample time of 1 ms
GRID_HZ = np.geomspace(1e-2, 1e3, 300)  # on which minima of the margin are looked for


@dataclass(frozen=True)
class Deviation:
    """What one wrong quantity does.

    Attributes
    ----------
    name : str
        ``rig.…`` (a mirror image is wrong alike) or ``loop.dead_time``.
    change : float
        Relative; in s for the dead time.
    stable : bool
    spectral_abscissa, modulus_margin : float
        Of the feedback loop, the margin counted as for the nominal one; None where it was not looked for.
    response_error : float
        Against the vehicle, which has the wrong value too where it shares the component.
    """

    name: str
    change: float
    stable: bool
    spectral_abscissa: float
    modulus_margin: float | None
    response_error: float

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return dict(vars(self))


@dataclass(frozen=True)
class _Deviating:
    """One bed that differs: the name and change of its quantity, and the bed."""

    name: str
    change: float
    bed: ComparedBed
    dead_time: float


def robustness(
    parts: Parts, feed_forward: FeedForward | None, nodes: BandNodes, order: int, margin_from: float = 0.0
) -> tuple[Deviation, ...]:
    """Every stiffness and inertia of the rig 5 % off either way, the dead time 0.5 ms; worst first.

    Parameters
    ----------
    feed_forward : FeedForward or None
        As designed for the nominal rig.
    nodes : BandNodes
        Frequencies at which the nominal response error has converged.
    order : int
        Of the Padé approximation of the dead time that stability is judged with.
    margin_from : float
        Hz, from where on the modulus margin counts.
    """
    judged = [_judged(deviating, nodes, order, margin_from) for deviating in _deviating(parts, feed_forward)]
    return tuple(sorted(judged, key=lambda deviation: (deviation.stable, -deviation.response_error)))


def _deviating(parts: Parts, feed_forward: FeedForward | None) -> Iterator[_Deviating]:
    case, vehicle, done = parts.case, body(parts.case.vehicle), set[str]()
    dead_time = case.loop["dead_time"]
    for name in case.rig.parameters:
        if name in done or name.rsplit(".", 1)[1] not in ("J", "stiffness") or name.count(".") != 2:
            continue
        together = {name, mirror_image(name, case.rig)}
        done |= together
        for change in (RELATIVE_CHANGE, -RELATIVE_CHANGE):
            values = {member: case.rig.parameters[member].value * (1 + change) for member in together}
            rig = body(watched(case.rig.with_values(values), parts.cuts, rig_side=True))
            shared = {member: value for member, value in values.items() if member in case.vehicle.parameters}
            compared_with = body(case.vehicle.with_values(shared)) if shared else vehicle
            bed = ComparedBed(case, replace(parts, rig=rig), feed_forward, compared_with)
            yield _Deviating(f"rig.{name}", change, bed, dead_time)
    for change in (DEAD_TIME_CHANGE, -DEAD_TIME_CHANGE):
        changed = max(dead_time + change, 0.0)
        if changed != dead_time:
            bed = ComparedBed(case, parts, feed_forward, vehicle, changed)
            yield _Deviating("loop.dead_time", changed - dead_time, bed, changed)


def _judged(deviating: _Deviating, nodes: BandNodes, order: int, margin_from: float) -> Deviation:
    parts = deviating.bed.parts
    poles = np.linalg.eigvals(closed_matrix(parts, order, deviating.dead_time))
    _, unstable = resting_and_right(poles, neutral_motions(parts))
    difference = ExactLoop(parts, deviating.dead_time).return_difference
    counted = np.union1d(GRID_HZ[margin_from < GRID_HZ], [margin_from] if margin_from > 0 else [])
    margin, _ = modulus_margin(difference, counted, difference(2j * np.pi * counted))
    responses = deviating.bed.at(nodes.frequencies)
    error = pooled(nodes.root_mean(log_squares(responses.matched, responses.vehicle)))
    return Deviation(deviating.name, float(deviating.change), unstable == 0, float(poles.real.max()), margin, error)
