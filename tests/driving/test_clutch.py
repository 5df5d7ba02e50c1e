"""An input machine that acts the engine and its clutch: own car, whose clutch sticks by events, and own bed."""

from dataclasses import replace

import numpy as np
import pytest
from driving.own_clutch import CASE, EMULATION, HOLD, SIGNALS, STEP, Clutched, Driven, in_c, plant, pull_away, shifted
from needs import compiles

from matching.match.case import Drive
from matching.match.case_file import case_files, case_from_tables, load_case
from matching.match.driving import DRIVING, at_speeds, driving, vehicles_in
from matching.match.exported import exported_controller
from matching.match.imperfections import Imperfection
from matching.match.operating_range import at_speed, law_over_speed
from matching.match.shifts import with_live_clutches
from modelling.bed.clutches import carried_torques
from modelling.bed.manoeuvres import RecordedTorque
from modelling.controller.batch import ControllerBatch
from modelling.controller.law import FAULTS
from modelling.errors import InputError
from modelling.linear.steady_motion import torques_of
from modelling.toml import read_toml

pytestmark = compiles
OF_SHAFTS = [SIGNALS.index("input shaft"), SIGNALS.index("side shaft")]


def case_of(dead_time=0.003, case=CASE, speeds=None):
    """With weights that a search begins at: none was tuned on the drives of these tests."""
    data = read_toml(case)
    data["loop"]["dead_time"] = dead_time
    if speeds is not None:
        data["operating_range"]["vehicle_speed"], data["drives"] = speeds, data["drives"][:1]
    case = case_from_tables(data, str(case))
    return replace(case, loop=case.loop.with_values(case.loop.structure.starts(case.rig, case.loop)[0]))


@pytest.fixture(scope="module")
def controller():
    return exported_controller(case_of())


@pytest.fixture(scope="module")
def beds(tmp_path_factory):
    return Clutched(tmp_path_factory.mktemp("clutch"))


def test_the_capacity_is_an_input_of_the_controller_under_its_name(controller):
    law, case = controller.law, case_of()
    assert law.known == ("engine_torque", "road_left", "road_right", "clutch_torque")
    assert any("gearboxes.clutch slips and opens in the emulated vehicle" in note for note in case.notes)
    assert [part.name for part in case.vehicle.gears] == ["clutch"], "linear models have it locked"


def test_a_case_that_is_written_still_has_its_clutch(tmp_path):
    case = case_of()
    for name, text in case_files(case).items():
        (tmp_path / name).write_text(text)
    again = load_case(tmp_path / "case.toml")
    assert again.gearboxes.emulated_clutches == ("clutch_torque",)
    assert again.vehicle == replace(case.vehicle, operating_point=again.vehicle.operating_point)


def test_a_gearbox_of_two_ratios_or_beside_the_cut_stays_locked(tmp_path):
    for name in ("vehicle.toml", "rig.toml", "case.toml"):
        text = (CASE.parent / name).read_text()
        text = text.replace("ratios = [1.0]", "ratios = [1.0, 0.8]").replace(
            'capacities = ["clutch_torque"]', 'capacities = ["clutch_torque", "other_torque"]'
        )
        (tmp_path / name).write_text(text + '\n[inputs.other_torque]\non = "engine"\n' * (name == "vehicle.toml"))
    with pytest.raises(InputError, match=r"clutch_torque: is a clutch of the vehicle alone; .* one ratio"):
        load_case(tmp_path / "case.toml")
    case = case_of(case=tmp_path / "case.toml", speeds=["0 km/h", "60 km/h"])
    assert not case.gearboxes.emulated
    assert any("gearboxes.clutch is in gear 1, its clutch locked" in note for note in case.notes)


def test_a_clutch_carries_what_ends_its_slip_or_all_that_it_can():
    """Two inertias A and B over a step h: slip + h·(1/A + 1/B)·(−T) = 0, T at most the capacity."""
    A, B, h, slip = 0.15, 0.03, 5e-4, 0.7
    gain, none = np.array([[-h * (1 / A + 1 / B)]]), np.zeros(1)
    sticks = slip / (h * (1 / A + 1 / B))
    for capacity, wanted in ((1e3, sticks), (20.0, 20.0), (0.0, 0.0), (-5.0, 0.0)):
        found = carried_torques(np.array([slip]), gain, none, np.array([capacity]))
        np.testing.assert_allclose(found, wanted, rtol=1e-12)
        np.testing.assert_allclose(carried_torques(np.array([-slip]), gain, none, np.array([capacity])), -found)


