"""An uncertainty that is stated too small is said to be; no cause is looked for in what only scatters."""

import numpy as np
import pytest

from matching.diagnosis.diagnose import diagnose
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording

J, DRAG, NOISE = 0.4, 0.6, 0.03
TIME = 0.005 * np.arange(2000)
WAVES = ((2.0, 0.5, 0.3), (1.5, 1.3, 2.0), (1.0, 3.7, 4.0))  # amplitude N·m, Hz, rad


def diagnosis(stated):
    """Of a rotor whose speed under three waves of torque has a closed form."""
    torque = sum(a * np.sin(2 * np.pi * f * TIME + phase) for a, f, phase in WAVES)
    speed = sum(
        np.imag(a * np.exp(1j * (2 * np.pi * f * TIME + phase)) / (DRAG + 2j * np.pi * f * J)) for a, f, phase in WAVES
    )
    system = from_dict({
        "inertias": {"rotor": {"J": {"value": 0.43, "tolerance": 0.2}, "drag": {"value": 0.5, "tolerance": 0.5}}},
        "inputs": {"torque": {"on": "rotor"}},
        "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": stated}},
    })  # fmt: skip
    reading = speed + NOISE * np.random.default_rng(3).standard_normal(len(TIME))
    return diagnose(system, [Recording(TIME, {"torque": torque, "speed": reading})])


@pytest.mark.parametrize(("stated", "verdict", "said"), [(NOISE / 3, "unexplained", True), (NOISE, "adequate", False)])
def test_what_only_scatters_has_no_cause(stated, verdict, said):
    found = diagnosis(stated)
    assert (found.verdict, found.causes) == (verdict, [])
    notes = [note for note in found.notes if "stated too small" in note]
    assert bool(notes) == said
    if said:
        assert notes[0].startswith("speed scatters by 3") or notes[0].startswith("speed scatters by 2.9")
