"""What an effect adds to the torque of a plain shaft, as its first guess says it, against a motion solved by SciPy."""

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from modelling.effects import EFFECTS
from modelling.effects.effect import FittedMotion

K, C, K2, J_ENDS, STEP = 300.0, 2.5, 1200.0, (0.4, 1.5), 2e-4
J_MIDDLE = 0.4 * J_ENDS[0]  # a share and, with K2, a ratio that are guessed


@pytest.fixture(scope="module")
def soft_motion():
    """Discs a and b; spring and damper from a to a third disc, a spring from there to b; its twist and shaft torque."""
    (a, b), middle = J_ENDS, J_MIDDLE
    stiffness = np.array([[K, -K, 0], [-K, K + K2, -K2], [0, -K2, K2]])
    damping = np.array([[C, -C, 0], [-C, C, 0], [0, 0, 0]])
    inverse = np.diag([1 / a, 1 / middle, 1 / b])
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-inverse @ stiffness, -inverse @ damping]])
    torque = np.array([0, 0, 0, 1 / a, 0, 0])[:, None]
    time = np.arange(8000) * STEP
    drive = 5 * np.sin(2 * np.pi * (1.0 + 3 * time) * time)
    _, _, x = lsim(StateSpace(A, torque, np.eye(6), np.zeros((6, 1))), drive, time)
    return time, x, x @ A.T + drive[:, None] * torque.T


def test_a_compliance_takes_from_the_shaft_what_a_third_disc_behind_a_spring_does(soft_motion):
    """Of a shaft with damping: twist and its rate both count, and the disc's inertia."""
    time, x, rates = soft_motion
    motion = FittedMotion(
        time, (slice(0, len(time)),), angle={"a": x[:, 0], "b": x[:, 2]}, speed={"a": x[:, 3], "b": x[:, 5]},
        acceleration={"a": rates[:, 3], "b": rates[:, 5]}, twist={"link": x[:, 0] - x[:, 2]},
        twist_rate={"link": x[:, 3] - x[:, 5]}, torque={}, input={}, reading={}, noise={},
        value={
            "shafts.link.stiffness": K, "shafts.link.damping": C,
            "inertias.a.J": J_ENDS[0], "inertias.b.J": J_ENDS[1],
        },
        ends={"link": ("a", "b")},
    )  # fmt: skip
    wanted = pytest.approx({"stiffness": K2, "J": J_MIDDLE})
    guesses = EFFECTS["compliance"].guesses(motion, "shafts.link")
    (guess,) = [one for one in guesses if one.parameters(np.ones(1)) == wanted]
    (found,) = guess.additions
    torque = K * (x[:, 0] - x[:, 1]) + C * (x[:, 3] - x[:, 4])
    added = torque - K * motion.twist["link"] - C * motion.twist_rate["link"]
    # the guess filters and differentiates to second order in the step of 0.2 ms
    np.testing.assert_allclose(found["shafts.link"], added, atol=2e-3 * np.abs(added).max())
    slowed = -J_MIDDLE * rates[:, 4]
    np.testing.assert_allclose(found["inertias.b"][5:-5], slowed[5:-5], atol=1e-2 * np.abs(slowed).max())
