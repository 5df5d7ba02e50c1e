"""A ripple tied to the angle of another inertia, in a recording that the truth plant makes of a soft drive."""

from pathlib import Path

import numpy as np
import pytest
from plant.case import make_case
from plant.engine import Chain, simulate
from plant.marks import needs_compiler

from matching.diagnosis.data import prepare_data
from matching.diagnosis.descent import solve
from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.problem import base_problem
from matching.diagnosis.screening import ScreenedCandidate, Screening
from matching.report.diagnosis import content, summary
from modelling.errors import InputError
from modelling.model_file import from_dict, load
from modelling.recordings.read import read_recording
from modelling.recordings.recording import Recording
from modelling.system import System

J, STIFFNESS, DAMPING, DRAG, NOISE = (0.1, 0.3), 2.0, 0.05, 0.05, 0.01
ORDER, AMPLITUDE, PHASE = 5.0, 0.4, 0.7
MODEL = {
    "inertias": {
        "motor": {"J": J[0], "drag": {"value": DRAG, "tolerance": 0.5}},
        "load": {"J": J[1], "drag": {"value": DRAG, "tolerance": 0.5}},
    },
    "shafts": {
        "link": {"between": ["motor", "load"], "stiffness": {"value": 2.1, "tolerance": 0.2}, "damping": DAMPING},
    },
    "inputs": {"torque": {"on": "motor"}},
    "sensors": {
        name: {"measures": measures, "of": name.split("_")[0], "uncertainty": NOISE}
        for name, measures in (("motor_speed", "speed"), ("load_angle", "angle"))
    },
}


@needs_compiler
def test_ripple_over_the_angle_of_the_load_is_named_with_both_places() -> None:
    chain = Chain(2, 1, 1)
    values = {"J": J * 2, "drag": [DRAG] * 4, "k": [STIFFNESS] * 2, "c": [DAMPING] * 2, "second": [1], "on": [0]}
    ripple = {"order": [ORDER, 0], "amplitude": [AMPLITUDE, 0], "phase": [PHASE, 0], "follows": [1, 1]}
    for name, value in (values | {f"ripple_{key}": value for key, value in ripple.items()}).items():
        chain[name][:] = value
    time = np.arange(0, 10, 5e-3)
    torque = 0.9 + 1.5 * np.sin(2 * np.pi * 0.43 * time) + 0.6 * np.sin(2 * np.pi * 1.7 * time + 1)
    motion = simulate(chain, torque[:, None], np.zeros(4), 5e-3)
    noise = NOISE * np.random.default_rng(3).standard_normal((2, len(time)))
    channels = {
        "torque": torque, "motor_speed": motion.speed[:, 0] + noise[0], "load_angle": motion.angle[:, 1] + noise[1],
    }  # fmt: skip
    system = from_dict(MODEL)
    found = diagnose(system, [Recording(time, channels)])
    (cause,) = found.causes
    assert (cause.kind, cause.at) == ("geared_ripple", "inertias.motor+inertias.load")
    for key, value in {"order": ORDER, "amplitude": AMPLITUDE, "phase": PHASE}.items():
        estimate = cause.parameters[key]
        assert abs(estimate.value - value) < 4 * estimate.standard_uncertainty
    assert found.verdict == "explained"
    sentence = summary(content(found))
    assert "The inertia motor has a torque ripple of 0." in sentence
    assert "per turn of the inertia load" in sentence
    (effect,) = found.extended.effects
    assert effect.places == ("inertias.motor", "inertias.load")


def best_ripple(system: System, recording: Recording) -> ScreenedCandidate:
    """The ripple that would take most of what a base fit leaves."""
    data, _ = prepare_data(system, [recording])
    candidates = Screening(solve(*base_problem(system, data))).candidates()
    return max((one for one in candidates if one.kind == "torque_ripple"), key=lambda one: one.reduction)


@needs_compiler
def test_an_order_is_found_though_the_readings_answer_most_where_its_frequency_meets_a_mode() -> None:
    order, stiffness, chain = 8.4, 300.0, Chain(2, 1, 1)  # its mode: 10 Hz, met at 1.2 turns/s
    values = {"J": J * 2, "drag": [DRAG] * 4, "k": [stiffness] * 2, "c": [DAMPING] * 2, "second": [1], "on": [0]}
    ripple = {"order": [order, 0], "amplitude": [0.4, 0], "phase": [PHASE, 0], "follows": [1, 1]}
    for name, value in (values | {f"ripple_{key}": value for key, value in ripple.items()}).items():
        chain[name][:] = value
    time = np.arange(0, 8, 2e-3)
    torque = 1.5 + 0.5 * np.sin(2 * np.pi * 0.3 * time)  # runs up through the mode
    motion = simulate(chain, torque[:, None], np.zeros(4), 2e-3)
    noise = NOISE * np.random.default_rng(3).standard_normal((2, len(time)))
    readings = {"motor_speed": motion.speed[:, 0] + noise[0], "load_angle": motion.angle[:, 1] + noise[1]}
    system = from_dict(MODEL | {"shafts": {"link": MODEL["shafts"]["link"] | {"stiffness": stiffness}}})
    best = best_ripple(system, Recording(time, {"torque": torque} | readings))
    assert best.parameters["order"] == pytest.approx(order, abs=0.02)


@needs_compiler
@pytest.mark.parametrize("seed", [5, 10], ids=["torque that is lacking", "matched filter"])
def test_an_order_is_found_near_the_noise(seed: int, tmp_path: Path) -> None:
    """1.5 times the noise in the worst sensor: the order stands out of one of the two spectra only."""
    case = make_case("test_bed", [("torque_ripple", "inertias.motor")], 1.5, "normal", seed, 3.0, 500.0, moving=True)
    case.write(tmp_path)
    system = load(tmp_path / "model.toml")
    best = best_ripple(system, read_recording(tmp_path / "recording.csv", system))
    assert best.at == "inertias.motor"
    assert best.parameters["order"] == pytest.approx(case.answer["parameters"]["order"], abs=0.05)


@pytest.mark.parametrize("at", ["inertias.motor", ["inertias.motor", "inertias.motor"], ["inertias.motor"] * 3])
def test_two_inertias_are_needed(at) -> None:
    effect = {"kind": "geared_ripple", "at": at, "order": 3, "amplitude": 1.0, "phase": 0.0}
    with pytest.raises(InputError, match=r"two inertias|twice"):
        from_dict(MODEL | {"effects": [effect]})
