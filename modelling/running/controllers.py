"""An exported controller on every row of a batch, with what it is asked for over time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from modelling.bed.foreign_vehicle import ForeignVehicleLaw
from modelling.bed.stepped import Law, shown_of
from modelling.controller.batch import ControllerBatch
from modelling.controller.law import (
    EMULATION,
    NO_LIMIT,
    SPEED_HOLD,
    ExportedController,
    Settings,
    nothing_watched,
)
from modelling.running.vehicles import TimedVehicle


@dataclass(frozen=True)
class Schedule:
    """What a controller is asked for; t samples, k dynamometers, b rows or one value for all. The last value stays.

    Attributes
    ----------
    mode : ndarray of int (t,)
    hold : ndarray (t, k, b)
        rad/s of the rotors in speed hold.
    added : ndarray (t, k, b)
        N·m, added to the commands.
    trigger : ndarray of int (t,)
        1 from the begin of the manoeuvre on.
    """

    mode: np.ndarray
    hold: np.ndarray
    added: np.ndarray
    trigger: np.ndarray

    @classmethod
    def held_first(cls, before: int, samples: int, hold: np.ndarray, added: np.ndarray) -> Schedule:
        """Speed hold (k, b), rad/s, for ``before`` samples, which begins with commands (k, b), N·m; then emulation."""
        mode = np.where(np.arange(samples) < before, SPEED_HOLD, EMULATION).astype(np.int32)
        at_hold = (mode == SPEED_HOLD)[:, None, None] * added[None]
        return cls(mode, np.broadcast_to(hold, (samples, *hold.shape)), at_hold, (mode == EMULATION).astype(np.int32))

    def lasting(self, samples: int) -> Schedule:
        """The same for so many samples: what is asked for last stays."""
        at = np.minimum(np.arange(samples), len(self.mode) - 1)
        return self if samples == len(self.mode) else Schedule(*(part[at] for part in vars(self).values()))


class ControllerRows:
    """The same exported controller on every row; a :class:`modelling.running.plant.Controller`.

    With rows of the product and a compiler its C sources run (:func:`modelling.running.run.run`); elsewhere the same in
    Python. Where others step the vehicle, ``vehicle`` is it: it takes its own inputs from the known torques.

    Attributes
    ----------
    fault, fault_at : ndarray of int (b,)
        What ended the emulation first, 0 where nothing did, and its sample, −1.
    shown : tuple of str (e)
        What the emulated vehicle shows, by name.
    """

    def __init__(
        self, controller: ExportedController, schedule: Schedule, count: int = 1, vehicle: TimedVehicle | None = None
    ):
        if (vehicle is None) == isinstance(controller.law, ForeignVehicleLaw):
            raise ValueError("a vehicle is needed by, and only by, a law whose vehicle is stepped outside")
        self.controller, self.schedule, self.count = controller, schedule, count
        self.sensors, self.known = tuple(controller.law.sensors), tuple(controller.law.known)
        self.shown = tuple(name for name, _, _ in shown_of(controller.law))
        self.vehicle: TimedVehicle | None = None
        self.begin()
        self.vehicle = vehicle  # begins with a run

    def begin(self) -> None:
        """Everything forgotten."""
        self.fault, self.fault_at = np.zeros(self.count, np.int32), np.full(self.count, -1, np.int64)
        self._batch = None if self.vehicle is None else ControllerBatch(self.controller, self.count)
        self._each = [] if self._batch is not None else [self.controller.running() for _ in range(self.count)]
        if self.vehicle is not None:
            law = self.controller.law
            assert isinstance(law, ForeignVehicleLaw)
            held = np.flatnonzero(self.schedule.mode == EMULATION)  # the speed of the hold as it ends
            rotors = np.broadcast_to(self.schedule.hold[held[0] if len(held) else -1], (len(law.over), self.count))
            self.vehicle.begin(rotors / law.over[:, None])

    @property
    def batch(self) -> ControllerBatch | None:
        """The controllers of a run beside vehicles of others."""
        return self._batch

    def show(self) -> np.ndarray:
        """What the emulated vehicles do (e, b), as the last sample left it; NaN of a row that emulates nothing."""
        return np.stack([one.shown() for one in self._each], axis=1) if self._each else np.zeros((0, self.count))

    def step(self, sample: int, readings: np.ndarray, known: np.ndarray) -> np.ndarray:
        """See :class:`modelling.running.plant.Controller`."""
        asked, rows = self.schedule, self.count
        at = min(sample, len(asked.mode) - 1)
        shape = len(self.controller.law.dynamometers), rows
        hold, added = np.broadcast_to(asked.hold[at], shape), np.broadcast_to(asked.added[at], shape)
        mode, trigger = int(asked.mode[at]), bool(asked.trigger[at])
        if self._batch is not None and self.vehicle is not None:
            sent, _, faults = self._batch.step(
                readings, known, mode, hold, sample, added, trigger, self.vehicle.read()
            )  # fmt: skip
            # while the speeds are held the vehicle waits at them: it was brought there before
            if mode != EMULATION:
                return sent
            told = [known[self.known.index(name)] for name in self.vehicle.vehicle.own]
            self.vehicle.go_on(self._batch.cut_torque, np.array(told).reshape(-1, rows))
            first = (faults != 0) & (self.fault_at < 0)
            self.fault[first], self.fault_at[first] = faults[first], sample
            return sent
        answers = [
            one.step(readings[:, b], known[:, b], mode, hold[:, b], sample, added[:, b], trigger)
            for b, one in enumerate(self._each)
        ]
        for b, answer in enumerate(answers):
            if mode == EMULATION and self.fault_at[b] < 0 and answer.fault:
                self.fault[b], self.fault_at[b] = answer.fault, sample
        return np.stack([answer.commands for answer in answers], axis=1)


def unsupervised(controller: ExportedController) -> ExportedController:
    """The same controller that never gives up; what has no limit is not limited by a large number either."""
    own = controller.settings
    never = np.full(len(own.torque_limit), np.inf)
    unlimited = {
        name: np.where(getattr(own, name) >= NO_LIMIT, np.inf, getattr(own, name))
        for name in ("torque_limit", "power_limit", "curve_torques")
    }  # fmt: skip
    settings = replace(
        own, torque_limit=unlimited["torque_limit"], power_limit=unlimited["power_limit"],
        curve_torques=unlimited["curve_torques"], lost_torque=never, speed_limit=never,
        unexpected=np.full(len(own.unexpected), np.inf), opened_torque=np.full(len(own.opened_torque), np.inf),
        undelivered_share=0.0, frozen_samples=0, life_samples=0, ride_samples=0,
    )  # fmt: skip
    return replace(controller, settings=settings)


def plain(law: Law, torque_readings: tuple[int, ...], speed_readings: tuple[int, ...]) -> ExportedController:
    """A law with no limit and nothing that ends it; its speed hold gives what is added, and nothing more."""
    k, y = len(law.dynamometers), len(law.sensors)
    none, nothing = np.full(k, np.inf), np.zeros(k)
    settings = Settings(
        none, none, nothing, nothing, none, np.ones(k), np.full(y, np.inf), none, np.zeros(1), np.full(1, np.inf),
        none, none, undelivered_share=0.0, frozen_samples=0,
    )  # fmt: skip
    return ExportedController(
        "", law, settings, ("",) * y, torque_readings, speed_readings, nothing_watched(y, k), (), np.zeros((k, y))
    )  # fmt: skip
