"""Faults of channels: what they do to a signal, and which factor is called by a name."""

import numpy as np
import pytest

from modelling.recordings.channel_faults import CONVERSIONS, KINDS, conversion, factor_fault, fault, units_of
from modelling.units import factor

SIGNAL = np.array([0.0, 1.0, -2.0, 3.0])


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "factor"])
def test_every_kind_has_words(kind):
    made = fault(kind, "speed", "other", size="3 rad/s")
    assert made.words
    assert "{" not in made.sentence


def test_what_faults_do_to_a_signal():
    assert fault("sign", "a").acted(SIGNAL).tolist() == (-SIGNAL).tolist()
    assert not fault("stuck", "a").acted(SIGNAL).any()
    assert factor_fault("a", "speed", 0.5, 0.01).acted(SIGNAL).tolist() == [0, 0.5, -1, 1.5]
    assert fault("delay", "a", value=0.1).acted(SIGNAL, 0.1) == pytest.approx([0, 0, 1, -2])
    assert fault("held", "a", value=0.2).acted(SIGNAL, 0.1).tolist() == [0, 0, -2, -2]
    assert np.isnan(fault("dropouts", "a", value=0.2).acted(SIGNAL, 0.1)).tolist() == [False, True, False, True]
    assert fault("rounded", "a", value=2.0).acted(SIGNAL).tolist() == [0, 0, -2, 4]
    assert fault("clipped", "a", value=1.5).acted(SIGNAL).tolist() == [0, 1, -1.5, 1.5]


@pytest.mark.parametrize("order", [1, 2, 4])
def test_a_filter_halves_the_power_at_its_corner(order):
    time = np.arange(20000) * 1e-4
    filtered = fault("filter", "a", value=20.0, order=order).acted(np.sin(2 * np.pi * 20 * time), 1e-4)
    assert np.std(filtered[10000:]) == pytest.approx(0.5, rel=1e-3)


@pytest.mark.parametrize("one", CONVERSIONS)
def test_the_line_of_a_conversion_mends_what_it_names(one):
    """The unit's size in SI, or the factor of the line, times reading over truth is 1."""
    what, _, value = one.line.partition(" = ")
    si = {"speed": "rad/s", "angle": "rad", "torque": "N*m"}[one.quantities[0]]
    mends = factor(value.strip('"'), si) if what == "unit" else float(value)
    assert mends * one.factor == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize(
    ("value", "quantity", "named"),
    [(0.501, "speed", "half"), (0.737, "torque", "lbf·ft"), (9.54, "speed", "1/min"), (8.9, "torque", "lbf·in"),
     (0.6, "speed", None), (0.95, "torque", None), (0.0, "speed", None)],
)  # fmt: skip
def test_a_factor_within_its_uncertainty_has_its_name(value, quantity, named):
    found = conversion(value, quantity, 0.02)
    assert (found is None) if named is None else (named in found.words)


def test_any_factor_is_named_with_its_value():
    made = factor_fault("flange", "torque", -0.612, 0.02, 0.004)
    assert made.words == "reads 0.6120 ± 0.0080 times as large, and has the wrong sign"
    assert made.line == 'flange = { channel = "flange", factor = 1.634, sign = -1 }'


def test_units_of_a_quantity():
    sizes = dict(units_of("speed"))
    assert sizes["1/min"] == pytest.approx(2 * np.pi / 60)
    assert set(dict(units_of("angle"))) == {"deg", "turn"}
