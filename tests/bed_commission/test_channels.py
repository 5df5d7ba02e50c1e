"""The check of the channels on drawn beds that nobody modelled: a wrong one is named before anything is fed back."""

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from needs import compiles
from plant.engine import compiler
from plant.hidden import Hidden
from virtual_bed.bed import VirtualBed
from virtual_bed.drawn_beds import WRONG, draw_bed, largest_speed
from virtual_bed.drawn_rigs import KINDS, write_rig
from virtual_bed.reference_circle import CASE, reference_bed

from matching.bed.channels import channel_recording, check_channels, judge_channels, plan_channels
from matching.bed.excite import bed_inputs
from matching.bed.lost_motion import lost_motion
from matching.bed.simulated_bed import FmuBed
from matching.match.case_file import load_case
from matching.match.exported import exported_controller
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


def checked(case, controller, plan, bed, folder):
    """What one recording of a bed says, and the largest true speed of a dynamometer, rad/s."""
    running = bed
    if isinstance(bed, VirtualBed):
        path = bed.write(folder / "bed.fmu", case.loop["sample_time"])
        running = FmuBed(path, bed_inputs(case), [sensor.name for sensor in case.rig.sensors])
    with running:
        text, tripped = channel_recording(running, case, controller.law, controller.running(), plan)
    (folder / "recording.csv").write_text(text)
    found = judge_channels(case, read_recording(folder / "recording.csv", case.rig), tripped)
    return found, largest_speed(case, bed, folder / "recording.csv")


def with_reader(bed, name, **changed):
    return replace(bed, readers={**bed.readers, name: replace(bed.readers[name], **changed)})


def with_actuator(bed, name, **changed):
    return replace(bed, actuators={**bed.actuators, name: replace(bed.actuators[name], **changed)})


@pytest.mark.parametrize(
    ("change", "named", "words"),
    [
        (lambda bed: bed, None, "every channel has the sign, unit and place"),
        pytest.param(
            lambda bed: with_reader(bed, "motor_speed", gain=60 / (2 * np.pi)),
            "motor_speed",
            "1/min",
            marks=pytest.mark.long,
        ),
        pytest.param(
            lambda bed: with_reader(bed, "flange_left_torque", gain=-1.0),
            "flange_left_torque",
            "wrong sign",
            marks=pytest.mark.long,
        ),
        pytest.param(
            lambda bed: with_reader(bed, "side_right_torque", gain=0.0),
            "side_right_torque",
            "does not move",
            marks=pytest.mark.long,
        ),
        pytest.param(
            lambda bed: with_reader(bed, "flange_right_torque", offset=12.0),
            "flange_right_torque",
            "at rest",
            marks=pytest.mark.long,
        ),
        pytest.param(
            lambda bed: with_actuator(bed, "dyno_left", factor=-1.0),
            "dyno_left",
            "wrong sign",
            marks=pytest.mark.long,  # free play is looked for next to it
        ),
        pytest.param(
            lambda bed: with_actuator(bed, "dyno_right", factor=0.0),
            "dyno_right",
            "not followed",
            marks=pytest.mark.long,
        ),
    ],
)
def test_a_wrong_channel_is_named(case, controller, plan, tmp_path, change, named, words):
    found, largest = checked(case, controller, plan, change(reference_bed(case)), tmp_path)
    assert [one.channel for one in found.wrong] == ([] if named is None else [named])
    assert words in found.sentence()
    assert found.right == (named is None)
    assert largest < CHECK_SPEED_SHARE * case.limits["dynamometer_speed"]


@pytest.mark.long
@pytest.mark.parametrize("name", ["flange_left_torque", "side_right_torque"])
def test_the_end_of_a_range_is_named_and_nothing_else(case, controller, plan, tmp_path, name):
    """An amplifier whose range ends at a drawn share of what the check needs."""
    found, _ = checked(case, controller, plan, reference_bed(case), tmp_path)
    assert found.right
    recording = read_recording(tmp_path / "recording.csv", case.rig)
    end = np.random.default_rng().uniform(0.3, 0.8) * np.abs(recording[name]).max()
    clipped = replace(recording, channels={**recording.channels, name: np.clip(recording[name], -end, end)})
    judged = judge_channels(case, clipped)
    assert [(one.channel, one.kind) for one in judged.wrong] == [(name, "clipped")]
    assert judged.wrong[0].size == pytest.approx(end)
    assert not judged.off


