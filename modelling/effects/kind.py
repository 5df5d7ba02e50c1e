"""What every effect states about itself: its places, parameters, law, and what it asks of a simulation or a fit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from sympy import Expr

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import (
    Drivetrain,
    EquationBuilder,
    GearLaw,
    InputPath,
    Motion,
    SensorPath,
    ShaftLaw,
    Symbols,
)
from modelling.effects.place import members, shared_place
from modelling.effects.recorded_range import RecordedRange
from modelling.units import QUANTITY_UNITS


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect: SI unit, physical bounds.

    The units ``"sensor"``, ``"sensor/s"`` and ``"quantity"`` stand for that of the place.
    """

    unit: str
    lower: float = -math.inf
    upper: float = math.inf
    optional: bool = False


class SimplerEffect(NamedTuple):
    """An effect that behaves like one with more parameters: kind, place, and parameters in SI."""

    kind: str
    at: str
    parameters: dict[str, float]


SECOND_STATE = ".2"  # after ``place.kind``: name of the second state of an effect that has two


@dataclass(frozen=True)
class State:
    """The first-order state that an effect adds to the model, named ``place.kind``.

    Attributes
    ----------
    unit : str
        SI unit; ``"signal"`` stands for that of the input or sensor it sits at.
    meaning : str
        For the description of an FMU, with ``{place}`` in it.
    settles : bool
        Whether it has one fixed value while inputs and motion stay constant, so that a simulation may start there.
    from_zero : bool
        It is 0 when a recording begins, and follows from time alone, see :meth:`Kind.state_after`: no fit changes it.
    """

    unit: str
    meaning: str
    settles: bool = False
    from_zero: bool = False


