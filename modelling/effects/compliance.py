"""A further spring and inertia in series with a shaft: one more degree of freedom."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
import scipy

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import Drivetrain, EquationBuilder, ShaftLaw, Spring, Symbols
from modelling.effects.kind import Kind, Parameter, SimplerEffect


class Compliance(Kind):
    """Spring ``stiffness`` (N·m/rad) and inertia ``J`` (kg·m²) in series at the second end of the shaft."""

    kind = "compliance"
    words = "has a further spring of {stiffness} with an inertia of {J} at its second end"
    in_recording = "a further resonance; below it the shaft looks softer than stated."
    tables = ("shafts",)
    parameters = {"stiffness": Parameter("N*m/rad", lower=0.0), "J": Parameter("kg*m^2", lower=1e-12)}
    linear = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        label = f"{law.place}.{self.kind}"
        middle = assembly.add_coordinate(label)
        further = middle - law.second
        assembly.add_inertia(label, p["J"], middle)
        assembly.potential[label] = p["stiffness"] * further.angle**2 / 2
        assembly.springs[label] = Spring(p["stiffness"], further, further.angle)
        law.second = middle

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        name, second = at.split(".")[1], motion.ends[at.split(".")[1]][1]
        k, c = motion.value[f"{at}.stiffness"], motion.value[f"{at}.damping"]
        J_end = min(motion.value[f"inertias.{end}.J"] for end in motion.ends[name])
        drive = k * motion.twist[name] + c * motion.twist_rate[name]
        for ratio in (1.0, 4.0, 16.0):  # of the shaft's stiffness
            for share in (0.02, 0.1, 0.4, 1.0):  # of the smaller inertia at its ends
                k2, J = ratio * k, share * J_end
                # J·d̈ + c·ḋ + (k + k2)·d = k·twist + c·rate − J·φ̈, with d the middle angle ahead of the second end
                b, a = scipy.signal.bilinear([1.0], [J, c, k + k2], 1 / motion.step)
                d = motion.filtered(list(b), list(a), drive - J * motion.acceleration[second])
                d_rate = motion.per_segment(lambda t, s: np.gradient(s, t), d)
                d_rate2 = motion.per_segment(lambda t, s: np.gradient(s, t), d_rate)
                addition = {at: -k * d - c * d_rate, f"inertias.{second}": -J * (motion.acceleration[second] + d_rate2)}
                yield Guess((addition,), partial(_softer, k2, J))

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterator[SimplerEffect]:
        """A stiff one is a softer shaft, or a larger inertia at its second end."""
        name = f"{at}.stiffness"
        softer = 1 / (1 / value[name] + 1 / parameters["stiffness"])
        yield SimplerEffect("wrong_parameter", name, {"value": softer})
        second = next(shaft.between[1] for shaft in system.shafts if f"shafts.{shaft.name}" == at)
        name = f"inertias.{second}.J"
        yield SimplerEffect("wrong_parameter", name, {"value": value[name] + parameters["J"]})

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return (guess / 20, guess * 20)


def _softer(stiffness: float, J: float, a: np.ndarray) -> dict[str, float] | None:
    """Parameters for the amplitude a (1,) of the guessed effect: the larger, the softer the spring, the larger J."""
    return {"stiffness": stiffness / float(a[0]), "J": J * float(a[0])} if a[0] > 0.05 else None
