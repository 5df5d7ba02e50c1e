"""Gains of an observer and its state feedback for given weights, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from matching.frequency.beds.gain_slopes import feedback_slopes, filter_slopes
from matching.frequency.beds.slopes import GainSlopes
from modelling.bed.observer.design import (
    Ahead,
    Feedback,
    assembled,
    feedback_on_all,
    laid_out,
    predicted,
)
from modelling.bed.observer.filter import Filter, filter_of
from modelling.bed.observer.model import ObserverModel
from modelling.bed.observer_controller import ObserverController

SETS_KEPT = 40  # of the points last worked out
REGULATOR = (
    "command_weight",
    "command_change_weight",
)  # the weights of the state feedback; the others are the filter's
PER_DECADE = float(np.log(10))
Design = TypeVar("Design")


@dataclass
class Gains:
    """Of a model; w weights, given by their decimal logarithms in the order of ``names``.

    ``_regulators`` (with gains (k, o)) and ``_filters`` hold what was worked out lately.
    """

    model: ObserverModel
    ahead: Ahead
    names: tuple[str, ...]
    _regulators: dict[tuple[float, ...], tuple[Feedback, np.ndarray]] = field(default_factory=dict)
    _filters: dict[tuple[float, ...], Filter] = field(default_factory=dict)

    def controller(self, logarithms: np.ndarray) -> ObserverController:
        """The controller for weights (w,).

        Raises
        ------
        InputError
            If the design has no solution.
        """
        return assembled(self.model, self.ahead, self.feedback(logarithms), self.correction(logarithms))

    def feedback(self, logarithms: np.ndarray) -> np.ndarray:
        """Gains (k, o) of the state feedback for logarithms (w,), see :mod:`modelling.bed.observer.design`."""
        return self._regulator(logarithms)[1]

    def correction(self, logarithms: np.ndarray) -> np.ndarray:
        """Correction for logarithms (w,), (n + e + v, y); see :class:`modelling.bed.observer.filter.Filter`."""
        return self._filter(logarithms).correction

    def _weights(self, logarithms: np.ndarray, of_regulator: bool) -> dict[str, float]:
        named = zip(self.names, logarithms.tolist(), strict=True)
        return {name: 10.0**value for name, value in named if (name in REGULATOR) == of_regulator}

    def _regulator(self, logarithms: np.ndarray) -> tuple[Feedback, np.ndarray]:
        weights = self._weights(logarithms, True)

        def design() -> tuple[Feedback, np.ndarray]:
            made = feedback_on_all(self.model, *(weights[name] for name in REGULATOR))
            return made, predicted(self.model, made.F, made.of_torques)

        return _kept(self._regulators, tuple(weights.values()), design)

    def _filter(self, logarithms: np.ndarray) -> Filter:
        weights = self._weights(logarithms, False)
        return _kept(self._filters, tuple(weights.values()), lambda: filter_of(self.model, weights))

    def slopes(self, logarithms: np.ndarray) -> GainSlopes:
        """Derivatives of the gains at logarithms (w,): a weight changes feedback or correction alone."""
        priced, weights = self._weights(logarithms, True), self._weights(logarithms, False)
        made, gains = self._regulator(logarithms)
        model, x = self.model, len(self.model.bed.whole)
        o = x + len(model.dynamometers) * (model.bed.delay + 1) + model.estimated
        of_feedback = feedback_slopes(model, made, *(PER_DECADE * priced[name] for name in REGULATOR))
        of_filter = filter_slopes(model, self._filter(logarithms), weights, tuple(weights))
        feedback = np.zeros((len(self.names), *gains[:, :o].shape))
        correction = np.zeros((len(self.names), o, of_filter.shape[2]))
        for slopes, name in zip(of_feedback, REGULATOR, strict=True):
            feedback[self.names.index(name)] = slopes[:, :o]
        for slopes, name in zip(of_filter, weights, strict=True):
            correction[self.names.index(name)] = laid_out(model, slopes)
        return GainSlopes(feedback, correction)


def _kept(designs: dict[tuple[float, ...], Design], key: tuple[float, ...], design: Callable[[], Design]) -> Design:
    """A design that was worked out lately, or is now."""
    if key not in designs:
        if len(designs) > SETS_KEPT:
            designs.clear()
        designs[key] = design()
    return designs[key]
