"""Drawn beds by two assemblies that share nothing: state spaces in the search, dynamic stiffness in the check."""

from dataclasses import replace

import numpy as np
import pytest

from matching.match.beds import (
    action,
    bed_of,
    bed_set,
    closed_matrices,
    damping,
    errors,
    loop_figures,
    planned,
    requirements,
    sampled_beds,
)
from matching.match.case import Box, Uncertain
from matching.match.continuous_loop import sampled_poles
from matching.match.dynamic_stiffness import Judge, check_beds, check_loop, largest_error, worst_bed
from matching.match.loop import control_law, parts_of
from matching.match.responses import ComparedBed
from modelling.bed.controllers import STRUCTURES
from modelling.bed.observer import design, observer_model
from modelling.bed.vehicle import cut
from modelling.controller.law import law_of_observer
from modelling.system import Effect, Quantity


@pytest.fixture(scope="module")
def controller(small_case):
    return design(observer_model(small_case.rig, small_case.residual_vehicle, small_case.loop), small_case.loop.values)


@pytest.mark.parametrize("seed", range(4))
def test_both_see_the_same_bed(small_case, controller, seed):
    values = small_case.uncertainty.at(small_case.uncertainty.draw(1, seed)[0] * (1 + 2 * (seed == 3)))
    judge = Judge(small_case, law_of_observer(controller))
    beds = bed_set(small_case, [values], judge.frequencies)
    acting = action(controller, judge.frequencies)
    size, ratio = damping(np.linalg.eigvals(closed_matrices(beds.sampled, controller)), controller.sample_time)
    verdict = judge.verdict(values)
    assert verdict.stable == (size[0] < 1)
    assert verdict.damping_ratio == pytest.approx(ratio[0], rel=1e-6)
    assert verdict.measured == pytest.approx(np.sqrt(errors(beds, acting, ("motor_torque",)).mean()), rel=1e-7)
    assert verdict.unmeasured == pytest.approx(np.sqrt(errors(beds, acting, ()).mean()), rel=1e-7)
    assert verdict.measured != pytest.approx(verdict.unmeasured, rel=1e-3)


def test_a_mode_of_the_beds_own_beyond_the_roll_off_needs_no_more_damping_than_it_has(small_case, controller):
    """A flange with a hundredth of its damping: 0.014 at 240 Hz of its own, 0.057 here, where 0.07 is asked for."""
    law, worn = law_of_observer(controller), {"rig.shafts.flange.damping": 0.1}
    verdicts = [
        Judge(small_case, law, required=(0.07, rolled_off_from)).verdict(worn) for rolled_off_from in (100.0, 300.0)
    ]
    assert [verdict.damped for verdict in verdicts] == [True, False]
    assert bed_of(small_case, worn).own_damping < 0.02 < verdicts[0].damping_ratio < 0.06
    assert not Judge(small_case, law, required=(0.09, 100.0)).verdict(worn).damped  # slower modes need all of it
    assert bed_of(small_case, {}).own_damping > 0.08


def test_the_search_asks_no_more_of_such_a_mode_either(small_case, small_search):
    search = replace(small_search, required=replace(small_search.required, damping_ratio=0.06))
    start = np.log10([small_case.loop.values[name] for name in search.gains.names])
    beds = sampled_beds(small_case, [{"rig.shafts.flange.damping": 0.1}, {}])
    eased, planned_bed = search.rooms_of(beds, start)
    search.required = replace(search.required, rolled_off_from=300.0)
    asked, same = search.rooms_of(beds, start)
    assert asked < 0 < eased
    assert planned_bed == pytest.approx(same)


def test_a_bed_whose_dynamometer_pushes_the_wrong_way_is_found_unstable(small_case, controller):
    judge = Judge(small_case, law_of_observer(controller))
    assert judge.verdict({}).stable
    assert not judge.verdict({"dynamometers.dyno.torque_gain": -1.0}).stable


