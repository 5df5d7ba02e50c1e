"""The planetary gear and the clutch of the examples against textbook formulas."""

from pathlib import Path

import numpy as np
import pytest

import rigmatch as rm
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording

PARTS = Path(__file__).parents[2] / "examples" / "parts"


def test_a_planetary_gear_with_its_ring_held():
    """Willis: the sun's inertia counts (1 + k)² times at the carrier."""
    split = rm.load(PARTS / "planetary_gear.toml")
    for teeth in (1.8, 2.6, 3.7):
        found = rm.modes(split.with_values({"planetary_gears.split.ratio": teeth, "inertias.ring.J": 1e9}))
        carrier = 0.005 + (1 + teeth) ** 2 * 0.02
        wanted = np.sqrt(600 * (1 / carrier + 1 / 0.15)) / (2 * np.pi)
        assert min(abs(mode.frequency - wanted) for mode in found) < 1e-4 * wanted


def test_the_members_of_a_planetary_gear_share_a_torque_as_its_teeth_say():
    """Without shafts: a torque T at the carrier accelerates sun and ring as T/(1 + k) and T·k/(1 + k) do."""
    k, J, torque = 2.6, {"sun": 0.02, "ring": 0.4, "carrier": 0.03}, 12.0
    model = {
        "inertias": {name: {"J": each} for name, each in J.items()},
        "planetary_gears": {"split": {"sun": "sun", "carrier": "carrier", "ring": "ring", "ratio": k}},
        "inputs": {"torque": {"on": "carrier"}},
        "sensors": {f"{name}_speed": {"measures": "speed", "of": name} for name in J},
    }
    time = np.arange(0, 0.5, 1e-3)
    done = rm.simulate(from_dict(model), Recording(time, {"torque": np.full(len(time), torque)}, (), "made"))
    # per torque t at the sun, k·t at the ring: sun t/Js, ring k·t/Jr, carrier (T − (1 + k)·t)/Jc = (s + k·r)/(1 + k)
    own = torque / J["carrier"] / ((1 + k) / J["carrier"] + (1 / J["sun"] + k**2 / J["ring"]) / (1 + k))
    assert done["sun_speed"][-1] == pytest.approx(own / J["sun"] * time[-1], rel=1e-6)
    assert done["ring_speed"][-1] == pytest.approx(k * own / J["ring"] * time[-1], rel=1e-6)
    assert done["carrier_speed"][-1] == pytest.approx((torque - (1 + k) * own) / J["carrier"] * time[-1], rel=1e-6)


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
