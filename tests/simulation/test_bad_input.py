"""What simulate refuses, and how it says so."""

import numpy as np
import pytest

from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.simulation.simulate import sensitivities, simulate, simulate_batch
from modelling.simulation.stepping import SimulationError
from tests.simulation.drives import excitation, system_with

TIME, INPUTS = excitation(0.1)
GAP = {"motor_torque": np.where(TIME[5] == TIME, np.nan, 1.0), "brake_torque": TIME}


@pytest.mark.parametrize(
    ("time", "inputs", "line"),
    [
        (TIME[:1], INPUTS, "at least two samples"),
        (TIME[::-1], INPUTS, "does not rise"),
        (np.where(TIME[3] == TIME, np.nan, TIME), INPUTS, "not finite"),
        (TIME, {"motor_torqe": TIME, "brake_torque": TIME}, "inputs.motor_torque.*did you mean 'motor_torqe'"),
        (TIME, {"motor_torque": TIME[:-1], "brake_torque": TIME}, "inputs.motor_torque: shape"),
        (TIME, np.zeros((len(TIME), 3)), r"\(t, u\) = \(101, 2\)"),
        (TIME, GAP, "inputs.motor_torque: is not finite at 0.005 s"),
    ],
)
def test_wrong_time_or_inputs(time, inputs, line):
    with pytest.raises(InputError, match=line):
        simulate(system_with(), time, inputs)


def test_wrong_names():
    with pytest.raises(InputError, match="did you mean 'link_torque'"):
        simulate(system_with(), TIME, INPUTS, sensors=["link_torqe"])
    with pytest.raises(InputError, match=r"did you mean 'shafts.link.stiffness'"):
        simulate(system_with(), TIME, INPUTS, {"shafts.link.stifness": 1.0})
    with pytest.raises(InputError, match=r"did you mean 'speed\(load\)'"):
        sensitivities(system_with(), TIME, INPUTS, compiled(system_with()).p0, ["sped(load)"])


def test_wrong_parameters():
    with pytest.raises(InputError, match=r"\(b, 6\)"):
        simulate_batch(system_with(), TIME, INPUTS, np.ones((2, 4)))
    with pytest.raises(InputError, match="delay of -1 s"):
        simulate(system_with("dead_time"), TIME, INPUTS, {"inputs.motor_torque.dead_time.delay": -1.0})


def test_a_state_that_is_not_finite_is_an_error_that_says_when_and_which(path):
    system = system_with("hardening", hardening={"cubic": -3e6})  # softens until it pushes apart
    time, inputs = excitation(0.4)
    big = {name: 30 * value for name, value in inputs.items()}
    with pytest.raises(SimulationError, match=r"(angle|speed)\((motor|load)\) is not finite at [\d.]+ s"):
        simulate(system, time, big, compile=path)
    model = compiled(system)
    sets = np.stack([model.vector({"shafts.link.hardening.cubic": 0.0}), model.p0])
    with pytest.raises(SimulationError, match="parameter set 1"):
        simulate_batch(model, time, big, sets, compile=path)


def test_more_steps_than_can_be_taken_are_refused():
    with pytest.raises(SimulationError, match="fastest eigenvalue"):
        simulate(system_with(), TIME, INPUTS, {"shafts.link.stiffness": 1e12})
