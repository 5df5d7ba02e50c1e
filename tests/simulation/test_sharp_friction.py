"""Dry friction in simulation against the law itself: sticking and sliding as separate motions, changed by events."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from modelling.model_file import from_dict
from modelling.simulation.simulate import simulate

TIME = np.arange(901) * 1e-3
TORQUE = 0.8 * np.sin(2 * np.pi * 1.7 * TIME) * np.cos(2 * np.pi * 0.4 * TIME)
J, STIFFNESS, DAMPING, FRICTION = np.array([0.02, 0.006]), 170.0, 0.02, 0.4
DRIVE = {
    "inertias": {"motor": {"J": J[0]}, "load": {"J": J[1]}},
    "shafts": {"link": {"between": ["motor", "load"], "stiffness": STIFFNESS, "damping": DAMPING}},
    "inputs": {"torque": {"on": "motor"}},
    "sensors": {"speed": {"measures": "speed", "of": "load"}, "link_torque": {"measures": "torque", "of": "link"}},
    "effects": [{"kind": "coulomb_friction", "at": "inertias.load", "torque": FRICTION}],
}


def link_torque(x):
    return STIFFNESS * (x[0] - x[1]) + DAMPING * (x[2] - x[3])


def phase(sign):
    """Right-hand side and the event that ends it; ``sign`` of the load's speed, 0 while it sticks."""

    def rates(t, x):
        load = 0.0 if sign == 0 else (link_torque(x) - sign * FRICTION) / J[1]
        return [x[2], x[3], (np.interp(t, TIME, TORQUE) - link_torque(x)) / J[0], load]

    def ends(t, x):
        return FRICTION - abs(link_torque(x)) if sign == 0 else sign * x[3]

    ends.terminal, ends.direction = True, -1
    return rates, ends


def by_events(time):
    """Speed of the load and torque of the shaft (t, 2) from rest."""
    x, now, sign, rows = np.zeros(4), 0.0, 0, [np.zeros(4)]
    for until in time[1:]:
        while now < until:
            rates, ends = phase(sign)
            part = solve_ivp(rates, (now, until), x, "DOP853", events=ends, rtol=1e-9, atol=1e-12)
            x, now = part.y[:, -1].copy(), part.t[-1]
            if part.status == 1:
                x[3] = 0.0
                breaks_away = sign == 0 or abs(link_torque(x)) > FRICTION
                sign = int(np.sign(link_torque(x))) if breaks_away else 0
        rows.append(x.copy())
    states = np.array(rows)
    return np.column_stack([states[:, 3], [link_torque(row) for row in states]])


@pytest.mark.parametrize(("compile_", "samples"), [(None, 901), (False, 501)])
def test_dry_friction_is_as_sharp_as_the_tolerance_asks(compile_, samples):
    time = TIME[:samples]
    exact = by_events(time)
    assert ((exact[:, 0] == 0) & (np.abs(exact[:, 1]) > 0.1)).sum() > samples / 30  # it sticks under load
    done = simulate(from_dict(DRIVE), time, {"torque": TORQUE[:samples]}, compile=compile_)
    got = np.column_stack([done["speed"], done["link_torque"]])
    error = np.abs(got - exact).max(axis=0) / np.ptp(exact, axis=0)
    assert error.max() < 1e-3
    assert (error <= 1e-4 + 2 * np.array([done.integration_error[name] for name in ("speed", "link_torque")])).all()


def test_a_stick_speed_that_is_given_stays():
    done = simulate(from_dict(DRIVE), TIME, {"torque": TORQUE}, {"simulation.stick_speed": 0.05})
    assert done.stick_speed == 0.05
