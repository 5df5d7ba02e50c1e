"""Parts of a commissioning: steps that are not repeated, held torques, what a diagnosis changes in a case."""

from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock, create_autospec

import numpy as np
import pytest
from small_bed import write

from matching.bed import commission as module
from matching.bed.commission import Circle, CommissionOrder, Round, Stages
from matching.bed.identify import COVERAGE, LEAST_SHARE, bed_from_recordings, identified_case
from matching.bed.proof import Proof, plan_proof
from matching.bed.simulated_bed import (
    SETTLING_SECONDS,
    Tripped,
    Waiting,
    bed_system,
    excited_recording,
    friction_names,
    held_as_linear,
    names_in_system,
    own_times,
    proof_recording,
)
from matching.diagnosis.statistics import Estimate
from matching.match.case_file import case_files, load_case
from modelling.system import Effect, Quantity


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return load_case(write(tmp_path_factory.mktemp("case")))


def test_a_step_is_done_once_and_again_where_its_files_inputs_or_the_program_changed(tmp_path, monkeypatch):
    stages, calls = Stages(tmp_path), []

    def work():
        calls.append(1)
        return {"a.txt": "text", "b.bin": b"\x00"}, {"error": 0.5}

    assert stages.run("1_step", "same", work) == {"error": 0.5}
    assert stages.run("1_step", "same", work) == {"error": 0.5}
    assert len(calls) == 1
    assert stages.run("1_step", "other", work) == {"error": 0.5}
    assert len(calls) == 2
    (tmp_path / "1_step" / "a.txt").write_text("changed")
    stages.run("1_step", "other", work)
    assert len(calls) == 3
    assert (tmp_path / "1_step" / "a.txt").read_text() == "text"
    monkeypatch.setattr(module, "VERSION", "99")
    stages.run("1_step", "other", work)
    assert len(calls) == 4


def test_another_seed_or_another_model_is_matched_again(tmp_path, monkeypatch):
    """The text of the case file stays as it is where a model that it names changes."""
    asked = []

    def matched(case, seed, *_):
        asked.append(seed)
        return SimpleNamespace(to_dict=dict, tuned=case, status="matched", limits=())

    monkeypatch.setattr(module, "match", matched)
    monkeypatch.setattr(module, "plan_speed", lambda *_: 20.0)
    monkeypatch.setattr(module, "tuned_case", create_autospec(module.tuned_case, side_effect=Waiting("the next step")))
    path = write(tmp_path)

    def run(seed):
        Circle(tmp_path / "out", tmp_path / "bed", CommissionOrder(seed=seed, skip_channel_check=True)).run(path)
        return len(asked)

    assert [run(0), run(0), run(1), run(0)] == [1, 1, 2, 2]
    vehicle = path.with_name("vehicle.toml")
    vehicle.write_text(vehicle.read_text(encoding="utf-8").replace("stiffness = 8000", "stiffness = 8000.0001"))
    assert run(0) == 3


def test_a_bed_that_falls_short_is_diagnosed_from_its_own_recording(case, tmp_path, monkeypatch):
    """Excited as planned, recorded by hand, told apart; every step leaves its files."""
    (tmp_path / "bed").mkdir()
    found = create_autospec(
        bed_from_recordings, return_value=SimpleNamespace(files=lambda: {"a.txt": ""}, to_dict=lambda: {"named": 1})
    )
    plan = SimpleNamespace(to_dict=dict)
    monkeypatch.setattr(module, "bed_from_recordings", found)
    monkeypatch.setattr(module, "plan_excitation", create_autospec(module.plan_excitation, return_value=plan))
    monkeypatch.setattr(module, "excitation_csv", lambda plan: "time [s]")
    order = CommissionOrder(diagnosis_limit=7.0)
    monkeypatch.setattr(module, "tuned_case", lambda path: SimpleNamespace(tuned=case))
    circle = Circle(tmp_path / "out", tmp_path / "bed", order)
    circle._tuned[1] = case
    monkeypatch.setattr(circle, "_recorded", lambda case, plan, number: circle._stages.run(
        f"{number}_record", "", lambda: ({"recording.csv": "recorded"}, {})))  # fmt: skip
    assert circle._identified(2) == {"named": 1}
    assert module.plan_excitation.call_args.args == (case, order.excitation)
    (given, paths, _, limit), path = found.call_args.args, tmp_path / "out" / "2_record" / "recording.csv"
    assert (given, paths, limit) == (case, [path], 7.0)
    assert (tmp_path / "out" / "2_diagnose" / "a.txt").exists()


