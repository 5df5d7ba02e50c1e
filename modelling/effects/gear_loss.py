"""Torque that a gear loses in proportion to what it passes on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from sympy import Abs, Expr, sign

from modelling.effects.first_guess import FittedMotion, Guess, smooth_sign
from modelling.effects.interface import EquationBuilder, GearLaw, ShaftLaw, Symbols
from modelling.effects.kind import Kind, Parameter

SMALLEST_LOSS, LARGEST_LOSS = 1e-4, 0.95  # share of the torque


class GearLoss(Kind):
    """Of the shaft's torque T, (1 − efficiency)·|T| is lost at the second end where that end is driven, and
    (1/efficiency_reverse − 1)·|T| where it drives; it opposes the second end's motion.

    Power in is then power out over the efficiency, either way. The shaft's sensor reads T, before the loss. Of a rigid
    gear T is what the train on its first side passes on, its own inertia accelerated.
    """

    kind = "gear_loss"
    words = "passes on torque with an efficiency of {efficiency}"
    in_recording = "torque is missing in proportion to the torque passed on: a step at zero speed that grows with load."
    tables = ("shafts", "gears")
    parameters = {
        "efficiency": Parameter("1", lower=1e-3, upper=1.0),
        "efficiency_reverse": Parameter("1", lower=1e-3, upper=1.0, optional=True),
    }
    state_dependent = True
    sticks = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        of_size, of_torque = _shares(p, assembly.sign(law.second.speed))
        law.losses.append(lambda torque: of_size * Abs(torque) + of_torque * torque)

    def gear(self, law: GearLaw, p: Symbols, assembly: EquationBuilder) -> None:
        # (J₂ + (1 − share)·J₁)·T = J₂·F₁ − J₁·F₂, of both sides' torques and inertias; T has the sign of the right side
        of_size, of_torque = _shares(p, assembly.sign(law.second.speed))
        passed_on = law.second_inertia * law.first_torque - law.first_inertia * law.second_torque
        share = of_size * sign(passed_on) + of_torque
        inertia = law.second_inertia + (1 - share) * law.first_inertia
        lost = (of_size * Abs(passed_on) + of_torque * passed_on) / inertia
        assembly.add_torque(law.place, -lost, law.second)

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        table, name = at.split(".")
        ends, torques = (motion.ends, motion.torque) if table == "shafts" else (motion.gear_ends, motion.gear_torque)
        if name not in torques:
            return  # of a gear in a ring or beside a differential
        second, torque = ends[name][1], torques[name]
        direction = smooth_sign(motion.speed[second])
        lost = -np.abs(torque) * direction
        place = f"inertias.{second}"
        yield Guess(({place: lost},), _one_efficiency)
        driven = torque * direction > 0
        if driven.any() and not driven.all():
            yield Guess(({place: np.where(driven, lost, 0.0)}, {place: np.where(driven, 0.0, lost)}), _two_efficiencies)

    def possible(self, parameters: Mapping[str, float]) -> bool:
        return parameters["efficiency"] <= 1 and parameters.get("efficiency_reverse", 1.0) <= 1


def _shares(p: Symbols, direction: Expr) -> tuple[Expr, Expr]:
    """Shares lost of abs(T) and of T, ``direction`` the sign of the second end's speed.

    The loss is abs(T)·sgn(speed) at the mean of both shares, and half their difference where T drives the motion.
    """
    driven = 1 - p["efficiency"]
    driving = 1 / p.get("efficiency_reverse", p["efficiency"]) - 1
    return (driven + driving) / 2 * direction, (driven - driving) / 2 * direction**2


def _one_efficiency(a: np.ndarray) -> dict[str, float] | None:
    """The efficiency for the mean share (1 − e + 1/e − 1)/2 of torque that is lost."""
    share = float(a[0])
    return {"efficiency": float(np.sqrt(share**2 + 1) - share)} if SMALLEST_LOSS < share < LARGEST_LOSS else None


def _two_efficiencies(a: np.ndarray) -> dict[str, float] | None:
    driven, driving = (float(share) for share in a)
    if not (0 <= driven < LARGEST_LOSS and driving >= 0 and driven + driving > SMALLEST_LOSS):
        return None
    return {"efficiency": 1 - driven, "efficiency_reverse": 1 / (1 + driving)}
