"""Minutes, turns and counts: a text means the same in a model and in a budget, or one line asks which is meant."""

import math
from itertools import product

import pytest

from matching.uncertainty.budget import budget_from_tables
from modelling.errors import InputError
from modelling.units import factor, unit_of


def budget(formula, unit, **inputs):
    given = {name: {"value": 1.0, "unit": own, "uncertainty": 0.01} for name, own in inputs.items()}
    return budget_from_tables({"measurand": {"name": "y", "formula": formula, "unit": unit}, "inputs": given}, "b.toml")


def result(formula, unit, **inputs):
    """Value of a formula of inputs that are 1 in their units, in the unit of the measurand."""
    found = budget(formula, unit, **inputs)
    values = {quantity.name: quantity.value for quantity in found.inputs}
    measurand = found.measurands[0]
    return measurand.unit.value_from_si(
        float(measurand.expression.subs({own: values[own.name] for own in measurand.expression.free_symbols}))
    )


@pytest.mark.parametrize("torque", ["N*m", "kN*m", "Nm", "N*mm", "lbf*ft", "in*lbf"])
@pytest.mark.parametrize("per_speed", ["{}*min", "{}/(1/min)", "{}/rpm", "{}*s/rad", "{}/(rad/s)"])
def test_a_damping_is_the_same_in_a_model_and_in_a_budget(torque, per_speed):
    text = per_speed.format(torque)
    assert unit_of(text, "").scale == pytest.approx(factor(text, "N*m*s/rad"), rel=1e-12)
    assert unit_of("N*m*min", "").scale == pytest.approx(30 / math.pi)


@pytest.mark.parametrize("voltage", ["V", "mV", "kV"])
def test_a_voltage_times_minutes_may_mean_both(voltage):
    with pytest.raises(InputError, match=r"leaves open whether min is a time or 1/min a speed; write V\*s .*V/rpm"):
        unit_of(f"{voltage}*min", "b.toml")
    assert result("k", f"{voltage}/rpm", k="V*s/rad") == pytest.approx(
        math.pi / 30 / {"V": 1, "mV": 1e-3, "kV": 1e3}[voltage]
    )


@pytest.mark.parametrize(
    ("torque", "frequency"),
    list(product(["N*m", "kNm", "lbf*ft", "ft*lbf", "in*lbf", "ozf*inch", "kgf*m", "N·mm"], ["Hz", "kHz", "mHz"])),
)
def test_a_torque_times_a_frequency_is_no_power(torque, frequency):
    with pytest.raises(InputError, match=r"counts cycles; write the factor 2\*pi"):
        budget("T*f", "W", T=torque, f=frequency)
    budget("2*pi*T*f", "W", T=torque, f=frequency)
    budget("E*f", "W", E="J", f=frequency)


@pytest.mark.parametrize("time", ["s", "ms", "min", "h"])
@pytest.mark.parametrize("unit", ["1/min", "rpm"])
def test_a_count_over_a_time_is_no_angle(time, unit):
    minutes = {"s": 1 / 60, "ms": 1 / 60_000, "min": 1.0, "h": 60.0}[time]
    assert result("count/t", unit, count="1", t=time) == pytest.approx(1 / minutes)
    assert result("turns/t", unit, turns="turn", t=time) == pytest.approx(1 / minutes)
    assert result("angle/t", unit, angle="deg", t=time) == pytest.approx(1 / 360 / minutes)
    assert result("n/i", unit, n="1/min", i="1") == pytest.approx(1.0)