def test_two_clutches_in_series_stick_together():
    """Slips of inertias in a row depend on both torques: sticking both, neither slips at the end of the step."""
    J, h, speeds = np.array([0.2, 0.01, 0.05]), 5e-4, np.array([100.0, 60.0, 20.0])
    slips = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    by_torque = -h / J[:, None] * slips.T
    torques = carried_torques(slips @ speeds, slips @ by_torque, np.zeros(2), np.full(2, 1e6))
    after = speeds + by_torque @ torques
    np.testing.assert_allclose(after, np.dot(J, speeds) / J.sum(), rtol=1e-6)


def test_the_vehicle_alone_locks_when_momentum_says(controller):
    """Engine and hub from a slip under constant torques, against finely stepped ones: when they stick, and for good."""
    vehicle = controller.law.stepped
    x = np.zeros(len(vehicle.body))
    engine, hub, into, torque, capacity = 0.15, 0.03, -40.0, 20.0, 90.0
    turned = vehicle.rates_by_own(x, np.zeros(4))[:, vehicle.inputs.index("engine_torque")] * engine
    x[np.argmax(turned)] = 300.0  # rad/s of the engine, the hub at rest
    own, carried, slips = np.array([torque, 0.0, 0.0, capacity]), np.zeros(1), []
    for _ in range(600):
        x, carried = vehicle.step_carrying(x, np.array([into, 0.0, 0.0]), own, vehicle.as_planned, 0.0, carried)
        slips.append(float(vehicle.slip[0] @ x))
    # beyond idle the engine's drag is a line: 20 N·m at 500 rad/s from 0 at 110, and 0.02 N·m·s/rad
    at, speed, other = 0.0, 300.0, 0.0
    while other < speed:
        drag = 20 * min(max((speed - 110) / 390, 0.0), 1.0) + 0.02 * speed
        speed += 1e-6 * (torque - drag - capacity) / engine
        other += 1e-6 * (capacity + into) / hub
        at += 1e-6
    found = np.argmax(np.abs(slips) < 1e-3) * STEP
    assert found == pytest.approx(at, abs=2 * STEP)
    assert np.abs(slips[round(at / STEP) + 2 :]).max() < 1e-3, "it stays locked"


SPRING = """
[inertias.flywheel]
J = 0.1

[shafts.damper]
between = ["engine", "flywheel"]
stiffness = 1500
damping = 3
"""
PULSES = """
[[effects]]
kind = "torque_ripple"
at = "inertias.engine"
order = 2
amplitude = 60
phase = 0.3
"""
OTHERS = {
    "a ratio of its own": [("ratios = [1.0]", "ratios = [1.7]")],
    "a spring before it": [
        ("[inertias.hub]", SPRING + "[inertias.hub]"), ('between = ["engine", "hub"]', 'between = ["flywheel", "hub"]'),
        ('0 or more\non = "engine"', '0 or more\non = "flywheel"'),
    ],
    "pulses": [("[gearboxes.clutch]", PULSES + "[gearboxes.clutch]")],
}  # fmt: skip


def other(folder, changes, specimen="known"):
    """The case with another vehicle."""
    for name in ("vehicle.toml", "rig.toml", "case.toml"):
        text = (CASE.parent / name).read_text()
        for old, new in changes if name == "vehicle.toml" else ():
            assert old in text
            text = text.replace(old, new)
        if name == "case.toml":
            text = text.replace("knows = []", f'knows = []\nspecimen = "{specimen}"')
        (folder / name).write_text(text)
    return case_of(case=folder / "case.toml", speeds=["20 km/h", "50 km/h"])


ALONE = "a spring before it"  # else they are long


