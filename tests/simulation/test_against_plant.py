"""Laws of the program against the truth plant, which shares no code with it: a tyre that slips, an imposed motion, a
table."""

import numpy as np
import pytest
from plant.build import chain_of
from plant.engine import Chain, compiler
from plant.engine import simulate as plant_motion
from plant.hidden import Hidden
from plant.systems import Drive

from modelling.model_file import from_dict
from modelling.simulation.simulate import simulate

pytestmark = pytest.mark.skipif(not compiler(), reason="needs a C compiler")
TIME = np.arange(0, 2, 1e-3)
J, DRAG, STIFFNESS, DAMPING, RATIO = (0.9, 40.0), (0.05, 2.0), 6000.0, 15.0, 1.3
SLIP_STIFFNESS, PEAK, SHAPE, SPEED = 9000.0, 400.0, 1.65, 12.0


def chain(**laws):
    plant = Chain(2, 1, 2)
    values = {"J": J * 2, "drag": DRAG * 2, "k": STIFFNESS, "c": DAMPING, "ratio": RATIO, "second": 1, "on": [0, 1]}
    for name, value in (values | laws).items():
        plant[name][:] = value
    return plant


def system(effect):
    return from_dict(
        {
            "inertias": {name: {"J": j, "drag": d} for name, j, d in zip(("wheel", "body"), J, DRAG, strict=True)},
            "shafts": {
                "tyre": {"between": ["wheel", "body"], "stiffness": STIFFNESS, "damping": DAMPING, "ratio": RATIO}
            },
            "inputs": {"drive": {"on": "wheel"}, "road": {"on": "body"}},
            "sensors": {
                "wheel": {"measures": "speed", "of": "wheel"},
                "body": {"measures": "speed", "of": "body"},
                "torque": {"measures": "torque", "of": "tyre"},
            },
            "effects": [effect],
        }
    )


def agree(program, plant, tolerance):
    for name, expected in zip(("wheel", "body", "torque"), (*plant.speed.T, plant.torque[:, 0]), strict=True):
        assert np.abs(program[name] - expected).max() < tolerance * np.ptp(expected), name


def test_a_tyre_slips_as_the_plants_does():
    """From small slips to a torque a third beyond the peak, and back."""
    drive = np.interp(TIME, [0, 0.5, 0.6, 1.1, 1.2], [0, 0.3, 1.35, 1.35, -0.3]) * PEAK / RATIO
    road = 30 * np.sin(2 * np.pi * 3 * TIME)
    plant = plant_motion(
        chain(slip_stiffness=SLIP_STIFFNESS, slip_peak=PEAK, slip_shape=SHAPE),
        np.stack([drive, road], axis=1),
        np.array([0, 0, RATIO * SPEED, SPEED]),
        1e-3,
    )
    law = {"kind": "tyre_slip", "at": "shafts.tyre", "slip_stiffness": SLIP_STIFFNESS, "peak": PEAK}
    start = {"speed(wheel)": RATIO * SPEED, "speed(body)": SPEED}
    program = simulate(system(law), TIME, {"drive": drive, "road": road}, start=start)
    assert plant.torque.max() > 0.99 * PEAK
    agree(program, plant, 1e-3)


def test_an_imposed_motion_drives_the_other_inertia_as_the_plants_does():
    """The plant has the recorded speed to the bit; the program's filter of 3000 rad/s leaves 0.2 %."""
    drive = 20 * np.sin(2 * np.pi * 1.5 * TIME)
    road = SPEED * (1 - np.cos(2 * np.pi * 2 * TIME))
    plant = plant_motion(chain(imposed=[0, 1]), np.stack([drive, road], axis=1), np.zeros(4), 1e-3)
    np.testing.assert_allclose(plant.speed[:, 1], road, atol=1e-9 * SPEED)
    program = simulate(system({"kind": "imposed_motion", "at": "inertias.body"}), TIME, {"drive": drive, "road": road})
    agree(program, plant, 2e-3)


