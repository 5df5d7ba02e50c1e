"""The whole verification, and the response errors it reports."""

import json
from dataclasses import replace

import numpy as np
import pytest

from matching.match.bounds import lower_bound
from matching.match.loop_modes import vehicle_modes_in_loop
from matching.match.requirements import DEFAULT_LIMITS
from matching.match.responses import error_figures
from matching.match.verify import verify
from modelling.bed.controllers import STRUCTURES
from modelling.modal.modes import modes


@pytest.fixture(scope="module")
def verified(reference):
    return verify(reference)


def test_errors_of_the_reference_case(reference):
    found = error_figures(reference)
    by = {(own.input, own.sensor): own for own in found.functions}
    # the figure of a trial with the published set: motor speed of the free rig
    assert by["motor_torque", "motor_speed"].before == pytest.approx(3.3, abs=0.05)
    assert by["road_left", "side_left_torque"].before is None
    # a torque that is held lags half a sample: 0.033 over the band, rms of a lag over ln f
    half_a_sample = np.pi * 30 * 1e-3 / np.sqrt(2 * np.log(60))
    assert found.after < 0.15 * half_a_sample < 0.05 < found.unmeasured
    like = [own.after**2 for own in found.functions if own.before is not None]
    assert found.after_same_functions == pytest.approx(np.sqrt(np.mean(like)))
    assert found.after == pytest.approx(np.sqrt(np.mean([own.after**2 for own in found.functions])))
    on_rig = [own.unmeasured**2 for own in found.functions if own.input == "motor_torque"]  # roads are always known
    assert found.unmeasured == pytest.approx(np.sqrt(np.mean(on_rig)))


def test_sampling_costs_the_sample_time(reference):
    """Sampled four times as fast, the controller's error is that of the dead time alone: it hardly falls further."""
    slow = error_figures(reference)
    fast = error_figures(replace(reference, loop=reference.loop.with_values({"sample_time": 2.5e-4})))
    assert fast.after < 0.6 * slow.after
    faster = error_figures(replace(reference, loop=reference.loop.with_values({"sample_time": 2e-4})))
    assert faster.after == pytest.approx(fast.after, rel=0.05)
    assert fast.unmeasured == pytest.approx(slow.unmeasured, rel=0.02)


def test_feedback_alone_answers_all_torques_alike(feedback):
    found = error_figures(feedback)
    assert [own.after for own in found.functions] == [own.unmeasured for own in found.functions]


@pytest.mark.parametrize("dead_time", [0.0023, 0.005])
def test_no_dead_time_between_samples_costs_more(reference, dead_time):
    """The lower bound grows with the dead time, whole samples or not: what is left of one is taken exactly."""
    case = replace(reference, loop=reference.loop.with_values({"dead_time": dead_time}))
    longer = replace(reference, loop=reference.loop.with_values({"dead_time": 1.2 * dead_time}))
    found = lower_bound(case, 4)
    assert found < lower_bound(case, 1)
    assert found < lower_bound(longer, 4)


def test_reference_case_is_stable_under_every_check(verified):
    assert verified.stable
    assert set(verified.checks) == {"sampled loop", "feed-forward poles", "simulation", "loop and simulation agree"}
    assert verified.spectral_abscissa < 0


def test_targets_are_read_off_the_simulation(verified):
    for seen, (number, mode, mac), wanted in zip(verified.identified, verified.targets, (1.5997, 8.4421), strict=True):
        assert seen.vehicle_mode == number
        assert mode.belongs_to == "feed_forward"
        assert mac > 0.99
        assert seen.vehicle.frequency == pytest.approx(wanted, rel=1e-4)
        assert seen.matched.frequency == pytest.approx(mode.frequency, rel=1e-4)
        assert seen.matched.damping_ratio == pytest.approx(mode.damping_ratio, abs=1e-4)


def test_feedback_modes_are_read_off_too(feedback):
    checked = verify(feedback, deviations=False)
    for seen, (_, mode, _) in zip(checked.identified, checked.targets, strict=True):
        assert mode.belongs_to == "feedback"
        assert seen.matched.frequency == pytest.approx(mode.frequency, rel=2e-3)
        assert seen.matched.damping_ratio == pytest.approx(mode.damping_ratio, abs=1e-3)
        assert abs(seen.matched.frequency / seen.vehicle.frequency - 1) > 0.05  # honest: this gain does not match


def test_peaks_and_limits(verified, reference):
    matched = verified.traces.matched
    assert verified.peaks["dynamometers.left.torque"] == np.abs(matched["dynamometers.left.torque"]).max()
    assert verified.peaks["shafts.flange_left.torque"] == pytest.approx(
        2e5 * verified.peaks["shafts.flange_left.twist"], rel=1e-2
    )
    assert not verified.violations
    tight = replace(
        reference,
        limits=DEFAULT_LIMITS
        | {
            "dynamometer_torque": 800.0,
            "shafts.flange_left.twist": 1e-3,
            "modulus_margin": 1e-3,
            "damping_ratio": 0.01,
        },
    )
    broken = verify(tight, deviations=False).violations
    assert [own.limit for own in broken] == ["shafts.flange_left.twist", "dynamometer_torque", "dynamometer_torque"]


