"""Held-out data whose simulations are kept: several questions are asked of the same fit."""

from __future__ import annotations

from matching.diagnosis.data.segments import FitData, Segment
from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.fitting.holdout import Holdout, HoldoutRun

MOST_KEPT_READINGS = 10_000_000  # of all simulations: 80 MB


class RememberedHoldout:
    """Held-out data that are simulated once with each fit, as far as the memory for it goes."""

    def __init__(self, holdout: Holdout):
        self.holdout = holdout
        self._runs: dict[int, tuple[Fit, list[HoldoutRun]]] = {}  # with the fit, so that no other takes its identity
        self._left = MOST_KEPT_READINGS

    @property
    def data(self) -> FitData:
        """The data."""
        return self.holdout.data

    def simulate(self, fit: Fit) -> list[HoldoutRun]:
        """Simulate them with a fit."""
        if id(fit) in self._runs:
            return self._runs[id(fit)][1]
        runs = self.holdout.simulate(fit)
        size = sum(len(run.residual) for run in runs)
        if size <= self._left:
            self._left -= size
            self._runs[id(fit)] = fit, runs
        return runs

    def segments(self, fit: Fit) -> list[Segment]:
        """The segments to which the residuals of :meth:`simulate` belong, in their order."""
        return self.holdout.segments(fit)
