"""The virtual bed, stepped as an FMU, against the engine's own runs."""

import zipfile
from importlib.util import find_spec

import numpy as np
import pytest
from plant.build import chain_of
from plant.engine import compiler, simulate
from plant.hidden import Hidden
from plant.systems import two_mass

from matching.bed.simulated_bed import FmuBed
from modelling.errors import InputError
from virtual_bed.bed import Actuator, Reader, VirtualBed

pytestmark = pytest.mark.skipif(not (find_spec("fmpy") and compiler()), reason="needs FMPy and a C compiler")
STEP, COUNT, SPEED = 1e-3, 300, 20.0
COMMANDS = np.array([8.0, -3.0])
EFFECTS = [
    Hidden("backlash", "shafts.link", {"gap": 0.01}),
    Hidden("coulomb_friction", "inertias.load", {"torque": 0.7}),
]


@pytest.fixture(scope="module")
def drive():
    return two_mass(np.random.default_rng(3))


@pytest.fixture(scope="module")
def truth(drive):
    """The engine's run under constant torques: link torque, motor speed, load speed."""
    chain = chain_of(drive, EFFECTS)
    start = np.concatenate([np.zeros(2), SPEED * np.array([drive.speed_ratio(name) for name in drive.inertias])])
    motion = simulate(chain, np.tile(COMMANDS, (COUNT + 1, 1)), start, STEP)
    return {"link_torque": motion.torque[:, 0], "motor_speed": motion.speed[:, 0], "load_speed": motion.speed[:, 1]}


def stepped(drive, folder, **how):
    path = VirtualBed(drive, EFFECTS, **how).write(folder / "bed.fmu", STEP)
    with FmuBed(path, list(drive.inputs), list(drive.sensors)) as bed:
        bed.begin(SPEED)
        rows = []
        for _ in range(COUNT):
            rows.append(bed.readings())
            bed.step(COMMANDS, STEP)
    return dict(zip(drive.sensors, np.array(rows).T, strict=True))


def test_the_motion_is_the_engine_s(drive, truth, tmp_path):
    found = stepped(drive, tmp_path)
    for name, wanted in truth.items():
        np.testing.assert_allclose(found[name], wanted[:COUNT], rtol=1e-6, atol=1e-6 * np.abs(wanted).max())


def test_an_fmu_that_does_not_run_is_one_line(drive, tmp_path):
    """Its binary is missing."""
    path, bare = VirtualBed(drive, EFFECTS).write(tmp_path / "bed.fmu", STEP), tmp_path / "bare.fmu"
    with zipfile.ZipFile(path) as whole, zipfile.ZipFile(bare, "w") as archive:
        archive.writestr("modelDescription.xml", whole.read("modelDescription.xml"))
    with pytest.raises(InputError, match=r"bare\.fmu: t = 0 s: does not run: .*; mend the FMU"):
        FmuBed(bare, list(drive.inputs), list(drive.sensors))


def test_sensors_are_late_scaled_shifted_and_rounded(drive, truth, tmp_path):
    readers = {
        "link_torque": Reader(gain=1.02, offset=0.3, delay=5e-3),
        "motor_speed": Reader(converter=0.05),
        "load_speed": Reader(noise=0.2),
    }
    found = stepped(drive, tmp_path, readers=readers)
    late = 1.02 * truth["link_torque"][10 : COUNT - 5] + 0.3
    np.testing.assert_allclose(found["link_torque"][15:], late, atol=1e-6 * np.abs(late).max())
    steps = found["motor_speed"] / 0.05
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert np.abs(found["motor_speed"] - truth["motor_speed"][:COUNT]).max() <= 0.025 + 1e-6
    noise = found["load_speed"] - truth["load_speed"][:COUNT]
    assert noise.std() == pytest.approx(0.2, rel=4 / np.sqrt(2 * COUNT))


def test_commands_arrive_late_and_with_another_size(drive, tmp_path):
    """Before its dead time a torque does nothing; a limit and a factor act on it."""
    name = next(iter(drive.inputs))
    idle = stepped(drive, tmp_path, actuators={own: Actuator(factor=0.0) for own in drive.inputs})
    late = stepped(drive, tmp_path, actuators={own: Actuator(delay=0.05) for own in drive.inputs})
    limited = stepped(drive, tmp_path, actuators={own: Actuator(delay=0.05, limit=1e-12) for own in drive.inputs})
    np.testing.assert_allclose(late["motor_speed"][:51], idle["motor_speed"][:51], atol=1e-9)
    assert np.abs(late["motor_speed"][60:] - idle["motor_speed"][60:]).max() > 0.1
    np.testing.assert_allclose(limited["motor_speed"], idle["motor_speed"], atol=1e-6)
    half = stepped(drive, tmp_path, actuators={name: Actuator(factor=0.5)})
    assert half["motor_speed"][20] != pytest.approx(late["motor_speed"][20], abs=1e-3)
