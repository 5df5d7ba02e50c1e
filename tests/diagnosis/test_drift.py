"""Values that drift while a machine warms up, hidden by the truth plant."""

from pathlib import Path

import numpy as np
import pytest
from plant.case import make_case
from plant.explicit import scene_of, write_recording
from plant.hidden import SPOKEN, Hidden
from plant.marks import needs_compiler

from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.problem import base_problem
from modelling.modal.modes import modes
from modelling.model_file import from_dict, load
from modelling.recordings.read import read_recording
from modelling.simulation.simulate import simulate


@needs_compiler
@pytest.mark.parametrize(
    ("kind", "at", "seed"),
    [
        ("parameter_drift", "shafts.link.stiffness", 3),
        # nearly a straight line: three times the recording
        pytest.param("input_gain_drift", "inputs.motor_torque", 5, marks=pytest.mark.long),
        pytest.param("sensor_gain_drift", "sensors.load_speed", 6, marks=pytest.mark.long),
    ],
)
def test_a_drift_is_named_with_its_values(kind: str, at: str, seed: int, tmp_path: Path) -> None:
    case = make_case("two_mass", [(kind, at)], 8.0, "normal", seed, 8.0, 250.0)
    case.write(tmp_path)
    system = load(tmp_path / "model.toml")
    found = diagnose(system, [read_recording(tmp_path / "recording.csv", system)])
    assert [(cause.kind, cause.at) for cause in found.causes] == [(SPOKEN.get(kind, kind), at)]
    assert found.verdict == "explained"
    for key, value in case.answer["parameters"].items():
        estimate = found.causes[0].parameters[key]
        assert abs(estimate.value - value) < 4 * estimate.standard_uncertainty
    assert {name for name, _ in found.extended.effects[0].parameters} == {"change", "time_constant"}


@pytest.mark.long
@needs_compiler
def test_a_straight_line_is_a_drift_whose_end_was_not_recorded(tmp_path: Path) -> None:
    """Its slope is known, its change and time constant only together."""
    slope, constant = 0.3 / 8.0, 8000.0  # of the drag per s; s
    hidden = Hidden("parameter_drift", "inertias.load.drag", {"change": slope * constant, "time_constant": constant})
    write_recording(tmp_path, scene_of("two_mass", 5, 8.0, 250.0), [hidden])
    system = load(tmp_path / "model.toml")
    (cause,) = diagnose(system, [read_recording(tmp_path / "recording.csv", system)]).causes
    assert (cause.kind, cause.at) == (hidden.kind, hidden.at)
    change, time_constant = (cause.parameters[key] for key in ("change", "time_constant"))
    assert change.value / time_constant.value == pytest.approx(slope, rel=0.1)
    assert change.standard_uncertainty > 0.3 * change.value


@pytest.mark.long
def test_a_drag_that_falls_by_more_than_its_mean_is_named_beside_dry_friction(tmp_path: Path) -> None:
    """Both at one disc; the model is fitted to a mean drag, of which the fall is more than all."""
    rng = np.random.default_rng(21)
    J, cold, change, constant, dry = 0.5, 0.4, -0.9, 4.0, 1.5
    step, fine = 0.01, 20
    time = np.arange(0, 20, step)
    torque = np.interp(time, np.arange(0, 20.5, 0.5), rng.uniform(-12, 12, 41))
    speed, now = np.zeros(len(time)), 0.0
    for i in range(len(time) - 1):
        for k in range(fine):  # midpoint rule; hard friction holds what it brings to rest
            t, drive = time[i] + k * step / fine, torque[i] + (torque[i + 1] - torque[i]) * (k + 0.5) / fine
            drag = cold * (1 + change * (1 - np.exp(-(t + step / fine / 2) / constant)))
            way, half = np.sign(now or drive), step / fine / 2 / J
            middle = now + half * (drive - drag * now - dry * way)
            after = now + 2 * half * (drive - drag * middle - dry * way)
            now = 0.0 if abs(drive) < dry and after * way <= 0 else after
        speed[i + 1] = now
    measured = speed + 0.02 * rng.standard_normal(len(time))
    rows = [f"{t:.2f},{u:.9g},{w:.9g}" for t, u, w in zip(time, torque, measured, strict=True)]
    (tmp_path / "r.csv").write_text("\n".join(["time [s],drive [N*m],speed [rad/s]", *rows]) + "\n")
    system = from_dict({
        "inertias": {"disc": {"J": J, "drag": {"value": 0.2, "tolerance": 1.0}}},
        "inputs": {"drive": {"on": "disc"}},
        "sensors": {"speed": {"measures": "speed", "of": "disc", "uncertainty": 0.02}},
    })  # fmt: skip
    found = diagnose(system, [read_recording(tmp_path / "r.csv", system)])
    causes = {(cause.kind, cause.at): cause.parameters for cause in found.causes}
    assert set(causes) == {("parameter_drift", "inertias.disc.drag"), ("coulomb_friction", "inertias.disc")}
    assert found.verdict == "explained"
    drift, friction = causes["parameter_drift", "inertias.disc.drag"], causes["coulomb_friction", "inertias.disc"]
    for estimate, value in ((drift["change"], change), (drift["time_constant"], constant), (friction["torque"], dry)):
        assert abs(estimate.value - value) < 4 * estimate.standard_uncertainty


CHANGE, WARM, DRAG = 0.5, 3.0, 2.0  # relative, s, N·m·s/rad


def brake():
    return from_dict({
        "inertias": {"disc": {"J": 4.0, "drag": {"value": DRAG, "tolerance": 0.5}}},
        "inputs": {"drive": {"on": "disc"}},
        "sensors": {"speed": {"measures": "speed", "of": "disc"}},
        "effects": [{"kind": "parameter_drift", "at": "inertias.disc.drag", "change": CHANGE, "time_constant": WARM}],
    })  # fmt: skip


def test_a_part_of_a_recording_begins_as_warm_as_the_machine_is_then() -> None:
    time = np.linspace(5.0, 6.0, 101)
    data = FitData((Segment(time, np.zeros((101, 1)), np.ones((101, 1))),), np.array([0.1]))
    problem, v = base_problem(brake(), data)
    (start,) = problem.unpack(v)[1]
    assert start[-1] == pytest.approx(1 - np.exp(-5.0 / WARM))
    assert len(v) == 2  # drag and speed: how warm it is at the start is not free


def test_steady_motion_is_that_of_the_warm_machine() -> None:
    time = np.linspace(0, 1, 101)
    done = simulate(brake(), time, {"drive": np.full(101, 6.0)}, start="steady")
    assert done["speed"] == pytest.approx(6.0 / (DRAG * (1 + CHANGE)), rel=1e-6)


def test_modes_at_rest_are_those_of_the_cold_machine() -> None:
    cold = {
        "inertias": {"a": {"J": 0.4}, "b": {"J": 1.5}},
        "shafts": {"link": {"between": ["a", "b"], "stiffness": 300.0}},
        "inputs": {"drive": {"on": "a"}},
    }
    drift = {"kind": "parameter_drift", "at": "shafts.link.stiffness", "change": CHANGE, "time_constant": WARM}
    frequencies = modes(from_dict(cold | {"effects": [drift]})).frequencies
    assert frequencies == pytest.approx(modes(from_dict(cold)).frequencies, rel=1e-9)
