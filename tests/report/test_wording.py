"""Numbers and units in words: a printed number can be pasted into a calculator and means the same."""

import math

import pytest

from matching.report.common import (
    amount,
    change,
    component,
    enough_digits,
    hertz,
    number,
    percent,
    practical,
    sentence,
    unit,
)
from modelling.display import counted


@pytest.mark.parametrize("value", [0.0, 3.0, -0.5, 438_500.0, 1.234e6, 12_345.678, 5e-4, 7.16e-6, -2.2e9, 99_999.6])
@pytest.mark.parametrize("digits", [2, 3, 4, 5])
def test_a_number_reads_back_to_its_digits(value, digits):
    text = number(value, digits)
    assert float(text) == pytest.approx(value, rel=0.51 * 10.0 ** (1 - digits), abs=1e-300)
    assert text.isascii()


@pytest.mark.parametrize(
    ("value", "text"),
    [(438_500.4, "438500"), (1.5e6, "1500000"), (2.5e7, "2.5e7"), (1.25e-4, "0.000125"), (2e-6, "2e-6"), (None, "–")],
)
def test_only_very_large_and_very_small_numbers_have_an_exponent(value, text):
    assert number(value) == text


def test_practical_units():
    assert practical(0.003, "s") == "3 ms"
    assert practical(math.pi / 2, "rad") == "90 °"
    assert practical(100 * math.pi, "rad/s", 4) == "3000 1/min"
    assert practical(150_000, "W") == "150 kW"
    assert practical(12.5, "N*m") == "12.5 N·m"
    assert practical(None, "s") == "– ms"


def test_units_amounts_and_shares():
    assert [unit(si) for si in ("kg*m^2", "N*m*s/rad", "1", "N*m/rad^3")] == ["kg·m²", "N·m·s/rad", "", "N·m/rad³"]
    assert amount(0.05, "kg*m^2") == "0.05 kg·m²"
    assert amount(2.0, "1") == "2"
    assert percent(0.98765) == "98.77 %"
    assert (hertz(8.44), hertz(16.7), hertz(math.nan)) == ("8.440", "16.70", "–")


@pytest.mark.parametrize(
    ("before", "after", "text"),
    [
        (2.0, 3.0, "+50 %"),
        (2.0, 1.0, "-50 %"),
        (1.0, 4.0, "× 4"),
        (4.0, 1.0, "× 0.25"),
        (1.0, 1.0004, "unchanged"),
        (1.0, 1.001, "+0.1 %"),
        (0.0, 1.0, ""),
    ],
)
def test_changes(before, after, text):
    assert change(before, after) == text


def test_names_and_sentences():
    assert component("rig.shafts.flange_left.stiffness") == "flange left, stiffness"
    assert component("dynamometers.left.torque") == "dynamometer left, torque"
    assert component("dynamometers.dynamometer.speed") == "dynamometer, speed"
    assert component("loop.dead_time") == "dead time"
    assert [sentence(parts) for parts in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == ["", "a", "a and b", "a, b and c"]


@pytest.mark.parametrize("apart", [1.3e-4, 1e-3, 0.2])
@pytest.mark.parametrize("size", [1e-5, 0.65, 8.149, 4e5])
def test_close_numbers_have_enough_digits_to_differ(size, apart):
    ends = [size, size * (1 + apart)]
    low, high = (float(number(end, enough_digits(ends))) for end in ends)
    assert high - low == pytest.approx(size * apart, rel=0.11)


def test_equal_and_unknown_ends_get_the_least_digits():
    assert enough_digits([8.1, 8.1], 4) == enough_digits([None, 8.1], 4) == enough_digits([], 4) == 4


def test_counts_agree_with_their_nouns():
    assert [counted(count, "point") for count in (0, 1, 2)] == ["0 points", "1 point", "2 points"]
    assert [counted(count, "quantity", "quantities") for count in (1, 2)] == ["1 quantity", "2 quantities"]
