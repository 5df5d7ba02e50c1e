"""The planned proof of a controlled bed: its responses, what it shows, the limits it keeps."""

from dataclasses import replace

import numpy as np
import pytest

from matching.bed.excite import controlled_beds, recorded_bed
from matching.bed.proof import PROOF, plan_proof
from matching.match.exported import exported_controller
from matching.match.loop import without_limits
from matching.match.responses import ComparedBed
from modelling.bed.vehicle import cut
from modelling.errors import InputError

SPEED = 30.0  # rad/s


FEW = replace(PROOF, beds=1)


@pytest.fixture(scope="module")
def controlled(limited_case):
    """Responses of the bed as planned to motor and road, at four frequencies."""
    frequencies = np.array([1.1, 4.0, 12.0, 28.0])
    bed, law = recorded_bed(limited_case), exported_controller(limited_case).law
    return frequencies, bed, controlled_beds(bed, [{}], law, ["motor_torque", "road"], frequencies)


@pytest.fixture(scope="module")
def quiet_case(limited_case):
    """The case with sensors that state their noise."""
    sensors = tuple(replace(sensor, uncertainty=0.02) for sensor in limited_case.rig.sensors)
    return replace(limited_case, rig=replace(limited_case.rig, sensors=sensors))


@pytest.fixture(scope="module")
def proof(quiet_case):
    return plan_proof(quiet_case, SPEED, settings=FEW)


def test_responses_are_those_that_the_prediction_compares(limited_case, controlled):
    """Against the sampled loop's own; what the controller reads folds back what lies above half its frequency."""
    (frequencies, bed, found), read = controlled, limited_case.loop.controller_sensors
    observer = limited_case.loop.structure.observer(
        limited_case.rig, cut(limited_case.vehicle, limited_case.rig), limited_case.loop
    )
    wanted = ComparedBed(limited_case, controller=without_limits(observer)).at(frequencies)
    for h, (source, sensor) in enumerate(wanted.pairs):
        own = found.outputs[0][:, bed.sensors.index(sensor), ["motor_torque", "road"].index(source)]
        np.testing.assert_allclose(own, wanted.matched[:, h], rtol=2e-3 if sensor in read else 1e-9)


def test_a_torque_balances_at_the_rotor(limited_case, controlled):
    """Newton's law of the rotor: J·dω/dt + drag·ω is the flange's torque and what the command has become."""
    frequencies, bed, found = controlled
    s, loop = 2j * np.pi * frequencies, limited_case.loop
    speed, torque = (found.outputs[0][:, bed.sensors.index(name)] for name in ("rotor_speed", "flange_torque"))
    late = np.exp(-s * loop["dead_time"]) * np.sinc(frequencies * loop["sample_time"])  # the hold's half sample: in it
    acting = found.commands[0][:, 0] * (late / (1 + s * loop["inverter_lag"]))[:, None]
    flange = torque * (1 + s * loop["torque_sensor_lag"])[:, None]  # as it is, not as its sensor says
    left_over = (0.9 * s + 0.1)[:, None] * speed - flange - acting
    # both are read at the samples: of the held command's images, 1 ms apart, so much folds back
    assert (np.abs(left_over) < 2e-4 * np.abs(acting)).all()


def test_it_shows_road_torques_where_the_vehicle_hardly_answers(limited_case, proof):
    """The old proof was as large as the manoeuvre everywhere."""
    assert set(proof.visible) == {f"{pair.input} → {pair.sensor}" for pair in limited_case.compared}
    assert min(proof.visible.values()) > 0.9
    power = np.abs(np.fft.rfft(proof.torques, axis=0)) ** 2
    f = np.fft.rfftfreq(len(proof.torques), proof.step)
    road = [power[np.abs(f - at) < 1, proof.inputs.index("road")].mean() for at in (6.0, 28.0)]
    assert road[1] > 10 * road[0]


def test_it_keeps_the_limits_and_uses_one(proof):
    assert max(proof.used.values()) <= 1.02 * (1 - PROOF.free)
    assert max(proof.used.values()) > 0.5
    assert np.abs(proof.torques[:, proof.inputs.index("motor_torque")]).max() <= 0.8 * 50 * 1.02
    assert np.abs(proof.torques[[0, -1]]).max() < 1e-9
    assert abs(np.corrcoef(proof.torques.T)[0, 1]) < 0.1


def test_smaller_limits_make_it_smaller(quiet_case, proof):
    smaller = replace(quiet_case, limits={**quiet_case.limits, "dynamometer_torque": 40.0})
    found = plan_proof(smaller, SPEED, settings=FEW)
    assert found.used["dynamometer_torque"] <= (1 - PROOF.free) * 1.001
    assert np.abs(found.torques).max() < np.abs(proof.torques).max()


def test_what_is_missing_is_named(limited_case):
    with pytest.raises(InputError, match=r"manoeuvre\.motor_torque"):
        plan_proof(replace(limited_case, manoeuvre={}), SPEED)
    limits = {name: value for name, value in limited_case.limits.items() if name != "dynamometer_torque"}
    with pytest.raises(InputError, match=r"limits\.dynamometer_torque"):
        plan_proof(replace(limited_case, limits=limits), SPEED)


def test_every_torque_has_lines_of_its_own_and_some_stay_empty(proof):
    """The periods at the end repeat exactly; of three lines or more in a row one is left to what is not linear."""
    count = round(proof.period / proof.step)
    end = len(proof.torques) - round(0.25 / proof.step)
    last, before = proof.torques[end - count : end], proof.torques[end - 2 * count : end - count]
    np.testing.assert_allclose(last, before, atol=1e-9 * np.abs(last).max())
    power = np.abs(np.fft.rfft(last, axis=0)) ** 2
    excited = power > 1e-12 * power.max(axis=0)
    assert not excited.all(axis=1).any()
    f = np.fft.rfftfreq(count, proof.step)
    inside = (f > 2.0) & (f < 25.0)
    assert np.mean(~excited[inside].any(axis=1)) > 0.15


def test_a_shorter_recording_is_not_promised_more_than_it_tells(quiet_case, proof):
    """Noise ten times as large is told to be ten times as long, or said not to fit."""
    (quiet,) = proof.expected
    sensors = tuple(replace(sensor, uncertainty=2.0) for sensor in quiet_case.rig.sensors)
    noisy = replace(quiet_case, rig=replace(quiet_case.rig, sensors=sensors))
    found = plan_proof(noisy, SPEED, settings=FEW)
    assert proof.duration <= found.duration <= PROOF.longest
    assert quiet.largest <= quiet.allowed / 3
    assert found.expected[0].largest > quiet.largest
    assert not proof.notes
    assert "would do, or limits" in found.notes[0] or "does not show" in found.notes[0]
