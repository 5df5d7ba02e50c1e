"""The law of a range for a vehicle that others simulate: torques go to it at each cut, wheel speeds come back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from modelling.bed.observer import FORGETTING_PER_SAMPLE
from modelling.bed.stepped import SteppedLaw, SteppedSettings, load_filter, with_loads

# --- The law.
#
# The observer holds a linear design vehicle, which may be coarse. What the foreign vehicle does beyond it acts on the
# design vehicle as two loads that wander, one at the wheel of each cut and one at each body; both follow from the
# wheel speeds that the foreign vehicle gives. The bed's readings do not correct the design vehicle: what they say of
# the torque at the cut goes into both vehicles as momentum, so the bed and the foreign vehicle have had the same.
# No linearisation of the foreign vehicle is needed, no second instance of it, and no step back in time.


@dataclass(frozen=True)
class VehicleTiming:
    """When a foreign vehicle steps and answers, in samples of the controller.

    Attributes
    ----------
    steps : int
        Samples in one step of the vehicle, 1 or more. It takes the mean torque of so many samples.
    late : int
        Samples between the moment to which a wheel speed belongs and the one in which the controller reads it. 0: the
        vehicle steps between two samples, and its answer is there at the next one.
    """

    steps: int = 1
    late: int = 0


@dataclass(frozen=True)
class RunIn:
    """How a foreign vehicle is brought to the rotors' speeds while these are held; k cuts.

    Its states cannot be set from outside, so torques at its cuts drive it there.

    Attributes
    ----------
    proportional, integral : ndarray (k,)
        N·m·s/rad and N·m/rad: torque at a cut for a wheel that is slower than its rotor.
    largest : ndarray (k,)
        N·m.
    """

    proportional: np.ndarray
    integral: np.ndarray
    largest: np.ndarray


RUN_IN_STEPS = 3.0  # steps of the vehicle in which a lone wheel follows its rotor: no wheel rings


@dataclass(frozen=True)
class Followed:
    """What the law keeps while a foreign vehicle is emulated, of one bed; k cuts, q loads.

    Attributes
    ----------
    state : ndarray (x,)
        Of the linear law, in deviations from where it was switched on.
    load : ndarray (q,)
        N·m: of the wheels, then of the bodies.
    angle : ndarray (k,)
        rad by which each rotor is ahead of its wheel, forgotten as the wheel rolls.
    expected : ndarray (late + 1, k)
        Wheel speeds (deviations, rad/s) that were expected, the oldest first, corrected by what came since.
    torques : ndarray (steps, k)
        Torques at the cuts, N·m, absolute, of the last samples; the newest first.
    wheel : ndarray (k,)
        rad/s, as they were read last.
    since : int
        Samples since wheel speeds were used.
    """

    state: np.ndarray
    load: np.ndarray
    angle: np.ndarray
    expected: np.ndarray
    torques: np.ndarray
    wheel: np.ndarray
    since: int = 0

    @property
    def cut_torque(self) -> np.ndarray:
        """Torques (k,), N·m, for the vehicle's next step: the mean over one of its steps."""
        mean: np.ndarray = self.torques.mean(axis=0)
        return mean


