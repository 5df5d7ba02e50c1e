"""The sampled-data response against stepping a continuous rig under an exact sine, with commands held and delayed."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from matching.match.adapters import curves_of
from matching.match.continuous_loop import ExactLoop
from matching.match.loop import body, parts_of, watched
from matching.match.responses import ComparedBed, SampledLoop, feed_forward_action, feed_forward_of

FINE = 4  # steps a sample time; the dead times are whole numbers of them
SECONDS = 20.0  # until what the start left has died away, as far as the fitted trend does not take it


def stepped(parts, feed_forward, source, frequency):
    """Amplitude of motor speed and side-shaft torque for cos(ωt) on an input, the rest as the controller runs."""
    step, k, bed, law = parts.case.loop["sample_time"], len(parts.dynamometers), parts.bed, parts.sampled_controller
    small, omega = step / FINE, 2 * np.pi * frequency
    n, drive = len(bed.A), bed.B[:, k + parts.drives.index(source)] if source in parts.drives else np.zeros(len(bed.A))
    # states [bed, cos ωt, sin ωt]: the sine is part of the system, so every step is exact
    A = np.zeros((n + 2, n + 2))
    A[:n, :n], A[:n, n], A[n, n + 1], A[n + 1, n] = bed.A, drive, -omega, omega
    B = np.vstack([bed.B[:, :k], np.zeros((2, k))])
    whole = expm(np.block([[A, B], [np.zeros((k, n + 2 + k))]]) * small)
    over, push = whole[: n + 2, : n + 2], whole[: n + 2, n + 2 :]
    dead_time = parts.case.loop["dead_time"]
    line = [np.zeros(k)] * round((dead_time - step / 2) / small)
    state, control = np.zeros(n + 2), np.zeros(len(law.A))
    state[n] = 1.0
    model = sent = None
    if feed_forward is not None:
        model, sent = np.zeros(len(feed_forward.A)), [np.zeros(k)] * feed_forward.delay
        rows = [
            feed_forward.outputs.index(f"{d.name} {what}") for what in ("torque", "speed") for d in parts.dynamometers
        ]
    samples = round(SECONDS / step)
    rows_out = [parts.rig.space.outputs.index(name) for name in ("motor_speed", "side_left_torque")]
    states, of_bed, of_model = np.empty((samples * FINE, n + 2)), bed.C[: 2 * k], None
    if feed_forward is not None:
        of_model = feed_forward.C[rows], feed_forward.D[rows]
    for i in range(samples):
        now, read, road = np.cos(omega * i * step), of_bed @ state[:n], np.zeros(len(parts.simulated))
        ahead = np.zeros(k)
        if feed_forward is not None:
            w = np.array([now if name == source else 0.0 for name in feed_forward.measured])
            read = read - of_model[0] @ model - of_model[1] @ w
            ahead = feed_forward.command(model, sent, w)
            sent = [*sent, ahead]
            model = feed_forward.A @ model + feed_forward.B @ sent.pop(0) + feed_forward.W @ w
        elif source in parts.simulated:
            road[parts.simulated.index(source)] = now
        seen = np.concatenate([read, road])
        command = law.C @ control + law.D @ seen
        control = law.A @ control + law.B @ seen
        for j in range(FINE):
            states[i * FINE + j] = state
            line.append(command + ahead)
            state = over @ state + push @ line.pop(0)
    last = states[-round(4 / frequency / small) :, : len(parts.rig.space.A)] @ parts.rig.space.C[rows_out].T
    t = np.arange(len(states))[-len(last) :] * small
    basis = np.stack([np.ones(len(t)), t, t**2, np.cos(omega * t), np.sin(omega * t)], axis=1)
    fitted = np.linalg.lstsq(basis, last, rcond=None)[0]
    return fitted[3] - 1j * fitted[4]


@pytest.mark.parametrize(
    ("source", "frequency", "with_feed_forward"),
    [
        ("motor_torque", 25.0, False),
        ("road_left", 4.0, False),
        ("motor_torque", 4.0, True),  # at 25 Hz below, on a bed that differs
        ("road_left", 25.0, True),
    ],
)
def test_response_is_what_stepping_shows(reference, feedback, source, frequency, with_feed_forward):
    case = reference if with_feed_forward else feedback
    parts, feed_forward = parts_of(case), feed_forward_of(case)
    assert (feed_forward is not None) == with_feed_forward
    loop, inputs, action = SampledLoop(parts, np.array([frequency])), [source], None
    if feed_forward is not None:
        inputs = feed_forward.measured
        action = feed_forward_action(feed_forward, parts.toward, ["left", "right"], np.array([frequency]))
    H = loop.response(inputs, ["motor_speed", "side_left_torque"], action)[0, :, inputs.index(source)]
    np.testing.assert_allclose(stepped(parts, feed_forward, source, frequency), H, rtol=2e-3)


def test_a_bed_other_than_the_controllers_model(reference):
    """Side shafts 20 % stiffer than the feed-forward has them: both parts of the loop at work."""
    nominal, feed_forward, f = parts_of(reference), feed_forward_of(reference), np.array([25.0])
    values = {f"shafts.side_{side}.stiffness": 1.2 * 1.092e4 for side in ("left", "right")}
    stiffer = body(watched(reference.rig.with_values(values), nominal.cuts, rig_side=True))
    parts = replace(nominal, rig=stiffer)
    curves = ComparedBed(reference, parts, feed_forward).at(f)
    motor = [h for h, (source, _) in enumerate(curves.pairs) if source == "motor_torque"][:2]
    np.testing.assert_allclose(stepped(parts, feed_forward, "motor_torque", 25.0), curves.matched[0, motor], rtol=2e-3)
    assert abs(curves.matched[0, motor[1]] / curves.vehicle[0, motor[1]] - 1) > 0.1


def test_sampled_faster_and_faster_it_is_the_continuous_loop(feedback):
    f = np.geomspace(0.5, 30, 8)
    inputs, sensors = ["motor_torque", "road_left"], ["motor_speed", "side_left_torque"]
    differences = []
    for step in (1e-3, 1e-4):
        parts = parts_of(replace(feedback, loop=feedback.loop.with_values({"sample_time": step})))
        continuous = ExactLoop(parts).response(2j * np.pi * f, inputs, sensors)
        sampled = SampledLoop(parts, f).response(inputs, sensors)
        differences.append(np.abs(sampled / continuous - 1).max())
    # the hold is counted in the dead time: only what is of the sample time squared is left
    assert differences[0] < 0.01
    assert differences[1] < 0.02 * differences[0]


def test_curves_go_from_below_to_above_the_band(reference):
    low, high = reference.band
    drawn = curves_of(ComparedBed(reference))
    assert drawn.frequencies[[0, -1]] == pytest.approx([low / 2, 3 * high])
    assert drawn.vehicle.shape == (len(drawn.frequencies), len(reference.compared))


def test_without_a_path_there_is_no_response(reference):
    f = np.geomspace(0.5, 30, 12)
    found = ComparedBed(reference).at(f)
    assert np.isnan(found.rig[:, [source == "road_left" for source, _ in found.pairs]]).all()
    assert np.isfinite(found.matched).all()


def test_a_torque_that_is_not_measured_is_answered_by_the_feedback(reference):
    f = np.geomspace(0.5, 30, 12)
    found = ComparedBed(replace(reference, loop=replace(reference.loop, measured=()))).at(f)
    motor = np.array([source == "motor_torque" for source, _ in found.pairs])
    np.testing.assert_allclose(found.matched[:, motor], found.unmeasured[:, motor])
    assert not np.allclose(found.matched[:, ~motor], found.unmeasured[:, ~motor])


def test_feedback_alone_is_what_model_based_does_about_unmeasured_torques(reference, feedback):
    f = np.geomspace(0.5, 30, 12)
    np.testing.assert_allclose(ComparedBed(feedback).at(f).matched, ComparedBed(reference).at(f).unmeasured)


def test_a_dead_time_that_differs_from_the_controllers(reference):
    """Longer by a whole sample: the commands of the feed-forward come as much later, its expectation stays."""
    f = np.array([8.0])
    parts, feed_forward = parts_of(reference), feed_forward_of(reference)
    late = ComparedBed(reference, parts, feed_forward, dead_time=0.004).at(f).matched
    longer = parts_of(replace(reference, loop=reference.loop.with_values({"dead_time": 0.004})))
    action = feed_forward_action(feed_forward, parts.toward, ["left", "right"], f)
    H = SampledLoop(longer, f).response(feed_forward.measured, ["motor_speed"], action)
    assert late[0, 0] == pytest.approx(H[0, 0, feed_forward.measured.index("motor_torque")])
    assert abs(late[0, 0] / ComparedBed(reference, parts, feed_forward).at(f).matched[0, 0] - 1) > 0.05
