"""How the words of terminal and pages are compared: numbers masked, words and their order not."""

import pytest
from kept_words import _alike, numbers, words


def test_numbers_checksums_and_places_are_masked():
    text = "/tmp/x/case.toml 3f2a9c1: -1.2e-05 N·m,\n  12.4 ± 0.3 Hz in 20 s. At 2026-11-23 10:05:00; 5·10⁶ N·m/rad"
    assert words(text, "/tmp/x") == ["PLACE/case.toml #:", "# N·m, # ± # Hz in # s.", "At ### #;", "# N·m/rad"]


@pytest.mark.parametrize("digits", ["0.1", "1", "12.345678901", "1e-7", "−3.25", "1 000.5"])
def test_how_many_digits_a_number_has_makes_no_difference(digits):
    assert words(f"error {digits.replace(' ', '')} at mode") == ["error # at mode"]


def test_of_a_page_counts_what_is_read_and_what_is_read_aloud():
    page = """<!doctype html><html><head><style>b {x: 1}</style><title>A case</title></head>
    <body><h1 title="why">Answer</h1><svg><text>drawn</text></svg><script>let a</script><p>of <b>3</b> beds</p>"""
    assert " ".join(words(page)) == "A case why Answer of # beds"


def test_a_word_more_less_or_elsewhere_is_another_text():
    assert words("two beds stable") != words("two beds unstable")
    assert words("motor and load") != words("load and motor")
    assert words("error None") != words("error 1")


def test_numbers_are_those_that_are_read():
    text = "<!doctype html><p class='x7'>12.4 ± 0.3 Hz, −2·10⁻⁶ N on 2026-11-23 at 10:05</p><svg><text>9</text></svg>"
    assert numbers(text) == ["12.4", "0.3", "-2·10⁻⁶"]


@pytest.mark.parametrize(
    ("before", "present", "alike"),
    [("12.4", "12.5", True), ("12.4", "12.6", False), ("12.40", "12.5", True), ("2·10⁻⁶", "4·10⁻⁶", False),
     ("2·10⁻⁶", "2·10⁻⁵", False), ("1.20e-05", "1.21e-05", True), ("∞", "∞", True), ("∞", "3", False)],
)  # fmt: skip
def test_a_number_may_differ_by_one_in_its_last_digit(before, present, alike):
    assert _alike(before, present) == alike
