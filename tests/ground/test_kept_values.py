"""How values of results and places in figures are compared with their lists."""

import kept_lists
import pytest
from kept_values import _alike, _leaves, same_places
from matplotlib.figure import Figure


@pytest.mark.parametrize(
    ("before", "present", "alike"),
    [(1.0, 1.0 + 5e-7, True), (1.0, 1.0 + 5e-6, False), (1e-12, -3e-11, True), ([3.0, 1e6], [3.5, 1e6], True),
     ([3.0, 1e6], [5.0, 1e6], False), ([1.0], [1.0, 1.0], False), ([], [], True), (True, 1, False), (None, 0.0, False),
     ("sine", "ramp", False), ("sine", "sine", True), (2, "two", False)],
)  # fmt: skip
def test_what_counts_as_alike(before, present, alike):
    assert _alike(before, present, 1e-6) == alike
    assert _alike(present, before, 1e-6) == alike


def test_order_and_size_of_a_list_are_kept_but_not_what_changes_from_run_to_run():
    def leaves(values):
        return dict(_leaves({"seconds": 1.0, "kind": "multisine", "said": "two words", "values": values}, ""))

    assert set(leaves([1.0, 2.0])) == {"/kind", "/values", "/values, numbers"}
    assert leaves([1.0, 2.0, 3.0])["/values"] != leaves([2.0, 1.0, 3.0])["/values"]
    assert leaves([1.0, None])["/values, numbers"] == [2, 1]
    assert leaves([{"a": 1}, {"a": 2}]) | {"/values[]": 2, "/values[1]/a": 2} == leaves([{"a": 1}, {"a": 2}])


@pytest.mark.parametrize(("move", "same"), [(0.0, True), (0.1, False)])
def test_a_bar_a_line_or_a_text_that_moves_is_noticed(move, same, monkeypatch):
    def drawn(shift):
        figure = Figure()
        axes = figure.subplots()
        axes.bar([0, 1], [1 + shift, 2])
        axes.set_xlim(-1, 2)
        axes.set_ylim(0, 3)
        return figure

    monkeypatch.setattr(kept_lists, "renewing", True)
    monkeypatch.setattr(kept_lists, "renewed", {})
    same_places("bars", drawn(0.0))
    monkeypatch.setattr("kept_values.kept", lambda file, name, present: kept_lists.renewed[file][name])
    if same:
        same_places("bars", drawn(move))
    else:
        with pytest.raises(AssertionError, match="patch 0"):
            same_places("bars", drawn(move))
