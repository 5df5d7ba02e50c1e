"""Planned excitations: their information, their spectrum, the limits of the bed."""

import json
from dataclasses import replace

import numpy as np
import pytest
from axis_units import check
from result_schema import check_schema
from scipy.linalg import expm

from matching.bed.excite import (
    PRIOR,
    ExcitationOrder,
    ExcitedBeds,
    SpeedHold,
    chirp,
    error_weights,
    information,
    multisine,
    optimal_powers,
    plan_excitation,
    recorded_bed,
    steps,
)
from matching.cli import main
from matching.match.exported import exported_controller
from matching.match.loop import frequency_response, law_response, without_limits
from modelling.bed.vehicle import cut

FREE = SpeedHold(np.zeros(1), np.zeros(1))


def test_information_is_that_of_simulated_differences(limited_case):
    """Frequency domain with exact delays against samples stepped with torques as a bed holds them."""
    rig = limited_case.rig.with_values({"inertias.rotor.drag": 5.0})  # motions die out within the recording
    bed, box = recorded_bed(replace(limited_case, rig=rig)), limited_case.uncertainty
    step = limited_case.loop["sample_time"]
    lines = np.array([1.5, 4.0, 9.0, 15.0])
    demands = multisine(lines, np.array([0, 1, 0, 1]), np.full(4, 200.0), 2, 1400, step, 0)
    demands = np.vstack([np.zeros((10, 2)), demands, np.zeros((2000, 2))])
    p = len(box.uncertain)
    values = [box.at(0.1 * sign * np.eye(p)[i]) for i in range(p) for sign in (1, -1)]
    outputs = ExcitedBeds(bed, values, FREE).run(demands).outputs[:, :, : len(bed.sensors)]
    slopes = (outputs[:, 0::2] - outputs[:, 1::2]) / 0.2 / bed.noise
    wanted = np.einsum("tpy,tqy->pq", slopes, slopes)
    found = information(bed, box, demands, step, 0.0)
    size = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    np.testing.assert_allclose(found / size, wanted / size, atol=0.02)


def test_powers_are_optimal_in_closed_form():
    """Two lines, each telling one quantity: minimise Σ wᵢ/(prior + mᵢ·Pᵢ) with P₁ + P₂ given, by Lagrange."""
    m, w, budget = np.array([5.0, 0.8]), np.array([1.0, 4.0]), 30.0
    lines = np.zeros((2, 2, 2))
    lines[0, 0, 0], lines[1, 1, 1] = m
    found = optimal_powers(lines, np.zeros(2, int), np.diag(w), np.array([budget]))
    root = (budget + np.sum(PRIOR / m)) / np.sum(np.sqrt(w / m))
    np.testing.assert_allclose(found, root * np.sqrt(w / m) - PRIOR / m, rtol=1e-6)


def test_a_law_in_one_form_acts_as_the_observer_does(limited_case):
    case = limited_case
    frequencies = np.array([0.7, 3.0, 11.0, 60.0])
    observer = case.loop.structure.observer(case.rig, cut(case.vehicle, case.rig), case.loop)
    wanted = frequency_response(without_limits(observer), frequencies)
    found = law_response(exported_controller(case).law, frequencies, case.loop.controller_sensors)
    np.testing.assert_allclose(found.of_readings, wanted.of_readings, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.of_known, wanted.of_known, rtol=1e-6, atol=1e-9)


def test_weights_are_a_square_error(limited_case):
    weights = error_weights(limited_case)
    assert np.linalg.eigvalsh(weights).min() > -1e-12 * np.trace(weights)
    names = [one.name for one in limited_case.uncertainty.uncertain]
    matters = np.diag(weights)
    assert matters[names.index("dynamometers.dyno.torque_gain")] > matters[names.index("rig.shafts.flange.damping")]