def test_free_play_that_the_check_shows_enters_the_first_match(case, tmp_path):
    """In rig and vehicle, whose shaft is the same; nothing is matched before."""
    (tmp_path / "bed").mkdir()
    circle = Circle(tmp_path / "out", tmp_path / "bed", CommissionOrder(rounds=1))
    seen, play = [], {"at": "shafts.side", "gap": 0.004, "misfit": 0.6}
    circle._found = lambda **of_step: seen.append(of_step)
    circle._checked = Mock(return_value={"right": True, "free_plays": [play], "measured": [], "off": []})
    circle._matched = Mock(side_effect=Waiting("the match"))
    folder = tmp_path / "case"
    folder.mkdir()
    for name, text in case_files(case).items():
        (folder / name).write_text(text, encoding="utf-8")
    with pytest.raises(Waiting):
        circle._round(folder / "case.toml", 1)
    assert seen[0]["identification"]["causes"][0]["kind"] == "backlash"
    made = load_case(circle._matched.call_args.args[0])
    for model in (made.rig, made.vehicle):
        assert set(model.free_plays) == {"shafts.side"}
        assert model.parameters[model.free_plays["shafts.side"]].value == pytest.approx(0.004)


def test_a_commissioning_that_is_killed_leaves_its_page(case, tmp_path):
    """After every stage, with what is known by then."""
    (tmp_path / "bed").mkdir()
    kept = []
    circle = Circle(tmp_path / "out", tmp_path / "bed", CommissionOrder(rounds=1), keep=kept.append)
    circle._rounds = [Round(1)]
    circle._found(match={"status": "matched", "limits": [], "structure": "observer"})
    circle._found(verification={"status": "short", "errors": [], "modes": []})
    assert [list(one.to_dict()["rounds"][0]) for one in kept] == [
        ["round", "match"],
        ["round", "match", "verification"],
    ]
    kept[0].save(tmp_path / "page")
    page = (tmp_path / "page" / "report.html").read_text(encoding="utf-8")
    assert "still running" in page
    assert "Round 1" in page


def test_a_commissioning_goes_on_at_the_step_that_tripped(case, tmp_path, monkeypatch):
    """The run is repeated while nothing came after it; what was done before is not."""
    wanted = SimpleNamespace(inputs=(), torques=np.zeros((3, 0)), step=1e-3, to_dict=dict)
    trip = Tripped(1.5, "overspeed", "rotor_speed reads 130, 125 is the limit", "time [s]")
    run = create_autospec(module.proof_recording, side_effect=trip)
    monkeypatch.setattr(module, "plan_proof", lambda *_: wanted)
    monkeypatch.setattr(module, "plan_speed", lambda *_: 10.0)
    monkeypatch.setattr(module, "proof_recording", run)
    monkeypatch.setattr(module, "exported_controller", lambda _: SimpleNamespace(law=None, running=lambda: None))
    monkeypatch.setattr(module, "FmuController", lambda *_: nullcontext())
    bed = tmp_path / "bed.fmu"
    bed.write_text("bed")
    circle = Circle(tmp_path / "out", bed, CommissionOrder())
    monkeypatch.setattr(circle, "_fmu", lambda _: nullcontext())
    circle._channels = {"right": True}
    before = Mock(return_value=({}, {"done": True}))
    for times in (1, 2):
        circle._stages.run("1_channels", "as before", before)
        found = circle._verified(case, 2)
        assert found["status"] == "unlike_model"
        assert "overspeed (rotor_speed reads 130, 125 is the limit)" in found["tripped"]
        assert run.call_count == times
    assert before.call_count == 1
    (tmp_path / "out" / "3_excite").mkdir()
    circle._verified(case, 2)
    assert run.call_count == 2


@pytest.mark.parametrize("frequency", [5.0, 30.0, 60.0])
def test_held_torques_are_recorded_as_what_they_do(frequency):
    """The spectrum of the straight line through the samples against that of the staircase, both in closed form."""
    step, count = 1e-3, 400
    angle = 2 * np.pi * frequency * step
    torque = np.cos(angle * np.arange(count))[:, None]
    samples = held_as_linear(torque)[50:-50, 0]
    phasor = np.array([np.exp(-1j * angle * n) for n in range(50, count - 50)])
    found = np.linalg.lstsq(
        np.stack([phasor.conj().real, -phasor.conj().imag], axis=1), samples, rcond=None
    )[0] @ [1, 1j]  # fmt: skip
    half = angle / 2
    straight, staircase = (np.sin(half) / half) ** 2, np.sin(half) / half * np.exp(-1j * half)
    assert abs(found * straight / staircase - 1) < 0.1 * angle**4 + 1e-12


