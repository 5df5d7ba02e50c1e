"""How the words of terminal and pages are compared: numbers masked, words and their order not."""

import pytest
from kept_words import words


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
