"""Every modal figure of the reference case, from its files, against the published and recomputed values."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from modelling.equations.casadi_code import compiled
from modelling.modal.modes import damped_modes, modes
from modelling.model_file import load

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig"
MODES = {
    "vehicle": [0.0, 1.600, 8.439, 45.642, 46.120, 74.29, 124.7, 124.7, 479.5],
    "rig": [0.0, 16.703, 17.946, 74.05, 334.3, 335.0, 480.0],
}


@pytest.mark.parametrize("name", MODES)
def test_every_modal_figure(name):
    found = modes(load(CASE / f"{name}.toml"))
    np.testing.assert_allclose(found.frequencies, MODES[name], rtol=1e-3)
    assert found.frequencies[0] == 0.0


@pytest.mark.parametrize("name", MODES)
def test_frequencies_from_the_equations(name):
    """The same from the linearised equations of motion, tyre slip and damping left out."""
    system = dataclasses.replace(load(CASE / f"{name}.toml"), effects=())
    model = compiled(system)
    p = model.vector({key: 0.0 for key in model.parameters if key.endswith(("damping", "drag"))})
    A = model.jacobians(np.zeros(2 * model.n), np.zeros(len(model.inputs)), p, 0)[0].full()
    squares = np.sort(-np.linalg.eigvals(A[model.n :, : model.n]).real)
    frequencies = np.sqrt(np.abs(squares)) / (2 * np.pi)
    np.testing.assert_allclose(frequencies[1:], MODES[name][1:], rtol=1e-3)
    assert frequencies[0] < 1e-4


@pytest.mark.parametrize("name", MODES)
def test_damped_modes_stay_near_the_targets(name):
    """Damping is ours; it must leave the modes that are matched where they are."""
    found = damped_modes(load(CASE / f"{name}.toml"))
    np.testing.assert_allclose(found.frequencies[1:3], MODES[name][1:3], rtol=0.005)
    assert np.all((found.damping_ratios[1:3] > 0.002) & (found.damping_ratios[1:3] < 0.1))


def test_common_components_carry_the_same_values():
    vehicle, rig = (load(CASE / f"{name}.toml").parameters for name in MODES)
    common = vehicle.keys() & rig.keys()
    assert {
        "inertias.motor.J",
        "shafts.gear_mesh.stiffness",
        "shafts.gear_output.ratio",
        "shafts.side_left.stiffness",
    } <= common
    assert all(vehicle[name] == rig[name] for name in common)
