"""A drive that nothing holds drifts away by whatever torque its model lacks, hundreds of times the noise."""

import numpy as np
import pytest
from plant.marks import needs_compiler

from matching.diagnosis.diagnose import diagnose
from modelling.model_file import load
from modelling.recordings.read import read_recording

pytestmark = needs_compiler

MODEL = """
title = "drive"
[inertias.motor]
drag = 0.002
[inertias.motor.J]
value = 0.055
lower = 0.04
upper = 0.06
[inertias.load]
drag = 0.02
[inertias.load.J]
value = 0.45
lower = 0.4
upper = 0.6
[shafts.link]
between = ["motor", "load"]
damping = 0.4
[shafts.link.stiffness]
value = 900.0
lower = 700.0
upper = 1300.0
[inputs.drive]
on = "motor"
[inputs.brake]
on = "load"
[sensors.motor_speed]
measures = "speed"
of = "motor"
uncertainty = 0.01
[sensors.load_speed]
measures = "speed"
of = "load"
uncertainty = 0.01
[sensors.link_torque]
measures = "torque"
of = "link"
uncertainty = 0.05
"""
FRICTION, RATE, STEPS, SECONDS = 4.0, 250.0, 40, 6.0


def recorded(seed):
    """Own fine steps: semi-implicit Euler, friction that takes what turns the motor within a step, at most its size."""
    rng = np.random.default_rng(seed)
    J, k, c, d = (0.05, 0.5), 1000.0, 0.4, (0.002, 0.02)
    time = np.arange(0, SECONDS, 1 / RATE)
    lines = rng.uniform(0.2, 20, 12)
    waves = np.sin(2 * np.pi * lines * time[:, None] + rng.uniform(0, 2 * np.pi, 12)).sum(axis=1)
    torques = np.column_stack([16 * np.sin(2 * np.pi * 0.4 * time) + 2.5 * waves, 3 * np.cos(2 * np.pi * 0.9 * time)])
    h, w, twist, rows = 1 / RATE / STEPS, np.zeros(2), 0.0, []
    for n, now in enumerate(torques):
        rows.append((time[n], *now, *w, k * twist + c * (w[0] - w[1])))
        following = torques[min(n + 1, len(torques) - 1)]
        for step in range(STEPS):
            put = now + (following - now) * (step + 0.5) / STEPS
            shaft = k * twist + c * (w[0] - w[1])
            free = w[0] + h * (put[0] - shaft - d[0] * w[0]) / J[0]
            w = np.array([
                np.sign(free) * max(abs(free) - h * FRICTION / J[0], 0.0),
                w[1] + h * (put[1] + shaft - d[1] * w[1]) / J[1],
            ])  # fmt: skip
            twist += h * (w[0] - w[1])
    rows = np.array(rows)
    rows[:, 3:] += rng.standard_normal((len(rows), 3)) * (0.01, 0.01, 0.05)
    return rows


@pytest.mark.long
@pytest.mark.parametrize("seed", [5])
def test_friction_is_named_where_the_model_drifts_away(tmp_path, seed):
    (tmp_path / "model.toml").write_text(MODEL)
    names = "time [s],drive [N*m],brake [N*m],motor_speed [rad/s],load_speed [rad/s],link_torque [N*m]"
    np.savetxt(tmp_path / "recording.csv", recorded(seed), delimiter=",", header=names, comments="")
    system = load(tmp_path / "model.toml")
    found = diagnose(system, [read_recording(tmp_path / "recording.csv", system)])
    assert found.errors["load_speed"].before_holdout > 100 * 0.01
    first = found.causes[0]
    assert (first.kind, first.at) == ("coulomb_friction", "inertias.motor")
    assert first.parameters["torque"].value == pytest.approx(FRICTION, rel=0.05)
