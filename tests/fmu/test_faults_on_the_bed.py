"""The controller's FMU holds a tip-in on the linear bed when something goes wrong: each cause, the whole way down.

Flange torques are zero in the beginning, so the linear bed's deviations are the torques themselves.
"""

from dataclasses import replace

import numpy as np
import pytest
from fmu.linear_bed import LinearBed
from fmu.slave import slave
from needs import compiles

from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from matching.match.loop import linear_bed
from modelling.controller.law import EMULATION, FAULTS, HELD_BELOW_LIMIT, NO_LIMIT, SPEED_HOLD, ZERO_TORQUE
from modelling.fmu.export import controller_fmu

pytestmark = compiles

EMULATION_FROM, TIP_IN, GOES_WRONG, SAMPLES = 100, 200, 640, 1140
SPEED, MOTOR_TORQUE, BROKEN = 20.0, 100.0, 1e-6  # rad/s, N·m, and N·m/rad of a shaft that is broken
NOTICED_WITHIN = 5  # samples


class Stand:
    """The FMU on a bed; ``wrong`` names what goes wrong at sample ``GOES_WRONG``."""

    def __init__(self, case):
        self.case, self.controller, self.parts = case, exported_controller(case), linear_bed(case)
        self.law = self.controller.law
        self.k = len(self.law.dynamometers)

    def broken(self, shaft):
        rig = self.case.rig.with_values({f"shafts.{shaft}.{what}": BROKEN for what in ("stiffness", "damping")})
        return LinearBed(linear_bed(replace(self.case, rig=rig)), self.case.loop)

    def run(self, path, wrong="", back_at=SAMPLES, **parameters):
        """Rows of readings (y), commands (k), mode and fault; the motor's torque ends at sample ``back_at``."""
        law, k = self.law, self.k
        bed, rng = LinearBed(self.parts, self.case.loop), np.random.default_rng(4)
        steady = np.concatenate([np.zeros(k), np.full(len(law.sensors) - k, SPEED)])
        n = np.arange(SAMPLES + 1)
        motor = MOTOR_TORQUE * (np.clip((n - TIP_IN) / 50, 0, 1) - np.clip((n - back_at) / 50, 0, 1))
        outputs = [*(f"{name}.command" for name in law.dynamometers), "active_mode", "fault"]
        held = {f"{name}.hold_speed": SPEED for name in law.dynamometers}
        rows, last = [], steady
        with slave(path) as one:
            one.begin(given=parameters)
            for n in range(SAMPLES):
                happened, life = n >= GOES_WRONG, n
                if n == GOES_WRONG and wrong.startswith("breaks "):
                    bed.half = self.broken(wrong.removeprefix("breaks ")).half
                readings = steady + bed.readings() + 1e-3 * rng.normal(size=len(steady))
                known = np.array([motor[n] if name == "motor_torque" else 0.0 for name in law.known])
                read = readings.copy()
                if happened and wrong == "a reading is no number":
                    read[0] = np.nan
                if happened and wrong.startswith("two readings"):
                    read[[0, self.k]] = np.nan
                if GOES_WRONG <= n < GOES_WRONG + 5 and wrong == "an encoder drops out":
                    read[self.k] = 0.0
                if happened and wrong == "an encoder is dead":
                    read[self.k] = 0.0
                if happened and wrong == "a measured torque is no number":
                    known[0] = np.inf
                if happened and wrong == "readings stand still":
                    read = last
                if happened and wrong == "the sender is gone":
                    read, life = last, GOES_WRONG - 1
                if happened and wrong == "a torque sensor jumps":
                    read[0] += 1500.0
                last = read
                mode = SPEED_HOLD if n < EMULATION_FROM else EMULATION
                one.set(dict(zip((*law.sensors, *law.known), (*read, *known), strict=True)) | held)
                one.set({"mode": float(mode if n else ZERO_TORQUE), "life": float(life)})
                one.step(law.sample_time)
                answer = one.get(outputs)
                rows.append([*readings, *answer])
                bed.step(answer[:k], motor[n : n + 1], motor[n + 1 : n + 2])
        rows = np.array(rows)
        return rows[:, : len(steady)], rows[:, -k - 2 : -2], rows[:, -2], rows[:, -1]


@pytest.fixture(scope="module", params=["case.toml", "observer.toml"])
def stand(request, reference_case):
    return Stand(load_case(reference_case.with_name(request.param)))


