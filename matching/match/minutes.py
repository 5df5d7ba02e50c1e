"""The exported controller with its supervision, for a minute at rest and a minute at speed, on beds that are not exact.

It may not leave emulation by itself: the stated noise of the sensors, an offset of each that drifts, a gain error of
each encoder and the tolerances of the bed are what stands there every day.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from matching.match.case import Case
from matching.match.in_time import ANGLE_OF_A_COUNT, Imperfection, hardware, perturbed_system
from matching.match.running import SAMPLES_BETWEEN_CHECKS
from modelling.bed.nonlinear import NonlinearBeds
from modelling.bed.observer import NOISE
from modelling.controller.batch import ControllerBatch
from modelling.controller.law import EMULATION, FAULTS, SPEED_HOLD, ExportedController
from modelling.linear.steady_motion import torques_of
from modelling.simulation.stepping import SimulationError

DRAWN_AT_ONCE = 500  # samples of noise (speed only)


@dataclass(frozen=True)
class MinuteSettings:
    """What the minutes are like.

    Attributes
    ----------
    seconds : float
        Of emulation, at rest and at speed: an idle phase of a test run.
    settle : float
        s of speed hold before; the first half of it brings the rotors to their speed.
    drawn : int
        Beds drawn from the case's box, in addition to the bed as planned.
    offset : float
        Uncertainties of a sensor by which it drifts over the time: a warm flange, one way or the other.
    encoder_gain : float
        Relative error of every encoder: an eccentric disc, averaged over a turn, leaves less.
    speed : float
        rad/s of the rotors in the run at speed, where no operating point states it and no limit is lower.
    speed_share : float
        Of the speed limit that the run at speed takes at most.
    pulse : float
        s, of the manoeuvre's largest torque and then of its opposite, right after emulation has begun.
    pulse_share : float
        Of that torque: it moves the bed and leaves its speed within all limits.
    """

    seconds: float = 60.0
    settle: float = 3.0
    drawn: int = 1
    offset: float = 1.0
    encoder_gain: float = 1e-3
    speed: float = 50.0
    speed_share: float = 0.3
    pulse: float = 0.5
    pulse_share: float = 0.3


@dataclass(frozen=True)
class Minute:
    """One run.

    Attributes
    ----------
    where : str
        ``at rest`` or ``at speed``, and on which bed.
    emulated : float
        s that the controller stayed in emulation.
    fault : str
        What ended it, in the words of :data:`modelling.controller.law.FAULTS`; empty where nothing did.
    drift : float
        rad/s: largest change of a rotor's speed over the run.
    """

    where: str
    emulated: float
    fault: str
    drift: float

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return dict(vars(self))


@dataclass(frozen=True)
class Minutes:
    """All runs of an exported controller; ``not_run`` is why there are none."""

    seconds: float = 0.0
    runs: tuple[Minute, ...] = ()
    not_run: str = ""

    @property
    def left(self) -> list[Minute]:
        """The runs that left emulation."""
        return [run for run in self.runs if run.fault]

    def sentences(self) -> list[str]:
        """What is said of runs that left emulation."""
        said = []
        for run in self.left:
            said.append(
                f"the exported controller leaves emulation {run.where} after {run.emulated:.3g} s of "
                f"{self.seconds:g} s ({run.fault}), with nothing but the stated noise, a drift of each sensor by its "
                "uncertainty and a gain error of each encoder"
            )
        return said

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "seconds": self.seconds, "runs": [run.to_dict() for run in self.runs], "not_run": self.not_run,
        }  # fmt: skip


@dataclass
class Sensors:
    """Readings of y sensors on b beds: gain, noise, counts of encoders, an offset that grows over the run."""

    noise: np.ndarray
    gains: np.ndarray
    drift: np.ndarray
    counting: np.ndarray
    step: float
    random: np.random.Generator
    angle: np.ndarray = field(init=False)
    last: np.ndarray | float = 0.0
    rest: np.ndarray | float = 0.0
    drawn: np.ndarray = field(default_factory=lambda: np.zeros(0))
    used: int = 0

    def __post_init__(self) -> None:
        self.angle = np.zeros(self.gains.shape)

    def read(self, true: np.ndarray, part: float) -> np.ndarray:
        """Readings (y, b) of true values (y, b) at a part of the run."""
        exact = self.gains * true
        self.angle, self.last = self.angle + self.step * (self.last + exact) / 2, exact
        rest = self.angle % ANGLE_OF_A_COUNT
        counts = np.where(self.counting, (self.rest - rest) / self.step, 0.0)
        self.rest = rest
        if self.used == len(self.drawn):
            self.drawn, self.used = self.noise * self.random.standard_normal((DRAWN_AT_ONCE, *self.gains.shape)), 0
        self.used += 1
        read: np.ndarray = exact + counts + self.drawn[self.used - 1] + part * self.drift
        return read


def minutes(
    case: Case, controller: ExportedController, seed: int = 0, settings: MinuteSettings | None = None
) -> Minutes:  # fmt: skip
    """Run an exported controller of a tuned case at rest and at speed; where it cannot be run the result says why."""
    settings = settings or MinuteSettings()
    if case.loop.torqueless:
        return Minutes(not_run="the dynamometers give no torque")
    try:
        return _run(case, controller, seed, settings)
    except SimulationError as fault:
        return Minutes(not_run=str(fault))


def minutes_of(case: Case, seconds: float, seed: int = 0) -> Minutes:
    """Export the controller of a tuned case and run it for so many seconds."""
    from matching.export import exported_controller  # which imports the match

    if case.loop.torqueless:
        return minutes_without("the dynamometers give no torque")
    return minutes(case, exported_controller(case), seed, MinuteSettings(seconds=seconds))


def minutes_without(reason: str) -> Minutes:
    """No runs, and why."""
    return Minutes(not_run=reason)


def _run(case: Case, controller: ExportedController, seed: int, settings: MinuteSettings) -> Minutes:
    loop, law, random = case.loop, controller.law, np.random.default_rng(seed)
    step, k = law.sample_time, len(law.dynamometers)
    drawn = [case.uncertainty.at(position) for position in case.uncertainty.draw(settings.drawn, seed)]
    names = ["the bed as planned", *(f"drawn bed {i}" for i in range(1, len(drawn) + 1))]
    turning = case.rig.operating_point is not None
    rows = [
        (f"{how} on {name}", values, how == "at speed")
        for name, values in zip(names, ({}, *drawn), strict=True)
        for how in (("at speed",) if turning else ("at rest", "at speed"))
    ]
    imperfect = [Imperfection("", values) for _, values, _ in rows]
    beds = NonlinearBeds(
        [perturbed_system(case.rig, one, case) for one in imperfect], loop, loop.dynamometers,
        [hardware(case, one) for one in imperfect],
    )  # fmt: skip
    sensors = sensors_on(case, law.sensors, [values for _, values, _ in rows], settings, step, random)
    batch, size = ControllerBatch(controller, len(rows)), len(rows)
    at, flanges = (
        [beds.model.sensors.index(name) for name in law.sensors],
        [at for at in controller.torque_readings if at >= 0],
    )
    about = _operating_readings(case, beds, at)
    speeds = list(controller.speed_readings)
    wanted = about[speeds][:, None] + _hold_speeds(case, settings, turning) * np.array([row[2] for row in rows])
    begun, ended = round(settings.settle / step), round((settings.settle + settings.seconds) / step)
    held = np.array([torques_of(case.rig)[dynamometer.torque_input] for dynamometer in loop.dynamometers])[:, None]
    x, pulse = beds.start, _Pulse.of(case, beds.drives, law.known, begun, step, settings, size)
    emulated, faults = np.full(size, settings.seconds), np.zeros(size, int)
    first = largest = np.zeros((k, size))
    for n in range(ended):
        now, known = pulse.at(n)
        after, _ = pulse.at(n + 1)
        true = beds.read(x, now)[at]
        true[flanges] = beds.lagged(x)
        readings = sensors.read(true, max(n - begun, 0) / (ended - begun)) + about[:, None]
        ramp = min(2.0 * n / begun, 1.0)
        hold = about[speeds][:, None] + ramp * (wanted - about[speeds][:, None]) if n <= begun else wanted
        mode = SPEED_HOLD if n < begun else EMULATION
        commands, _, fault = batch.step(readings, known, mode, hold, n)
        if n >= begun and fault.any():
            failed = (fault != 0) & (faults == 0)
            emulated[failed], faults[failed] = (n - begun) * step, fault[failed]
            if (faults != 0).all():
                break
        if n == begun:
            first = true[speeds].copy()
        if n >= begun and n % SAMPLES_BETWEEN_CHECKS == 0:
            largest = np.maximum(largest, np.where(faults == 0, np.abs(true[speeds] - first), 0.0))
            if not np.isfinite(x).all():
                raise SimulationError(
                    "simulation", f"the bed grows out of bounds at {n * step:g} s", "check its parameters"
                )
        x = beds.advance(x, commands - held, now, after)
    return Minutes(
        settings.seconds,
        tuple(
            Minute(where, float(time), FAULTS[number] if number else "", float(drift))
            for (where, _, _), time, number, drift in zip(
                rows, emulated, faults.tolist(), largest.max(axis=0), strict=True
            )
        ),
    )


def sensors_on(
    case: Case, names: Sequence[str], values: Sequence[Mapping[str, float]], settings: MinuteSettings, step: float,
    random: np.random.Generator,
) -> Sensors:  # fmt: skip
    """Sensors by name as they stand on beds with these values."""
    by_name = {sensor.name: sensor for sensor in case.rig.sensors}
    noise = np.array([by_name[name].uncertainty or NOISE[by_name[name].measures] for name in names])[:, None]
    counting = np.array([by_name[name].measures == "speed" for name in names])[:, None]
    signs = random.choice([-1.0, 1.0], (2, len(names), len(values)))
    gains = np.array([[of_bed.get(f"sensors.{name}.gain", 1.0) for of_bed in values] for name in names])
    gains = gains * np.where(counting, 1 + settings.encoder_gain * signs[0], 1.0)
    return Sensors(noise, gains, settings.offset * noise * signs[1], counting, step, random)


def _operating_readings(case: Case, beds: NonlinearBeds, at: Sequence[int]) -> np.ndarray:
    """Readings (y,) at the operating point, from which the bed counts."""
    return beds.steady[list(at), 0]


def _hold_speeds(case: Case, settings: MinuteSettings, turning: bool) -> float:
    """rad/s above the operating point in the run at speed."""
    if turning:
        return 0.0
    limit = case.limits.get("dynamometer_speed", np.inf)
    return min(settings.speed, settings.speed_share * limit)


@dataclass(frozen=True)
class _Pulse:
    """A pulse of the manoeuvre's largest torque, and its opposite, right after emulation has begun.

    ``sizes`` are torques that act (d, b), and as the controller knows them (w, b): of nothing, pulse and opposite.
    """

    sizes: tuple[tuple[np.ndarray, np.ndarray], ...]
    begun: int
    count: int

    @classmethod
    def of(
        cls, case: Case, drives: Sequence[str], known: Sequence[str], begun: int, step: float,
        settings: MinuteSettings, beds: int,
    ) -> _Pulse:  # fmt: skip
        """At the input of the rig that the manoeuvre drives hardest."""
        largest = {
            name: float(np.abs(torque.torque(torque.time())).max())
            for name, torque in case.manoeuvre.items() if name in drives
        }  # fmt: skip
        name = max(largest, key=lambda one: largest[one]) if largest else ""
        size = settings.pulse_share * largest.get(name, 0.0)
        acting = np.array([[float(one == name)] * beds for one in drives]).reshape(len(drives), beds)
        told = np.array([[float(one == name and one in case.loop.measured)] * beds for one in known])
        told = told.reshape(len(known), beds)
        sizes = tuple((height * acting, height * told) for height in (0.0, size, -size))
        return cls(sizes, begun, round(settings.pulse / step))

    def at(self, sample: int) -> tuple[np.ndarray, np.ndarray]:
        """What acts at a sample, and what the controller knows of it; the same arrays as long as nothing changes."""
        since = sample - self.begun - self.count
        return self.sizes[1 if 0 <= since < self.count else 2 if self.count <= since < 2 * self.count else 0]
