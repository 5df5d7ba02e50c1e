"""What a page makes of texts: minus signs, and what opens for printing."""

import pytest

from matching.report.page import Fold, Report, Table, minus_signs, page


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("-3.2 ± 0.1 N·m", "−3.2 ± 0.1 N·m"),
        ("from -40 to -2 (-1)", "from −40 to −2 (−1)"),
        ("1e-05, 2026-11-26, a-3, 3-5", "1e-05, 2026-11-26, a-3, 3-5"),
        ("--limit m=-5", "--limit m=-5"),
    ],
)
def test_a_minus_is_no_hyphen(text, shown):
    assert minus_signs(text) == shown
    html = page(Report("t", "s", text, table=Table([{"what": "x", "value": text}])), {}, {})
    assert html.count(shown) == 2


def test_several_folds_have_a_button_that_opens_all():
    folds = [Fold("one", ["a"]), Fold("two", ["b"]), Fold("none", [])]
    assert 'class="all"' in page(Report("t", "s", "a", folds=folds), {}, {})
    assert 'class="all"' not in page(Report("t", "s", "a", folds=folds[1:]), {}, {})
