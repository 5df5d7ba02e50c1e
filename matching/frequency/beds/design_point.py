"""A point of the search over an observer's weights: what was worked out there, and how it is judged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matching.frequency.beds.closed_loop import Action
from matching.frequency.beds.figures import LoopCurves
from modelling.bed.observer_controller import ObserverController

MERIT = 10.0  # cost of a requirement missed by all of it, where ends are compared


@dataclass(frozen=True)
class Judged:
    """Cost of a point of the search, and how much of its requirements is left, relative; negative if missed.

    Attributes
    ----------
    cost : float
    room : ndarray (r,)
        Of every bed's damping, every dynamometer's noise, roll-off and margin at every frequency.
    least : ndarray (b + 3,)
        The same, of noise, roll-off and margin the worst alone.
    """

    cost: float
    room: np.ndarray
    least: np.ndarray

    @property
    def merit(self) -> float:
        """By which points are compared: the cost, and much for what is missed."""
        return self.cost + MERIT * float(np.maximum(-self.least, 0.0).sum())


@dataclass(frozen=True)
class DesignPoint:
    """What was worked out at a point: poles (b, x), errors (b + 1,) over the tolerance, of the bed as planned last."""

    controller: ObserverController
    acting: Action
    curves: LoopCurves
    poles: np.ndarray
    errors: np.ndarray