def peaks(case, plan, values):
    """Largest torques, speed, power and twist of the bed under a plan: three masses, in the equations of this test.

    Motor, adapter and rotor with an air-gap lag; the command is a mean over each sample, late by the dead time.
    """
    own = {name.removeprefix("rig."): value for name, value in values.items()}

    def get(name):
        return own.get(name, case.rig.parameters[name].value if name in case.rig.parameters else None)

    J = np.array([get(f"inertias.{name}.J") for name in ("motor", "adapter", "rotor")])
    d = np.array([0.01, 0.0, 0.1])
    k, c = ([get(f"shafts.{name}.{key}") for name in ("side", "flange")] for key in ("stiffness", "damping"))
    lag, dead = values["loop.inverter_lag"], values["loop.dead_time"]
    A = np.zeros((6, 6))  # twists, speeds, air gap
    A[0, 2], A[0, 3], A[1, 3], A[1, 4] = 1, -1, 1, -1
    pull = np.array([[-1, 0], [1, -1], [0, 1]])
    A[2:5, :2] = pull * k / J[:, None]
    A[2:5, 2:5] = (pull * c @ np.array([[1, -1, 0], [0, 1, -1]]) - np.diag(d)) / J[:, None]
    A[4, 5] = values["dynamometers.dyno.torque_gain"] / J[2]
    A[5, 5] = -1 / lag
    B = np.zeros((6, 2))
    B[5, 0], B[2, 1] = 1 / lag, 1 / J[0]
    fine = 10
    h = case.loop["sample_time"] / fine
    block = expm(np.block([[A, B], [np.zeros((2, 8))]]) * h)
    late = round((dead - case.loop["sample_time"] / 2) / h)
    proportional, integral = plan.hold["dyno"]
    start = np.linalg.lstsq(np.vstack([np.hstack([A, B[:, :1]]), np.eye(7)[4]]),
                            np.append(np.zeros(6), plan.speed), rcond=None)[0]  # fmt: skip
    x, total, queue = start[:6].copy(), start[6], [start[6]] * late
    applied = np.vstack([(plan.torques[:-1] + plan.torques[1:]) / 2, plan.torques[-1:]])
    seen = []
    for now in applied:
        error = plan.speed - x[4]
        command = now[0] + total + proportional * error
        total += integral * case.loop["sample_time"] * error
        seen.append([command, x[4], command * x[4], k[1] * x[1] + c[1] * (x[3] - x[4]), x[0]])
        for _ in range(fine):
            queue.append(command)
            x = block[:6, :6] @ x + block[:6, 6:] @ np.array([queue.pop(0), now[1]])
    return np.abs(np.array(seen)).max(axis=0)


def test_limits_hold_on_the_nominal_and_on_the_worst_drawn_bed(limited_case, plan):
    """Every share is at most what was asked for, and equations of this test find the same peaks."""
    assert max(plan.used.values()) <= 0.8 + 1e-6
    assert max(plan.used.values()) > 0.75
    box = limited_case.uncertainty
    limits = np.array([400, 120, 30e3, 500, 0.05])
    names = ["dynamometer_torque", "dynamometer_speed", "dynamometer_power", "shafts.flange.torque",
             "shafts.side.twist"]  # fmt: skip
    positions = np.vstack([np.zeros(len(box.uncertain)), box.draw(1, 0)])
    shares = np.max([peaks(limited_case, plan, box.at(position)) for position in positions], axis=0) / limits
    np.testing.assert_allclose(shares, [plan.used[name] for name in names], rtol=0.03)


def test_a_recording_tells_what_matters(limited_case, plan):
    """Unknown values cost a quarter of the allowed error before the recording, and a twenty-fifth of it after."""
    assert plan.error_before > 0.2 * limited_case.tolerance
    assert plan.error_after < 0.04 * limited_case.tolerance
    assert all(one.after <= one.before * (1 + 1e-9) for one in plan.expected)
    shares = [one.share_before for one in plan.expected]
    assert shares == sorted(shares, reverse=True)


def test_all_of_a_recording_is_counted_on(plan):
    """A diagnosis fits all of it: what it has not seen are blocks, left out in turn."""
    step = plan.time[1] - plan.time[0]
    assert plan.fitted_until == pytest.approx(plan.time[-1] + step)


