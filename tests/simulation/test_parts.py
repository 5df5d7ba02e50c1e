"""The planetary gear and the clutch of the examples against textbook formulas."""

from pathlib import Path

import numpy as np
import pytest

import rigmatch as rm
from modelling.recordings.recording import Recording

PARTS = Path(__file__).parents[2] / "examples" / "parts"


def test_a_planetary_gear_with_its_ring_held():
    """Willis: the sun's inertia counts (1 + k)² times at the carrier, k = 3."""
    found = [mode.frequency for mode in rm.modes(PARTS / "planetary_gear.toml")]
    carrier = 0.05 + 4**2 * 0.01
    assert found[2] == pytest.approx(np.sqrt(2000 * (1 / carrier + 1 / 40)) / (2 * np.pi), rel=1e-4)


@pytest.mark.parametrize(("torque", "engine", "car"), [(200.0, 500.0, 100 / 2.02), (60.0, 60 / 2.22, 60 / 2.22)])
def test_a_clutch_slips_above_its_torque_and_sticks_below(torque, engine, car):
    """Mean accelerations from 0.2 to 1 s, after the side shaft has swung out a little."""
    model = rm.load(PARTS / "clutch.toml")
    time = np.arange(0, 1.2, 1e-3)
    pulled = Recording(time, {"engine_torque": np.where(time > 0.01, torque, 0.0)}, (), "made")
    done = rm.simulate(model, pulled)
    for name, wanted in (("engine_speed", engine), ("car_speed", car)):
        slope = np.polyfit(done.time[200:1000], done[name][200:1000], 1)[0]
        assert slope == pytest.approx(wanted, rel=0.03)
