"""The check of the channels on drawn beds that nobody modelled: a wrong one is named before anything is fed back."""

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from needs import compiles
from plant.engine import compiler
from plant.hidden import Hidden
from virtual_bed.bed import Actuator, Reader, VirtualBed, drawn, drive_of
from virtual_bed.reference_circle import CASE, reference_bed

from matching.bed.channels import channel_recording, judge_channels, plan_channels
from matching.bed.simulated_bed import FmuBed
from matching.export import exported_controller
from matching.match.case_file import load_case
from modelling.controller.law import CHECK_SPEED_SHARE
from modelling.recordings.read import read_recording

pytestmark = [compiles, pytest.mark.skipif(not (find_spec("fmpy") and compiler()), reason="needs FMPy, a C compiler")]


@pytest.fixture(scope="module")
def case():
    return load_case(CASE)


@pytest.fixture(scope="module")
def controller(case):
    return exported_controller(case)


@pytest.fixture(scope="module")
def plan(case):
    return plan_channels(case)


class Exchanged(FmuBed):
    """A bed two of whose channels are exchanged."""

    pair: tuple[int, int] | None = None

    def readings(self):
        values = super().readings()
        if self.pair:
            values[list(self.pair)] = values[list(self.pair)[::-1]]
        return values


def checked(case, controller, plan, bed, folder, exchanged=None):
    """What the check says of a bed, and the largest true speed of a dynamometer, rad/s."""
    path = bed.write(folder / "bed.fmu", case.loop["sample_time"])
    driven = [dynamometer.torque_input for dynamometer in case.loop.dynamometers]
    others = [part.name for part in case.rig.inputs if part.name not in driven]
    names = [sensor.name for sensor in case.rig.sensors]
    with Exchanged(path, [*driven, *others], names) as running:
        running.pair = exchanged and tuple(map(names.index, exchanged))
        text, tripped = channel_recording(running, case, controller.law, controller.running(), plan)
    (folder / "recording.csv").write_text(text)
    recording = read_recording(folder / "recording.csv", case.rig)
    found = judge_channels(case, recording, tripped)
    exchange = dict(zip(exchanged, exchanged[::-1], strict=True)) if exchanged else {}
    speeds = [exchange.get(one.speed_sensor, one.speed_sensor) for one in case.loop.dynamometers]
    factors = [(bed.readers[name].gain or np.inf, bed.readers[name].offset) for name in speeds]
    largest = max(
        np.abs((recording[name] - offset) / gain).max() for name, (gain, offset) in zip(speeds, factors, strict=True)
    )
    return found, largest


def with_reader(bed, name, **changed):
    return replace(bed, readers={**bed.readers, name: replace(bed.readers[name], **changed)})


def with_actuator(bed, name, **changed):
    return replace(bed, actuators={**bed.actuators, name: replace(bed.actuators[name], **changed)})


@pytest.mark.parametrize(
    ("change", "named", "words"),
    [
        (lambda bed: bed, None, "every channel has the sign, unit and place"),
        (lambda bed: with_reader(bed, "motor_speed", gain=60 / (2 * np.pi)), "motor_speed", "1/min"),
        (lambda bed: with_reader(bed, "flange_left_torque", gain=-1.0), "flange_left_torque", "wrong sign"),
        (lambda bed: with_reader(bed, "rotor_right_speed", gain=-180 / np.pi), "rotor_right_speed", "deg/s"),
        (lambda bed: with_reader(bed, "side_right_torque", gain=0.0), "side_right_torque", "does not move"),
        (lambda bed: with_reader(bed, "flange_right_torque", offset=12.0), "flange_right_torque", "at rest"),
        (lambda bed: with_actuator(bed, "dyno_left", factor=-1.0), "dyno_left", "wrong sign"),
        (lambda bed: with_actuator(bed, "dyno_right", factor=0.0), "dyno_right", "not followed"),
    ],
)
def test_a_wrong_channel_is_named(case, controller, plan, tmp_path, change, named, words):
    found, largest = checked(case, controller, plan, change(reference_bed(case)), tmp_path)
    assert [one.channel for one in found.wrong] == ([] if named is None else [named])
    assert words in found.sentence()
    assert found.right == (named is None)
    assert largest < CHECK_SPEED_SHARE * case.limits["dynamometer_speed"]


