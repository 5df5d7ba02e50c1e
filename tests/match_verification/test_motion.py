"""Simulation against frequency responses, the feed-forward's own recursion, and itself by another path."""

from dataclasses import replace

import numpy as np
import pytest

from matching.match.loop import feed_forward_of, linear_bed
from matching.match.verify import free_motion, matched_motion
from modelling.bed.nonlinear import arrivals
from modelling.simulation.simulate import simulate
from modelling.simulation.stepping import SimulationError
from modelling.system import Effect, Quantity

STEP = 1e-3


def phasors(signal, frequencies, periods=5):
    """Complex amplitudes over the last whole periods of the slowest."""
    count = round(periods / (min(frequencies) * STEP))
    k = np.arange(len(signal) - count, len(signal))
    carriers = [np.exp(-2j * np.pi * frequency * STEP * k) for frequency in frequencies]
    waves = [part for carrier in carriers for part in (carrier.real, -carrier.imag)]
    fitted = np.linalg.lstsq(np.stack([np.ones(count), k / len(signal), *waves], axis=1), signal[-count:], rcond=None)
    return fitted[0][2::2] - 1j * fitted[0][3::2]


def sines(frequencies, length):
    """Their sum, each as large as its frequency, for what swings fast answers little; the rigs here are linear."""
    k = np.arange(round(length / STEP))
    return sum(frequency * np.cos(2 * np.pi * frequency * STEP * k) for frequency in frequencies)


def linear(frequency):
    """What is left of a sine at its frequency where it is taken as linear between samples."""
    return np.sinc(frequency * STEP) ** 2


def test_arrivals():
    weights = arrivals(0.00253, 0.001, 20)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    # of a sample 0.53 still belongs to the command of three samples ago
    np.testing.assert_allclose(weights.mean(axis=0), [0, 0, 0.47, 0.53], atol=1e-12)
    np.testing.assert_allclose(arrivals(0.0, 0.001, 5), np.ones((5, 1)))


def test_free_rig_is_its_response(reference):
    parts = linear_bed(reference)
    f = 5.0
    trace = free_motion(parts.rig.system, parts, {"motor_torque": sines([f], 12)}, STEP)["side_left_torque"]
    rig = parts.rig.space
    H = parts.rig.response(np.array([2j * np.pi * f]))[
        0, rig.outputs.index("side_left_torque"), rig.inputs.index("motor_torque")
    ]
    assert phasors(trace, [f])[0] / f == pytest.approx(H * linear(f), rel=1e-5)


def test_a_motion_out_of_bounds_says_when(reference):
    parts = linear_bed(reference)
    with pytest.raises(SimulationError, match=r"grows out of bounds within 0\.05 s"):
        free_motion(parts.rig.system, parts, {"motor_torque": np.full(50, 1e300)}, STEP)


@pytest.mark.parametrize("dead_time", [0.0005, 0.003, 0.0047])
def test_a_perfect_model_and_the_rig_do_the_same(reference, dead_time):
    """The feed-forward's recursion against the equations of motion with a true delay line: to the steps of RK4."""
    case = replace(reference, loop=reference.loop.with_values({"dead_time": dead_time, "torque_feed_forward": 0.0}))
    parts, feed_forward = linear_bed(case), feed_forward_of(case)
    rng = np.random.default_rng(0)
    torques = {"motor_torque": rng.normal(size=600).cumsum(), "road_left": 10 * rng.normal(size=600).cumsum()}
    for torque in torques.values():
        torque[0] = 0.0  # as before
    traces = matched_motion(parts, torques)
    news = np.stack([torques.get(name, np.zeros(600)) for name in feed_forward.measured], axis=1)
    state, sent, outputs = np.zeros(len(feed_forward.A)), np.zeros((600 + feed_forward.delay, 2)), []
    of_known, of_news = feed_forward.gains()
    for k in range(600):
        outputs.append(feed_forward.C @ state + feed_forward.D @ news[k])
        on_their_way = sent[k : k + feed_forward.delay]  # oldest first
        sent[k + feed_forward.delay] = of_known @ np.r_[state, on_their_way.ravel()] + of_news @ news[k]
        state = feed_forward.A @ state + feed_forward.B @ sent[k] + feed_forward.W @ news[k]
    for sensor in ("motor_speed", "side_left_torque", "flange_right_torque"):
        wanted = np.array(outputs)[:, feed_forward.outputs.index(sensor)]
        np.testing.assert_allclose(traces[sensor], wanted, atol=2e-5 * np.ptp(wanted))


def test_nonlinear_path_is_the_linear_one_where_nothing_bends(reference):
    bent = reference.rig.with_effects(Effect("hardening", "shafts.side_left", (("cubic", Quantity(0.0)),)))
    case = replace(reference, rig=bent)
    time = np.arange(400) * STEP
    torques = {"motor_torque": 50 * np.clip(time / 0.05, 0, 1)}
    curved, straight = (matched_motion(linear_bed(own), torques) for own in (case, reference))
    assert curved.keys() == straight.keys()
    for name, wanted in straight.items():
        np.testing.assert_allclose(curved[name], wanted, atol=2e-5 * np.ptp(wanted), err_msg=name)


def test_lash_moves_as_the_general_simulation_says(reference):
    """The same rig by the general simulation, on a grid of 0.1 ms."""
    lash = reference.rig.with_effects(Effect("backlash", "shafts.side_left", (("gap", Quantity(0.02)),)))
    parts = linear_bed(replace(reference, rig=lash))
    time = np.arange(300) * STEP
    torque = 50 * np.sin(2 * np.pi * 8 * time)
    trace = free_motion(parts.rig.system, parts, {"motor_torque": torque}, STEP)["side_left_torque"]
    fine = np.arange(3000) * STEP / 10
    inputs = {"motor_torque": np.interp(fine, time, torque), "dyno_left": 0 * fine, "dyno_right": 0 * fine}
    other = simulate(lash, fine, inputs, compile=False)["side_left_torque"][::10]
    np.testing.assert_allclose(trace, other, atol=0.01 * np.ptp(other))
    plain = linear_bed(reference)
    assert np.abs(
        free_motion(plain.rig.system, plain, {"motor_torque": torque}, STEP)["side_left_torque"] - trace
    ).max() > 0.1 * np.ptp(trace)
