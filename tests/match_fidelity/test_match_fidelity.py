"""The fidelity that a match reports: against closed identities and against the same figures worked out by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from matching.match.loop_modes import PLACE, emulated
from matching.match.verify import match_fidelity


@pytest.fixture(scope="module")
def found(simulated):
    return match_fidelity(*simulated)


def test_a_rig_that_is_the_vehicle_scores_one_but_for_its_sensors(simulated):
    parts, traces = simulated
    ideal = traces.vehicle | {PLACE + name: own for name, own in traces.vehicle.items()}
    found = match_fidelity(parts, replace(traces, matched=ideal)).after
    assert found.domains["system_dynamics"] == 1
    assert found.domains["residual_vehicle_model"] == 1
    assert 0.99 < found.domains["measurement_uncertainty"] < 1


def test_residual_vehicle_on_the_vehicles_own_torques_reads_what_the_vehicle_reads(simulated):
    """Cut, lag, sign and integration at once: the flanges are told the vehicle's side-shaft torques."""
    parts, traces = simulated
    fast = replace(parts, case=replace(parts.case, loop=parts.case.loop.with_values({"torque_sensor_lag": 1e-6})))
    flanges = {
        dyno.torque_sensor: sign * traces.vehicle[f"shafts.{dyno.follows}.torque"]
        for dyno, sign in zip(parts.dynamometers, parts.torque_signs, strict=True)
    }
    read = emulated(fast, flanges, traces.torques, tuned=False)
    for name in ("body_left_speed", "body_right_speed", "body_left_acceleration"):
        wanted = traces.vehicle[name]
        np.testing.assert_allclose(read[PLACE + name], wanted, atol=2e-3 * np.ptp(wanted))


def test_figures_follow_from_the_traces_by_the_equations(simulated, found):
    """R_MU and one R_NRMSE by Eqs. 18, 22 and 23 directly; sums by Eqs. 16 and 17."""
    parts, traces = simulated
    sensors = {own.name: own.uncertainty for own in parts.case.rig.sensors}
    ratios = []
    for dyno in parts.dynamometers:
        for name, sensor in (
            (f"shafts.{dyno.follows}.torque", dyno.torque_sensor),
            (f"interfaces.{dyno.follows}.speed", dyno.speed_sensor),
        ):
            ratios.append(2 * sensors[sensor] / np.ptp(traces.vehicle[name]))
    by_hand = 1 - math.sqrt(np.mean(np.square(ratios)))
    assert found.after.domains["measurement_uncertainty"] == pytest.approx(by_hand, abs=1e-5)
    assert found.before.domains["measurement_uncertainty"] == found.after.domains["measurement_uncertainty"]

    one = found.after.signals["system_dynamics"][0]
    off = traces.matched[one.name] - traces.vehicle[one.name]
    assert one.nrmse == pytest.approx(1 - np.sqrt(np.mean(off**2)) / np.ptp(traces.vehicle[one.name]), abs=2e-4)
    for own in (found.before, found.after):
        partial = {
            domain: math.sqrt(np.mean([r**2 for one in members for r in (one.nrmse, one.delay_fidelity)]))
            for domain, members in own.signals.items()
        } | {"measurement_uncertainty": by_hand}
        weights = {"system_dynamics": 0.4, "residual_vehicle_model": 0.4, "measurement_uncertainty": 0.2}
        assert own.total == pytest.approx(math.sqrt(sum(weights[k] * partial[k] ** 2 for k in weights)), abs=1e-5)


def test_closing_the_loop_raises_the_fidelity(found):
    assert found.after.total > found.before.total


def test_without_sensor_uncertainty_the_weights_are_scaled_and_it_is_said(simulated):
    parts, traces = simulated
    rig = replace(parts.case.rig, sensors=tuple(replace(own, uncertainty=None) for own in parts.case.rig.sensors))
    said = match_fidelity(replace(parts, case=replace(parts.case, rig=rig)), traces).to_dict()
    assert said["after"]["R_MU"] is None
    assert said["weights"] == {"R_SD": 0.5, "R_RVM": 0.5, "R_MU": 0.0}
    assert any("R_MU is left out" in note for note in said["notes"])


def test_what_rests_does_not_count(simulated):
    parts, traces = simulated
    still = traces.vehicle | {"body_left_speed": np.zeros_like(traces.time)}
    found = match_fidelity(parts, replace(traces, vehicle=still))
    assert found.at_rest == (PLACE + "body_left_speed",)
    resting = {name: np.zeros_like(own) for name, own in traces.vehicle.items()}
    assert match_fidelity(parts, replace(traces, vehicle=resting)) is None
