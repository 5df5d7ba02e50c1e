"""Numbers and names in results, and where things are drawn, as they were when somebody last looked; kept in lists.

``values.json``, ``drawn.json``, ``statements.json`` in ``tests/kept``; ``make kept`` renews them. Independent tests
say which values are right; these lists say that none has changed since, also those that nobody thought of. Only what is
worked out without a search is kept: where a search ends depends on the processor's rounding.
"""

import json
import math
import os
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from kept_lists import kept
from matplotlib.axes import Axes
from matplotlib.figure import Figure

PASSING = ("version", "date", "seconds", "checksum", "sha256", "platform")  # keys whose values change from run to run
ROUNDING = 1e-9  # a number below is 0 but for rounding
ENTRIES = 12  # of a list of tables: the first ones


def same_values(name: str, result: Any, within: float = 1e-6, without: tuple[str, ...] = ()) -> None:
    """Compare numbers (relative difference ``within``) and names of a result with what is kept under the name.

    ``without`` are parts of paths: what only rounding decides.
    """
    everything = dict(_leaves(json.loads(json.dumps(result)), ""))
    present = {path: value for path, value in everything.items() if not any(part in path for part in without)}
    _compare(name, present, kept("values.json", name, present), within)


def same_places(name: str, figure: Figure, within: float = 1e-4) -> None:
    """Compare where lines, bars, areas and texts of a figure stand with what is kept under the name."""
    figure.canvas.draw()
    present = {f"{i} {what}": numbers for i, axes in enumerate(figure.axes) for what, numbers in _places(axes)}
    _compare(name, present, kept("drawn.json", name, present), within)


def _places(axes: Axes) -> Iterator[tuple[str, list[float]]]:
    """What is drawn, in its data's units."""
    yield "limits", [_rounded(value) for value in (*axes.get_xlim(), *axes.get_ylim())]
    for i, line in enumerate(axes.get_lines()):
        for direction, values in zip("xy", line.get_data(orig=False), strict=True):
            yield from _of_list(f"line {i}, {direction}", np.asarray(values, dtype=float).ravel())
    for i, patch in enumerate(axes.patches):
        yield (
            f"patch {i}",
            [_rounded(value) for value in patch.get_path().get_extents(patch.get_patch_transform()).extents],
        )
    for i, collection in enumerate(axes.collections):
        extents = collection.get_datalim(axes.transData).extents
        yield f"collection {i}", [_rounded(value) for value in extents if np.isfinite(value)]
        if collection.get_array() is not None:
            yield from _of_list(f"values of collection {i}", np.ma.getdata(collection.get_array()).ravel())
    for i, text in enumerate(axes.texts):
        yield f"text {i}", [_rounded(float(value)) for value in text.get_position()]


def _leaves(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Path and value of numbers, names and truths; of a list of numbers what tells it from others."""
    if isinstance(value, dict):
        for key, entry in value.items():
            if not any(word in key for word in PASSING):
                yield from _leaves(entry, f"{path}/{key}")
    elif isinstance(value, list):
        if value and all(isinstance(entry, int | float | None) for entry in value):
            yield from _of_list(path, np.array([math.nan if entry is None else entry for entry in value], dtype=float))
            return
        yield f"{path}[]", len(value)
        for i, entry in enumerate(value[:ENTRIES]):
            yield from _leaves(entry, f"{path}[{i}]")
    elif isinstance(value, str):
        if not re.search(r"[\s\d]", value) and os.sep not in value:
            yield path, value
    else:
        yield path, _rounded(value) if isinstance(value, float) else value


def _of_list(path: str, values: np.ndarray) -> Iterator[tuple[str, list[float]]]:
    """Length, how many are numbers; their mean, root mean square, and a sum that depends on the order."""
    known = values[np.isfinite(values)]
    yield f"{path}, numbers", [values.size, known.size]
    if known.size:
        size = float(np.abs(known).max()) or 1.0
        order = np.cos(0.7 * np.arange(known.size))
        sums = known.mean(), size * np.sqrt(np.mean((known / size) ** 2)), np.mean(known * order)
        yield path, [_rounded(value) for value in sums]


def _rounded(value: float) -> float:
    return float(f"{value:.9g}")


def _compare(name: str, present: dict[str, Any], listed: dict[str, Any], within: float) -> None:
    paths = sorted(listed.keys() | present.keys())
    pairs = {path: (listed.get(path), present.get(path)) for path in paths}
    wrong = {path: pair for path, pair in pairs.items() if not _alike(*pair, within)}
    assert not wrong, f"{name}: kept and present values differ, path → (kept, present): {wrong}"


def _alike(before: Any, present: Any, within: float) -> bool:
    """Numbers of a list are compared with the largest of them."""
    if isinstance(before, list) and isinstance(present, list):
        largest = max(map(abs, (*before, *present)), default=0.0)
        return len(before) == len(present) and np.allclose(before, present, rtol=0, atol=within * largest + ROUNDING)
    if any(isinstance(value, bool | str | None) for value in (before, present)):
        return type(before) is type(present) and before == present
    return math.isclose(before, present, rel_tol=within, abs_tol=ROUNDING)


def same_statement(name: str, stated: Any) -> None:
    """Compare what the program states to its users (names, units, bounds) with what is kept, to the letter."""
    present = json.loads(json.dumps(stated, default=_stated))
    assert present == kept("statements.json", name, present)


def _stated(thing: Any) -> Any:
    """Dataclasses by field, sets in order."""
    if is_dataclass(thing) and not isinstance(thing, type):
        return {field.name: getattr(thing, field.name) for field in fields(thing)}
    if isinstance(thing, set | frozenset):
        return sorted(thing)
    raise TypeError(f"{thing!r} is no statement")
