"""Result files are contracts: which keys stand in which table, and what kind of value each holds.

``result_schema.json`` has one line for each table of each result: its keys with the kinds of their values, a ``?``
after a key that not every such table has, ``*`` for names of components, quantities, checks or files of the user.
"""

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

SCHEMA = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
KINDS = {dict: "table", str: "text", bool: "truth", int: "number", float: "number", type(None): "null"}
# Tables whose keys are names of the user; an entry whose name has a point is one in every table.
BY_NAME = [
    "allowed", "alone", "asked", "by_origin", "checks", "command_noise", "dimensions", "domains", "errors",
    "integration_error", "judged_seconds", "kinetic", "largest_difference", "left", "limits_used", "measured", "misfit",
    "operating_point", "operating_torques", "parameters", "potential", "settings_without_controller", "speed_hold",
    "states", "together", "torque_gains", "uncertainty", "unexpected_torque_of_offsets", "unmeasured", "yield",
]  # fmt: skip


def check_schema(name: str, result: Any) -> None:
    """Compare the tables of a result with the lines of the schema under the name."""
    found: dict[str, list[dict[str, set[str]]]] = defaultdict(list)
    _collect(json.loads(json.dumps(result)), "", found)
    wrong = []
    for path, entries in found.items():
        listed = dict(entry.split(": ") for entry in SCHEMA[name].get(path, "").split(", ") if entry)
        needed = {key for key in listed if key[-1] not in "?*"}
        allowed = {key.removesuffix("?"): set(kinds.split("|")) for key, kinds in listed.items()}
        for entry in entries:
            wrong += [f"{path}/{key} is missing" for key in needed - entry.keys()]
            wrong += [
                f"{path}/{key} is {kinds}, listed is {allowed.get(key)}"
                for key, kinds in entry.items()
                if not kinds <= allowed.get(key, set()) and not _empty_list(kinds, allowed.get(key, set()))
            ]
    assert not wrong, f"{name} has another schema than tests/result_schema.json says: {sorted(set(wrong))}"


def _collect(value: Any, path: str, found: dict[str, list[dict[str, set[str]]]]) -> None:
    if isinstance(value, dict):
        by_name = path.rpartition("/")[2] in BY_NAME
        entry: dict[str, set[str]] = defaultdict(set)
        for key, content in value.items():
            key = "*" if by_name or "." in key else key
            entry[key] |= _kinds(content)
            _collect(content, f"{path}/{key}", found)
        found[path].append(entry)
    elif isinstance(value, list):
        for content in value:
            _collect(content, f"{path}[]", found)


def _kinds(value: Any) -> set[str]:
    if isinstance(value, list):
        return {f"list of {kind}" for entry in value for kind in _kinds(entry)} or {"list"}
    return {KINDS[type(value)]}


def _empty_list(kinds: set[str], allowed: set[str]) -> bool:
    return kinds == {"list"} and any(kind.startswith("list") for kind in allowed)
