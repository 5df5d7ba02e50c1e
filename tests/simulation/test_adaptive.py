"""Fixed steps against SciPy's adaptive solvers, every kind of effect."""

import numpy as np
import pytest

from modelling.simulation.simulate import simulate
from tests.simulation.adaptive import simulate_adaptive
from tests.simulation.drives import EFFECTS, excitation, system_with

TOLERANCE = 2e-4  # of each reading's range
SHARP = {"simulation.stick_speed": 1e-2}  # the same in both: here the integrators are compared, not the laws


@pytest.mark.parametrize("kind", EFFECTS)
def test_both_integrators_agree(kind):
    system = system_with(kind)
    time, inputs = excitation(0.2)
    values = SHARP if "friction" in kind else None
    start = {"speed(motor)": 1.0, "speed(load)": 1.0}
    fixed = simulate(system, time, inputs, values, start, steps_per_second=8000.0)
    adaptive = simulate_adaptive(system, time, inputs, values, start, tolerance=1e-7)
    for name, reading in fixed.readings.items():
        error = np.abs(reading - adaptive[name]) / np.ptp(reading)
        if kind == "backlash" and name in ("link_torque", "load_acceleration"):
            error = np.sort(error)[:-3]  # a sample within the step in which the torque jumps
        assert error.max() < TOLERANCE, (name, error.max())


def test_the_chosen_steps_are_fine_enough():
    time, inputs = excitation(0.1)
    fixed = simulate(system_with(), time, inputs)
    adaptive = simulate_adaptive(system_with(), time, inputs, method="DOP853", tolerance=1e-9)
    for name, reading in fixed.readings.items():
        assert np.abs(reading - adaptive[name]).max() < 1e-5 * np.ptp(reading)