@pytest.mark.long
def test_two_wrong_channels_are_both_named(case, controller, plan, tmp_path):
    bed = with_reader(reference_bed(case), "motor_speed", gain=-1.0)
    bed = with_reader(bed, "flange_right_torque", gain=1e-3, noise=1e-3 * bed.readers["flange_right_torque"].noise)
    found, _ = checked(case, controller, plan, bed, tmp_path)
    assert {one.channel for one in found.wrong} == {"motor_speed", "flange_right_torque"}
    assert "kN·m" in found.sentence()


@pytest.mark.long
def test_what_right_channels_read_is_within_its_uncertainty(case, controller, plan, tmp_path):
    """Gains of 1 (torques 1.020 and 0.985), zeros and noise as they are."""
    found, _ = checked(case, controller, plan, reference_bed(case), tmp_path)
    for own in found.channels:
        true = {"dyno_left": 1.02, "dyno_right": 0.985}.get(own.name, 1.0)
        assert abs(own.gain - true) < 3 * own.gain_uncertainty + 0.1  # the model is off by 5 % in every inertia
        if own.noise is not None:
            assert abs(own.zero) < 4 * own.zero_uncertainty
            assert own.noise == pytest.approx(reference_bed(case).readers[own.name].noise, rel=0.2)


@pytest.mark.long
def test_friction_that_holds_the_bed_is_no_wrong_channel(case, controller, tmp_path):
    """Torques that do not overcome it: what they do not move is not judged, and no emulation follows."""
    bed = reference_bed(case)
    bed.effects.append(Hidden("coulomb_friction", "inertias.motor", {"torque": 4.0}))
    found, _ = checked(case, controller, plan_channels(case, 0.1), bed, tmp_path)
    assert not found.wrong
    assert not found.right
    assert "motor_speed" in found.needed
    assert "not judged: motor_speed" in found.sentence()


def test_after_a_trip_the_rest_is_not_judged(case, controller, plan, tmp_path):
    bed = with_reader(reference_bed(case), "rotor_left_speed", gain=180 / np.pi)
    found, _ = checked(case, controller, plan, bed, tmp_path)
    assert found.tripped
    assert [one.channel for one in found.wrong] == ["rotor_left_speed"]
    others = {sensor.name for sensor in case.rig.sensors} - {"rotor_left_speed"}
    assert set(found.unjudged) == others | {"dyno_left", "dyno_right", "motor_torque"}


@pytest.mark.long
@pytest.mark.parametrize(
    ("pair", "tripping"),
    [(("motor_speed", "rotor_left_speed"), True), (("flange_left_torque", "side_left_torque"), False)],
)
def test_a_second_defect_is_told_beside_exchanged_channels(case, controller, plan, tmp_path, pair, tripping):
    """Exchanged speeds end the check before it says more; torques of one shaft answer nearly alike."""
    bed = with_actuator(reference_bed(case), "dyno_right", factor=0.65)
    bed.wired = dict(zip(pair, pair[::-1], strict=True))
    path, trips = bed.write(tmp_path / "bed.fmu", case.loop["sample_time"]), []

    def record(known):
        with FmuBed(path, bed_inputs(case), [sensor.name for sensor in case.rig.sensors]) as running:
            text, tripped = channel_recording(running, case, controller.law, controller.running(), plan, known)
        trips.append(bool(tripped))
        (tmp_path / "recording.csv").write_text(text)
        return read_recording(tmp_path / "recording.csv", case.rig), tripped

    found = check_channels(case, record)
    assert trips == ([True, False] if tripping else [False])
    assert {one.channel for one in found.wrong} == {*pair, "dyno_right"}
    gain = next(one for one in found.channels if one.name == "dyno_right")
    assert abs(gain.gain - 0.65) < 3 * gain.gain_uncertainty