@pytest.fixture(scope="module")
def path(stand, tmp_path_factory):
    target = tmp_path_factory.mktemp("stand") / "controller.fmu"
    target.write_bytes(controller_fmu(stand.controller).content)
    return target


def ended(mode, fault):
    """Name of the first fault and the sample at which it ended the emulation; none before is allowed."""
    at = int(np.flatnonzero(fault)[0])
    assert set(mode[EMULATION_FROM:at]) == {float(EMULATION)}
    assert len(set(fault[at:])) == 1
    return FAULTS[int(fault[at])], at


def test_without_a_fault_the_emulation_goes_on(stand, path):
    readings, _, mode, fault = stand.run(path)
    assert set(mode[EMULATION_FROM:]) == {float(EMULATION)}
    assert not fault.any()
    assert readings[GOES_WRONG, 0] > 1.5 * stand.controller.settings.lost_torque[0]  # there is a torque to be lost


@pytest.mark.parametrize(
    ("wrong", "fault", "parameters"),
    [
        ("two readings are no numbers, of one dynamometer", "not finite", {"ride_samples": 0.0}),
        ("a measured torque is no number", "not finite", {}),
        ("readings stand still", "frozen", {}),
        ("the sender is gone", "missing", {"life_samples": 3.0, "frozen_samples": 0.0}),
    ],
)
def test_where_the_speeds_are_not_known_any_more_the_torque_is_zero(wrong, fault, parameters, stand, path):
    _, commands, mode, faults = stand.run(path, wrong, **parameters)
    name, at = ended(mode, faults)
    assert name == fault
    assert at < GOES_WRONG + NOTICED_WITHIN
    assert not commands[at:].any()
    assert set(mode[at:]) == {float(ZERO_TORQUE)}


@pytest.mark.parametrize("shaft", ["flange_left", "side_left", "gear_output"])
def test_a_shaft_that_breaks_ends_in_speed_hold(shaft, stand, path):
    """At the flange, behind the adapter, whose inertia then swings at the flange, and behind the gearbox."""
    readings, commands, mode, faults = stand.run(path, f"breaks {shaft}")
    name, at = ended(mode, faults)
    assert name == "torque gone"
    assert GOES_WRONG < at <= GOES_WRONG + NOTICED_WITHIN
    assert set(mode[at:]) == {float(SPEED_HOLD)}
    speeds = readings[:, list(stand.controller.speed_readings)]
    assert np.abs(speeds[at:, 0] - speeds[GOES_WRONG, 0]).max() < 6.0  # rad/s: the rotor without a load does not swing
    assert np.abs(speeds[at:]).max() < stand.controller.settings.speed_limit[0]
    assert np.abs(commands[at:]).max() <= stand.controller.settings.torque_limit[0]


def test_a_clutch_far_from_the_flange_is_noticed_by_an_observer_within_five_samples(stand, path):
    """The flange torque goes on for a quarter of a swing after it; without an observer it takes 20 ms."""
    readings, commands, mode, faults = stand.run(path, "breaks gear_mesh")
    name, at = ended(mode, faults)
    observed = stand.case.loop.structure.is_observer
    assert stand.controller.watched.shafts == (("gear_mesh",) if observed else ())
    assert name in (("torque gone",) if observed else ("torque gone", "unexpected"))
    assert np.abs(readings[GOES_WRONG + NOTICED_WITHIN, 0]) > 0.8 * np.abs(readings[GOES_WRONG, 0])
    assert GOES_WRONG < at <= GOES_WRONG + (NOTICED_WITHIN if observed else 40)
    assert set(mode[at:]) == {float(SPEED_HOLD)}
    assert np.abs(commands[at:]).max() <= stand.controller.settings.torque_limit[0]


def test_a_clutch_that_opens_below_the_torque_that_is_judged_is_not_taken_for_one(stand, path):
    least = {f"{shaft}.opened_torque": 200.0 for shaft in stand.controller.watched.shafts}
    _, _, mode, faults = stand.run(path, "breaks gear_mesh", **least)
    assert ended(mode, faults)[1] > GOES_WRONG + NOTICED_WITHIN


