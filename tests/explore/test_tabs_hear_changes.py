"""A change of a model on one tab of the page is told to those that show it."""

from importlib.util import find_spec
from types import SimpleNamespace

import pytest

pytestmark = pytest.mark.skipif(not find_spec("panel"), reason="needs Panel")


class Tab:
    """A tab that notes what it is told."""

    def __init__(self, name, told, heard):
        self.heard, self.name, self.told = heard, name, told

    def panel(self):
        return self.name

    def __getattr__(self, name):
        return lambda: self.heard.append(f"{self.name}.{name}")


@pytest.fixture
def tabs(monkeypatch):
    """The three tabs once each was opened, and what they heard."""
    from matching.explore import page as server

    heard, made = [], {}

    def maker(name):
        def make(workspace, *rest):
            made[name] = Tab(name, rest[-1] if rest else None, heard)
            return made[name]

        return make

    for name in ("DrivetrainTab", "ModesTab", "MatchTab"):
        monkeypatch.setattr(server, name, maker(name))
    makers = server._makers(SimpleNamespace(models={"rig": ""}, case="case"), SimpleNamespace(example=print))
    assert [makers[name]() for name in ("Drivetrain", "Modes", "Match")] == ["DrivetrainTab", "ModesTab", "MatchTab"]
    return SimpleNamespace(**made), heard


def test_a_value_that_is_entered_is_seen_by_modes_and_match(tabs):
    opened, heard = tabs
    opened.DrivetrainTab.told()
    assert heard == ["ModesTab.open_model", "MatchTab.models_changed"]


def test_a_value_that_a_slider_keeps_is_seen_by_drawing_and_match(tabs):
    opened, heard = tabs
    opened.ModesTab.after_keeping()
    assert heard == ["DrivetrainTab.after_change", "MatchTab.models_changed"]


def test_a_matched_model_that_is_taken_over_is_seen_by_drawing_and_modes(tabs):
    opened, heard = tabs
    opened.MatchTab.told()
    assert heard == ["DrivetrainTab.after_change", "ModesTab.open_model"]
