"""Rules on what is left out reach no further than they say."""

import pytest

faults = pytest.importorskip("tests.mutants.operators", reason="mutmut comes with `make mutants`").faults


def changed(tmp_path, file, text, kind="number"):
    path = tmp_path / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return {fault.change for fault in faults(path, tmp_path) if fault.kind == kind}


def test_pixels_of_the_explorer_s_page_are_its_look_and_widths_elsewhere_are_not(tmp_path):
    text = "a = field(width=340, height=130, most=250, start=compute(width=2.0 * share))\n"
    on_page = changed(tmp_path, "matching/explore/page/a.py", text)
    assert on_page == {"250 → 500", "2.0 → 4.0"}
    assert changed(tmp_path, "matching/explore/a.py", text) == on_page | {"340 → 680", "130 → 260"}


def test_a_false_that_is_lost_is_as_untrue_and_a_true_is_not(tmp_path):
    text = "class A:\n    clock: bool = False\n    shared: bool = True\n"
    assert changed(tmp_path, "modelling/a.py", text, "assignment") == {"shared: bool = True → shared: bool = None"}
