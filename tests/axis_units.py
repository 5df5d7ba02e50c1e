"""The unit that an axis names is the unit of what is drawn on it: a figure against the ranges of its own data."""

import re

import numpy as np

UNIT = re.compile(r"(?:\bin |\[)(ms|s|Hz|°|%)(?=\]|$|[\s(])")


def drawn_on(figure):
    """Axis name, unit and the values drawn on every axis of a figure that names one of the units."""
    for axes in figure.axes:
        for name, column in (("x", 0), ("y", 1)):
            unit = UNIT.search(getattr(axes, f"get_{name}label")().replace("\n", " "))
            lines = [np.asarray(line.get_xydata(), float) for line in axes.get_lines()]
            whole = [points[:, column] for points in lines if len(points) > 2]  # not the lines that mark a place
            if unit and whole:
                values = np.concatenate(whole)
                yield name, unit[1], values[np.isfinite(values)]


def check(figure, *, seconds=None, hertz=None):
    """Times end at ``seconds``, frequencies lie in ``hertz``, phases are degrees; how many axes named such a unit."""
    count = 0
    for name, unit, values in drawn_on(figure):
        count += 1
        if unit in ("s", "ms") and name == "x":
            long = seconds * (1e3 if unit == "ms" else 1.0)
            assert long / 30 <= np.ptp(values) <= 1.01 * long  # part of it may be drawn; units are a thousand apart
        elif unit == "Hz":
            assert hertz[0] * 0.999 <= values.min() <= values.max() <= hertz[1] * 1.001
            assert values.max() > hertz[1] / 30
        elif unit == "°":
            assert 30 < np.abs(values).max() < 2000  # radians of a phase stay below some 20
    return count
