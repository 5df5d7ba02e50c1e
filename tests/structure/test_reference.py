"""What the reference pages are written from is complete: a new effect or key cannot be forgotten."""

import sys
from pathlib import Path

import pytest

from modelling.effects import EFFECTS

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture
def site_pages(monkeypatch):
    """The package that writes the pages."""
    monkeypatch.syspath_prepend(str(DOCS))
    yield
    for name in [name for name in sys.modules if name.partition(".")[0] == "site_pages"]:
        del sys.modules[name]


def test_every_effect_says_how_it_looks_in_a_recording():
    assert [kind for kind, effect in EFFECTS.items() if not effect.in_recording] == []


@pytest.mark.usefixtures("site_pages")
def test_every_key_of_every_file_has_a_meaning():
    """``docs/site_pages/key_meanings.py`` holds the meanings; LookupError names what is missing."""
    from site_pages.keys import keys_page

    assert "`between`" in keys_page()


@pytest.mark.usefixtures("site_pages")
def test_a_key_without_a_meaning_is_named():
    from site_pages.keys import _table

    with pytest.raises(LookupError, match="new_key"):
        _table("[loop]", ["known", "new_key"], {"known": "is described"})


@pytest.mark.usefixtures("site_pages")
def test_every_effect_and_every_parameter_stands_on_its_page():
    from site_pages.effects import effects_page

    page = effects_page()
    for kind, effect in EFFECTS.items():
        section = page.partition(f"\n## {kind}\n")[2].partition("\n## ")[0]
        assert all(f"| `{key}` |" in section for key in effect.parameters), kind
