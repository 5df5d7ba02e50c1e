"""Every modal figure of the reference case, from its files, against the published and recomputed values."""

from pathlib import Path

import numpy as np
import pytest

from modelling.compiled import compiled
from modelling.files import load

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig"
MODES = {
    "vehicle": [0.0, 1.600, 8.439, 45.642, 46.120, 74.29, 124.7, 124.7, 479.5],
    "rig": [0.0, 16.703, 17.946, 74.05, 334.3, 335.0, 480.0],
}


@pytest.mark.parametrize("name", MODES)
def test_frequencies_from_the_equations(name):
    model = compiled(load(CASE / f"{name}.toml"))
    n = model.n
    A = model.jacobians(
        np.zeros(2 * n),
        np.zeros(len(model.inputs)),
        model.p0 * ~np.array([("damping" in p or "drag" in p) for p in model.parameters]),
        0,
    )[0].full()
    squares = np.sort(-np.linalg.eigvals(A[n:, :n]).real)
    frequencies = np.sqrt(np.abs(squares)) / (2 * np.pi)
    np.testing.assert_allclose(frequencies[1:], MODES[name][1:], rtol=1e-3)
    assert frequencies[0] < 1e-4


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
