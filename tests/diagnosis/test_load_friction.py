"""Friction in proportion to the torque put in, in a model without gear or shaft."""

import numpy as np
import pytest
from needs import compiles
from scipy.integrate import solve_ivp

from matching.diagnosis.diagnose import diagnose
from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording

J, DRAG, SHARE, NOISE, RATE = 0.2, 0.05, 0.12, 0.01, 500.0
ARM = {
    "inertias": {"arm": {"J": {"value": 0.19, "lower": 0.1, "upper": 0.4},
                         "drag": {"value": 0.06, "lower": 0.0, "upper": 0.5}}},
    "inputs": {"motor": {"on": "arm"}},
    "sensors": {"speed": {"measures": "speed", "of": "arm", "uncertainty": NOISE}},
}  # fmt: skip


def recorded(seconds: float, constant: float) -> Recording:
    """An arm that SciPy integrates, with friction of a share of its torque and a constant one."""
    rng = np.random.default_rng(5)
    time = np.arange(0.0, seconds, 1 / RATE)
    tones = [(a, f, rng.uniform(0, 6)) for a, f in ((2.0, 0.4), (1.5, 1.1), (1.0, 2.7))]
    torque = sum(a * np.sin(2 * np.pi * f * time + phase) for a, f, phase in tones)

    def rate(t: float, speed: np.ndarray) -> np.ndarray:
        own = np.interp(t, time, torque)
        return (own - (SHARE * abs(own) + constant) * np.tanh(speed / 1e-3) - DRAG * speed) / J

    speed = solve_ivp(rate, (0.0, time[-1]), [0.0], "LSODA", time, max_step=1 / RATE, rtol=1e-7, atol=1e-8).y[0]
    readings = speed + NOISE * rng.standard_normal(len(time))
    return Recording(time, {"motor": torque, "speed": readings}, "arm")


@compiles
@pytest.mark.parametrize("constant", [0.0, pytest.param(0.4, marks=pytest.mark.long)])
def test_it_is_named_with_its_size(constant: float) -> None:
    found = diagnose(from_dict(ARM), [recorded(5.0, constant)])
    named = {cause.kind: cause for cause in found.causes}
    assert set(named) == {"load_friction"} | ({"coulomb_friction"} if constant else set())
    own = named["load_friction"].parameters["coefficient"]
    assert abs(own.value - SHARE) < 4 * own.standard_uncertainty < 0.02
    assert found.verdict == "explained"


def test_without_a_torque_input_it_is_refused() -> None:
    parts = {"inertias": {"arm": {"J": 1.0}, "wheel": {"J": 1.0}}, "shafts": {"s": {"between": ["arm", "wheel"],
             "stiffness": 100.0}}, "inputs": {"motor": {"on": "arm"}}}  # fmt: skip
    effects = [{"kind": "load_friction", "at": "inertias.wheel", "coefficient": 0.1}]
    with pytest.raises(InputError, match=r"no torque input.*gear_loss"):
        compiled(from_dict(parts | {"effects": effects}))
