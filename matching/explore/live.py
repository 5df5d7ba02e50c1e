"""Modes and frequency responses that follow a slider: the equations are derived once, then only evaluated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from modelling.common.errors import InputError
from modelling.equations.compiled import compiled
from modelling.linear.linearise import linearise
from modelling.linear.response import Response, response
from modelling.modal.damped_modes import damped_modes_of
from modelling.modal.modes import LARGEST_WITH_ALL_MODES, modes_of
from modelling.modal.result import Modes
from modelling.model.quantity import Quantity
from modelling.model.system import System

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

    Raises
    ------
    InputError
        If the system is too large to be followed.
    """

    def __init__(self, system: System):
        self.system = system
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
        """Modes and responses at values (SI) by name.

        Raises
        ------
        InputError
            If there is nothing to oscillate about at these values.
        """
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
