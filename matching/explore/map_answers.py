"""Answers from a map that was computed: at a point of it, and between its points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from modelling.common.errors import InputError


class MapGrid(NamedTuple):
    """Values of x (i,), of y (j,), SI, and a quantity of the points (j, i), NaN where there is none."""

    x: np.ndarray
    y: np.ndarray
    values: np.ndarray


def grid(content: Mapping[str, Any], key: str = "error") -> MapGrid:
    """A quantity of a map over its axes.

    Parameters
    ----------
    content : mapping
        Of ``map.json``.
    """
    x, y = (np.array(content[axis]["values"]) for axis in ("x", "y"))
    values = [np.nan if point[key] is None else point[key] for point in content["points"]]
    return MapGrid(x, y, np.array(values, float).reshape(len(y), len(x)))


def nearest_point(content: Mapping[str, Any], x: float, y: float) -> dict[str, Any]:
    """The point of the map nearest to values (SI) of its quantities, each counted in steps of its axis."""
    row, column = round(_place(content, "y", y)), round(_place(content, "x", x))
    return dict(content["points"][row * len(content["x"]["values"]) + column])


def interpolated_error(content: Mapping[str, Any], x: float, y: float) -> float:
    """Response error between the points of a map: its logarithm is linear in steps of the axes.

    Parameters
    ----------
    x, y : float
        SI.

    Raises
    ------
    InputError
        If the point lies outside the map, or beside a point without an error.
    """
    for axis, value in (("x", x), ("y", y)):
        values = content[axis]["values"]
        if not values[0] <= value <= values[-1]:
            raise InputError(
                content[axis]["name"], f"{value:g} lies outside the map", f"{values[0]:g} … {values[-1]:g}"
            )
    columns, rows, errors = grid(content)
    places = np.arange(len(rows), dtype=float), np.arange(len(columns), dtype=float)
    read = RegularGridInterpolator(places, np.log(errors))
    answer = float(np.exp(read([[_place(content, "y", y), _place(content, "x", x)]])[0]))
    if not np.isfinite(answer):
        raise InputError("", "a point beside it has no error", "compute it exactly")
    return answer


def _place(content: Mapping[str, Any], axis: str, value: float) -> float:
    """Where a value lies on an axis, in steps from its first."""
    values = np.array(content[axis]["values"])
    return float(np.interp(value, values, np.arange(len(values))))
