"""What a recording leaves unknown: half-widths of faults of sensors, torques of the road that nobody measured."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from matching.bed.identify import (
    COVERAGE,
    KNOWN,
    LEAST_DELAY,
    LEAST_SHARE,
    _half_range,
    _moved,
    _of_faults,
    narrowed,
    recorded_vehicle,
)
from matching.bed.simulated_bed import FIT_RANGE_RATIO
from matching.diagnosis.statistics import Estimate
from matching.match.box import LARGEST_SHARE, Box, Uncertain
from matching.match.case import Move
from matching.match.case_file import load_case
from matching.report.bed import gain
from modelling.system import Effect, Quantity

FOLDER = Path(__file__).parents[2] / "examples" / "from_recordings"


@pytest.fixture(scope="module")
def case():
    return load_case(FOLDER / "case.toml")


@pytest.mark.parametrize(
    ("spread", "half_width"),
    [(0.01, COVERAGE * 0.01), (1e-9, LEAST_SHARE * 0.9), (5.0, LARGEST_SHARE * 0.9)],
)
def test_a_wrong_gain_of_a_sensor_is_known_no_better_and_no_worse_than_makes_sense(case, spread, half_width):
    name = case.rig.sensors[0].name
    gain_of_sensor = Effect("sensor_gain", f"sensors.{name}", (("factor", Quantity(0.9)),))
    rig = case.rig.with_effects(gain_of_sensor)
    key = f"{gain_of_sensor.name}.factor"
    diagnosis = SimpleNamespace(parameters={key: Estimate(0.9, spread)})
    (unknown,) = _of_faults(rig, [gain_of_sensor], diagnosis, set())
    assert unknown.name == f"rig.{key}"
    assert (unknown.value, unknown.half_width) == pytest.approx((0.9, half_width))
    assert list(_of_faults(rig, [gain_of_sensor], diagnosis, {unknown.name})) == []
    assert list(_of_faults(rig, [gain_of_sensor], SimpleNamespace(parameters={}), set())) == []


@pytest.mark.parametrize(
    ("quantity", "estimate", "wanted"),
    [
        (Uncertain("rig.a.J", 2.0, 0.5), None, (2.0, 0.5)),
        (Uncertain("rig.a.J", 2.0, 0.5), Estimate(2.2, 0.01), (2.2, 0.02)),
        (Uncertain("rig.a.J", 2.0, 0.5), Estimate(2.2, 1e-6), (2.2, 0.0044)),
        (Uncertain("rig.a.J", 2.0, 0.5), Estimate(2.2, 9.0), (2.2, FIT_RANGE_RATIO * 0.5)),
        (Uncertain("rig.a.J", 2.0, 0.5), Estimate(2.2, 0.01, "at the bound of its range"), (2.2, 0.5)),
        (Uncertain("loop.dead_time", 0.003, 5e-4), Estimate(0.002, 1e-9), (0.0025, LEAST_DELAY)),
        (Uncertain("dynamometers.d.torque_gain", 1.0, 0.1), Estimate(0.8, 0.02), (1.0, 0.05)),
    ],
)
def test_what_is_still_unknown_of_a_quantity(quantity, estimate, wanted):
    left = narrowed(quantity, estimate, 5e-4)
    assert (left.name, left.value, left.half_width) == (quantity.name, *map(pytest.approx, wanted))


def test_a_torque_that_nobody_recorded_is_left_out_with_its_effects(case):
    assert "road" not in {part.name for part in case.rig.inputs}
    late = Effect("dead_time", "inputs.road", (("delay", Quantity(0.01)),))
    driven = Effect("dead_time", "inputs.motor_torque", (("delay", Quantity(0.002)),))
    vehicle, notes = recorded_vehicle(
        replace(case, vehicle=case.vehicle.with_effects(late, driven)), [FOLDER / "road.csv"]
    )
    assert [part.name for part in vehicle.inputs] == ["motor_torque"]
    assert [effect.at for effect in vehicle.effects] == ["inputs.motor_torque"]
    assert notes == ("no recording holds road: it is taken as zero on the road",)


@pytest.mark.parametrize(("factor", "known"), [(0.9, True), (1.1, False)])
def test_what_the_bed_tells_much_better_is_taken_as_known(case, factor, known):
    shared = next(
        name for name, quantity in case.vehicle.parameters.items() if quantity.uncertain and name in case.rig.parameters
    )
    quantity = case.vehicle.parameters[shared]
    threshold = KNOWN * (quantity.upper - quantity.lower) / 2
    box = Box((Uncertain(f"rig.{shared}", quantity.value, factor * threshold),))
    vehicle, _ = recorded_vehicle(replace(case, uncertainty=box), [FOLDER / "road.csv"])
    assert (shared not in vehicle.uncertain) == known


def test_half_a_range_counts_as_a_width_of_the_box():
    assert _half_range(Quantity(3.0, 1.0, 5.0)) == 2.0 / FIT_RANGE_RATIO
    assert _half_range(Quantity(3.0)) == 0.0


def test_a_quantity_of_the_residual_vehicle_starts_from_what_it_is():
    name = "residual_vehicle.inertias.body.J"
    move = Move(name, (name,), 40.0, 20.0, 80.0, "kg*m^2", 40.0)
    moved = _moved(move, {"inertias.body.J": 50.0})
    assert (moved.start, moved.planned, moved.lower, moved.upper) == (50.0, 50.0, 25.0, 100.0)
    other = replace(move, name="loop.gain")
    assert _moved(other, {"inertias.body.J": 50.0}) is other
    assert _moved(move, {"inertias.wheel.J": 50.0}) is move


def a_round(number, error):
    errors = [] if error is None else [{"error": error}]
    return {"round": number, "verification": {"errors": errors}}


def test_a_gain_is_told_where_it_exceeds_its_uncertainty():
    def judged(number, low, error, high):
        one = {"error": error, "interval": [low, high], "standard_uncertainty": (high - low) / 4}
        return {**a_round(number, error), "verification": {"errors": [one]}}

    first, last = judged(1, 0.38, 0.4, 0.42), judged(3, 0.09, 0.1, 0.11)
    assert "from 0.4 ± 0.02 to 0.1 ± 0.01, at least by a factor of 3.5" in gain({"rounds": [first, last]})
    assert gain({"rounds": [first]}) == ""
    assert gain({"rounds": [judged(1, 0.0, 0.067, 0.3), judged(2, 0.0, 0.0026, 0.34)]}) == ""
    assert gain({"rounds": [first, a_round(2, None)]}) == ""
    again = {**first, "against_last_vehicle": judged(1, 0.77, 0.8, 0.83)["verification"]}
    assert "factor of 7" in gain({"rounds": [again, last]})
