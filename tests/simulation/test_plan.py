"""Steps fixed in advance, from eigenvalues in closed form."""

import numpy as np
import pytest

from modelling.equations.casadi_code import compiled
from modelling.model_file import from_dict
from modelling.simulation.stepping import ACCURATE_STEP, steps_per_second

J1, J2, STIFFNESS = 0.2, 1.5, 300.0
OMEGA = np.sqrt(STIFFNESS * (1 / J1 + 1 / J2))  # rad/s


def two_masses(**more):
    shaft = {"between": ["motor", "load"], "stiffness": STIFFNESS}
    return compiled(from_dict({"inertias": {"motor": {"J": J1}, "load": {"J": J2}}, "shafts": {"link": shaft}, **more}))


def test_a_vibration_takes_its_share_of_a_radian_a_step():
    model = two_masses()
    assert steps_per_second(model, model.p0[None]) == pytest.approx(OMEGA / ACCURATE_STEP, rel=1e-9)


def test_contacts_of_a_lash_take_a_fifth_of_a_radian_a_step():
    model = two_masses(effects=[{"kind": "backlash", "at": "shafts.link", "gap": 0.01}])
    assert steps_per_second(model, model.p0[None]) == pytest.approx(OMEGA / 0.2, rel=1e-6)
