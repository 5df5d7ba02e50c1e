"""A machine that gives another torque than recorded about one speed: no law of friction or drag may stand for its map.

Own semi-implicit steps of 0.1 ms; a drag that is really there beside a torque that no kind has is the counter-example.
"""

import numpy as np
import pytest

from matching.diagnosis.diagnose import diagnose
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording

STEP, EVERY, SECONDS = 1e-4, 40, 12.0
NOISE = {"motor_speed": 0.03, "load_speed": 0.02, "link_torque": 0.06}


def drawn(seed: int, dip: float, quadratic: float, unknown: float) -> tuple[dict, Recording]:
    """A motor that pulls and pushes over a range of speeds; ``dip`` of its torque is missing about a middle speed,
    its drag grows with ``quadratic`` times the square of the speed, an ``unknown`` torque (N·m, 7 Hz) acts on it."""
    rng = np.random.default_rng(seed)
    motor, load, drag = rng.uniform(0.05, 0.15), rng.uniform(0.6, 1.4), rng.uniform(0.15, 0.25)
    k, c = rng.uniform(250, 450), rng.uniform(0.3, 0.8)
    t = np.arange(0, SECONDS, STEP)
    waves = zip(rng.uniform(0.08, 3.0, 8), rng.uniform(0, 6.3, 8), strict=True)
    torque = 9 + sum(3.5 * np.sin(2 * np.pi * f * t + phase) for f, phase in waves)
    centre, width = rng.uniform(35, 50), rng.uniform(9, 14)
    other = unknown * np.sin(2 * np.pi * 7 * t + rng.uniform(0, 6))
    out, twist, w1, w2 = np.empty((len(t), 3)), 0.0, 0.0, 0.0
    for i, u in enumerate(torque):
        link = k * twist + c * (w1 - w2)
        out[i] = w1, w2, link
        acting = u * (1 - dip * np.exp(-(((w1 - centre) / width) ** 2))) + other[i]
        w1 += STEP * (acting - link - 0.02 * w1 - quadratic * w1 * abs(w1)) / motor
        w2 += STEP * (link - drag * w2) / load
        twist += STEP * (w1 - w2)
    few = slice(None, None, EVERY)
    channels = {
        name: values + NOISE[name] * rng.standard_normal(len(values))
        for name, values in zip(NOISE, out[few].T, strict=True)
    }

    def known(value: float) -> dict:
        return {"value": value * rng.uniform(0.85, 1.15), "tolerance": 0.5}

    model = {
        "inertias": {"motor": {"J": motor, "drag": known(0.02)}, "load": {"J": load, "drag": known(drag)}},
        "shafts": {"link": {"between": ["motor", "load"], "stiffness": known(k), "damping": known(c)}},
        "inputs": {"drive": {"on": "motor"}},
        "sensors": {
            "motor_speed": {"measures": "speed", "of": "motor", "uncertainty": NOISE["motor_speed"]},
            "load_speed": {"measures": "speed", "of": "load", "uncertainty": NOISE["load_speed"]},
            "link_torque": {"measures": "torque", "of": "link", "uncertainty": NOISE["link_torque"]},
        },
    }
    return model, Recording(t[few], channels | {"drive": torque[few]}, (), "made", {})


@pytest.mark.long
@pytest.mark.parametrize("seed", [21, 22, 23])
def test_no_law_of_the_machine_stands_for_a_dip_in_its_map(seed: int) -> None:
    model, recording = drawn(seed, 0.25, 0.0, 0.0)
    found = diagnose(from_dict(model), [recording])
    assert not [cause for cause in found.causes if cause.in_model]


@pytest.mark.long
@pytest.mark.parametrize("seed", [31, 32])
def test_a_drag_that_is_there_stays_beside_a_torque_that_no_kind_has(seed: int) -> None:
    model, recording = drawn(seed, 0.0, 0.003, 0.5)
    found = diagnose(from_dict(model), [recording])
    drag = next(cause for cause in found.causes if cause.kind == "quadratic_drag")
    assert (drag.at, drag.in_model) == ("inertias.motor", True)
    assert drag.parameters["coefficient"].value == pytest.approx(0.003, rel=0.2)