def test_shapes_begin_and_end_at_zero():
    lines = np.array([2.0, 7.0])
    for shape in (
        multisine(lines, np.array([0, 1]), np.array([1.0, 4.0]), 2, 3000, 1e-3, 0),
        chirp(1.0, 30.0, 1, 2, 3000, 1e-3),
        steps(0, 2, 3000, 1e-3),
    ):
        np.testing.assert_allclose(shape[[0, -1]], 0.0, atol=1e-4)
    rms = multisine(lines, np.array([0, 1]), np.array([1.0, 4.0]), 2, 40000, 1e-3, 0).std(axis=0)
    np.testing.assert_allclose(rms, [1.0, 2.0], rtol=0.02)


def test_the_command_writes_it(limited_path, tmp_path, capsys):
    out = tmp_path / "out"
    assert (
        main(
            [
                "excite",
                str(limited_path),
                "--duration",
                "6",
                "--beds",
                "1",
                "--limit",
                "motor_torque=80",
                "--out",
                str(out),
            ]
        )
        == 0
    )
    said = capsys.readouterr().out
    assert "asked for 80 %" in said
    result = json.loads((out / "excite.json").read_text(encoding="utf-8"))
    assert max(result["limits_used"].values()) <= 0.8 + 1e-6
    check_schema("excite", result)
    table = np.loadtxt(out / "excitation.csv", delimiter=",", skiprows=1)
    assert np.abs(table[:, 2]).max() <= 64.0001
    assert (out / "figures" / "excitation.svg").stat().st_size > 1000


def test_its_figure_holds_the_torques_and_what_each_quantity_adds(plan):
    drawn = plan.plot()
    *panels, below = drawn.axes
    for j, axes in enumerate(panels):
        (line,) = axes.get_lines()
        time, torque = line.get_xydata().T  # fewer points than samples, with the extremes of each stretch
        np.testing.assert_array_equal(torque, np.interp(time, plan.time, plan.torques[:, j]))
        assert (torque.min(), torque.max()) == (plan.torques[:, j].min(), plan.torques[:, j].max())
        assert np.diff(time).max() < 0.01 * plan.time[-1]
    assert all(panels[0].get_shared_x_axes().joined(panels[0], axes) for axes in panels)
    assert [text.get_text() for text in panels[0].texts] == [part.kind for part in plan.parts]
    areas = [end for area in panels[0].patches for end in (area.get_x(), area.get_x() + area.get_width())]
    assert areas == pytest.approx([end for part in plan.parts[::2] for end in (part.begin, part.end)])
    assert check(drawn, seconds=8.0) == 1  # the lowest panel names the time axis of all
    for line, key in zip(below.get_lines(), ("share_before", "share_after"), strict=True):
        shares = [max(getattr(quantity, key), 1e-6) for quantity in plan.expected[:12]]
        assert list(line.get_xdata()) == shares


@pytest.mark.parametrize(
    ("more", "wrong"),
    [
        (["--limit", "road=80"], "is no input beside the dynamometers'"),
        (["--limit", "motor_torque"], "is no pair"),
        (["--duration", "1"], "too short"),
        (["--margin", "1.5"], "is no share"),
        (["--speed", "119"], "choose another speed"),
    ],
)
def test_wishes_that_cannot_be_met(more, wrong, limited_path, tmp_path, capsys):
    assert main(["excite", str(limited_path), *more, "--out", str(tmp_path / "out")]) == 2
    assert wrong in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_excitation_too_weak_for_what_is_allowed_says_so_first_with_a_length_that_does(limited_case):
    """Sensors of 5 rad/s or 5 N·m of noise; a plan so many times as long leaves what is allowed."""
    sensors = tuple(replace(sensor, uncertainty=5.0) for sensor in limited_case.rig.sensors)
    noisy = replace(limited_case, rig=replace(limited_case.rig, sensors=sensors), tolerance=0.05)
    order = ExcitationOrder(duration=8.0, beds=1)
    plan = plan_excitation(noisy, order)
    assert plan.error_after > plan.allowed == 0.05
    assert 1 < plan.longer < 100
    assert str(plan).splitlines()[1].startswith("The excitation is too weak")
    longer = plan_excitation(noisy, replace(order, duration=plan.longer * order.duration))
    assert longer.error_after < 1.2 * 0.05
