"""Result files are contracts: every key that a command writes, with the kind of its value, is kept in a list.

A key that is lost, renamed or holds another kind of value fails; so does a new one until it stands in the list,
``tests/kept/keys.json`` (``make kept`` renews it). Its entries were compared with the fixed formats once; they say
nothing of values.
"""

import json
from collections import defaultdict
from typing import Any

from kept_lists import kept

KINDS = {str: "text", bool: "truth", int: "number", float: "number", type(None): "null"}


def keys(result: Any) -> dict[str, str]:
    """Path of every key → kinds of its values; ``[]`` stands for the entries of a list, of which there may be none."""
    kinds: dict[str, set[str]] = defaultdict(set)
    _collect(result, "", kinds)
    return {path: " or ".join(sorted(kind)) for path, kind in sorted(kinds.items())}


def _collect(value: Any, path: str, kinds: dict[str, set[str]]) -> None:
    if isinstance(value, dict):
        kinds[path].add("table")
        for key, entry in value.items():
            _collect(entry, f"{path}/{key}", kinds)
    elif isinstance(value, list):
        kinds[path].add("list")
        for entry in value:
            if not isinstance(entry, str):  # notes in words: as many as there are
                _collect(entry, f"{path}[]", kinds)
    else:
        kinds[path].add(KINDS[type(value)])


def same_keys(name: str, result: Any) -> None:
    """Compare a result, as read from its file, with what is kept under the name."""
    present = keys(json.loads(json.dumps(result)))
    listed = kept("keys.json", name, present)
    differ = {path: (listed.get(path), present.get(path)) for path in sorted(listed.keys() | present.keys())}
    wrong = {path: pair for path, pair in differ.items() if pair[0] != pair[1]}
    assert not wrong, f"{name}: kept and present keys differ, path → (kept, present): {wrong}"