def test_every_drawn_bed_counts(small_case, controller):
    found = check_beds(small_case, law_of_observer(controller), 1e-4, 12, 5)
    assert (found.drawn, found.stable, found.damped) == (12, 12, 12)
    assert found.holds
    strict = check_beds(small_case, law_of_observer(controller), found.smallest_damping_ratio * 1.0001, 12, 5)
    assert (strict.damped, strict.holds) == (11, False)
    assert found.to_dict()["unmeasured_95"] == pytest.approx(np.quantile(found.unmeasured, 0.95))


class Plane:
    """A judge whose damping falls evenly: its least value stands in a corner that can be told beforehand."""

    def __init__(self, slopes):
        self.slopes = slopes

    def dampings(self, values):
        return np.array([0.1 - sum(slope * values[name] for name, slope in self.slopes.items())])


def test_the_worst_bed_of_a_plane_is_its_corner():
    slopes = {"a": 0.02, "b": -0.05, "c": 0.001}
    box = Box(tuple(Uncertain(name, 2.0, 1.0) for name in slopes))
    found = worst_bed(Plane(slopes).dampings, box, box.draw(3, 0))
    assert found.values == pytest.approx({"a": 3.0, "b": 1.0, "c": 3.0})
    assert found.damping_ratio == pytest.approx(0.1 - 0.06 + 0.05 - 0.003)
    assert found.named == ("b", "a", "c")
    assert worst_bed(Plane({}).dampings, Box(), np.zeros((3, 0))) is None


@pytest.mark.parametrize("rounding", [1e-15, -1e-15])
def test_a_mode_that_no_bed_moves_hides_no_worst_bed(rounding):
    """A mode with 0.02 in every bed but for rounding; another one is damped by 0.001 in one corner."""
    box = Box((Uncertain("a", 2.0, 1.0), Uncertain("b", 2.0, 1.0)))

    def dampings(values):
        moved = 0.03 + 0.02 * (values["a"] - 2) - 0.009 * (values["b"] - 2)
        return np.sort([0.02 + rounding * values["a"], moved])

    found = worst_bed(dampings, box, box.draw(3, 0))
    assert found.values == pytest.approx({"a": 1.0, "b": 3.0})
    assert found.damping_ratio == pytest.approx(0.001)
    assert found.named == ("a", "b")


def test_the_largest_error_is_climbed_to_and_stops_short_of_beds_that_are_not_stable():
    """Error a + 2·b; beds with a over 2.4 are not stable: of the points on the way to the corner the last below it."""
    box = Box((Uncertain("a", 2.0, 1.0), Uncertain("b", 2.0, 1.0)))
    free = largest_error(lambda values: values["a"] + 2 * values["b"], box, np.array([-0.5, 0.2]))
    assert free.unmeasured == pytest.approx(9.0)
    assert free.named == ("b", "a")
    bounded = largest_error(
        lambda values: values["a"] + 2 * values["b"] if values["a"] <= 2.4 else np.inf, box, np.array([-0.5, 0.2])
    )
    assert bounded.values["a"] <= 2.4
    assert 1.5 + 2 * 2.2 < bounded.unmeasured < 9.0


def test_the_worst_bed_is_worse_than_those_drawn_and_is_what_it_says(small_case, controller):
    law = law_of_observer(controller)
    found = check_beds(small_case, law, 1e-4, 6, 5)
    assert found.worst.damping_ratio < found.smallest_damping_ratio
    assert Judge(small_case, law).verdict(found.worst.values).damping_ratio == pytest.approx(found.worst.damping_ratio)
    assert found.largest_error.unmeasured > found.unmeasured[-1]
    verdict = Judge(small_case, law).verdict(found.largest_error.values)
    assert verdict.stable
    assert verdict.unmeasured == pytest.approx(found.largest_error.unmeasured)
    box = {one.name: one for one in small_case.uncertainty.uncertain}
    for name, value in (*found.worst.values.items(), *found.largest_error.values.items()):
        assert abs(value - box[name].value) <= box[name].half_width * (1 + 1e-9)


