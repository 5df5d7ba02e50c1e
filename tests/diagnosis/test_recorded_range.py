"""Causes lie within what the recording has shown, and values at its ends are refused."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from matching.diagnosis.causes import TORQUE_MARGIN, ExtendedModel, recorded_range, simulated_motion
from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import solve
from matching.diagnosis.problem import base_problem
from modelling.model_file import from_dict

SPEED, TORQUE, DRAG, DURATION = 12.0, 5.4, 0.45, 4.0
NAME = "inertias.rotor.coulomb_friction.torque"


@pytest.fixture(scope="module")
def model() -> ExtendedModel:
    """A rotor at constant speed: the torque is that of its drag."""
    system = from_dict({
        "inertias": {"rotor": {"J": 0.02, "drag": {"value": DRAG, "tolerance": 0.5}}},
        "inputs": {"motor": {"on": "rotor"}},
        "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": 0.1}},
    })  # fmt: skip
    time = np.linspace(0, DURATION, 401)
    readings = np.full((401, 1), SPEED)
    data = FitData((Segment(time, np.full((401, 1), TORQUE), readings),), np.array([0.1]))
    fit = solve(*base_problem(system, data))
    recorded = recorded_range(system, data, simulated_motion(fit))
    return ExtendedModel(system, (), {}, {}, recorded=recorded)


def test_range_of_a_steady_recording(model: ExtendedModel) -> None:
    recorded = model.recorded
    assert recorded is not None
    assert recorded.duration == DURATION
    assert recorded.torque["rotor"] == pytest.approx(TORQUE_MARGIN * TORQUE)
    assert (recorded.largest_reading["speed"], recorded.width["speed"]) == (SPEED, 0.0)
    assert recorded.turns["rotor"] == pytest.approx(SPEED * DURATION / (2 * np.pi), rel=1e-3)


@pytest.mark.parametrize(
    ("kind", "at", "parameters", "key", "expected"),
    [
        ("coulomb_friction", "inertias.rotor", {"torque": 1.0}, "torque", (0.0, TORQUE_MARGIN * TORQUE)),
        ("constant_torque", "inertias.rotor", {"torque": 1.0}, "torque", (-8.1, 8.1)),
        ("sensor_offset", "sensors.speed", {"offset": 1.0}, "offset", (-SPEED, SPEED)),
        ("sensor_delay", "sensors.speed", {"delay": 0.1}, "delay", (0.0, DURATION / 4)),
        ("lag", "sensors.speed", {"time_constant": 0.6}, "time_constant", (0.0025, DURATION / 4)),
    ],
)
def test_bounds_of_a_cause(model: ExtendedModel, kind: str, at: str, parameters: dict, key: str, expected) -> None:
    extended = model.with_cause(kind, at, parameters, 0.01)
    assert extended.bounds[extended.causes[0].names()[key]] == pytest.approx(expected)


@pytest.mark.parametrize(("turns", "path", "lowest"), [(0.8, 11.0, 1.25), (8.0, 8.0, 0.25), (8.0, 40.0, 0.125)])
def test_orders_are_those_whose_period_was_recorded_as_a_whole_and_twice(
    model: ExtendedModel, turns: float, path: float, lowest: float
) -> None:
    """An axis that swings over 0.8 turns eleven turns long shows no order of 0.1, though one period fits its path."""
    assert model.recorded is not None
    recorded = replace(model.recorded, turns={"rotor": path}, range_of_turns={"rotor": turns})
    ripple = {"order": 2.0, "amplitude": 0.1, "phase": 0.0}
    extended = replace(model, recorded=recorded).with_cause("torque_ripple", "inertias.rotor", ripple, 0.01)
    low, _ = extended.bounds["inertias.rotor.torque_ripple.order"]
    assert low == pytest.approx(max(lowest, 1.7))  # a fit keeps within 0.3 of its guess
    names = extended.causes[0].names()
    at_end = {names["order"]: lowest, names["amplitude"]: 0.1, names["phase"]: 0.0}
    assert extended.not_taken(fit_of(extended, at_end)) == "beyond_recording"


def fit_of(extended: ExtendedModel, values: dict[str, float]) -> Any:
    """A fit that ended there, within the bounds that the model has for it."""
    return SimpleNamespace(values=values, problem=SimpleNamespace(bounds=extended.bounds))


def test_values_at_the_end_of_the_recorded_range_are_refused(model: ExtendedModel) -> None:
    extended = model.with_cause("coulomb_friction", "inertias.rotor", {"torque": 1.0}, 0.01)
    reasons = [extended.not_taken(fit_of(extended, {NAME: torque})) for torque in (0.0, 3.0, 8.1)]
    assert reasons == ["", "", "beyond_recording"]
    free = replace(extended, recorded=None, bounds={NAME: (0.0, np.inf)})
    assert free.not_taken(fit_of(free, {NAME: 8.1})) == ""


def test_friction_that_breaks_away_at_less_than_it_slides_is_not_physical(model: ExtendedModel) -> None:
    values = {"torque": 2.0, "breakaway": 2.8e-14, "speed": 0.5}
    extended = model.with_cause("stribeck_friction", "inertias.rotor", values, 0.01)
    names = extended.causes[0].names()
    assert extended.not_taken(fit_of(extended, {names[key]: v for key, v in values.items()})) == "not_physical"
    values["breakaway"] = 3.0
    assert extended.not_taken(fit_of(extended, {names[key]: v for key, v in values.items()})) == ""


def test_range_of_two_segments_with_a_gear_and_two_shafts() -> None:
    """Torques on an inertia: its shafts and all inputs over the gear, or what accelerates it, whichever is larger."""
    system = from_dict({
        "inertias": {"motor": {"J": 0.1}, "pinion": {"J": 0.1}, "hub": {"J": 50.0}, "rim": {"J": 0.3}},
        "gears": {"final": {"between": ["motor", "pinion"], "ratio": 0.25}},
        "shafts": {
            "side": {"between": ["pinion", "hub"], "stiffness": 100.0},
            "tyre": {"between": ["hub", "rim"], "stiffness": 100.0},
        },
        "inputs": {"torque": {"on": "motor"}, "brake": {"on": "rim"}},
        "sensors": {"speed": {"measures": "speed", "of": "motor"}, "idle": {"measures": "speed", "of": "rim"}},
    })  # fmt: skip
    short, long = np.arange(3) * 1.0, 10 + np.arange(5) * 1.0
    readings = [
        np.array([[1.0, np.nan], [-7.0, np.nan], [2.0, np.nan]]),
        np.array([[np.nan, np.nan]] * 4 + [[3.0, np.nan]]),
    ]
    segments = tuple(
        Segment(time, np.zeros((len(time), 2)), values) for time, values in zip((short, long), readings, strict=True)
    )
    samples = np.arange(8.0)
    angle = 2 * np.pi * np.array([0.0, 0.5, 0.0, 9.0, 9.25, 9.5, 9.75, 10.0])
    motion = SimpleNamespace(
        segments=(slice(0, 3), slice(3, 8)), angle={"motor": angle},
        torque={"side": samples - 6, "tyre": 2 - 0.5 * samples},
        input={"torque": -3 * np.ones(8), "brake": np.append(np.zeros(7), 0.5)},
        acceleration={"motor": samples, "pinion": samples, "hub": -samples, "rim": samples},
        value={f"inertias.{part.name}.J": part.J.value for part in system.inertias},
    )  # fmt: skip
    found = recorded_range(system, FitData(segments, np.ones(2)), motion)
    assert found.duration == 4.0  # of the longer segment
    inputs, side, tyre = 4 * 3.5, 6.0, 2.0
    wanted = {"motor": inputs, "pinion": inputs + side, "hub": 50.0 * 7.0, "rim": inputs + tyre}
    assert found.torque == pytest.approx({name: 1.5 * torque for name, torque in wanted.items()})
    assert found.largest_reading == {"speed": 7.0, "idle": 0.0}
    assert found.width == {"speed": 10.0, "idle": 0.0}
    assert found.turns["motor"] == pytest.approx(1.0 + 1.0)  # path within the segments, the jump between them not
    assert found.range_of_turns["motor"] == pytest.approx(1.0)