@pytest.mark.long
@pytest.mark.parametrize("gap", [0.0, 0.006])
def test_the_check_shows_free_play(case, controller, plan, tmp_path, gap):
    """Friction that is there as well is none, and hides none."""
    bed = reference_bed(case)
    bed.effects.append(Hidden("coulomb_friction", "inertias.motor", {"torque": 1.5}))
    bed.effects += [Hidden("backlash", "shafts.gear_output", {"gap": gap})] if gap else []
    found, _ = checked(case, controller, plan, bed, tmp_path)
    seen = lost_motion(case, read_recording(tmp_path / "recording.csv", case.rig))
    assert found.right
    if gap:
        assert [one.at for one in (seen, *found.free_plays)] == ["shafts.gear_output"] * 2
        assert seen.gap == pytest.approx(gap, rel=0.1)
    else:
        assert seen is None
        assert not found.free_plays


@pytest.mark.long
@pytest.mark.parametrize("kind", ["reference", *KINDS])
def test_on_drawn_beds_every_wrong_channel_is_named_and_no_right_one(kind, tmp_path):
    """Rigs of six kinds, all numbers drawn; beds off by up to 10 %, with play and friction; every second is wrong.

    Where friction holds a part of the bed, its channel cannot be judged: then nothing is fed back. One of five at most.
    """
    missed, held, false, fast = [], [], [], []
    for n in range(10):
        rng = np.random.default_rng([71177, n, len(kind)])
        path = CASE if kind == "reference" else write_rig(kind, rng, tmp_path / str(n))
        case = load_case(path)
        wrong = WRONG[n // 2 % len(WRONG)] if n % 2 else ""
        bed = draw_bed(path, rng, wrong, n + 1)
        found, largest = checked(case, exported_controller(case), plan_channels(case), bed.bed, tmp_path)
        named = {one.channel for one in found.wrong}
        if not named >= bed.expected and tuple(sorted(bed.expected)) not in map(tuple, map(sorted, found.alike)):
            unjudged = bed.expected <= {*found.unjudged} and not found.right
            (held if unjudged else missed).append((n, wrong, bed.expected, found.sentence()))
        if named - bed.expected or not (wrong or found.right):
            false.append((n, wrong, bed.expected, found.sentence()))
        if largest > CHECK_SPEED_SHARE * case.limits["dynamometer_speed"]:
            fast.append((n, wrong, largest))
    assert not missed
    assert len(held) <= 1
    assert not false
    assert not fast


@pytest.mark.long
@pytest.mark.parametrize(
    ("reader", "changed"), [("flange_left_torque", {"gain": -1.0}), ("motor_speed", {"offset": 2.0})]
)
def test_free_play_is_told_next_to_a_wrong_channel(case, controller, plan, tmp_path, reader, changed):
    """The channel ends the check; the recording with the channel mended shows the play all the same."""
    bed = with_reader(reference_bed(case), reader, **changed)
    bed.effects.append(Hidden("backlash", "shafts.gear_output", {"gap": 0.006}))
    found, _ = checked(case, controller, plan, bed, tmp_path)
    assert {one.channel for one in found.wrong} == {reader}
    (seen,) = found.free_plays
    assert seen.at == "shafts.gear_output"
    assert seen.gap == pytest.approx(0.006, rel=0.1)


@pytest.mark.long
def test_a_late_side_is_told_next_to_free_play(case, controller, plan, tmp_path):
    """No linear fit explains a bed with play. With the play in the model, or by the kinks of its rotor's speed, the
    dead time is measured all the same."""
    bed = reference_bed(case)
    bed.effects.append(Hidden("backlash", "shafts.gear_output", {"gap": 0.006}))
    bed.actuators["dyno_right"].delay += 3e-3
    found, _ = checked(case, controller, plan, bed, tmp_path)
    assert found.right
    assert [one.at for one in found.free_plays] == ["shafts.gear_output"]
    (late,) = found.off
    assert late.name == "dynamometers.right.dead_time"
    true = bed.actuators["dyno_right"].delay + case.loop["dead_time"] - case.loop.command_delay()
    assert abs(late.value - true) < 3 * late.uncertainty