@pytest.mark.parametrize(
    ("at", "axis", "points"),
    [
        ("inertias.body", "speed", [-0.2, 0.0, 0.3, 0.6]),
        ("inertias.wheel", "angle", [-0.2, 0.05, 0.1, 0.4]),
        ("shafts.tyre", "twist", [-8e-3, -2e-3, 1e-3, 6e-3]),
    ],
)
def test_a_table_of_torque_is_that_of_the_plant(at, axis, points):
    torques = [25.0, -10.0, 5.0, -40.0]
    hidden = {f"{axis}_{i}": x for i, x in enumerate(points, 1)} | {f"torque_{i}": y for i, y in enumerate(torques, 1)}
    values = {f"inertias.{name}.{key}": v for name, j, d in zip(("wheel", "body"), J, DRAG, strict=True)
              for key, v in (("J", j), ("drag", d))}  # fmt: skip
    values |= {"shafts.tyre.stiffness": STIFFNESS, "shafts.tyre.damping": DAMPING, "shafts.tyre.ratio": RATIO}
    drive = Drive("", "", ["wheel", "body"], {"tyre": ("wheel", "body")}, {"drive": "wheel", "road": "body"}, {},
                  values, {})  # fmt: skip
    inputs = np.stack([60 * np.sin(2 * np.pi * 1.5 * TIME), 40 * np.cos(2 * np.pi * 0.7 * TIME)], axis=1)
    plant = plant_motion(chain_of(drive, [Hidden("table", at, hidden)]), inputs, np.zeros(4), 1e-3)
    passed = {"speed": plant.speed[:, 1], "angle": plant.angle[:, 0],
              "twist": plant.angle[:, 0] / RATIO - plant.angle[:, 1]}[axis]  # fmt: skip
    assert passed.min() < points[1] < points[2] < passed.max()
    law = {"kind": "table", "at": at, axis: points, "torque": torques}
    program = simulate(system(law), TIME, {"drive": inputs[:, 0], "road": inputs[:, 1]})
    agree(program, plant, 1e-4)
    without = plant_motion(chain_of(drive, []), inputs, np.zeros(4), 1e-3)
    assert np.abs(plant.speed - without.speed).max() > 0.05 * np.ptp(plant.speed)


CHANGE, WARM = -0.4, 0.7  # relative, s


@pytest.mark.parametrize(
    ("law", "at", "kind"),
    [
        ("k", "shafts.tyre.stiffness", "parameter_drift"),
        ("c", "shafts.tyre.damping", "parameter_drift"),
        ("drag", "inertias.body.drag", "parameter_drift"),
        ("gain", "inputs.drive", "gain_drift"),
    ],
)
def test_a_value_that_drifts_changes_as_the_plants_does(law, at, kind):
    """From the start of the recording on, exponentially towards the changed value."""
    inputs = np.stack([60 * np.sin(2 * np.pi * 2.5 * TIME), 40 * np.cos(2 * np.pi * 0.7 * TIME)], axis=1)
    start = np.array([0, 0, RATIO * SPEED, SPEED])
    names = {f"{law}_change": CHANGE, f"{law}_warm": WARM}
    component = {"gain": [1, 0], "drag": [0, 1]}.get(law, [1])
    drifting = chain(**{name: np.array(component) * value for name, value in names.items()})
    plant = plant_motion(drifting, inputs, start, 1e-3)
    effect = {"kind": kind, "at": at, "change": CHANGE, "time_constant": WARM}
    named = {"speed(wheel)": RATIO * SPEED, "speed(body)": SPEED}
    program = simulate(system(effect), TIME, {"drive": inputs[:, 0], "road": inputs[:, 1]}, start=named)
    agree(program, plant, 1e-4)
    without = plant_motion(chain(), inputs, start, 1e-3)
    moved = [np.abs(a - b).max() / np.ptp(a) for a, b in ((plant.torque, without.torque), (plant.speed, without.speed))]
    assert max(moved) > 1e-3
