"""Rate-independent friction in parallel with a shaft (Dahl 1968)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from itertools import accumulate

import numpy as np
from sympy import Abs

from modelling.effects.first_guess import FittedMotion, Guess, if_positive
from modelling.effects.interface import Drivetrain, EquationBuilder, ShaftLaw, Symbols
from modelling.effects.kind import Kind, Parameter, SimplerEffect, State


class Hysteresis(Kind):
    """Dahl element: ż = twist_rate·(1 − sgn(twist_rate)·z/torque)·torque/angle.

    It is written with |twist_rate|, which is continuous.
    """

    kind = "hysteresis"
    words = "has hysteresis of {torque} over an angle of {angle}"
    in_recording = (
        "torque over twist is a loop that does not close up at low frequency; small oscillations see a "
        "stiffer and more damped shaft than large ones."
    )
    tables = ("shafts",)
    parameters = {"torque": Parameter("N*m", lower=0.0), "angle": Parameter("rad", lower=1e-9)}
    state = State("1", "hysteresis of {place}, as a share of its torque")
    state_dependent = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        # z/torque is the state: it stays within ±1 and has a limit at torque = 0
        z = assembly.add_state(f"{law.place}.{self.kind}", lambda z: (law.rate - Abs(law.rate) * z) / p["angle"])
        law.parallel.append(p["torque"] * z)
        law.parallel_stiffness.append(p["torque"] / p["angle"])

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        name = at.split(".")[1]
        for share in (0.1, 0.3, 1.0, 3.0):  # of the standard deviation of the twist
            angle = share * float(motion.twist[name].std())
            yield Guess(
                ({at: motion.per_segment(partial(_dahl, angle), motion.twist_rate[name])},),
                if_positive("torque", angle=angle),
            )

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterator[SimplerEffect]:
        """A spring, where the twist never reaches the angle."""
        name = f"{at}.stiffness"
        stiffer = value[name] + parameters["torque"] / parameters["angle"]
        yield SimplerEffect("wrong_parameter", name, {"value": stiffer})

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return (0.1 * guess, 10 * guess) if key == "angle" else super().fit_bounds(key, guess, step)


def _dahl(angle: float, time: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """z/torque over a twist rate (t,), exact for a rate that is constant between samples."""
    mean = (rate[1:] + rate[:-1]) / 2
    kept = np.exp(-np.abs(mean) * np.diff(time) / angle)
    added = np.sign(mean) * (1 - kept)
    return np.array(list(accumulate(zip(kept.tolist(), added.tolist()), lambda z, s: s[0] * z + s[1], initial=0.0)))