@pytest.mark.parametrize("of", [ALONE, *(pytest.param(of, marks=pytest.mark.long) for of in OTHERS if of != ALONE)])
def test_a_closed_clutch_moves_as_a_locked_one(of, tmp_path):
    """States of the vehicle with its clutch locked, from those of the one whose clutch could slip; drawn motions."""
    law, random = law_over_speed(other(tmp_path, OTHERS[of])), np.random.default_rng(12)
    clutches, locked, live = law.slipping.clutches, law.vehicle, law.stepped
    np.testing.assert_allclose(clutches.seen @ clutches.locked, np.eye(len(locked.body)), atol=1e-9)
    x = locked.steady[2] + 0.05 * random.normal(size=len(locked.body)) * np.abs(locked.steady[2]).max()
    z, carried = clutches.locked @ x, np.zeros(1)
    for _ in range(100):
        cut, own = random.uniform(-60, 60, 3), np.r_[random.uniform(-80, 80, 3), 5000.0]
        x = locked.step(x, cut, own, locked.as_planned)
        z, carried = live.step_carrying(z, cut, own, live.as_planned, 0.0, carried)
    assert np.abs(live.slip @ z).max() < 1e-2
    np.testing.assert_allclose(clutches.seen @ z, x, atol=2e-3 * np.abs(x).max())


def test_an_unknown_specimen_may_stand_before_the_clutch(tmp_path):
    law = law_over_speed(other(tmp_path, [], "unknown"))
    assert law.known[-1] == "clutch_torque"
    assert law.slipping is not None


def test_a_capacity_that_is_missing_is_held_as_any_known_torque(controller):
    """Of another torque and of the capacity: the same mode and fault after one sample, and after many."""
    names, ended = list(controller.law.known), []
    for name in ("engine_torque", "clutch_torque"):
        batch, modes = ControllerBatch(controller, 1), []
        for n in range(900):
            known = np.full((len(names), 1), 100.0) * (np.array(names) == "clutch_torque")[:, None]
            if n == 600 or n >= 700:
                known[names.index(name)] = np.nan
            readings = np.array([0.0, 0.0, 0.0, 150.0, 30.0, 30.0])[:, None] + 1e-3 * np.sin(n)
            sent, mode, fault = batch.step(readings, known, HOLD if n < 300 else EMULATION, readings[3:], n)
            assert np.isfinite(sent).all()
            modes.append((int(mode[0]), int(fault[0])))
        ended.append(modes)
    assert ended[0] == ended[1]
    assert ended[0][-1][1] != 0


@pytest.mark.parametrize("of", ["as it is", *(pytest.param(name, marks=pytest.mark.long) for name in OTHERS)])
def test_c_and_python_let_the_clutch_slip_alike(controller, of, tmp_path):
    if of in OTHERS:
        controller = exported_controller(other(tmp_path, OTHERS[of]))
    never = np.full(len(controller.law.sensors), 1e12)
    settings = replace(controller.settings, ride_samples=0, unexpected=never, undelivered_share=0.0)
    controller = replace(controller, settings=settings)
    law, samples, random = controller.law, 1200, np.random.default_rng(8)
    running, batch, worst, slips = controller.running(), ControllerBatch(controller, 1), 0.0, []
    wheel = 30 + 10 * np.sin(2 * np.arange(samples) * 1e-3)
    readings = np.stack([
        *(30 * np.sin(np.arange(samples) / 40) + 0.3 * random.standard_normal(samples) for _ in range(3)),
        5 * wheel, wheel, wheel,
    ])  # fmt: skip
    known = np.zeros((len(law.known), samples))
    known[law.known.index("engine_torque")] = 60 * np.sin(3e-3 * np.arange(samples))
    capacity = 150 * np.cos(7e-3 * np.arange(samples))  # below 0 it is open
    known[law.known.index("clutch_torque")] = capacity
    for n in range(samples):
        mode, hold = HOLD if n < 100 else EMULATION, np.array([150.0, 30.0, 30.0])
        wanted = running.step(readings[:, n], known[:, n], mode, hold, n)
        sent, _, _ = batch.step(readings[:, n : n + 1], known[:, n : n + 1], mode, hold[:, None], n)
        worst = max(worst, float(np.abs(sent[:, 0] - wanted.commands).max()))
        if mode == EMULATION:
            slips.append(float(law.stepped.slip[0] @ running.vehicle.vehicle))
    assert law.stepped.pulses.count == (of == "pulses")
    assert worst < 1e-6
    assert np.abs(slips).max() > 5, "it slips"
    assert np.mean(np.abs(slips) < 1e-3) > 0.1, "it sticks"


