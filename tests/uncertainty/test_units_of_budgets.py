"""A budget's U in the unit of the budget reaches R_MU in SI: closed form, by every way a case can name it."""

import math

import numpy as np
import pytest

from matching.fidelity import read_case

BUDGET = """
coverage_factor = 2
[measurand]
name = "speed"
formula = "reading"
unit = "1/min"
[inputs.reading]
value = 1000
unit = "1/min"
uncertainty = 3
"""
CASE = """
weights = { system_dynamics = 0.5, measurement_uncertainty = 0.5 }
[recordings]
reference = "road.csv"
test = "road.csv"
[system_dynamics.speed]
[measurement_uncertainty.speed]
budget = "budget.toml"
"""
U = 6.0  # 1/min
RANGE = 120.0  # 1/min


def case(folder, sensor, unit="1/min"):
    time = 0.01 * np.arange(200)
    speed = RANGE * (time > 1) * (1 if unit == "1/min" else math.pi / 30)
    rows = [f"{t:.2f},{n:.12g}" for t, n in zip(time, speed, strict=True)]
    (folder / "road.csv").write_text("\n".join([f"time [s],speed [{unit}]", *rows]))
    (folder / "budget.toml").write_text(BUDGET)
    (folder / "case.toml").write_text(CASE.replace('budget = "budget.toml"', sensor))
    return read_case(folder / "case.toml")[1]


@pytest.mark.parametrize("unit", ["1/min", "rad/s"])
@pytest.mark.parametrize(
    "sensor",
    [
        'budget = "budget.toml"\nsignal = "speed"',
        'budget = "budget.toml"\nrange = "120 1/min"',
        'budget = "budget.toml"\nrange = "12.566370614 rad/s"',
        'expanded_uncertainty = "6 1/min"\nsignal = "speed"',
        'expanded_uncertainty = "0.62831853 rad/s"\nrange = "120 1/min"',
    ],
)
def test_u_over_range_has_no_unit(tmp_path, sensor, unit):
    fidelity = case(tmp_path, sensor, unit)
    (speed,) = fidelity.sensors
    assert speed.ratio == pytest.approx(U / RANGE, rel=1e-8)
    assert fidelity.domains["measurement_uncertainty"] == pytest.approx(1 - U / RANGE, rel=1e-8)


def test_u_of_a_signal_comes_in_si_with_its_coverage_factor(tmp_path):
    fidelity = case(tmp_path, 'budget = "budget.toml"\nsignal = "speed"')
    pair = fidelity.signals["system_dynamics"][0].pair
    assert pair.expanded_uncertainty == pytest.approx(U * math.pi / 30)
    assert pair.coverage_factor == 2
