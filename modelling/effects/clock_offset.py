"""The clock of a logger that is ahead of or behind that of the others."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import Drivetrain, EquationBuilder, InputPath, SensorPath, Symbols
from modelling.effects.kind import Kind, Parameter
from modelling.effects.place import members, shared_place
from modelling.effects.recorded_range import RecordedRange

FIRST_OFFSETS = (1e-3, 4e-3, 1.6e-2, 6.4e-2)  # s, of the screening


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
        """Of several channels only: that of one is a dead time, or the delay of a sensor."""
        yield from ()

    def shared_guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        places = members(at)
        if len(places) < 2:
            return
        for early in FIRST_OFFSETS:
            addition = {}
            for place in places:
                table, name = place.split(".")
                signal = (motion.input if table == "inputs" else motion.reading)[name]
                late = -early if table == "sensors" else early
                addition[place] = motion.delayed(signal, late) - signal
            yield Guess((addition,), partial(_late, -early))

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        """Early ones only: late sensors are those of a shared delay, which is looked for as such."""
        return (-math.inf, 0.0)

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        return -recorded.longest_memory, recorded.longest_memory

    def shared_places(self, system: Drivetrain) -> list[str]:
        """The inputs together, and the sensors of each quantity: loggers divide channels so.

        That of all sensors is that of all inputs with the opposite sign.
        """
        groups: dict[str, list[str]] = {}
        for sensor in system.sensors:
            groups.setdefault(sensor.measures, []).append(f"sensors.{sensor.name}")
        several = [group for group in groups.values() if len(group) > 1] if len(groups) > 1 else []
        return [shared_place(group) for group in several]


def _late(offset: float, a: np.ndarray) -> dict[str, float] | None:
    return {"offset": offset * float(a[0])} if a[0] > 0 else None
