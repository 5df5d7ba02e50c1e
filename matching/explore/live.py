"""Answers without a run: modes and responses that follow a slider, and values between the points of a map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from matching.explore.files import ModelDocument
from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.linear.linearise import linearise
from modelling.linear.state_space import Response, response
from modelling.modal.modes import LARGEST_WITH_ALL_MODES, damped_modes_of, modes_of
from modelling.modal.result import Mode, Modes
from modelling.system import Quantity, System

# --- Modes and frequency responses that follow a slider: the equations are derived once, then only evaluated.

FREQUENCIES = 300  # of a response, spaced logarithmically
BELOW, ABOVE = 0.1, 3.0  # of the lowest and the highest frequency drawn, times the lowest and highest mode
WIDEST_DECADES = 3.0  # drawn at most; the highest modes are left out before
SLIDER_FACTOR = 3.0  # a quantity without a range moves by this factor up and down


@dataclass(frozen=True)
class LiveState:
    """Undamped and damped modes and responses at one set of values."""

    modes: Modes
    damped: Modes
    response: Response | None


class LiveModel:
    """A system compiled once, evaluated at other values of its quantities.

    Attributes
    ----------
    system : System
    frequencies : ndarray (f,)
        Hz, of the responses.
    """

    def __init__(self, system: System):
        self.system = system = system.in_gear(1)
        self._model = compiled(system)
        if self._model.n > LARGEST_WITH_ALL_MODES:
            raise InputError(
                "inertias", f"{self._model.n} degrees of freedom are too many", f"at most {LARGEST_WITH_ALL_MODES}"
            )
        self.frequencies = _grid(self.modes())

    def modes(self, values: Mapping[str, float] | None = None) -> Modes:
        """Undamped modes at values (SI) by name."""
        return modes_of(self._model, self._model.vector(values)[None]).case(0)

    def at(self, values: Mapping[str, float] | None = None) -> LiveState:
        """Modes and responses at values (SI) by name."""
        linear, answer = linearise(self._model, values), None
        if self.system.inputs and self.system.sensors:
            answer = response(linear, self.frequencies)
        return LiveState(self.modes(values), damped_modes_of(linear), answer)


def slider_range(quantity: Quantity) -> tuple[float, float] | None:
    """Lower and upper end of a slider (SI): the range of an uncertain quantity, else a factor; None at zero."""
    if quantity.lower is not None and quantity.upper is not None and quantity.lower < quantity.upper:
        return quantity.lower, quantity.upper
    if quantity.value == 0:
        return None
    ends = sorted((quantity.value / SLIDER_FACTOR, quantity.value * SLIDER_FACTOR))
    return ends[0], ends[1]


def _grid(modes: Modes) -> np.ndarray:
    elastic = modes.frequencies[modes.frequencies > 0]
    low = BELOW * float(elastic[0]) if len(elastic) else BELOW
    high = ABOVE * float(elastic[-1]) if len(elastic) else 1 / BELOW
    return np.geomspace(low, min(high, low * 10**WIDEST_DECADES), FREQUENCIES)


# --- Answers from a map that was computed: at a point of it, and between its points.


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


# --- What if

LARGEST_SHARES = 3  # components of a mode that its row of the table names


@dataclass
class WhatIf:
    """A model with quantities that a slider moves.

    Attributes
    ----------
    document : ModelDocument
    values : dict of str to float
        Tried, SI, by name.
    now, before : LiveState
        With the tried values, and with those of the document.
    """

    document: ModelDocument
    values: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget what was tried, and follow the document."""
        self.live = LiveModel(self.document.system)
        self.values.clear()
        self.before: LiveState = self.live.at()
        self.now: LiveState = self.before

    @property
    def movable(self) -> dict[str, tuple[float, float]]:
        """Range of the slider (SI) of every quantity that has one."""
        ranges = {name: slider_range(quantity) for name, quantity in self.live.system.parameters.items()
                  if name in self.document.system.parameters}  # fmt: skip
        return {name: ends for name, ends in ranges.items() if ends is not None}

    def try_value(self, name: str, value: float) -> None:
        """Set a quantity (SI) and follow it."""
        values = self.values | {name: value}
        self.now = self.live.at(values)
        self.values = values

    def keep(self) -> None:
        """Write what was tried into the document, as changes that can be undone."""
        for name, value in self.values.items():
            self.document.set_value(name, value)
        self.reset()


def largest_shares(mode: Mode) -> str:
    """The components that hold most of a mode's energy, in words: ``body left 49 %, …``."""
    shares = sorted((mode.kinetic | mode.potential).items(), key=lambda item: -item[1])[:LARGEST_SHARES]
    return ", ".join(f"{name.partition('.')[2].replace('_', ' ')} {100 * share:.0f} %" for name, share in shares)