class Kind:
    """One kind of effect. A subclass sets the class attributes and overrides the law of the tables it can sit at.

    Attributes
    ----------
    kind : str
        Its name in model files.
    words : str
        Predicate of the place in reports, parameters in braces: ``"has {gap} of free play"``.
    in_recording : str
        How it looks in a recording, in one sentence for a test engineer.
    tables : tuple of str
        Tables of the model file that it can sit at.
    parameters : dict of str to Parameter
        By key of the model file.
    state : State or None
        The state it adds to the model.
    second_state : str
        What a second one, named ``place.kind.2`` and in the unit of the first, means; empty where there is none.
    linear : bool
        A linear model holds it completely.
    state_dependent : bool
        The eigenvalues of the linearised model depend on the state: steps are chosen along the motion.
    abrupt : bool
        The torque or its derivative jumps: a fit needs finer steps.
    sticks : bool
        Dry friction between an inertia and ground, whose sign changes over the stick speed.
    shareable : bool
        Several inputs or sensors may share it: one filter on two channels, one clock for a logger.
    follows : bool
        ``at`` lists two inertias: it acts on the first as the second turns.
    changes_quantity : bool
        What acts at its place is what :meth:`quantity` makes of the quantity there.
    replaces_quantity : bool
        Its parameter ``value`` replaces the quantity at its place; it adds nothing else to the equations.
    free_play : str
        The parameter that is the total free play of a shaft in rad, if it has one.
    speed_exponent : int or None
        Its only parameter times speed to this power is the torque that resists; None where it is another law.
    only_delays : bool
        Its only parameter is a time in s by which an input acts or a sensor reads later; nothing else changes.
    zero_of_recording : bool
        A zero that may differ between recordings: a recording that is not fitted gets its own, with its start state.
    by_recording : str
        The list that has an element for every fitted recording; a recording that is not fitted gets its own.
    is_clock : bool
        Its only parameter is by how many s the clock of a logger, whose channels share it, is late.
    imposes_motion : bool
        The inertia moves as recorded: an input on it is a motion, see :meth:`imposed_input`.
    arrays : tuple of str
        Keys that files write as lists; their values are the parameters ``key_1``, ``key_2``, ….
    zero_mean : tuple of str
        Parameters that scale a torque whose mean over a turn is zero; a steady state leaves them out.
    """

    kind: ClassVar[str] = ""
    words: ClassVar[str] = ""
    in_recording: ClassVar[str] = ""
    tables: ClassVar[tuple[str, ...]] = ()
    parameters: ClassVar[dict[str, Parameter]] = {}
    state: ClassVar[State | None] = None
    second_state: ClassVar[str] = ""
    linear: ClassVar[bool] = False
    state_dependent: ClassVar[bool] = False
    abrupt: ClassVar[bool] = False
    sticks: ClassVar[bool] = False
    shareable: ClassVar[bool] = False
    follows: ClassVar[bool] = False
    changes_quantity: ClassVar[bool] = False
    replaces_quantity: ClassVar[bool] = False
    free_play: ClassVar[str] = ""
    speed_exponent: ClassVar[int | None] = None
    only_delays: ClassVar[bool] = False
    zero_of_recording: ClassVar[bool] = False
    by_recording: ClassVar[str] = ""
    is_clock: ClassVar[bool] = False
    imposes_motion: ClassVar[bool] = False
    arrays: ClassVar[tuple[str, ...]] = ()
    zero_mean: ClassVar[tuple[str, ...]] = ()

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        """Change the torque law of a shaft."""
        raise NotImplementedError

    def gear(self, law: GearLaw, p: Symbols, assembly: EquationBuilder) -> None:
        """Add a torque at the second end of a rigid gear."""
        raise NotImplementedError

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        """Add a torque on an inertia; ``name`` is the place, of a kind that ``follows`` both of its places."""
        raise NotImplementedError

    def input(self, path: InputPath, p: Symbols, assembly: EquationBuilder) -> None:
        """Change what reaches the inertia of a recorded input."""
        raise NotImplementedError

    def imposed_input(self, path: InputPath, measures: str, motion: Motion, assembly: EquationBuilder) -> None:
        """Impose the ``speed`` or ``angle`` that an input holds on the motion of the inertia it sits on."""
        raise NotImplementedError

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        """Change what a sensor reads."""
        raise NotImplementedError

    def quantity(self, value: Expr, p: Symbols, assembly: EquationBuilder, name: str) -> Expr:
        """What a quantity of this value becomes; ``name`` is that of the state."""
        raise NotImplementedError

    def state_after(self, seconds: float, parameters: Mapping[str, float]) -> float:
        """The state of a kind that begins ``from_zero``, so long after the start of a recording."""
        raise NotImplementedError

    def guesses(self, motion: FittedMotion, at: str) -> Iterable[Guess]:
        """First guesses of this effect at a place, from a motion without it; for screening and as starts of a fit."""
        raise NotImplementedError

    def shared_guesses(self, motion: FittedMotion, at: str) -> Iterable[Guess]:
        """First guesses at one place or at several that share the effect: the same amplitude at each of them."""
        for guesses in zip(*(self.guesses(motion, place) for place in members(at)), strict=True):
            additions = tuple(
                {place: signal for addition in parts for place, signal in addition.items()}
                for parts in zip(*(guess.additions for guess in guesses), strict=True)
            )
            yield Guess(additions, guesses[0].parameters, max(guess.chosen_from for guess in guesses))

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterable[Guess]:
        """Further guesses near the best one, where a fit would not move from one to the other; by default none."""
        return ()

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterable[SimplerEffect]:
        """Effects of fewer parameters that behave alike at these values; by default none.

        A fit started there may reach such an effect where it does not from a first guess. ``value`` holds the
        quantities of the system by name.
        """
        return ()

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        """Bounds of a parameter in a fit that starts from a guess, for data sampled every ``step`` s.

        By default the physical bounds.
        """
        parameter = self.parameters[key]
        if parameter.lower > 0:  # a scale: it may differ much from the guess, but not be 0
            return max(parameter.lower, guess / 20), min(parameter.upper, guess * 20)
        return parameter.lower, parameter.upper

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        """Bounds of a parameter from what a recording has shown; by default none."""
        return -math.inf, math.inf

    def bounds_in_recording(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        """:meth:`recorded_bounds` of an effect; of a shared one, those of its first place."""
        return self.recorded_bounds(key, at if self.follows else members(at)[0], recorded)

    def possible(self, parameters: Mapping[str, float]) -> bool:
        """Whether parameters within their bounds make sense together."""
        return True

    @property
    def file_keys(self) -> list[str]:
        """Keys of its parameters in model files."""
        return [*self.arrays, *(key for key in self.parameters if key.rpartition("_")[0] not in self.arrays)]

    def fault(self, at: str, values: Mapping[str, float]) -> str:
        """What is wrong with parameters (SI) of a model file that are each within their bounds; empty if nothing."""
        return ""

    def canonical(self, parameters: dict[str, float]) -> dict[str, float]:
        """The same effect with its parameters in their usual range, e.g. a phase within ±π."""
        return parameters

    def unit(self, key: str, at: str, system: Drivetrain) -> str:
        """SI unit of the parameter ``key`` of this effect at the place ``at``."""
        unit = self.parameters[key].unit
        if unit == "quantity":
            return QUANTITY_UNITS[at.rsplit(".", 1)[1]]
        if unit.startswith("sensor"):
            reading = next(sensor.unit for sensor in system.sensors if f"sensors.{sensor.name}" in members(at))
            return reading + unit.removeprefix("sensor")
        return unit

    def state_unit(self, at: str, system: Drivetrain) -> str:
        """SI unit of the state of this effect at the place ``at``.

        Raises
        ------
        AttributeError
            If this kind has no state.
        """
        assert self.state is not None
        if self.state.unit != "signal":
            return self.state.unit
        return next((sensor.unit for sensor in system.sensors if f"sensors.{sensor.name}" in members(at)), "N*m")

    def places(self, system: Drivetrain) -> list[str]:
        """Every place of a system where this kind can sit by itself."""
        return [place for place in system.places() if place.split(".")[0] in self.tables]

    def candidate_places(self, system: Drivetrain) -> list[str]:
        """Those of :meth:`places` where a diagnosis looks for it."""
        return self.places(system)

    def same_as(self, at: str, system: Drivetrain) -> Iterable[tuple[str, str]]:
        """Kinds and places that no recording can tell from this effect at a place; they are named with it."""
        return ()

    def shared_places(self, system: Drivetrain) -> list[str]:
        """Groups of sensors that may share it, as far as a diagnosis tries them: all that measure the same quantity.

        A group of all sensors is left out: whatever all of them have is the same at the inputs.
        """
        if not self.shareable or "sensors" not in self.tables:
            return []
        groups: dict[str, list[str]] = {}
        for sensor in system.sensors:
            groups.setdefault(sensor.measures, []).append(f"sensors.{sensor.name}")
        return [shared_place(group) for group in groups.values() if len(group) > 1] if len(groups) > 1 else []
