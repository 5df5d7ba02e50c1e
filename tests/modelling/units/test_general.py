"""Units of budgets and fidelity cases, and what a formula makes of turns, cycles and radians."""

import math

import pytest

from matching.uncertainty.budget import budget_from_tables
from matching.uncertainty.evaluate import evaluate
from modelling.errors import InputError
from modelling.units import factor, signal_quantity, signal_unit, unit_of


@pytest.mark.parametrize(
    ("text", "scale"),
    [("kN*m", 1e3), ("%", 0.01), ("1/K", 1.0), ("nm", 1e-9), ("mV/V", 1e-3), ("l/min", 1e-3 / 60), ("N*m/%", 100.0),
     ("N*m/K", 1.0), ("N*m/°C", 1.0), ("arcsecond", math.pi / 648000), ("%/h", 0.01 / 3600), ("kHz", 1e3),
     ("deg/s", math.pi / 180), ("N*m/(1/min)", 30 / math.pi), ("ohm", 1.0), ("W*s", 1.0)],
)  # fmt: skip
def test_scale(text, scale):
    assert unit_of(text, "").scale == pytest.approx(scale, rel=1e-12)


@pytest.mark.parametrize("text", ["1/min", "1/minutes", "RPM", "U/min", "rev/min", "min-1", "/min", "rad/s", "deg/s"])
def test_a_speed_is_the_same_in_budgets_and_models(text):
    assert unit_of(text, "").scale == pytest.approx(factor(text, "rad/s"), rel=1e-15)
    assert signal_quantity(f"3 {text}", "")[0] == pytest.approx(3 * factor(text, "rad/s"), rel=1e-15)


@pytest.mark.parametrize("text", ["1/s", "1/h", "1/ms", "1/s^2"])
def test_turns_or_radians_are_asked_for(text):
    with pytest.raises(InputError, match="leaves open whether it counts turns"):
        unit_of(text, "budget.toml: inputs.n.unit")


@pytest.mark.parametrize("text", ["Bq", "Ci", "foo", "m^9^9", "$", "N*m)", "1" * 80])
def test_no_unit(text):
    with pytest.raises(InputError, match=r"unknown unit|no unit"):
        unit_of(text, "")


def test_celsius_has_an_offset_alone_and_none_in_a_product():
    unit = unit_of("degC", "")
    assert unit.value_to_si(20.0) == pytest.approx(293.15)
    assert unit.difference_to_si(20.0) == pytest.approx(20.0)
    assert unit.value_from_si(293.15) == pytest.approx(20.0)
    assert unit_of("1/degC", "").offset == 0.0


def test_a_signal_is_not_in_hertz():
    with pytest.raises(InputError, match="radians or turns"):
        signal_unit("Hz", "")


def power(speed_unit, formula="M*n", speed=3000.0, torque_unit="N*m"):
    tables = {
        "measurand": {"name": "P", "formula": formula, "unit": "kW"},
        "inputs": {
            "M": {"value": 300.0, "unit": torque_unit, "uncertainty": 0.3},
            "n": {"value": speed, "unit": speed_unit, "uncertainty": 1.0},
        },
    }
    result = evaluate(budget_from_tables(tables), with_monte_carlo=False).measurands[0]
    return result.measurand.unit.value_from_si(result.propagation.value)


def test_torque_times_speed_is_the_power_of_turns():
    for unit in ("1/min", "rpm", "U/min", "1/minutes"):
        assert power(unit) == pytest.approx(300 * 3000 * math.pi / 30 / 1000, rel=1e-12)  # 94.25 kW
    assert power("Hz", "2*pi*M*n", 50.0) == pytest.approx(94.2477796, rel=1e-8)
    assert power("Hz", "M*n", 50.0, "J") == pytest.approx(15.0)  # energy per cycle


def test_a_factor_too_many_or_too_few_is_said():
    with pytest.raises(InputError, match="n in 1/min is taken in rad/s already; leave out the factor"):
        power("1/min", "2*pi*n*M")
    with pytest.raises(InputError, match="counts cycles; write the factor"):
        power("Hz", "M*n", 50.0)


def test_a_speed_that_the_formula_states_in_turns():
    """A quarter turn in 10 ms is 1500 1/min, whether or not the formula divides by 2·pi."""
    inputs = {"a": {"value": 90.0, "unit": "deg"}, "t": {"value": 10.0, "unit": "ms"}}
    for formula in ("a/t", "a/(2*pi*t)"):
        measurand = {"name": "n", "formula": formula, "unit": "1/min"}
        budget = budget_from_tables({"measurand": measurand, "inputs": inputs})
        result = evaluate(budget, with_monte_carlo=False).measurands[0]
        speed = result.measurand.unit.value_from_si(result.propagation.value)
        assert speed == pytest.approx(1500.0, rel=1e-12)