@dataclass(frozen=True, kw_only=True)
class ForeignVehicleLaw(SteppedLaw):
    """Designs over speed as one law for a vehicle that is stepped outside; shapes as in :class:`SteppedLaw`, q loads.

    ``vehicle`` is the design vehicle; it is not stepped. ``by_wheel`` is the correction by wheel speeds that are read
    without a delay, as :meth:`frozen` needs it.

    Attributes
    ----------
    timing : VehicleTiming
    load_rates : ndarray (v, q)
        Rates of the design vehicle for each load.
    by_late_wheel : ndarray (d, v + q, k)
        Correction of the design vehicle and of the loads by wheel speeds that are late.
    catches : ndarray (d, late · k, k)
        The same of the speeds that are expected of the samples since, the oldest first.
    by_own : ndarray (d, v, r)
        Rates of the design vehicle for inputs of its own that act as it moves (brakes, pedals), 0 of plain torques.
    run_in : RunIn
    """

    timing: VehicleTiming
    load_rates: np.ndarray
    by_late_wheel: np.ndarray
    catches: np.ndarray
    by_own: np.ndarray
    run_in: RunIn

    @property
    def steps_vehicle(self) -> bool:
        """The vehicle is stepped outside."""
        return False

    @property
    def by_load(self) -> np.ndarray:
        """Rates (v, q) of the design vehicle for each of the loads that are estimated."""
        return self.load_rates

    @property
    def load_stays(self) -> float:
        """Share of a load that stays from sample to sample where nothing corrects it."""
        return 1 - FORGETTING_PER_SAMPLE

    @property
    def lowest_speed(self) -> float:
        """rad/s of the vehicle: below it what acts as the vehicle moves falls off in proportion, 0: nowhere."""
        return max(float(self.designed[0]), 0.0)

    def started(self, readings: np.ndarray) -> np.ndarray:
        """Wheel speeds (k,), rad/s, at which an emulation begins: those of the rotors, absolute readings (y,)."""
        wheel: np.ndarray = readings[list(self.speed_readings)] / self.over
        return wheel

    def started_speed(self, readings: np.ndarray) -> float:
        """Speed of the design vehicle's bodies there, rad/s."""
        return float(self.steady_vehicle(readings) @ self.vehicle.body)

    def start_following(self, readings: np.ndarray, sent: np.ndarray, held: np.ndarray, wheel: np.ndarray) -> Followed:
        """Where an emulation begins.

        Parameters
        ----------
        readings, sent : ndarray (y,), (k,)
            Absolute readings and commands, N·m.
        held : ndarray (k,)
            N·m, with which the vehicle was held at the rotors' speeds.
        wheel : ndarray (k,)
            rad/s that the vehicle has.
        """
        k, timing = len(self.dynamometers), self.timing
        cut = self.cut_torque_read(readings, sent)
        load = np.zeros(self.load_rates.shape[1])
        load[:k] = cut - held  # it needs that torque to stay at its speed, and gets another one from now on
        return Followed(
            np.zeros(self.states), load, np.zeros(k), np.zeros((timing.late + 1, k)), np.tile(held, (timing.steps, 1)),
            wheel.copy(), 0,
        )  # fmt: skip

    def follow(
        self, now: Followed, start: tuple[np.ndarray, np.ndarray, float], readings: np.ndarray, known: np.ndarray,
        wheel: np.ndarray, limits: tuple[np.ndarray, np.ndarray], turned: np.ndarray, added: np.ndarray | float = 0.0,
    ) -> tuple[np.ndarray, Followed]:  # fmt: skip
        """Commands (k,), N·m, less those of the begin, and what is kept for the next sample.

        Parameters
        ----------
        now : Followed
        start : (ndarray (k,), ndarray (k,), float)
            Wheel speeds and torques at the cuts when the emulation began, and the speed of the bodies then.
        readings, known : ndarray (y,), (w,)
            Less those of the begin.
        wheel : ndarray (k,)
            rad/s, absolute, as the vehicle gives them now.
        limits : (ndarray (k,), ndarray (k,))
            Of the commands, less those of the begin.
        turned : ndarray (k,)
            rad/s: each rotor's speed as it is read, absolute.
        """
        wheel_start, cut_start, body_start = start
        settings, h, v, k = self.settings, self.sample_time, self.vehicle_states, len(wheel)
        r, timing = len(self.vehicle.inputs), self.timing
        body = body_start + float(self.vehicle.body @ now.state[self.observed])
        made = self.at(body)
        angle = (now.angle + h * (turned / self.over - wheel)) / (1 + h * np.abs(wheel) / settings.angle_roll)
        # wheel and body of a steady vehicle are not told apart by wheel speeds: what is not corrected is forgotten
        state, load, since = now.state, self.load_stays * now.load, now.since + 1
        expected = np.vstack([now.expected[1:], self.vehicle.wheel @ state[self.observed]])
        innovation = readings - self.E @ state
        corrected = state + made["L"] @ innovation
        if since >= timing.steps or (wheel != now.wheel).any():
            off = wheel - angle / settings.angle_time - wheel_start - expected[0]
            found = made["by_late_wheel"] @ off
            corrected[self.observed] += found[:v]
            load = load + found[v:]
            expected[1:] += (made["catches"] @ off).reshape(-1, k)
            since = 0
        share = float(np.clip(body / self.lowest_speed, -1.0, 1.0)) if self.lowest_speed else 1.0
        own = known[len(known) - r :] * self.vehicle.nonlinear
        acting = np.concatenate([known, self.load_rates @ load + share * (made["by_own"] @ own)])
        sent = np.clip(made["K"] @ corrected + made["Dw"] @ acting + added, *limits)
        state = made["A"] @ corrected + made["Bw"] @ acting + made["Bs"] @ sent
        torque = cut_start + self.cut_torque @ (corrected + state) / 2 + self.momentum @ innovation / h
        torques = np.vstack([torque, now.torques[:-1]])
        return sent, Followed(state, load, angle, expected, torques, wheel.copy(), since)

    @property
    def _over_speed(self) -> dict[str, np.ndarray]:
        more = {name: getattr(self, name) for name in ("by_late_wheel", "catches", "by_own")}
        return {**super()._over_speed, **more}


