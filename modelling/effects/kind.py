"""What every effect says of itself: where it can sit, its parameters, its law."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

from modelling.common.units import UNITS
from modelling.effects.first_guess import Guess, Seen
from modelling.effects.interface import Drivetrain, EquationBuilder, InputPath, Motion, SensorPath, ShaftLaw, Symbols


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect: SI unit, physical bounds.

    The units ``"sensor"``, ``"sensor/s"`` and ``"quantity"`` stand for that of the place.
    """

    unit: str
    lower: float = -math.inf
    upper: float = math.inf
    optional: bool = False


class Kind:
    """One kind of effect. A subclass sets the class attributes and overrides the law of the tables it can sit at."""

    kind: ClassVar[str] = ""
    words: ClassVar[str] = ""  # what is said of the place, parameters in braces: "has {gap} of free play"
    tables: ClassVar[tuple[str, ...]] = ()
    parameters: ClassVar[dict[str, Parameter]] = {}
    abrupt: ClassVar[bool] = False  # the torque jumps within a step: a fit needs finer steps

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        """Change the torque law of a shaft."""
        raise NotImplementedError

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        """Add a torque on an inertia."""
        raise NotImplementedError

    def input(self, path: InputPath, p: Symbols, assembly: EquationBuilder) -> None:
        """Change what reaches the inertia of a recorded input."""
        raise NotImplementedError

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        """Change what a sensor reads."""
        raise NotImplementedError

    def guesses(self, seen: Seen, at: str) -> Iterable[Guess]:
        """First guesses of this effect at a place, from a motion without it; for screening and as starts of a fit."""
        raise NotImplementedError

    def nearby(self, seen: Seen, at: str, best: dict[str, float]) -> Iterable[Guess]:
        """Further guesses about the best one, where a fit would not find from one to the other; here none."""
        return ()

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterable[tuple[str, str, dict[str, float]]]:
        """Kinds with fewer parameters that this effect, with these, may pass for: kind, place, parameters; here none.

        A fit may come near such an effect from here where it does not from a first guess. ``value`` holds the
        quantities of the system.
        """
        return ()

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        """Bounds of a parameter in a fit that begins at a guess, for data sampled every ``step`` s; here the physical
        ones."""
        own = self.parameters[key]
        if own.lower > 0:  # a scale: it may be far from the guess, but not at 0
            return max(own.lower, guess / 20), min(own.upper, guess * 20)
        return own.lower, own.upper

    def canonical(self, parameters: dict[str, float]) -> dict[str, float]:
        """The same effect with its parameters as one would write them, e.g. an angle within one turn."""
        return parameters

    def unit(self, key: str, at: str, system: Drivetrain) -> str:
        """SI unit of the parameter ``key`` of this effect at the place ``at``."""
        unit = self.parameters[key].unit
        if unit == "quantity":
            return UNITS[at.rsplit(".", 1)[1]]
        if unit.startswith("sensor"):
            own = next(sensor.unit for sensor in system.sensors if f"sensors.{sensor.name}" == at)
            return own + unit.removeprefix("sensor")
        return unit

    def places(self, system: Drivetrain) -> list[str]:
        """Every place of a system where this kind can sit."""
        return [place for place in system.places() if place.split(".")[0] in self.tables]
