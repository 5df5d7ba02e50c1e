"""Limits that a manoeuvre breaks, from peaks that are known."""

from types import SimpleNamespace

import pytest

from matching.match.verify import LeastDamped, Violation, violations_of

PEAKS = {
    "dynamometers.left.torque": 900.0, "dynamometers.right.torque": 1100.0, "dynamometers.left.speed": 200.0,
    "dynamometers.left.torque_over_speed": 0.5, "shafts.flange.torque": 600.0, "shafts.flange.twist": 0.02,
}  # fmt: skip


def broken(margin=1.0, damping=0.1, **limits):
    """Broken limits; a point in a name is written as two underscores."""
    limits = {name.replace("__", "."): value for name, value in limits.items()}
    return violations_of(
        SimpleNamespace(limits=limits), PEAKS, margin, LeastDamped(damping, 8.437, limits.get("damping_ratio", 0.0))
    )


def test_a_limit_of_dynamometers_holds_for_each_of_them_and_not_for_shafts():
    assert broken(dynamometer_torque=1000.0) == (
        Violation("dynamometer_torque", "dynamometers.right.torque", 1100.0, 1000.0),
    )
    assert [found.where for found in broken(dynamometer_torque=500.0)] == [
        "dynamometers.right.torque", "dynamometers.left.torque",
    ]  # fmt: skip
    assert broken(dynamometer_torque=1100.0) == ()
    assert broken(dynamometer_torque_over_speed=0.6, dynamometer_power=1.0) == ()


def test_a_limit_of_a_shaft_holds_for_that_shaft():
    assert broken(shafts__flange__torque=500.0) == (
        Violation("shafts.flange.torque", "shafts.flange.torque", 600.0, 500.0),
    )
    assert broken(shafts__flange__torque=600.0, shafts__flange__twist=0.02, shafts__side__torque=1.0) == ()


@pytest.mark.parametrize(("margin", "damping", "limit"), [(0.49, 0.1, "modulus_margin"), (0.5, 0.02, "damping_ratio")])
def test_margin_and_damping_are_limits_from_below(margin, damping, limit):
    found = broken(margin, damping, modulus_margin=0.5, damping_ratio=0.03)
    assert [violation.limit for violation in found] == [limit]
    assert broken(0.5, 0.03, modulus_margin=0.5, damping_ratio=0.03) == ()


def test_what_is_furthest_off_stands_first():
    """Of a limit from below that is allowed/value, from above value/allowed; a margin of 0 is off without end."""
    limits = {"modulus_margin": 0.5, "damping_ratio": 0.03, "dynamometer_speed": 100.0, "shafts.flange.twist": 0.019}
    found = broken(0.2, 0.02, **limits)
    assert [violation.limit for violation in found] == [
        "modulus_margin", "dynamometer_speed", "damping_ratio", "shafts.flange.twist",
    ]  # fmt: skip
    assert found[2].where == "mode at 8.44 Hz"
    assert broken(0.0, modulus_margin=0.5, shafts__flange__torque=1e-6)[0].limit == "modulus_margin"
    assert vars(found[1]) == {
        "limit": "dynamometer_speed", "where": "dynamometers.left.speed", "value": 200.0, "allowed": 100.0,
    }  # fmt: skip