def run_in_gains(
    inertia: np.ndarray, whole: np.ndarray, largest: np.ndarray, timing: VehicleTiming, sample_time: float
) -> RunIn:
    """Gains that bring a vehicle to the rotors' speeds, critically damped as one inertia.

    Parameters
    ----------
    inertia, whole : ndarray (k,)
        kg·m²: of the wheel at each cut, and of what of the vehicle turns with it.
    largest : ndarray (k,)
        N·m.
    sample_time : float
        s.
    """
    proportional = inertia / (RUN_IN_STEPS * (timing.steps + timing.late) * sample_time)
    return RunIn(proportional, proportional**2 / (4 * whole), largest)


def foreign_vehicle_law(law: SteppedLaw, timing: VehicleTiming, run_in: RunIn) -> ForeignVehicleLaw:
    """The same designs, which hold the design vehicle, for a vehicle that is stepped outside."""
    vehicle, w = law.vehicle, len(law.known)
    load_rates = np.hstack([vehicle.by_cut, vehicle.by_body])
    kept: list[tuple[np.ndarray, ...]] = []
    for one, speed in zip(law.laws, law.designed, strict=True):
        on, of_loads = one.A[law.observed, law.observed], one.Bw[law.observed, w:] @ load_rates
        filters = _filters(on, of_loads, vehicle.wheel, law.sample_time, timing, law.settings)
        kept.append((*filters, vehicle.by_own(*vehicle.steady_at(float(speed), law.speeds))))
    prompt, late, catches, own = (np.stack(each) for each in zip(*kept, strict=True))
    given = {name: getattr(law, name) for name in SteppedLaw.__dataclass_fields__ if name != "by_wheel"}
    return ForeignVehicleLaw(
        **given, by_wheel=prompt, timing=timing, load_rates=load_rates, by_late_wheel=late,
        catches=catches, by_own=own, run_in=run_in,
    )  # fmt: skip


def _filters(
    on: np.ndarray, of_loads: np.ndarray, wheel: np.ndarray, step: float, timing: VehicleTiming,
    settings: SteppedSettings,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Gains by wheel speeds without delay (v + q, k), with it (v + q, k), and on what is expected since (late · k, k).

    Parameters
    ----------
    on, of_loads : ndarray (v, v), (v, q)
        The design vehicle and what loads do to it, from sample to sample.
    """
    gain = load_filter(on, of_loads, wheel, step, settings, timing.steps)
    one, C = with_loads(on, of_loads), np.hstack([wheel, np.zeros((len(wheel), of_loads.shape[1]))])
    after = [np.linalg.matrix_power(one, number) @ gain for number in range(timing.late + 1)]
    catches = np.vstack([C @ each for each in after[1:]]) if timing.late else np.zeros((0, len(wheel)))
    return gain, after[-1], catches
