"""A stiffness, damping or drag that changes while the machine warms up."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from sympy import Expr

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import Drivetrain, EquationBuilder, Symbols
from modelling.effects.kind import Kind
from modelling.effects.warming import PARAMETERS, STATE, done_after, drift_bounds, factor, first_guesses

MOTIONS = {"drag": "speed", "stiffness": "twist", "damping": "twist_rate"}  # quantity → what it is multiplied by


class ParameterDrift(Kind):
    """The quantity at the place times 1 + change·(1 − exp(−t/time_constant)), t from the start of the recording.

    In steady motion the change has happened; modes and linear models at rest are without it.
    """

    kind = "parameter_drift"
    words = "changes by a factor of 1 + {change} with a time constant of {time_constant}"
    in_recording = "the model fits at the beginning or at the end of a recording, not at both."
    tables = ("inertias", "shafts")
    parameters = PARAMETERS
    state = STATE
    state_dependent = True
    changes_quantity = True

    def places(self, system: Drivetrain) -> list[str]:
        return [name for name in system.parameters if name.count(".") == 2 and name.rpartition(".")[2] in MOTIONS]

    def candidate_places(self, system: Drivetrain) -> list[str]:
        """Quantities that are not 0: the change is relative."""
        return [name for name in self.places(system) if system.parameters[name].value != 0]

    def quantity(self, value: Expr, p: Symbols, assembly: EquationBuilder, name: str) -> Expr:
        return value * factor(p, assembly, name)

    def state_after(self, seconds: float, parameters: Mapping[str, float]) -> float:
        return done_after(seconds, parameters["time_constant"])

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        place, signal = _torque(motion, at)
        yield from first_guesses(motion, place, signal)

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return drift_bounds(guess) if key == "time_constant" else super().fit_bounds(key, guess, step)

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterator[Guess]:
        place, signal = _torque(motion, at)
        yield from first_guesses(motion, place, signal, bent=True)


def _torque(motion: FittedMotion, at: str) -> tuple[str, np.ndarray]:
    """The component and the torque (t,) that a quantity gives it."""
    table, name, key = at.split(".")
    along = getattr(motion, MOTIONS[key])[name]
    return f"{table}.{name}", (-1.0 if table == "inertias" else 1.0) * motion.value[at] * along
