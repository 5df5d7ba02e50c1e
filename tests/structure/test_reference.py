"""What the reference pages are written from is complete: a new effect or key cannot be forgotten."""

import importlib
import inspect
import json
import re
import sys
from pathlib import Path

import pytest

from modelling.effects import EFFECTS

DOCS = Path(__file__).parents[2] / "docs"
KEPT = Path(__file__).parents[1] / "kept" / "keys.json"
BY_NAME = {  # tables whose keys are names of components, quantities, checks, levels or files of the user
    "alone", "asked", "by_origin", "checks", "command_noise", "dimensions", "domains", "errors", "integration_error",
    "kinetic",
    "largest_difference", "limits_used", "measured", "misfit", "operating_point", "operating_torques", "parameters",
    "potential", "judged_seconds", "speed_hold",
    "states", "together", "torque_gains", "uncertainty", "unmeasured", "yield",
}  # fmt: skip


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


@pytest.mark.usefixtures("site_pages")
def test_every_key_of_every_result_file_is_described():
    """By the docstring of a class on the page of the results, or in the tables below them."""
    from site_pages.functions import CLASSES
    from site_pages.result_keys import RESULT_KEYS

    classes = [(module, name) for modules in CLASSES.values() for module, names in modules.items() for name in names]
    texts = [inspect.getdoc(getattr(importlib.import_module(module), name)) for module, name in classes]
    described = set(re.findall(r"\w+", " ".join(texts))) | {key for keys in RESULT_KEYS.values() for key in keys}
    for module, name in classes:
        kind = getattr(importlib.import_module(module), name)
        described |= set(getattr(kind, "__dataclass_fields__", ())) | set(vars(kind))
    missing = set()
    for file, paths in json.loads(KEPT.read_text(encoding="utf-8")).items():
        for path in paths:
            *_, table, key = ["", *path.replace("[]", "").split("/")]
            if key and "." not in key and table not in BY_NAME and key not in described:
                missing.add(f"{file}: {path}")
    assert not missing, "; ".join(sorted(missing))
