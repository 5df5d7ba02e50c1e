"""Gains of an observer and its state feedback for given weights, and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from matching.frequency.beds.slopes import GainSlopes
from modelling.bed.observer_controller import ObserverController
from modelling.bed.observer_design import Ahead, assembled, correction, state_feedback
from modelling.bed.observer_model import ObserverModel

STEP_DECADES = 1e-3  # of finite differences of the gains; Riccati equations are solved to 1e-6 or so
SETS_KEPT = 40  # of the points last worked out
REGULATOR = (
    "command_weight",
    "command_change_weight",
)  # the weights of the state feedback; the others are the filter's


@dataclass
class Gains:
    """Of a model; w weights, given by their decimal logarithms in the order of ``names``.

    ``_known`` holds gains (k, o) and corrections (n + e + v, y) worked out lately.
    """

    model: ObserverModel
    ahead: Ahead
    names: tuple[str, ...]
    _known: dict[tuple[bool, tuple[float, ...]], np.ndarray] = field(default_factory=dict)

    def controller(self, logarithms: np.ndarray) -> ObserverController:
        """The controller for weights (w,).

        Raises
        ------
        InputError
            If the design has no solution.
        """
        return assembled(self.model, self.ahead, self.feedback(logarithms), self.correction(logarithms))

    def feedback(self, logarithms: np.ndarray) -> np.ndarray:
        """Gains (k, o) of the state feedback for logarithms (w,), see :mod:`modelling.bed.observer_design`."""
        return self._gains(True, logarithms)

    def correction(self, logarithms: np.ndarray) -> np.ndarray:
        """Correction for logarithms (w,), (n + e + v, y); see :func:`modelling.bed.observer_design.correction`."""
        return self._gains(False, logarithms)

    def _gains(self, of_regulator: bool, logarithms: np.ndarray) -> np.ndarray:
        weights = {
            name: 10.0**value
            for name, value in zip(self.names, logarithms.tolist(), strict=True)
            if (name in REGULATOR) == of_regulator
        }
        key = of_regulator, tuple(weights.values())
        if key not in self._known:
            if len(self._known) > SETS_KEPT:
                self._known.clear()
            self._known[key] = (
                state_feedback(self.model, *(weights[name] for name in REGULATOR))
                if of_regulator
                else correction(self.model, weights)
            )
        return self._known[key]

    def slopes(self, logarithms: np.ndarray) -> GainSlopes:
        """Forward differences of the gains at logarithms (w,): a weight changes feedback or correction alone."""
        here = self.controller(logarithms)
        there = [self.controller(logarithms + STEP_DECADES * unit) for unit in np.eye(len(logarithms))]
        o = here.observed
        return GainSlopes(
            np.array([(each.F[:, :o] - here.F[:, :o]) / STEP_DECADES for each in there]),
            np.array([(each.L[:o] - here.L[:o]) / STEP_DECADES for each in there]),
        )
