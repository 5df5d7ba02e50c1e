"""Torque that a gear loses in proportion to what it passes on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from sympy import Abs, Expr

from modelling.effects.first_guess import FittedMotion, Guess, smooth_sign
from modelling.effects.interface import EquationBuilder, ShaftLaw, Symbols
from modelling.effects.kind import Kind, Parameter

SMALLEST_LOSS, LARGEST_LOSS = 1e-4, 0.95  # share of the torque


class GearLoss(Kind):
    """Of the shaft's torque T, (1 − efficiency)·|T| is lost at the second end where that end is driven, and
    (1/efficiency_reverse − 1)·|T| where it drives; it opposes the second end's motion.

    Power in is then power out over the efficiency, either way. The shaft's sensor reads T, before the loss.
    """

    kind = "gear_loss"
    words = "passes on torque with an efficiency of {efficiency}"
    in_recording = "torque is missing in proportion to the torque passed on: a step at zero speed that grows with load."
    tables = ("shafts",)
    parameters = {
        "efficiency": Parameter("1", lower=1e-3, upper=1.0),
        "efficiency_reverse": Parameter("1", lower=1e-3, upper=1.0, optional=True),
    }
    state_dependent = True
    sticks = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        driven = 1 - p["efficiency"]
        driving = 1 / p.get("efficiency_reverse", p["efficiency"]) - 1
        sign = assembly.sign(law.second.speed)

        def loss(torque: Expr) -> Expr:
            # |T|·sgn(speed) at the mean of both shares, and half their difference where sgn(T) and sgn(speed) agree
            return (driven + driving) / 2 * Abs(torque) * sign + (driven - driving) / 2 * torque * sign**2

        law.losses.append(loss)

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        name = at.split(".")[1]
        second, torque = motion.ends[name][1], motion.torque[name]
        sign = smooth_sign(motion.speed[second])
        lost = -np.abs(torque) * sign
        place = f"inertias.{second}"
        yield Guess(({place: lost},), _one_efficiency)
        driven = torque * sign > 0
        if driven.any() and not driven.all():
            yield Guess(({place: np.where(driven, lost, 0.0)}, {place: np.where(driven, 0.0, lost)}), _two_efficiencies)

    def possible(self, parameters: Mapping[str, float]) -> bool:
        return parameters["efficiency"] <= 1 and parameters.get("efficiency_reverse", 1.0) <= 1


def _one_efficiency(a: np.ndarray) -> dict[str, float] | None:
    """The efficiency for the mean share (1 − e + 1/e − 1)/2 of torque that is lost."""
    share = float(a[0])
    return {"efficiency": float(np.sqrt(share**2 + 1) - share)} if SMALLEST_LOSS < share < LARGEST_LOSS else None


def _two_efficiencies(a: np.ndarray) -> dict[str, float] | None:
    driven, driving = (float(share) for share in a)
    if not (0 <= driven < LARGEST_LOSS and driving >= 0 and driven + driving > SMALLEST_LOSS):
        return None
    return {"efficiency": 1 - driven, "efficiency_reverse": 1 / (1 + driving)}
