"""Which causes reduce the fidelity, ranked: dynamics, model, measurement; by signal its ordinate, delay and noise.

R_XiL² is a sum, so 1 − R_XiL² splits without remainder: over the domains by their weights, within a dynamic domain
over each signal's 1 − R_NRMSE² and 1 − R_τ², within the measurement domain in proportion to (U/range)². The part of a
signal's ordinate loss that noise alone explains is attributed to measurement: better dynamics would not regain it.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from modelling.fidelity.distribution import noise_of
from modelling.fidelity.fidelity import MEASUREMENT_DOMAIN, Fidelity, SignalFidelity
from modelling.fidelity.measures import nrmse_fidelity_of

ORIGINS = {
    "system_dynamics": "dynamics",
    "residual_vehicle_model": "model",
    MEASUREMENT_DOMAIN: "measurement",
}  # by domain


@dataclass(frozen=True)
class Loss:
    """One cause.

    Attributes
    ----------
    origin, signal, cause : str
        E.g. ``"dynamics"``, the signal's name, ``"delay"``.
    loss : float
        Its part of 1 − R_XiL².
    gain : float
        How much R_XiL would rise if this cause alone were removed.
    """

    origin: str
    signal: str
    cause: str
    loss: float
    gain: float


@dataclass(frozen=True)
class Attribution:
    """Losses, largest gain first; their sum is 1 − R_XiL² as long as no part is cut at 0 or 1."""

    losses: tuple[Loss, ...]

    @property
    def by_origin(self) -> dict[str, float]:
        """Part of the whole loss by origin, largest first; sums to one, unless nothing is lost."""
        total = math.fsum(loss.loss for loss in self.losses)
        parts = {
            origin: math.fsum(loss.loss for loss in self.losses if loss.origin == origin) / total if total > 0 else 0.0
            for origin in ORIGINS.values()
        }
        return dict(sorted(parts.items(), key=lambda item: -item[1]))

    def to_dict(self) -> dict[str, Any]:
        """As ``fidelity.json`` holds it."""
        return {"by_origin": self.by_origin, "ranked": [asdict(loss) for loss in self.losses]}


def attribute(fidelity: Fidelity) -> Attribution:
    """Attribute 1 − R_XiL² to its causes.

    Raises
    ------
    ValueError
        For the published arithmetic, with which an ideal test bed does not score one: no loss can be attributed.
    """
    if fidelity.method.arithmetic != "definition":
        raise ValueError("attribution needs the arithmetic of the definition")
    losses: list[Loss] = []

    def add(origin: str, signal: str, cause: str, loss: float) -> None:
        if loss > 0:
            gain = math.sqrt(min(1.0, fidelity.total**2 + loss)) - fidelity.total
            losses.append(Loss(origin, signal, cause, loss, gain))

    for domain, members in fidelity.signals.items():
        weight, origin = fidelity.weights[domain] / (2 * len(members)), ORIGINS[domain]
        for signal in members:
            noise = _loss_by_noise(signal, fidelity)
            add(origin, signal.name, "ordinate", weight * (1 - signal.nrmse**2 - noise))
            add("measurement", signal.name, "noise", weight * noise)
            add(origin, signal.name, "delay", weight * (1 - signal.delay_fidelity**2))
    if fidelity.sensors:
        lost = fidelity.weights[MEASUREMENT_DOMAIN] * (1 - fidelity.domains[MEASUREMENT_DOMAIN] ** 2)
        squares = math.fsum(sensor.ratio**2 for sensor in fidelity.sensors)
        for sensor in fidelity.sensors:
            add("measurement", sensor.name, "uncertainty", lost * sensor.ratio**2 / squares if squares > 0 else 0.0)
    return Attribution(tuple(sorted(losses, key=lambda loss: -loss.gain)))


def _loss_by_noise(signal: SignalFidelity, fidelity: Fidelity) -> float:
    """How much R_NRMSE² would rise without the noise of the samples."""
    if signal.pair is None or fidelity.step is None:
        return 0.0
    reference, test = noise_of(signal.pair, fidelity.step, fidelity.f_max)
    noiseless = max(0.0, signal.mean_square - reference**2 - test**2)
    return nrmse_fidelity_of(noiseless, signal.width, fidelity.method.nrmse_form) ** 2 - signal.nrmse**2