def test_what_must_be_known_is_ranked(verified):
    errors = [own.response_error for own in verified.robustness]
    assert errors == sorted(errors, reverse=True)
    assert {own.name for own in verified.robustness[:4]} == {"rig.inertias.motor.J", "rig.shafts.side_left.stiffness"}
    late = [own.change for own in verified.robustness if own.name == "loop.dead_time"]
    assert sorted(late) == pytest.approx([-5e-4, 5e-4])


def test_an_unstable_loop_is_never_called_stable(reference):
    checked = verify(replace(reference, loop=reference.loop.with_values({"proportional_gain": 10.0})), deviations=False)
    assert not checked.stable
    assert not checked.checks["sampled loop"]
    assert checked.spectral_abscissa > 0
    json.dumps(checked.to_dict(), allow_nan=False)


def test_one_residual_vehicle_with_two_interfaces(compact):
    checked = verify(compact, deviations=False)
    assert checked.stable
    first, second = checked.identified
    assert first.matched.frequency == pytest.approx(first.vehicle.frequency, rel=0.01)
    # wheel against wheel: neither the motor nor the road on the one body moves it
    assert second.vehicle is None
    assert second.matched is None
    assert checked.traces.time[0] == 0
    assert checked.traces.vehicle["side_left_torque"][0] == pytest.approx(
        checked.traces.matched["side_left_torque"][0], rel=0.05
    )
    assert abs(checked.traces.vehicle["side_left_torque"][0]) > 10


def test_pairing_tells_symmetric_from_antisymmetric(verified, reference):
    known = modes(reference.vehicle)
    inertia = {f"inertias.{own.name}": own.J.value for own in reference.vehicle.inertias}
    of_feed_forward = [mode for mode in verified.modes if mode.belongs_to == "feed_forward"]
    became = vehicle_modes_in_loop(list(known), of_feed_forward, inertia)
    for number, symmetry in (
        (2, "antisymmetric"),
        (3, "symmetric"),
        (4, "symmetric"),
        (5, "antisymmetric"),
        (6, "symmetric"),
    ):
        mode, mac = became[number]
        assert (mode.symmetry, mac > 0.9) == (symmetry, True)
        assert sum(mode.kinetic.values()) == pytest.approx(1)
        assert sum(mode.potential.values()) == pytest.approx(1)
    assert 1 not in became


@pytest.mark.parametrize("structure", ["pi", "model_based"])
def test_a_flange_may_point_either_way(single, structure):
    forth, back = (
        verify(
            replace(case, loop=replace(case.loop, structure=STRUCTURES[structure], measured=("motor_torque",))),
            deviations=False,
        )
        for case in (single("adapter", "rotor"), single("rotor", "adapter"))
    )
    assert forth.stable
    assert back.modulus_margin == pytest.approx(forth.modulus_margin, rel=1e-9)
    assert back.spectral_abscissa == pytest.approx(forth.spectral_abscissa, rel=1e-6)
    assert back.errors.after == pytest.approx(forth.errors.after, rel=1e-6)
    assert back.peaks["dynamometers.one.torque"] == pytest.approx(forth.peaks["dynamometers.one.torque"], rel=1e-6)
    # a sweep leaves no free motion: the mode is read off a kick of its own
    assert forth.identified[0].excited_by == "motor_torque"
    if structure == "model_based":  # this gain leaves nothing like the mode to the feedback alone
        assert forth.identified[0].matched.frequency == pytest.approx(forth.targets[0][1].frequency, rel=5e-3)


def test_a_motion_that_leaves_every_bound_is_no_result(feedback):
    values = {
        "proportional_gain": 15.67, "integral_gain": 0.0, "torque_feed_forward": -0.234, "lead_time": 0.003,
        "acceleration_feed_forward": 2.477, "dead_time": 0.0005, "inverter_lag": 1e-5,
    }  # fmt: skip
    checked = verify(replace(feedback, loop=feedback.loop.with_values(values)), deviations=False)
    assert np.abs(checked.poles).max() > 1.1
    assert checked.traces is None
    assert not checked.checks["simulation"]
    assert all(own.matched is None for own in checked.identified)
    json.dumps(checked.to_dict(), allow_nan=False)


def test_pairing_leaves_out_rigid_modes_alone(verified, reference):
    """A mode of half a hertz is one as any other."""
    mode = modes(reference.vehicle)[1]
    inertia = {f"inertias.{part.name}": part.J.value for part in reference.vehicle.inertias}
    of_feed_forward = [mode for mode in verified.modes if mode.belongs_to == "feed_forward"]
    alike, _ = vehicle_modes_in_loop([mode], of_feed_forward, inertia)[mode.number]
    slow = replace(alike, frequency=0.5)
    assert vehicle_modes_in_loop([replace(mode, frequency=0.5)], [slow], inertia)[mode.number][0] is slow
    assert vehicle_modes_in_loop([replace(mode, frequency=0.0)], [slow], inertia) == {}