def test_a_bed_without_emulation_has_ranges_where_the_box_has_widths(case):
    system, (dynamometer,) = bed_system(case), case.loop.dynamometers
    assert {*names_in_system(case).values(), *own_times(dynamometer).values()} == set(system.uncertain)
    turning = bed_system(case, turning=True)
    assert set(turning.uncertain) - set(system.uncertain) == set(friction_names(case).values())
    delay = system.parameters["inputs.dyno.dead_time.delay"]
    assert delay.value == pytest.approx(0.0023 - 0.0005)  # the loop's dead time counts half a sample of hold
    assert delay.upper - delay.value == pytest.approx(2 * 0.0005)
    calibrated = tuple(replace(own, torque_gain=0.97) for own in case.loop.dynamometers)
    again = bed_system(replace(case, loop=replace(case.loop, dynamometers=calibrated)))
    assert again.parameters["inputs.dyno.input_gain.factor"].value == 0.97


def test_what_was_identified_enters_rig_vehicle_loop_and_box(case):
    names = names_in_system(case)
    values = {"rig.inertias.motor.J": 0.53, "rig.inertias.rotor.J": 0.87, "loop.dead_time": 0.0021,
              "dynamometers.dyno.torque_gain": 0.97, "loop.inverter_lag": 0.0018}  # fmt: skip
    spread = {"rig.inertias.motor.J": 0.004}
    names |= {f"loop.{name}": key for name, key in own_times(case.loop.dynamometers[0]).items()}
    parameters = {names[name]: Estimate(value, spread.get(name, 1e-9)) for name, value in values.items()}
    slip = Effect("slip", "shafts.side", (("coefficient", Quantity(5000.0)),))
    friction = Effect("coulomb_friction", "inertias.rotor", (("torque", Quantity(3.0)),))
    late = Effect("sensor_delay", "sensors.motor_speed", (("delay", Quantity(0.002)),))
    extended = bed_system(case).with_effects(slip, friction, late)
    made = identified_case(case, SimpleNamespace(parameters=parameters, extended=extended, verdict="explained"))
    new = made.case
    assert new.rig.parameters["inertias.rotor.J"].value == 0.87
    assert new.rig.parameters["inertias.motor.J"].value == new.vehicle.parameters["inertias.motor.J"].value == 0.53
    assert new.loop["dead_time"] == pytest.approx(0.0026)
    assert new.loop["inverter_lag"] == 0.0018
    assert new.loop.dynamometers[0].torque_gain == 0.97
    box = {one.name: one for one in new.uncertainty.uncertain}
    assert box["rig.inertias.motor.J"].half_width == pytest.approx(COVERAGE * 0.004)
    assert box["rig.inertias.rotor.J"].half_width == pytest.approx(LEAST_SHARE * 0.87)
    assert box["dynamometers.dyno.torque_gain"].value == 1.0
    assert box["rig.shafts.side.stiffness"].half_width == pytest.approx(0.05 * 4000)  # not identified: as before
    linear = slip.law.linear
    kinds = ["all_pass"] + ["slip"] * linear
    assert [one.kind for one in new.rig.effects] == [one.kind for one in new.vehicle.effects] == kinds
    assert any("coulomb_friction" in note for note in made.notes)
    assert any("sensor_delay at sensors.motor_speed was named: the next match reads" in note for note in made.notes)


@pytest.mark.parametrize("verdict", ["explained", "unexplained"])
def test_a_value_at_the_end_of_its_range_is_taken_only_from_a_model_that_explains(case, verdict):
    names = names_in_system(case)
    held = {"rig.inertias.motor.J": "at the bound of its range", "rig.inertias.rotor.J": ""}
    parameters = {names[name]: Estimate(0.6, 1e-3, note) for name, note in held.items()}
    known = SimpleNamespace(parameters=parameters, extended=bed_system(case), verdict=verdict)
    found = identified_case(case, known).case.rig.parameters
    before = case.rig.parameters["inertias.motor.J"].value
    assert found["inertias.motor.J"].value == (0.6 if verdict == "explained" else before)
    assert found["inertias.rotor.J"].value == 0.6


def test_free_play_that_was_found_is_in_both_models_and_kept_closed_by_the_proof(case):
    """A mean torque that is larger than what moves in the shaft, by a quarter of the mean at least."""
    play = Effect("backlash", "shafts.side", (("gap", Quantity(0.003)),))
    known = SimpleNamespace(parameters={}, extended=bed_system(case).with_effects(play), verdict="explained")
    made = identified_case(case, known)
    assert made.case.rig.free_plays
    assert made.case.vehicle.free_plays
    assert any("kept closed" in note or "keeps it closed" in note for note in made.notes)
    wanted = plan_proof(replace(made.case, limits={**made.case.limits, "dynamometer_speed": 120.0}), 30.0)
    assert any("stays closed" in note for note in wanted.notes)
    motor = wanted.torques[:, wanted.inputs.index("motor_torque")]
    assert motor[0] == motor[-1] != 0  # the wave fades, the mean stays
    assert abs(motor.mean() - motor[0]) < 0.02 * abs(motor[0])


