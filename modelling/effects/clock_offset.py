"""The clock of a logger that is ahead of or behind that of the others."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from modelling.effects.delay_guesses import (
    LONG_DELAYS,
    SHORT_DELAYS,
    Change,
    delays_near,
    first_delays,
    fixed_delays,
    late,
)
from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import Drivetrain, EquationBuilder, InputPath, SensorPath, Symbols
from modelling.effects.kind import Kind, Parameter
from modelling.effects.place import members, shared_place
from modelling.effects.recorded_late import known_offsets
from modelling.effects.recorded_range import RecordedRange

LEAST_STEPS = 0.5  # sampling steps of an offset that a further channel may share


class ClockOffset(Kind):
    """All channels of a logger are stamped ``offset`` (s) too late: they show what was that long ago.

    A sensor then reads the past; an input has acted earlier than recorded. A negative offset is a clock that is behind.
    """

    kind = "clock_offset"
    words = "is recorded with a clock that is {offset} late"
    in_recording = "all channels of one logger come by the same time too late or too early beside the others."
    tables = ("inputs", "sensors")
    parameters = {"offset": Parameter("s")}
    shareable = True
    is_clock = True

    def input(self, path: InputPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.delay -= p["offset"]

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.delay += p["offset"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        """Of one channel that shares a known offset: an input that is recorded late, or a sensor that is early.

        A sensor that is late has a delay, an input that is early a dead time; these are looked for as such.
        """
        table = at.split(".")[0]
        for offset in known_offsets(motion.value):
            if abs(offset) > LEAST_STEPS * motion.step and (offset > 0) == (table == "inputs"):
                change = late(motion, at)(-offset if table == "inputs" else offset)
                yield Guess((change,), _fixed(offset))

    def shared_guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        """Early sensors; late ones too where the group is that of all sensors; of one channel, :meth:`guesses`.

        Late sensors of one quantity are those of a shared delay, which is looked for as such.
        """
        if len(members(at)) < 2:
            yield from self.guesses(motion, at)
            return
        for early in SHORT_DELAYS:
            yield Guess((late(motion, at)(-early),), _scaled(-early))
        yield from fixed_delays(motion, _stamped_early(motion, at), "offset", LONG_DELAYS, -1.0)
        if len(members(at)) == len(motion.reading):
            yield from first_delays(motion, late(motion, at), "offset")

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterator[Guess]:
        offset = best["offset"]
        change = late(motion, at) if offset > 0 else _stamped_early(motion, at)
        return delays_near(motion, change, "offset", offset, math.copysign(1.0, offset))

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        """Early stays early, late stays late."""
        return (0.0, math.inf) if guess > 0 else (-math.inf, 0.0)

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        return -recorded.longest_memory, recorded.longest_memory

    def shared_places(self, system: Drivetrain) -> list[str]:
        """The sensors of each quantity, as loggers divide channels, and all sensors where there are several inputs.

        That of all sensors is that of all inputs with the opposite sign; of a single input it is a dead time.
        """
        groups: dict[str, list[str]] = {}
        for sensor in system.sensors:
            groups.setdefault(sensor.measures, []).append(f"sensors.{sensor.name}")
        several = [group for group in groups.values() if len(group) > 1] if len(groups) > 1 else []
        if len(list(system.inputs)) > 1 and sum(len(group) for group in groups.values()) > 1:
            several.append([place for group in groups.values() for place in group])
        return [shared_place(group) for group in several]


def _stamped_early(motion: FittedMotion, at: str) -> Change:
    """What sensors read more when their clock is early by so much."""
    change = late(motion, at)
    return lambda early: change(-early)


def _fixed(offset: float) -> Callable[[np.ndarray], dict[str, float] | None]:
    return lambda a: {"offset": offset} if a[0] > 0 else None


def _scaled(offset: float) -> Callable[[np.ndarray], dict[str, float] | None]:
    return lambda a: {"offset": offset * float(a[0])} if a[0] > 0 else None