def test_pulling_away_on_a_slipping_clutch_and_a_shift(controller, beds):
    """As planned, at 3 ms: input and side shafts within 1.5 % of their range in each part, no trip."""
    random = np.random.default_rng(161)
    of = plant()
    for speed, u, parts in ((0.0, *pull_away(random)), shifted(random, of)):
        run = beds.drive(controller, in_c(ControllerBatch(controller, 1)), of, speed, u, random)
        assert not run.faults.any()
        assert np.ptp(run.car[:, 6]) > 0, "it slips and sticks"
        for name, part in parts.items():
            assert run.errors(*part)[OF_SHAFTS].max() <= 0.015, name


@pytest.mark.parametrize(("hub", "stable"), [(0.03, True), (0.01, False)])
def test_a_hub_that_is_too_light_for_the_machine_is_found(hub, stable, tmp_path):
    """With 0.01 kg·m² behind the open clutch, an eighth of the rotor, own simulations of drawn beds run away."""
    for name in ("vehicle.toml", "rig.toml", "case.toml"):
        text = (CASE.parent / name).read_text()
        (tmp_path / name).write_text(text.replace("J = 0.03", f"J = {hub}") if name == "vehicle.toml" else text)
    rows = at_speeds(case_of(case=tmp_path / "case.toml", speeds=["26 km/h", "31 km/h"]), 3)
    missed = {what for row in rows for what in row.missed}
    assert ("beds that are not stable while the emulated clutch slips" not in missed) is stable
    assert "beds that are not stable" not in missed, "with the clutch locked they are"


ONE_BED = replace(DRIVING, drawn=1)


def own_shift(case, seed):
    """A shift as a drive of the case, and as the own car and bed play it."""
    random, of = np.random.default_rng([seed, 4]), plant()
    speed, u, parts = shifted(random, of)
    time, road = np.arange(len(u)) * STEP, torques_of(at_speed(case, speed).vehicle)["road_left"]
    torques = {"engine_torque": RecordedTorque.of(time, u[:, 0]), "clutch_torque": RecordedTorque.of(time, u[:, 3])}
    drive = Drive("own shift", speed, torques, case.gearboxes.begun_in(torques, "drive"))
    return (
        drive,
        parts["shift"],
        time,
        lambda beds, controller: beds.drive(
            controller, in_c(ControllerBatch(controller, 1)), of, speed, u, random, road
        ),
    )


TORQUES = {"input_torque": SIGNALS.index("input shaft"), "side_left_torque": SIGNALS.index("side shaft")}


def of_car(run, signal, first, last):
    """Less what it is as the drive begins."""
    return run.car[first:last, Driven.OF_CAR[signal]] - run.car[0, Driven.OF_CAR[signal]]


@pytest.mark.parametrize("seed", [21, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(22, 28))])
def test_the_vehicle_of_a_drive_is_the_own_car(beds, controller, seed):
    case = case_of()
    drive, (first, last), time, play = own_shift(case, seed)
    live, torques, steps = with_live_clutches(at_speed(case, drive.vehicle_speed), drive, time)
    assert steps == 0, "a clutch that sticks needs no finer ones"
    found, run = vehicles_in(live, torques, [Imperfection("")], list(TORQUES), steps), play(beds, controller)
    for column, signal in enumerate(TORQUES.values()):
        car = of_car(run, signal, first, last)
        assert np.sqrt(np.mean((found[first:last, column, 0] - car) ** 2)) <= 0.005 * np.ptp(car)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(5, 14))
