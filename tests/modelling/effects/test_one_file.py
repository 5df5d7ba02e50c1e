"""A new effect is one file: it is read, simulated, screened and reported without a change elsewhere."""

import importlib.util
import re

import numpy as np
import pytest

from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import solve
from matching.diagnosis.problem import base_problem
from matching.diagnosis.screening import Screening
from matching.report.diagnosis import clause
from modelling.effects import EFFECTS
from modelling.model_file import from_dict
from modelling.simulation.simulate import simulate

LAW = '''
from modelling.effects.effect import Guess, Kind, Parameter, if_positive

class CubicDrag(Kind):
    """coefficient·speed³, resisting."""

    kind = "cubic_drag"
    words = "has drag that grows with the cube of speed by {coefficient}"
    tables = ("inertias",)
    parameters = {"coefficient": Parameter("N*m*s^3/rad^3", lower=0.0)}
    state_dependent = True

    def inertia(self, motion, p, assembly, name):
        assembly.add_torque(name, -p["coefficient"] * motion.speed**3, motion)

    def guesses(self, motion, at):
        yield Guess(({at: -motion.speed[at.split(".")[1]] ** 3},), if_positive("coefficient"))
'''
MODEL = {
    "inertias": {"rotor": {"J": 0.5}},
    "inputs": {"motor": {"on": "rotor"}},
    "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": 0.01}},
}
COEFFICIENT = 0.02
TIME = np.arange(0, 6, 0.004)


@pytest.fixture
def cubic_drag(tmp_path, monkeypatch):
    path = tmp_path / "cubic_drag.py"
    path.write_text(LAW)
    spec = importlib.util.spec_from_file_location("cubic_drag", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setitem(EFFECTS, "cubic_drag", module.CubicDrag())


def test_a_new_effect_is_one_file(cubic_drag):
    effect = {"kind": "cubic_drag", "at": "inertias.rotor", "coefficient": COEFFICIENT}
    system = from_dict(MODEL | {"effects": [effect]})
    torque = 4 * np.sin(2 * np.pi * 0.5 * TIME)
    speed = simulate(system, TIME, {"motor": np.full(len(TIME), 4.0)}, compile=False)["speed"]
    assert speed[-1] == pytest.approx((4.0 / COEFFICIENT) ** (1 / 3), rel=1e-3)  # torque = coefficient·speed³

    recorded = simulate(system, TIME, {"motor": torque}, compile=False)["speed"]
    data = FitData((Segment(TIME, torque[:, None], recorded[:, None], "made"),), np.array([0.01]))
    screened = list(Screening(solve(*base_problem(from_dict(MODEL), data))).candidates())
    (one,) = [candidate for candidate in screened if candidate.kind == "cubic_drag"]
    assert one.at == "inertias.rotor"
    assert one.parameters["coefficient"] > 0
    assert one.reduction > 100

    estimate = {"value": 0.02, "standard_uncertainty": 0.001, "unit": "N*m*s^3/rad^3"}
    cause = {"kind": "cubic_drag", "at": "inertias.rotor", "parameters": {"coefficient": estimate}}
    assert re.search(
        r"rotor has drag that grows with the cube of speed by .*0\.020", clause(cause | {"alternatives": []})
    )
