"""Models, beds and controllers as state spaces, against responses and a loop stepped by hand."""

from pathlib import Path

import numpy as np
import pytest

import rigmatch as rm
from matching.match.loop import control_law, linear_bed
from modelling.errors import InputError

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_a_model_answers_as_its_responses():
    path = EXAMPLES / "road_to_rig" / "rig.toml"
    space, f = rm.to_ss(path), np.array([0.7, 8.0, 60.0])
    answer = (
        space.C @ np.linalg.solve(2j * np.pi * f[:, None, None] * np.eye(len(space.A)) - space.A, space.B) + space.D
    )
    response = rm.response(path, f)
    assert (space.inputs, space.outputs, space.sample_time) == (response.inputs, response.sensors, 0.0)
    np.testing.assert_allclose(answer, response.values, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("dead_time", [0.0005, 0.0024, 0.005])
@pytest.mark.parametrize("example", ["road_to_rig/case.toml", "road_to_rig/observer.toml"])
def test_bed_and_controller_close_by_their_names(example, dead_time, tmp_path):
    """A pushed loop of both, against the control law as it runs on a bed of small continuous steps."""
    text = (EXAMPLES / example).read_text()
    for name in ("vehicle.toml", "rig.toml"):
        (tmp_path / name).write_text((EXAMPLES / "road_to_rig" / name).read_text())
    (tmp_path / "case.toml").write_text(text.replace("dead_time = 0.003", f"dead_time = {dead_time}", 1))
    case = rm.load_case(tmp_path / "case.toml")
    assert case.loop["dead_time"] == dead_time
    bed, controller = rm.to_ss(case, "bed"), rm.to_ss(case, "controller")
    assert bed.sample_time == controller.sample_time == case.loop["sample_time"]
    assert set(controller.outputs) <= set(bed.inputs)
    read = [bed.outputs.index(name) for name in controller.inputs if name in bed.outputs]
    known = [controller.inputs.index(name) for name in controller.inputs if name not in bed.outputs]
    assert len(read) + len(known) == len(controller.inputs)
    push, steps = 20.0, 60
    at, k = bed.inputs.index("motor_torque"), len(controller.outputs)
    u, x, c = np.zeros(len(bed.inputs)), np.zeros(len(bed.A)), np.zeros(len(controller.A))
    w = np.array([push if controller.inputs[i] == "motor_torque" else 0.0 for i in known])
    u[at] = push
    by_names = []
    for _ in range(steps):
        y = np.concatenate([(bed.C @ x + bed.D @ u)[read], w])
        u[:k] = controller.C @ c + controller.D @ y
        c, x = controller.A @ c + controller.B @ y, bed.A @ x + bed.B @ u
        by_names.append(u[:k].copy())
    np.testing.assert_allclose(np.array(by_names), _stepped(case, push, steps), rtol=2e-3, atol=2e-3)


def _stepped(case, push, steps, fine=40):
    """Commands (t, k) of the law on the rig, lags and delay stepped by Runge and Kutta, ``fine`` steps a sample."""
    law, rig, loop = control_law(linear_bed(case)), rm.to_ss(case.rig), case.loop
    h, k = loop["sample_time"] / fine, len(loop.dynamometers)
    drives = [rig.inputs.index(dyno.torque_input) for dyno in loop.dynamometers]
    outputs = [rig.outputs.index(name) for name in law.sensors]
    late = round((loop["dead_time"] - loop["sample_time"] / 2) / h)
    n = len(rig.A)

    def rate(z, command):
        torque = np.zeros(len(rig.inputs))
        torque[rig.inputs.index("motor_torque")], torque[drives] = push, z[n : n + k]
        flange = (rig.C @ z[:n])[outputs[:k]]
        return np.concatenate([
            rig.A @ z[:n] + rig.B @ torque, (command - z[n : n + k]) / loop["inverter_lag"],
            (flange - z[n + k :]) / loop["torque_sensor_lag"],
        ])  # fmt: skip

    z, state = np.zeros(n + 2 * k), np.zeros(len(law.A))
    sent = [np.zeros(k)] * max(late, 1)
    known = np.array([push if name == "motor_torque" else 0.0 for name in law.known])
    commands = []
    for _ in range(steps):
        readings = (rig.C @ z[:n])[outputs]
        readings[:k] = z[n + k :]
        command, state = law.step(state, readings, known, np.full(k, 1e9))
        commands.append(command)
        for _ in range(fine):
            sent.append(command)
            acting = sent[len(sent) - 1 - late]
            a = rate(z, acting)
            b = rate(z + h / 2 * a, acting)
            c = rate(z + h / 2 * b, acting)
            z = z + h / 6 * (a + 2 * b + 2 * c + rate(z + h * c, acting))
    return np.array(commands)


def test_unknown_parts_are_said():
    case = rm.load_case(EXAMPLES / "road_to_rig" / "case.toml")
    with pytest.raises(InputError, match="bed"):
        rm.to_ss(case, "beds")
    with pytest.raises(InputError, match="of a model"):
        rm.to_ss(case.rig, "bed")