def test_a_drive_is_judged_as_an_own_bed_shows_it(beds, controller, seed):
    """Its error is that of the own bed, but for what the noise of each leaves, and without a constant torque that each
    begins with."""
    case = case_of()
    drive, (first, last), _, play = own_shift(case, seed)
    found = driving(replace(case, operating_range=replace(case.operating_range, drives=(drive,))), settings=ONE_BED)
    (result,), run = found.drives, play(beds, controller)
    assert not found.not_run
    assert not result.errors.fault
    assert not run.faults.any()
    for name, signal in TORQUES.items():
        vehicle, bed, _ = (each[first:last] for each in result.traces[1][name])
        own = run.bed[first:last, signal] - run.car[first:last, Driven.OF_CAR[signal]]
        span = np.ptp(of_car(run, signal, first, last))
        assert np.std(bed - vehicle) / span == pytest.approx(np.std(own) / span, rel=0.3, abs=0.003)


def test_a_drive_names_a_clutch_that_is_closed_as_it_begins(tmp_path):
    for name in ("vehicle.toml", "rig.toml", "case.toml"):
        text = (CASE.parent / name).read_text().replace("{ to = 300, hold = 0.6 }", "{ to = 0, hold = 0.6 }")
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=r"drives\[2\]: closes 0 clutches of gearboxes\.clutch"):
        load_case(tmp_path / "case.toml")


MAP = """
[[effects]]
kind = "torque_map"
at = "inputs.engine_torque"
speed = ["800 1/min", "2000 1/min", "6000 1/min"]
pedal = [0, 0.3, 1]
torque = [[10, 60, 160], [-15, 50, 180], [-40, 20, 170]]
"""


@pytest.mark.long
def test_a_driver_has_a_pedal_and_a_clutch(tmp_path):
    """An engine by its map in place of idle speed control: opened, and closed again, by pedal and capacity."""
    for name in ("vehicle.toml", "rig.toml", "case.toml"):
        text = (CASE.parent / name).read_text()
        if name == "vehicle.toml":
            before, governor = text.split("# Idle speed control", 1)
            text = before + MAP + governor[governor.index("[gearboxes.clutch]") :]
        (tmp_path / name).write_text(text)
    data = read_toml(tmp_path / "case.toml")
    data["operating_range"]["vehicle_speed"], data["manoeuvre"]["engine_torque"]["amplitude"] = (
        ["20 km/h", "60 km/h"],
        0.3,
    )
    data["drives"] = data["drives"][1:2]
    for segment in data["drives"][0]["engine_torque"]:
        segment["to"] /= 200
    case = case_from_tables(data, str(tmp_path / "case.toml"))
    case = replace(case, loop=case.loop.with_values(case.loop.structure.starts(case.rig, case.loop)[0]))
    assert exported_controller(case).pedals == ("engine_torque",)
    (drive,) = driving(case, settings=replace(DRIVING, drawn=3)).drives
    assert drive.errors.stayed == 3
    assert drive.errors.planned <= 0.015


def drawn(dead_time, beds, seed, shifts=40, aways=12):
    """Largest errors of the shafts in every drawn shift and part of a pull-away, and what ended emulation."""
    controller, found, faults = exported_controller(case_of(dead_time)), {}, []
    for number in range(shifts):
        random = np.random.default_rng([seed, number])
        of = plant(random, dead_time)
        drives = [shifted(random, of)] + ([(0.0, *pull_away(random))] if number < aways else [])
        for speed, u, parts in drives:
            run = beds.drive(controller, in_c(ControllerBatch(controller, 1)), of, speed, u, random)
            faults += [FAULTS[fault] for fault in set(run.faults[run.faults != 0])]
            for name, part in parts.items():
                found.setdefault(name, []).append(
                    (run.errors(*part)[OF_SHAFTS].max(), run.largest(*part)[OF_SHAFTS].max())
                )
    for name, rows in found.items():
        errors, apart = np.array(rows).T
        print(f"{1e3 * dead_time:g} ms, {name}: {np.round(100 * np.quantile(errors, [0.5, 0.95, 1]), 2)} %, "
              f"{apart.max():.0f} N·m")  # fmt: skip
    return {name: np.array(rows)[:, 0] for name, rows in found.items()}, faults


@pytest.mark.long
@pytest.mark.parametrize(("dead_time", "most"), [(0.003, 0.015), (0.008, 0.03)])
def test_drawn_shifts_on_drawn_beds(beds, dead_time, most):
    errors, faults = drawn(dead_time, beds, 90210)
    assert not faults
    assert np.quantile(errors["shift"], 0.95) <= most