def test_margin_roll_off_and_noise_are_those_of_the_search(small_case, controller):
    required = requirements(small_case)
    noise = observer_model(small_case.rig, small_case.residual_vehicle, small_case.loop).readings.noise
    wanted = loop_figures(planned(small_case, noise), controller, required)
    found = check_loop(
        small_case, law_of_observer(controller), noise, required.margin_from, required.rolled_off_from
    )  # fmt: skip
    for name, value in vars(wanted).items():
        assert getattr(found, name) == pytest.approx(value, rel=1e-6)


@pytest.mark.parametrize("structure", ["pi", "model_based"])
def test_feedback_laws_are_judged_as_they_run(small_case, structure):
    """Least damping of the bed as planned, against the poles of the verification's own sampled loop."""
    made = STRUCTURES[structure]
    values = {**small_case.loop.values, **{name: own.start for name, own in made.quantities.items()}}
    loop = replace(small_case.loop, structure=made, values=values, further_sensors=())
    case = replace(small_case, loop=loop)
    parts = parts_of(case)
    z = sampled_poles(parts)
    if structure == "model_based":
        z = np.append(z, np.exp(made.feed_forward(case.rig, cut(case.vehicle, case.rig), loop).poles * 1e-3))
    s = np.log(z[np.abs(z) > 1e-3].astype(complex)) / loop["sample_time"]
    s = s[np.abs(s.imag) > 1]
    judge = Judge(case, control_law(parts))
    found, wanted = judge.verdict({}), ComparedBed(case).at(judge.frequencies)
    assert found.damping_ratio == pytest.approx(np.min(-s.real / np.abs(s)), rel=1e-5)
    assert found.stable == bool((np.abs(z) < 1).all())
    on_rig = np.array([pair.input == "motor_torque" for pair in case.compared])  # the road's is known, it is simulated
    unmeasured = np.where(on_rig, wanted.unmeasured, wanted.matched)
    for error, responses in ((found.measured, wanted.matched), (found.unmeasured, unmeasured)):
        squares = np.abs(np.log(responses / wanted.vehicle)) ** 2
        assert error == pytest.approx(np.sqrt(squares.mean()), rel=1e-6)


@pytest.mark.parametrize("kind", ["all_pass", "lag", "sensor_gain"])
def test_both_see_a_faulty_sensor_and_an_uncertain_vehicle(small_case, kind):
    key, value = {"all_pass": ("delay", 0.002), "lag": ("time_constant", 0.003), "sensor_gain": ("factor", 0.9)}[kind]
    faults = [Effect(kind, f"sensors.{name}", ((key, Quantity(value)),)) for name in ("motor_speed", "flange_torque")]
    rig, vehicle = small_case.rig.with_effects(*faults), small_case.vehicle.with_effects(faults[0])
    case = replace(small_case, rig=rig, vehicle=vehicle, residual_vehicle=cut(vehicle, rig))
    controller = design(observer_model(case.rig, case.residual_vehicle, case.loop), case.loop.values)
    values = case.uncertainty.at(case.uncertainty.draw(1, 3)[0]) | {
        "vehicle.inertias.body.J": 44.0, f"rig.sensors.motor_speed.{kind}.{key}": 1.1 * value,
    }  # fmt: skip
    judge = Judge(case, law_of_observer(controller))
    beds = bed_set(case, [values], judge.frequencies)
    acting = action(controller, judge.frequencies)
    verdict = judge.verdict(values)
    _, ratio = damping(np.linalg.eigvals(closed_matrices(beds.sampled, controller)), controller.sample_time)
    assert verdict.damping_ratio == pytest.approx(ratio[0], rel=1e-6)
    assert verdict.measured == pytest.approx(np.sqrt(errors(beds, acting, ("motor_torque",)).mean()), rel=1e-7)
    assert verdict.unmeasured == pytest.approx(np.sqrt(errors(beds, acting, ()).mean()), rel=1e-7)
    known = judge.verdict({name: one for name, one in values.items() if not name.startswith("vehicle.")})
    assert known.measured != pytest.approx(verdict.measured, rel=1e-3)
