"""Lists that tests compare with, kept in ``tests/kept`` and renewed by ``make kept`` (``pytest --renew-kept``).

While they are renewed, only the tests that compare with a list are run, in this process, and what they find becomes the
list. What no test asked for is left out if all of them passed. The difference stands in git: read it before committing.
"""

import inspect
import json
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).with_name("kept")
SAME = ("keys", "figure", "words", "values", "places", "numbers", "statement")
COMPARE = (*(f"same_{what}(" for what in SAME), "kept_line(")
renewed: dict[str, dict[str, Any]] = {}  # file → name → what is kept from now on
renewing = False


def kept(file: str, name: str, present: Any) -> Any:
    """What a list keeps under a name; while the lists are renewed, what is present.

    Raises
    ------
    AssertionError
        If the list has no such name.
    """
    if renewing:
        renewed.setdefault(file, {})[name] = present
        return present
    listed = json.loads((FOLDER / file).read_text(encoding="utf-8"))
    assert name in listed, f"tests/kept/{file} has nothing under {name!r}; `make kept` adds it"
    return listed[name]


def compares(test: Any) -> bool:
    """Whether a test, as pytest collects it, compares with a list."""
    return any(call in inspect.getsource(test.function) for call in COMPARE)


def write(complete: bool) -> list[str]:
    """Write the lists anew; ``complete`` says that all tests passed. Names of the lists that changed."""
    changed = []
    for file, entries in renewed.items():
        path = FOLDER / file
        before = path.read_text(encoding="utf-8")
        listed = entries if complete else json.loads(before) | entries
        text = json.dumps(listed, indent=1, ensure_ascii=False, sort_keys=True) + "\n"
        if text != before:
            path.write_text(text, encoding="utf-8")
            changed.append(file)
    return changed