def test_an_identified_case_is_read_again_as_it_was_written(case, tmp_path):
    dynamometers = tuple(replace(own, torque_gain=0.97) for own in case.loop.dynamometers)
    box = replace(case.uncertainty, uncertain=tuple(replace(one, half_width=0.3 * one.half_width)
                                                    for one in case.uncertainty.uncertain[1:]))  # fmt: skip
    changed = replace(case, loop=replace(case.loop, dynamometers=dynamometers), uncertainty=box, tolerance=0.07)
    for name, text in case_files(changed).items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    found = load_case(tmp_path / "case.toml")
    assert found.loop.dynamometers[0].torque_gain == 0.97
    assert found.tolerance == 0.07
    widths = {one.name: one.half_width for one in found.uncertainty.uncertain}
    assert widths == pytest.approx({one.name: one.half_width for one in box.uncertain})


class StandingBed:
    """A bed whose sensors read nothing; it keeps what it is given."""

    inputs, sensors = ("dyno", "motor_torque"), ("flange_torque", "rotor_speed", "motor_speed", "side_torque")

    def __init__(self):
        self.given = []

    def begin(self, speed):
        self.speed = speed

    def readings(self):
        return np.zeros(len(self.sensors))

    def step(self, torques, span):
        self.given.append(torques)


class ListeningController:
    """Commands one N·m and keeps the known torques."""

    def __init__(self):
        self.known = []

    def step(self, readings, known, mode, hold, life, trigger=False):
        self.known.append(known)
        return SimpleNamespace(commands=np.ones(1), fault=0)


class TurningBed(StandingBed):
    """One rotor of 2 kg·m² that nothing brakes."""

    inputs, sensors = ("dyno", "motor_torque"), ("rotor_speed",)

    def readings(self):
        return np.array([self.speed])

    def step(self, torques, span):
        super().step(torques, span)
        self.speed += span * torques.sum() / 2.0


@pytest.mark.parametrize(("gains", "left"), [((40.0, 0.0), 12.0 / 40.0), ((40.0, 200.0), 0.0)])
def test_an_excitation_turns_the_bed_about_its_speed_as_the_hold_allows(case, gains, left):
    """A constant 12 N·m: a proportional hold is left 12 N·m over its gain too fast, an integral one takes it up."""
    count = round(4.0 / case.loop["sample_time"])
    torques = np.column_stack([np.zeros(count), np.full(count, 12.0)])
    bed, plan = (
        TurningBed(),
        SimpleNamespace(hold={"dyno": gains}, torques=torques, inputs=TurningBed.inputs, speed=30.0),
    )
    rows = excited_recording(bed, case, plan).splitlines()
    recorded = np.array([row.split(",") for row in rows[1:]], float)
    assert rows[0] == "time [s],dyno [N*m],motor_torque [N*m],rotor_speed [rad/s]"
    assert len(recorded) == count
    assert len(bed.given) == count + round(SETTLING_SECONDS / case.loop["sample_time"])
    assert recorded[0, 0] == 0.0
    assert recorded[0, 3] == 30.0
    assert recorded[-1, 3] == pytest.approx(30.0 + left, abs=1e-5)
    assert recorded[-1, 1] == pytest.approx(-12.0, abs=1e-3)
    np.testing.assert_allclose(recorded[5:, 2], 12.0, rtol=1e-6)


def test_a_proof_records_held_torques_as_what_they_do_and_road_torques_as_they_are_read(case):
    torques = np.array([[0.0, 0.0], [10.0, 3.0], [20.0, -4.0], [20.0, 5.0], [0.0, 0.0]])
    law = SimpleNamespace(known=("road", "motor_torque"), sensors=("flange_torque",), dynamometers=("dyno",))
    bed, controller = StandingBed(), ListeningController()
    wanted = Proof(("motor_torque", "road"), torques, 1e-3, 1.0, 2, {}, {}, (), {}, ())
    rows = proof_recording(bed, case, law, controller, wanted, 30.0).splitlines()
    recorded = np.array([row.split(",") for row in rows[1:]], float)
    assert rows[0].startswith("time [s],motor_torque [N*m],road [N*m],dyno [N*m],")
    before = len(bed.given) - len(torques)
    np.testing.assert_allclose(recorded[:, 1], held_as_linear(torques[:, :1])[:, 0], rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(recorded[:, 2], torques[:, 1])
    np.testing.assert_allclose(np.array(controller.known)[before:], recorded[:, [2, 1]], rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(np.array(bed.given)[before:, 1], torques[:, 0])
