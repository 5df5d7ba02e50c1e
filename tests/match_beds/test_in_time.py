"""The controller in time on beds that are not the model, against the truth plant, which shares no code with it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from match_beds.plant_loop import bed_run, plant_model, vehicle_run
from plant.marks import needs_compiler

from matching.match import imperfections as imperfect
from matching.match.box import of_system
from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from matching.match.free_play import FreePlay, lash_runs, lashes, open_lash
from matching.match.imperfections import (
    ANGLE_OF_A_COUNT,
    EVERYTHING_DRAWN,
    EVERYTHING_STATED,
    BedMotion,
    BedRun,
    Imperfection,
    acting,
    bed_motions,
    imperfections,
    perturbed_system,
    required_parameters,
    vehicle_motions,
)
from matching.match.in_time import errors_in_time, simulate_deviations, standstill
from matching.match.loop import control_law, linear_bed
from matching.match.match import match
from matching.match.requirements import DEFAULT_LIMITS
from modelling.bed.nonlinear import _refine_friction
from modelling.effects import EFFECTS
from modelling.equations.casadi_code import compiled
from modelling.equations.lagrange import STICK_SPEED
from modelling.running.controllers import unsupervised
from modelling.simulation.stepping import STABLE_STEP
from modelling.system import Effect, OperatingPoint, Quantity

SENSORS = ("motor_speed", "side_torque")
GAINS = ("dynamometers.", "sensors.")
WRONG = {
    "values": Imperfection("", {
        "rig.shafts.side.stiffness": 3800.0, "rig.inertias.motor.J": 0.52, "loop.dead_time": 0.00277,
        "dynamometers.dyno.torque_gain": 1.03,
    }, demand_factor=1.05, demand_late=5e-3),
    "lash": Imperfection("", gap=0.02),
    "friction": Imperfection("", friction=3.0),
    "everything": Imperfection("", {
        "rig.shafts.side.stiffness": 3800.0, "rig.inertias.motor.J": 0.525, "loop.dead_time": 0.0028,
    }, 0.02, 3.0, 1.05, 5e-3),
}  # fmt: skip


@pytest.fixture(scope="module")
def law(small_case):
    return control_law(linear_bed(small_case))


@pytest.fixture(scope="module")
def controller(small_case):
    """As it is exported, but for its supervision."""
    return unsupervised(exported_controller(small_case))


def pulse(case, count=800):
    time = np.arange(count) * case.loop["sample_time"]
    return {"motor_torque": np.interp(time, [0.05, 0.1, 0.4, 0.45], [0.0, 60.0, 60.0, -20.0])}


def on_plant(case, law, run):
    """The same run on the truth plant: vehicle and bed, (t, y)."""
    wrong, torques = run.imperfection, acting(case, run)
    both = {"gap": wrong.gap, "lashed": ("side",), "friction": wrong.friction, "rubbing": ("motor",)}
    shared = of_system(wrong.values, case.vehicle)
    vehicle = vehicle_run(plant_model(case.vehicle, shared, **both), torques, law.sample_time, SENSORS)
    told = {name: own for name, own in run.torques.items() if name in run.known}
    bed = bed_run(
        plant_model(case.rig, of_system(wrong.values, case.rig), **both), law, case.loop, torques, told, SENSORS,
        dead_time=wrong.values.get("loop.dead_time", case.loop["dead_time"]),
        gains=np.array([wrong.values.get("dynamometers.dyno.torque_gain", 1.0)]),
    )  # fmt: skip
    return vehicle, bed


@needs_compiler
@pytest.mark.parametrize("wrong", list(WRONG))
def test_vehicle_and_bed_move_as_on_the_truth_plant(small_case, law, controller, wrong):
    run = BedRun(WRONG[wrong], pulse(small_case), ("motor_torque",) if wrong == "values" else ())
    vehicle = vehicle_motions(small_case, [run], SENSORS)[0]
    bed = bed_motions(small_case, controller, [run], SENSORS)[0].readings
    wanted_vehicle, wanted_bed = on_plant(small_case, law, run)
    span = np.ptp(wanted_vehicle, axis=0)
    assert np.abs(vehicle - wanted_vehicle).max(axis=0) == pytest.approx(0, abs=4e-3 * span.max())
    for found, wanted in ((vehicle, wanted_vehicle), (bed, wanted_bed)):
        assert (np.sqrt(np.mean((found - wanted) ** 2, axis=0)) < 2e-3 * span).all()


@pytest.fixture(scope="module")
def table(small_case, controller):
    return errors_in_time(small_case, controller, pulse(small_case, 600))


def test_the_table_has_every_row(table):
    assert [row.words for row in table.rows][:2] == ["nothing", "shafts at the cut 5 % softer"]
    assert [row.words for row in table.rows][-2:] == [EVERYTHING_STATED, EVERYTHING_DRAWN]
    assert table.rows[0].measured["side_torque"] < 0.005  # the sampled controller on its own model
    assert table.rows[0].largest() < table.rows[-1].largest() < 0.3
    assert set(table.traces.vehicle) == set(SENSORS)


def test_a_bed_that_runs_away_is_not_stable_and_one_at_its_torque_limit_is_far_off(small_case, controller):
    runs, wrong = [BedRun(Imperfection(""), pulse(small_case, 600))], replace(controller.law, K=-controller.law.K)
    free = replace(small_case, limits=DEFAULT_LIMITS)
    unlimited = replace(unsupervised(exported_controller(free)), law=wrong)
    assert bed_motions(free, unlimited, runs, SENSORS) == [None]
    limited = bed_motions(small_case, replace(controller, law=wrong), runs, SENSORS)[0]
    vehicle = vehicle_motions(small_case, runs, SENSORS)[0]
    assert np.abs(limited.commands).max() == 1500
    assert np.abs(limited.readings - vehicle).max() > np.ptp(vehicle)


def test_one_that_runs_away_leaves_those_beside_it_as_they_are(small_case):
    torques = pulse(small_case, 600)
    wild = Imperfection("", {"dynamometers.dyno.torque_gain": -3.0})
    small_case = replace(small_case, limits=DEFAULT_LIMITS)
    controller = unsupervised(exported_controller(small_case))
    alone = bed_motions(small_case, controller, [BedRun(Imperfection(""), torques)], SENSORS)[0]
    runs = [BedRun(Imperfection(""), torques), BedRun(wild, torques)]
    beside, gone = bed_motions(small_case, controller, runs, SENSORS)
    assert gone is None
    assert beside.readings == pytest.approx(alone.readings, abs=1e-9)


def test_what_is_wrong_of_a_demand_reaches_the_rig_and_not_what_the_controller_is_told(small_case):
    run = BedRun(Imperfection("", demand_factor=1.05, demand_late=5e-3), pulse(small_case), ())
    late, demanded = acting(small_case, run)["motor_torque"], run.torques["motor_torque"]
    assert late[5:] == pytest.approx(1.05 * demanded[:-5])


def test_imperfections_draw_from_the_box_of_the_case(small_case):
    *alone, last = imperfections(small_case, 100.0, 0)
    names = {quantity.name for quantity in small_case.uncertainty.uncertain}
    assert set(last.values) == names
    assert last.gap
    assert last.friction == 2.0
    assert last.poor_sensors
    assert [len(row.values) for row in alone[:3]] == [0, 1, 1]


@pytest.mark.parametrize("own", ["backlash", "coulomb_friction", "hardening", "quadratic_drag"])
def test_only_play_and_friction_of_its_own_replace_those_that_are_added(small_case, own):
    """A shaft at the cut with play keeps it; with any other effect there, play and friction are added as well."""
    shafts = {part.name: part for part in small_case.vehicle.shafts}
    cuts = {cut.shaft: cut.vehicle_end for cut in small_case.residual_vehicle.interfaces}
    near = {next(end for end in shafts[shaft].between if end != vehicle) for shaft, vehicle in cuts.items()}
    on_shaft = own in ("backlash", "hardening")
    places = [f"shafts.{name}" for name in cuts] if on_shaft else [f"inertias.{name}" for name in near]
    values = tuple((name, Quantity(0.5)) for name in required_parameters(EFFECTS[own]))
    rig = small_case.rig.with_effects(*(Effect(own, place, values) for place in places))
    got = perturbed_system(rig, Imperfection("", gap=0.02, friction=3.0), small_case).effects
    added = sorted((effect.law.free_play != "", effect.law.sticks) for effect in got[len(rig.effects) :])
    play, friction = [(True, False)] * len(cuts), [(False, True)] * len(near)
    assert added == sorted(play * (own != "backlash") + friction * (own != "coulomb_friction"))


def test_a_limit_cycle_is_told_from_a_motion_that_dies_out():
    time = np.arange(3000) * 1e-3
    swinging, decaying = 100 * np.sin(50 * time)[:, None], (100 * np.exp(-time) * np.sin(50 * time))[:, None]
    vehicle = decaying * np.exp(-time)[:, None]
    motions = [BedMotion(own, own) for own in (swinging, decaying)] + [None]
    found = open_lash([vehicle] * 3, motions, [0], 1e-3)
    assert (found.drawn, found.limit_cycles) == (3, 2)
    assert open_lash([vehicle], motions[:1], [0], 1e-3).largest_swing == pytest.approx(100 / np.sqrt(2), rel=0.02)


WITHOUT_SWING = {
    "torque_drift": 19.0, "dynamometer_drift": 11.0, "dynamometer_swing": 1e-4, "dynamometer_noise": 0.096,
    "shaft_noise": 1e-6, "torque_sensor_noise": 1.6, "rotor_speed_noise": 0.24, "further_sensor_noise": 0.072,
}  # fmt: skip


def test_a_limit_cycle_in_a_lash_is_found_where_there_is_one(small_case):
    """Four lashes on drawn beds under weights that were not tuned for this drive: one swings on for ever."""
    loop = small_case.loop.with_values(WITHOUT_SWING)
    controller = unsupervised(exported_controller(replace(small_case, loop=loop)))
    law = controller.law
    runs = lash_runs(small_case, {"motor_torque": np.full(3000, 60.0)}, ("motor_torque",), 3, FreePlay(drawn=6))[:4]
    vehicles, beds = vehicle_motions(small_case, runs, SENSORS), bed_motions(small_case, controller, runs, SENSORS)
    found = open_lash(vehicles, beds, [1], law.sample_time)
    assert (found.drawn, found.limit_cycles) == (4, 1)
    assert found.largest_swing > 5 > 0.5 > found.vehicle_swing  # N·m
    assert open_lash(vehicles[1:], beds[1:], [1], law.sample_time).limit_cycles == 0


def test_encoders_keep_a_bed_swinging_at_standstill_in_proportion_to_their_count(small_case, controller, monkeypatch):
    """As a quantiser in a linear loop must; with counts near zero the bed is the exact one, which rests."""
    found = []
    for count in (1 / 8, 1 / 64, 1e-9):
        monkeypatch.setattr(imperfect, "ANGLE_OF_A_COUNT", count * ANGLE_OF_A_COUNT)
        found.append(standstill(small_case, controller, pulse(small_case), ("motor_torque",)))
    assert found[0].command > 0
    for name in ("command", "flange"):
        coarse, fine, none = (getattr(one, name) for one in found)
        assert 8 / 3 < coarse / fine < 8 * 3
        assert none < 1e-6 * coarse
    moving = replace(small_case, rig=replace(small_case.rig, operating_point=OperatingPoint((("motor", 50.0),))))
    assert standstill(moving, controller, pulse(small_case), ()) is None


@pytest.mark.long
def test_the_torque_at_a_cut_needs_no_sensor_of_the_models(small_case, controller, table):
    """Without one the size of the friction and the lash were those of a bed at rest, or the match ended in a fault."""
    vehicle, rig = (
        replace(system, sensors=tuple(part for part in system.sensors if part.name != "side_torque"))
        for system in (small_case.vehicle, small_case.rig)
    )
    compared = tuple(pair for pair in small_case.compared if pair.sensor != "side_torque")
    without = replace(small_case, vehicle=vehicle, rig=rig, compared=compared)
    blind = errors_in_time(without, controller, pulse(small_case, 600))
    assert lashes(without) == lashes(small_case) is not None
    assert [row.measured["motor_speed"] for row in blind.rows[:-1]] == pytest.approx(
        [row.measured["motor_speed"] for row in table.rows[:-1]]
    )


def test_a_bed_that_cannot_be_simulated_says_why(small_case):
    loop = replace(small_case.loop, values={**small_case.loop.values, "command_weight": -1.0})
    assert simulate_deviations(replace(small_case, loop=loop)).not_simulated


def test_a_bed_that_was_simulated_gives_no_reason(table):
    assert table.to_dict()["not_simulated"] == ""


@pytest.mark.long
def test_the_reference_follows_its_vehicle_with_everything_wrong_at_once():
    """2.5 % to measured and 3.5 % to unmeasured torques were asked with stated values; drawn beds are harder."""
    case = load_case(Path(__file__).parents[2] / "examples" / "road_to_rig" / "observer.toml")
    stated, drawn = match(case, beds=8).in_time.rows[-2:]
    assert (stated.words, drawn.words) == (EVERYTHING_STATED, EVERYTHING_DRAWN)
    assert max(stated.measured.values()) < 0.025
    assert max(stated.unmeasured.values()) < 0.035
    assert drawn.largest() < 0.035


@pytest.mark.long
@needs_compiler
@pytest.mark.parametrize(("milliseconds", "exact"), [(3, ()), (3, GAINS), (5, GAINS)])
def test_no_limit_cycle_of_the_reference_with_twenty_lashes(milliseconds, exact):
    """As the match leaves it: where its search begins, three of the twenty swing on at 3 ms.

    With exact gains 19 of 20 did at 3 and 5 ms while the search left opened cut shafts out, and 4 of 20 at 3 ms while
    opened shafts were given up where their price was high.
    """
    case = load_case(Path(__file__).parents[2] / "examples" / "road_to_rig" / "observer.toml")
    box = case.uncertainty.without(*exact).about({"loop.dead_time": milliseconds * 1e-3})
    loop = case.loop.with_values({"dead_time": milliseconds * 1e-3})
    case = match(replace(case, loop=loop, uncertainty=box), beds=8).tuned
    controller, names = unsupervised(exported_controller(case)), ("side_left_torque", "side_right_torque")
    time = np.arange(8000) * 1e-3
    runs = lash_runs(case, {"motor_torque": 100.0 * (time > 0.2)}, ("motor_torque",), 7, FreePlay(drawn=20))
    found = open_lash(vehicle_motions(case, runs, names), bed_motions(case, controller, runs, names), [0, 1], 1e-3)
    assert (found.drawn, found.limit_cycles) == (20, 0)
    assert found.largest_swing < found.vehicle_swing + 2.0  # N·m


@pytest.mark.parametrize("steps", [1000.0, 8000.0])
def test_dry_friction_is_as_steep_as_the_steps_allow(small_case, steps):
    """The fastest decay at rest is what so many steps a second hold: half the steps, twice as wide a ramp."""
    rubbing = small_case.rig.with_effects(Effect("coulomb_friction", "inertias.rotor", (("torque", Quantity(50.0)),)))
    model = compiled(rubbing)
    p = model.vector()
    _refine_friction(model, p, steps)
    wide = p[list(model.parameters).index(STICK_SPEED)]
    slope = 50.0 / (0.9 * wide)  # torque over the ramp's speed and the rotor's inertia, 1/s
    assert slope == pytest.approx(STABLE_STEP * steps, rel=0.02)


def test_a_model_without_friction_keeps_its_parameters(small_case):
    model = compiled(small_case.rig)
    p = model.vector()
    _refine_friction(model, p, 1000.0)
    np.testing.assert_array_equal(p, model.vector())
