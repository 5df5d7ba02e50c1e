"""Dog clutches against equations of the tests' own: teeth that hold rigidly, by impact where they find their gaps."""

import re
import tomllib
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from fmu.slave import slave
from needs import compiles
from simulation.own_dogs import drawn_shift, simulate_dogs
from simulation.own_gearbox import drawn
from simulation.test_gearbox import INPUTS, READ

import rigmatch as rm
from modelling.errors import InputError
from modelling.fmu.export import block, fmu
from modelling.linear.steady_motion import speeds_of, torques_of
from modelling.model_file import from_dict, to_dict
from modelling.system import OperatingPoint

BELOW = 6.0  # rad/s


def scene(seed, deflection=5e-4):
    """A drawn drivetrain's own equations and file, and a shift: times, torques (t, 3)."""
    rng = np.random.default_rng(seed)
    shift = drawn(rng, deflection)
    data = tomllib.loads(shift.toml)
    data["gearboxes"]["box"]["engages_below"] = BELOW
    return shift.own, data, *drawn_shift(shift.own, rng)


def errors(found, own):
    """Rms and largest error, % of the range, over motor and wheel speed and side torque."""
    off = np.stack([(found[name] - own[name]) / np.ptp(own[name]) for name in READ])
    return 100 * np.sqrt(np.mean(off**2, axis=1)).max(), 100 * np.abs(off).max()


def recorded(folder, time, torques):
    """A recording of the inputs."""
    path, names = folder / "shift.csv", ",".join(f"{name} [N*m]" for name in INPUTS)
    np.savetxt(path, np.column_stack([time, torques]), delimiter=",", comments="", header=f"time [s],{names}")
    return path


def of_seed(seed, folder):
    own, data, time, torques = scene(seed)
    right, events = simulate_dogs(own, time, torques, BELOW)
    found = rm.simulate(from_dict(data), recorded(folder, time, torques), start="rest")
    return errors(found, right), events, found.notes


def test_a_shift_of_teeth_is_that_of_rigid_ones_and_its_impulse_is_told(tmp_path):
    (rms, largest), events, notes = of_seed(887001, tmp_path)
    assert rms < 0.1
    assert largest < 1.5
    assert [gear for _, gear, _, _ in events] == [1, 2]
    time, _, slip, impulse = events[1]
    (note,) = notes
    told = r"clutch_2 of gearboxes.box engages at (\S+) s with (\S+) rad/s of slip, an impulse of (\S+) "
    numbers = re.match(told, note)
    at, before, told = (float(each) for each in numbers.groups())
    assert at == pytest.approx(time, abs=0.003)
    assert before == pytest.approx(slip, rel=0.1)
    assert told == pytest.approx(impulse, rel=0.1)


@pytest.mark.long
def test_many_shifts_of_teeth_are_those_of_rigid_ones(tmp_path):
    found = np.array([of_seed(seed, tmp_path)[0] for seed in range(888000, 888030)])
    print(found.max(axis=0), np.median(found, axis=0))
    assert found[:, 0].max() < 0.1
    assert found[:, 1].max() < 1.5


@pytest.mark.long
def test_teeth_that_turn_apart_do_not_come_in(tmp_path):
    """Asked for at 20 rad/s of slip and more: nothing carries until the slip is small; a friction clutch would pull."""
    own, data, time, torques = scene(887002)
    torques[:, 0] = np.clip(torques[:, 0], 0, None)  # nobody brakes the motor
    right, events = simulate_dogs(own, time, torques, 0.5)
    data["gearboxes"]["box"]["engages_below"] = 0.5
    assert [gear for _, gear, _, _ in events][:1] == [1]
    found = rm.simulate(from_dict(data), recorded(tmp_path, time, torques), start="rest")
    assert errors(found, right)[0] < 0.1


@pytest.mark.long
@compiles
def test_an_fmu_has_live_teeth(tmp_path):
    own, data, time, torques = scene(887003)
    right, events = simulate_dogs(own, time, torques, BELOW)
    assert len(events) == 2
    made = block([from_dict(data)], "box", "box")
    (tmp_path / "box.fmu").write_bytes(fmu(made).content)
    with slave(tmp_path / "box.fmu") as one:
        one.begin()
        rows = [one.get(READ)]
        for now, after in pairwise(torques):
            one.set(dict(zip(INPUTS, now, strict=True)))
            one.slope(dict(zip(INPUTS, (after - now) / 1e-3, strict=True)))
            one.step(1e-3)
            rows.append(one.get(READ))
    rms, largest = errors(dict(zip(READ, np.array(rows).T, strict=True)), right)
    assert rms < 0.2
    assert largest < 2.0


def test_its_file_its_gears_and_mistakes():
    _, data, _, _ = scene(887004)
    model = from_dict(data)
    assert to_dict(model)["gearboxes"]["box"]["engages_below"] == BELOW
    del data["gearboxes"]["box"]["engages_below"]
    np.testing.assert_allclose(rm.modes(model.in_gear(2)).frequencies, rm.modes(from_dict(data).in_gear(2)).frequencies)
    data["gearboxes"]["box"]["engages_below"] = 0
    with pytest.raises(InputError, match=r"gearboxes\.box\.engages_below: 0 is not possible"):
        from_dict(data)
    data["gearboxes"]["box"]["engages_below"] = 100
    assert "is it meant in 1/min?" in " ".join(from_dict(data).doubts)
    data["gearboxes"]["box"]["engages_below"] = "100 1/min"
    assert not from_dict(data).doubts


@pytest.mark.parametrize("seed", range(510, 516))
def test_steady_motion_is_found_with_teeth_in(seed):
    """Drag balances the motor through the ratio of the gear that is in."""
    own, data, *_ = scene(seed)
    rng = np.random.default_rng(seed)
    gear, wheel = int(rng.integers(2)), float(rng.uniform(5, 60))
    carried = (("clutch_1", float(gear == 0)), ("clutch_2", float(gear == 1)))
    system = replace(from_dict(data), operating_point=OperatingPoint((("wheel", wheel),), carried))
    ratio = own.ratios[gear]
    assert speeds_of(system)["motor"] == pytest.approx(ratio * wheel)
    balance = own.drags[0] * ratio * wheel + own.drags[1] * wheel / ratio
    assert torques_of(system)["motor_torque"] == pytest.approx(balance)
