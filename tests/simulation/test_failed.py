"""Where a motion leaves the numbers: the sample and the state, also where a sensitivity leaves them first."""

import numpy as np
import pytest

from modelling.equations.casadi_code import compiled
from modelling.model_file import from_dict
from modelling.simulation import compiled as native
from modelling.simulation import interpreted as virtual
from modelling.simulation.task import make_task

RATE, J = 400.0, 1e-6  # 1/s, kg·m²: speed e^(400 t), its derivative by J −(400/J)·t·e^(400 t)
TIME = np.arange(0.0, 2.0, 0.01)  # s


@pytest.mark.parametrize("integrate", [native.run_compiled, virtual.run])
@pytest.mark.parametrize("names", [[], ["inertias.rotor.J"]], ids=["motion", "sensitivity"])
def test_sample_and_state_that_fail_first(integrate, names):
    rotor = {"inertias": {"rotor": {"J": J, "drag": RATE * J}}, "inputs": {"torque": {"on": "rotor"}}}
    model = compiled(from_dict(rotor | {"sensors": {"speed": {"measures": "speed", "of": "rotor"}}}))
    p = model.p0[None].copy()
    p[:, model.parameters.index("inertias.rotor.drag")] *= -1
    start = np.array([[0.0, 1.0]])
    done = integrate(make_task(model, TIME, np.zeros((len(TIME), 1)), p, start, 20_000.0, names))
    if done is None:
        pytest.skip("no compiler")
    # the sum of a step's four rates leaves the numbers first, the angle with it within the same sample
    logarithm = np.log(6 * RATE) + RATE * TIME[1:] + (np.log(RATE / J * TIME[1:]) if names else 0.0)
    sample = 1 + int(np.argmax(logarithm > np.log(np.finfo(float).max)))
    assert done.failed[0].tolist() == [sample, 0]
    assert np.isfinite(done.states[0, :sample]).all()
    assert np.isnan(done.states[0, sample:]).all()
