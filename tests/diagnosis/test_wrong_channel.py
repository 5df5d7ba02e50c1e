"""A channel that is wrong in itself, in a way that no kind has: the model meets all others without it."""

from collections.abc import Callable

import numpy as np
import pytest

from matching.diagnosis.diagnose import diagnose
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording

STEP, EVERY, SECONDS = 1e-4, 20, 8.0
NOISE = {"motor_speed": 0.03, "load_speed": 0.02, "link_torque": 0.08}


CLIPPED = "link_torque is at the end of its range"


def drawn(seed: int, wrong: Callable[[dict[str, np.ndarray]], np.ndarray]) -> tuple[dict, Recording]:
    """Two inertias, by small explicit steps; the link torque is recorded as ``wrong`` has it."""
    rng = np.random.default_rng(seed)
    motor, load, drag = rng.uniform(0.05, 0.15), rng.uniform(0.5, 1.5), rng.uniform(0.1, 0.3)
    stiffness, damping = rng.uniform(200, 500), rng.uniform(0.3, 1.0)
    time = np.arange(0, SECONDS, STEP)
    waves = zip(rng.uniform(0.3, 9.0, 7), rng.uniform(0, 6.3, 7), strict=True)
    torque = 8 + sum(2.5 * np.sin(2 * np.pi * f * time + phase) for f, phase in waves)
    out, turned, w1, w2 = np.empty((len(time), 3)), 0.0, 0.0, 0.0
    for i, u in enumerate(torque):
        shaft = stiffness * turned + damping * (w1 - w2)
        out[i] = w1, w2, shaft
        w1 += STEP * (u - shaft - 0.01 * w1) / motor
        w2 += STEP * (shaft - drag * w2) / load
        turned += STEP * (w1 - w2)
    few = slice(None, None, EVERY)
    clean = dict(zip(NOISE, out[few].T, strict=True))
    clean["link_torque"] = wrong(clean)
    channels = {name: values + NOISE[name] * rng.standard_normal(len(values)) for name, values in clean.items()}

    def known(value: float) -> dict:
        return {"value": value * rng.uniform(0.9, 1.1), "tolerance": 0.3}

    model = {
        "inertias": {"motor": {"J": known(motor), "drag": 0.01}, "load": {"J": known(load), "drag": known(drag)}},
        "shafts": {"link": {"between": ["motor", "load"], "stiffness": known(stiffness), "damping": known(damping)}},
        "inputs": {"drive": {"on": "motor"}},
        "sensors": {
            "motor_speed": {"measures": "speed", "of": "motor", "uncertainty": NOISE["motor_speed"]},
            "load_speed": {"measures": "speed", "of": "load", "uncertainty": NOISE["load_speed"]},
            "link_torque": {"measures": "torque", "of": "link", "uncertainty": NOISE["link_torque"]},
        },
    }
    return model, Recording(time[few], channels | {"drive": torque[few]}, (), "made", {})


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        pytest.param(
            lambda c: np.clip(c["link_torque"], None, np.quantile(c["link_torque"], 0.8)), CLIPPED, id="clipped"
        ),
        pytest.param(
            lambda c: np.sign(c["link_torque"]) * np.maximum(np.abs(c["link_torque"]) - 3, 0),
            "look at its",
            id="dead band",
        ),
    ],
)
@pytest.mark.long
@pytest.mark.parametrize("seed", [3, 71])
def test_the_channel_is_named_and_nothing_of_the_drivetrain(wrong: Callable, named: str, seed: int) -> None:
    model, recording = drawn(seed, wrong)
    found = diagnose(from_dict(model), [recording])
    assert found.verdict == "unexplained"
    (note,) = (note for note in found.notes if note.startswith("without link_torque"))
    clipped = max(recording["link_torque"]) - 8 * NOISE["link_torque"]
    assert named in note
    if named == CLIPPED:
        assert float(note.rsplit(", ", 1)[1].split()[0]) == pytest.approx(clipped, rel=0.05)
    assert all(cause.at == "sensors.link_torque" for cause in found.causes)
    assert found.errors["load_speed"].after < 1.5 * NOISE["load_speed"]
