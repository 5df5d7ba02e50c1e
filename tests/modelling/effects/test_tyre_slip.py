"""Slip of a tyre: steady slip, small slips, the law past its peak and its linear model, each against a closed form."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.linear.linearise import operating_point
from modelling.linear.state_space import response
from modelling.model_file import from_dict
from modelling.simulation.simulate import simulate

K, D, SLIP_STIFFNESS, PEAK, SHAPE = 16000.0, 20.0, 24800.0, 1100.0, 1.65
SPEED, DRAG = 27.0, 6.0


def tyre(*effects, damping=D, **keys):
    """A wheel of 1 kg·m² on a tyre that rolls at the speed of a body."""
    return from_dict(
        {
            "inertias": {"wheel": {"J": 1.0}, "body": {"J": 90.0, "drag": DRAG}},
            "shafts": {"tyre": {"between": ["wheel", "body"], "stiffness": K, "damping": damping}},
            "inputs": {"drive": {"on": "wheel"}, "road": {"on": "body"}},
            "sensors": {
                "tyre_torque": {"measures": "torque", "of": "tyre"},
                "wheel_speed": {"measures": "speed", "of": "wheel"},
            },
            "effects": [
                {"kind": "tyre_slip", "at": "shafts.tyre", "slip_stiffness": SLIP_STIFFNESS, "peak": PEAK} | keys,
                *effects,
            ],
        }
    )


def magic(slip):
    return PEAK * np.sin(SHAPE * np.arctan(SLIP_STIFFNESS * slip / (SHAPE * PEAK)))


def slip_at(torque):
    return SHAPE * PEAK / SLIP_STIFFNESS * np.tan(np.arcsin(torque / PEAK) / SHAPE)


@pytest.mark.parametrize("share", [0.05, 0.7, 0.95])
def test_steady_slip_is_the_magic_formula_inverted(share):
    torque = share * PEAK
    point = operating_point(tyre(), {"body": SPEED}, {"drive": torque}, free=["road"])
    names = list(compiled(tyre()).states)
    wheel = point.x0[names.index("speed(wheel)")]
    assert wheel / SPEED - 1 == pytest.approx(slip_at(torque), rel=1e-7)
    assert magic(wheel / SPEED - 1) == pytest.approx(torque, rel=1e-7)
    # the carcass deflects by the torque that it would carry without a peak
    assert K * point.x0[names.index("shafts.tyre.tyre_slip")] == pytest.approx(SLIP_STIFFNESS * slip_at(torque))


@pytest.mark.parametrize("share", [0.0, 0.8])
def test_the_linear_model_is_that_of_a_carcass_on_the_slope_of_the_formula(share):
    """Wheel speed over torque, by hand: torque' = F'·(k + d·s)·δ', δ' = (Δω' − κ·ω_road')/(s + v·(k + d·s)/K)."""
    torque, step = share * PEAK, 1e-6
    slip = slip_at(torque)
    slope = (magic(slip + step) - magic(slip - step)) / (2 * step * SLIP_STIFFNESS)
    system = tyre()
    point = operating_point(system, {"body": SPEED}, {"drive": torque}, free=["road"])
    f = np.array([0.3, 2.0, 8.0, 30.0])
    s = 2j * np.pi * f
    carcass = K + D * s
    transfer = slope * carcass / (s + SPEED / SLIP_STIFFNESS * carcass)  # torque over Δω − κ·ω_road
    # wheel: s·w = 1 − T; road: (90·s + drag)·r = T; T = transfer·(w − (1 + κ)·r)
    expected = []
    for si, t in zip(s, transfer, strict=True):
        matrix = np.array([[si + t, -t * (1 + slip)], [-t, 90 * si + DRAG + t * (1 + slip)]])
        expected.append(np.linalg.solve(matrix, [1.0, 0.0])[0])
    got = response(point, f, ["wheel_speed"], ["drive"]).values.ravel()
    np.testing.assert_allclose(got, expected, rtol=1e-6)


def test_a_small_slip_is_a_damper_in_series_with_the_coefficient_of_the_speed():
    plain = {"kind": "slip", "at": "shafts.tyre", "coefficient": SLIP_STIFFNESS / SPEED}
    parts = {"inertias": {"wheel": {"J": 1.0}, "body": {"J": 90.0, "drag": DRAG}},
             "shafts": {"tyre": {"between": ["wheel", "body"], "stiffness": K, "damping": D}},
             "inputs": {"drive": {"on": "wheel"}},
             "sensors": {"tyre_torque": {"measures": "torque", "of": "tyre"}}}  # fmt: skip
    f = np.geomspace(0.2, 60, 9)
    rolling = operating_point(tyre(), {"body": SPEED}, {"drive": 0.0}, free=["road"])
    got = response(rolling, f, ["tyre_torque"], ["drive"]).values
    expected = response(from_dict(parts | {"effects": [plain]}), f, ["tyre_torque"], ["drive"]).values
    np.testing.assert_allclose(got, expected, rtol=1e-9)
    stuck = response(from_dict(parts), f, ["tyre_torque"], ["drive"]).values
    np.testing.assert_allclose(response(tyre(), f, ["tyre_torque"], ["drive"]).values, stuck, rtol=1e-9)  # standstill


@pytest.mark.parametrize("speed", [0.0, 8.0])
def test_a_torque_beyond_the_peak_spins_the_wheel_as_the_law_integrated_by_another_solver_does(speed):
    time = np.linspace(0, 1.5, 1501)
    drive = np.interp(time, [0.0, 0.1, 0.7, 0.8], [0.0, 1.6 * PEAK, 1.6 * PEAK, 0.0])

    def rates(t, x):
        wheel, body, deflection = x
        by = abs(body) / SLIP_STIFFNESS
        rate = (wheel - body - by * K * deflection) / (1 + by * D)
        torque = magic((K * deflection + D * rate) / SLIP_STIFFNESS)
        return [np.interp(t, time, drive) - torque, (torque - DRAG * body) / 90, rate]

    x = solve_ivp(rates, (0, time[-1]), [speed, speed, 0.0], t_eval=time, rtol=1e-8, atol=1e-9, max_step=0.002).y
    rate = np.array([rates(t, row)[2] for t, row in zip(time, x.T, strict=True)])
    torque = magic((K * x[2] + D * rate) / SLIP_STIFFNESS)
    start = {"speed(wheel)": speed, "speed(body)": speed} if speed else None
    got = simulate(tyre(), time, {"drive": drive, "road": 0 * drive}, start=start)
    for name, expected in (("wheel_speed", x[0]), ("tyre_torque", torque)):
        np.testing.assert_allclose(got[name], expected, atol=1e-3 * np.ptp(expected))
    assert got["tyre_torque"].max() == pytest.approx(PEAK, rel=1e-3)
    assert got["tyre_torque"][650] < 0.97 * PEAK  # past the peak it falls while the wheel spins


def test_it_is_refused_beside_another_damper_in_series():
    with pytest.raises(InputError, match=r"shafts\.tyre: slips twice"):
        compiled(tyre({"kind": "slip", "at": "shafts.tyre", "coefficient": 900.0}))
