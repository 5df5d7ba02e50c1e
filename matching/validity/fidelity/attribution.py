"""What the fidelity is lost to, ranked: dynamics, model, measurement; down to each signal's ordinate, delay and noise.

R_XiL² is a sum, so 1 − R_XiL² splits without remainder: over the domains by their weights, within a dynamic domain
over each signal's 1 − R_NRMSE² and 1 − R_τ², within the measurement domain in proportion to (U/range)². The part of a
signal's ordinate loss that noise alone explains goes to measurement, for no better dynamics would win it back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from modelling.fidelity.assess import MEASUREMENT, Fidelity, SignalFidelity
from modelling.fidelity.measures import nrmse_fidelity_of
from modelling.fidelity.spread import noise_of

ORIGIN = {"system_dynamics": "dynamics", "residual_vehicle_model": "model", MEASUREMENT: "measurement"}


@dataclass(frozen=True)
class Loss:
    """One cause: ``loss`` is its part of 1 − R_XiL²; ``gain`` what R_XiL would rise by if it alone were put right."""

    origin: str
    signal: str
    cause: str
    loss: float
    gain: float


def attribute(fidelity: Fidelity) -> list[Loss]:
    """Losses, largest gain first. Their sum is 1 − R_XiL² as long as no part is cut at 0 or 1.

    Raises
    ------
    ValueError
        For the published arithmetic, under which an ideal test bed does not score one: there is no loss to attribute.
    """
    if fidelity.arithmetic != "definition":
        raise ValueError("attribution needs the arithmetic of the definition")
    losses: list[tuple[str, str, str, float]] = []
    for domain, members in fidelity.signals.items():
        weight = fidelity.weights[domain] / (2 * len(members))
        for one in members:
            noise = _by_noise(one, fidelity)
            losses += [
                (ORIGIN[domain], one.name, "ordinate", weight * (1 - one.nrmse**2 - noise)),
                ("measurement", one.name, "noise", weight * noise),
                (ORIGIN[domain], one.name, "delay", weight * (1 - one.delay_fidelity**2)),
            ]
    if fidelity.sensors:
        lost = fidelity.weights[MEASUREMENT] * (1 - fidelity.domains[MEASUREMENT] ** 2)
        squares = math.fsum(one.ratio**2 for one in fidelity.sensors)
        losses += [
            ("measurement", one.name, "uncertainty", lost * one.ratio**2 / squares if squares > 0 else 0.0)
            for one in fidelity.sensors
        ]
    found = [
        Loss(*parts, math.sqrt(min(1.0, fidelity.total**2 + parts[3])) - fidelity.total)
        for parts in losses
        if parts[3] > 0
    ]
    return sorted(found, key=lambda loss: -loss.gain)


def by_origin(losses: list[Loss]) -> dict[str, float]:
    """Part of all that is lost that goes to dynamics, model and measurement, largest first; sums to one."""
    total = math.fsum(loss.loss for loss in losses)
    sums = {origin: math.fsum(loss.loss for loss in losses if loss.origin == origin) for origin in ORIGIN.values()}
    return dict(
        sorted(
            ((origin, part / total if total > 0 else 0.0) for origin, part in sums.items()), key=lambda item: -item[1]
        )
    )


def _by_noise(one: SignalFidelity, fidelity: Fidelity) -> float:
    """How much R_NRMSE² would rise without the noise of the samples."""
    if one.pair is None or fidelity.step is None:
        return 0.0
    noise = noise_of(one.pair, fidelity.step, fidelity.f_max)
    quiet = max(0.0, one.mean_square - noise[0] ** 2 - noise[1] ** 2)
    return nrmse_fidelity_of(quiet, one.width, fidelity.nrmse_form) ** 2 - one.nrmse**2


def as_json(losses: list[Loss]) -> dict[str, Any]:
    """For ``fidelity.json``."""
    return {"by_origin": by_origin(losses), "ranked": [vars(loss) for loss in losses]}