def test_python_notices_it_at_the_same_sample(stand, path):
    """The readings of the FMU's run, once more through rigmatch's own controller."""
    readings, commands, mode, faults = stand.run(path, "breaks gear_mesh")
    running, law = stand.controller.running(), stand.law
    motor = MOTOR_TORQUE * np.clip((np.arange(SAMPLES) - TIP_IN) / 50, 0, 1)
    for n, read in enumerate(readings[: GOES_WRONG + 60]):
        known = np.array([motor[n] if name == "motor_torque" else 0.0 for name in law.known])
        wanted = ZERO_TORQUE if n == 0 else SPEED_HOLD if n < EMULATION_FROM else EMULATION
        answer = running.step(read, known, wanted, np.full(stand.k, SPEED), n)
        assert (answer.mode, answer.fault) == (mode[n], faults[n])
        np.testing.assert_allclose(commands[n], answer.commands, rtol=1e-9, atol=1e-9 * 1500)


@pytest.mark.parametrize("wrong", ["a reading is no number", "a torque sensor jumps", "an encoder is dead"])
def test_a_sensor_that_is_wrong_is_ridden_through_and_named(wrong, stand, path):
    """Refused in its first sample by what the model expects; then the speeds are held by right sensors."""
    healthy, sent, _, _ = stand.run(path)
    readings, commands, mode, faults = stand.run(path, wrong)
    name, at = ended(mode, faults)
    ride = stand.controller.settings.ride_samples
    watched = stand.controller.settings.unexpected[stand.k if "encoder" in wrong else 0] < NO_LIMIT
    assert watched == (stand.case.loop.structure.is_observer or "encoder" not in wrong)
    if not watched:  # a feed-forward's model does not follow the bed
        return
    assert name == "unexpected"
    assert GOES_WRONG + ride - 2 <= at <= GOES_WRONG + ride + 2
    assert set(mode[at:]) == {float(SPEED_HOLD)}
    within = slice(GOES_WRONG, GOES_WRONG + ride - 2)
    assert np.abs(commands[within] - sent[within]).max() < 0.1 * np.abs(sent[within]).max()
    speeds = list(stand.controller.speed_readings)
    assert np.abs(readings[at:, speeds] - healthy[at, speeds]).max() < 6.0


def test_an_encoder_that_drops_out_for_five_samples_ends_nothing(stand, path):
    if not stand.case.loop.structure.is_observer:
        pytest.skip("a feed-forward's model does not follow the bed: its speeds are not watched")
    _, sent, _, _ = stand.run(path)
    _, commands, mode, faults = stand.run(path, "an encoder drops out")
    assert not faults.any()
    assert set(mode[EMULATION_FROM:]) == {float(EMULATION)}
    assert np.abs(commands - sent).max() < 0.1 * np.abs(sent).max()


def test_a_rotor_too_fast_is_held_below_its_limit(stand, path):
    """The tip-in passes the limit; who sees the fault takes the motor's torque off."""
    limit = SPEED + 2.5  # rad/s
    limits = {f"{name}.speed_limit": limit for name in stand.law.dynamometers}
    readings, _, mode, faults = stand.run(path, back_at=700, **limits)
    speeds = np.abs(readings[:, list(stand.controller.speed_readings)]).max(axis=1)
    name, at = ended(mode, faults)
    assert name == "overspeed"
    assert at == np.flatnonzero(speeds > limit)[0]
    assert set(mode[at:]) == {float(SPEED_HOLD)}
    assert speeds[-100:].max() < limit
    away = np.abs(speeds[[-200, -1]] - HELD_BELOW_LIMIT * limit)  # the hold is slow
    assert away[1] < 0.95 * away[0]


def test_commands_at_their_limit_come_back_from_it(stand, path):
    """A tip-in that asks for more than the limit; after the back-out nothing has wound up behind it."""
    limit = 300.0  # N·m
    limits = {f"{name}.torque_limit": limit for name in stand.law.dynamometers}
    _, free, *_ = stand.run(path, back_at=400)
    _, commands, mode, _ = stand.run(path, back_at=400, **limits)
    assert set(mode[EMULATION_FROM:]) == {float(EMULATION)}
    assert np.abs(free).max() > 1.3 * limit
    assert np.abs(commands).max() == limit
    assert np.sum(np.abs(commands[:, 0]) == limit) > 20
    assert np.abs(commands[-200:]).max() < np.abs(free[-200:]).max() + 0.1 * limit
    assert np.abs(commands[-200:]).max() < limit
