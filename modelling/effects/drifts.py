"""Quantities and gains that change while the machine warms up."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np
from sympy import Expr

from modelling.effects.effect import (
    Drivetrain,
    EquationBuilder,
    FittedMotion,
    Guess,
    InputPath,
    Kind,
    Parameter,
    SensorPath,
    SimplerEffect,
    State,
    Symbols,
)

# --- How a value changes while a machine warms up or cools down: towards a final value, exponentially from the start.

PARAMETERS = {"change": Parameter("1", lower=-1.0), "time_constant": Parameter("s", lower=1e-3)}
STATE = State("1", "share of the change of {place} that has happened", from_zero=True)
FIRST_SHARE = 1.0  # time constant of the screening, of the longest recording: nearly a straight line
NEARBY_SHARES = (0.3,)  # the same of a further guess, which bends
FASTEST = 0.1  # of a guess: what has changed sooner is a value that is wrong throughout, which has kinds of its own
MOST_FALL = 0.9  # share of a value that a first guess lets fall: to first order the value at the start stays as it is


def factor(p: Symbols, assembly: EquationBuilder, name: str) -> Expr:
    """1 + change·(1 − exp(−t/time_constant)), by a state of that name: t from the start of the recording."""
    done = assembly.add_state(name, lambda z: (1 - z) / p["time_constant"])
    return 1 + p["change"] * done


def done_after(seconds: float, time_constant: float) -> float:
    """Share of the change that has happened ``seconds`` after the start of a recording."""
    return float(-np.expm1(-seconds / time_constant))


def drift_bounds(guess: float) -> tuple[float, float]:
    """Bounds of a time constant, s, in a fit that starts from a guess."""
    return FASTEST * guess, math.inf


def first_guesses(motion: FittedMotion, at: str, signal: np.ndarray, *, bent: bool = False) -> Iterator[Guess]:
    """Guesses of what a value adds at a place as it changes; ``signal`` (t,) is what it contributes itself."""
    longest = float(motion.time.max(initial=0.0))
    for share in NEARBY_SHARES if bent else (FIRST_SHARE,):
        if longest > 0:
            constant = share * longest
            yield Guess(({at: -np.expm1(-motion.time / constant) * signal},), _changed(constant))


def _changed(time_constant: float) -> Callable[[np.ndarray], dict[str, float] | None]:
    def parameters(a: np.ndarray) -> dict[str, float] | None:
        return {"change": max(float(a[0]), -MOST_FALL), "time_constant": time_constant}

    return parameters


# --- An actuator or a sensor whose gain changes while it warms up.


class GainDrift(Kind):
    """The input acts, or the sensor reads, 1 + change·(1 − exp(−t/time_constant)) times the value.

    t counts from the start of the recording. In steady motion the change has happened; linear models at rest are
    without it.
    """

    kind = "gain_drift"
    words = "has a gain that changes by a factor of 1 + {change} with a time constant of {time_constant}"
    in_recording = "amplitudes of one channel beside those of the others grow or fall from beginning to end."
    tables = ("inputs", "sensors")
    parameters = PARAMETERS
    state = STATE

    def input(self, path: InputPath | SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value *= factor(p, assembly, f"{path.place}.{self.kind}")

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        self.input(path, p, assembly)

    def state_after(self, seconds: float, parameters: Mapping[str, float]) -> float:
        return done_after(seconds, parameters["time_constant"])

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterator[SimplerEffect]:
        """A gain that is wrong throughout, where the change has happened early or never."""
        kind = "input_gain" if at.startswith("inputs.") else "sensor_gain"
        yield SimplerEffect(kind, at, {"factor": 1 + parameters["change"]})

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield from first_guesses(motion, at, motion.signal(at))

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return drift_bounds(guess) if key == "time_constant" else super().fit_bounds(key, guess, step)

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterator[Guess]:
        yield from first_guesses(motion, at, motion.signal(at), bent=True)


# --- Parameter drift

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

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterator[SimplerEffect]:
        """A quantity that is wrong throughout, where the change has happened early."""
        yield SimplerEffect("wrong_parameter", at, {"value": value[at] * (1 + parameters["change"])})

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