def test_two_wrong_channels_are_both_named(case, controller, plan, tmp_path):
    bed = with_reader(reference_bed(case), "motor_speed", gain=-1.0)
    bed = with_reader(bed, "flange_right_torque", gain=1e-3, noise=1e-3 * bed.readers["flange_right_torque"].noise)
    found, _ = checked(case, controller, plan, bed, tmp_path)
    assert {one.channel for one in found.wrong} == {"motor_speed", "flange_right_torque"}
    assert "kN·m" in found.sentence()


def test_what_right_channels_read_is_within_its_uncertainty(case, controller, plan, tmp_path):
    """Gains of 1 (torques 1.020 and 0.985), zeros and noise as they are."""
    found, _ = checked(case, controller, plan, reference_bed(case), tmp_path)
    for own in found.channels:
        true = {"dyno_left": 1.02, "dyno_right": 0.985}.get(own.name, 1.0)
        assert abs(own.gain - true) < 3 * own.gain_uncertainty + 0.1  # the model is off by 5 % in every inertia
        if own.noise is not None:
            assert abs(own.zero) < 4 * own.zero_uncertainty
            assert own.noise == pytest.approx(reference_bed(case).readers[own.name].noise, rel=0.2)


WRONG = ("sign", "rpm", "degrees", "exchanged", "offset")


@pytest.mark.long
def test_on_forty_drawn_beds_every_wrong_channel_is_named_and_no_right_one(case, controller, plan, tmp_path):
    """Deviations to 10 %, play, friction to 3 % of the rated torque, every second with a wrong channel."""
    rng = np.random.default_rng(20261126)
    rated, names = case.limits["dynamometer_torque"], [sensor.name for sensor in case.rig.sensors]
    kinds = {sensor.name: sensor.measures for sensor in case.rig.sensors}
    missed, false, fast = [], [], []
    for n in range(40):
        drive = drawn(drive_of(CASE.parent / "rig.toml"), 0.10, rng)
        effects = (
            [Hidden("backlash", "shafts.gear_output", {"gap": rng.uniform(0.0005, 0.02)})] if rng.random() < 0.5 else []
        )
        if rng.random() < 0.5:
            torque = rng.uniform(0, 0.03) * rated / 10.05
            effects.append(Hidden("coulomb_friction", "inertias.motor", {"torque": torque}))
        readers = {sensor.name: Reader(noise=sensor.uncertainty or 0.0) for sensor in case.rig.sensors}
        actuators = {
            one.torque_input: Actuator(case.loop.command_delay() + rng.uniform(-3e-4, 5e-4), case.loop["inverter_lag"],
                                       rng.uniform(0.95, 1.05))
            for one in case.loop.dynamometers
        }  # fmt: skip
        bed = VirtualBed(drive, effects, actuators, readers, seed=n + 1)
        wrong, exchanged = WRONG[n // 2 % len(WRONG)] if n % 2 else "", None
        name = str(
            rng.choice([own for own in names if kinds[own] == "speed"] if wrong in ("rpm", "degrees") else names)
        )
        if wrong == "sign":
            bed = with_reader(bed, name, gain=-1.0)
        elif wrong in ("rpm", "degrees"):
            bed = with_reader(bed, name, gain=60 / (2 * np.pi) if wrong == "rpm" else 180 / np.pi)
        elif wrong == "offset":
            bed = with_reader(bed, name, offset=float(rng.choice([-1, 1])) * (2.0 if kinds[name] == "speed" else 20.0))
        elif wrong == "exchanged":
            alike = {frozenset((f"side_{side}_torque", f"flange_{side}_torque")) for side in ("left", "right")}
            while exchanged is None or frozenset(exchanged) in alike:
                exchanged = tuple(map(str, rng.choice(names, 2, replace=False)))
        expected = set(exchanged or ((name,) if wrong else ()))
        found, largest = checked(case, controller, plan, bed, tmp_path, exchanged)
        named = {one.channel for one in found.wrong}
        if expected - named:
            missed.append((n, wrong, expected, found.sentence()))
        if named - expected:
            false.append((n, wrong, expected, found.sentence()))
        if largest > CHECK_SPEED_SHARE * case.limits["dynamometer_speed"]:
            fast.append((n, wrong, largest))
    assert not missed
    assert not false
    assert not fast
