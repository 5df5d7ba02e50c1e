"""The compared functions of a rig whose controller is an observer with state feedback."""

from __future__ import annotations

import numpy as np

from matching.frequency.beds.closed_loop import action, bed_set
from matching.frequency.beds.closed_loop import responses as controlled
from matching.frequency.case.case import Case
from matching.frequency.loop.parts import Parts
from matching.frequency.response.responses import ComparedBed, Responses
from modelling.bed.observer_controller import ObserverController


class ObservedBed(ComparedBed):
    """A tuned bed under an observer; there is one loop for measured and unmeasured torques.

    Parameters
    ----------
    case, parts
        As for :class:`ComparedBed`.
    controller : ObserverController
    """

    def __init__(self, case: Case, parts: Parts, controller: ObserverController):
        super().__init__(case, parts)
        self.controller = controller

    @property
    def measured(self) -> np.ndarray:
        """False (h,) for every compared function: an observer has no feed-forward apart from its loop."""
        return np.zeros(len(self.pairs), bool)

    def at(self, frequencies: np.ndarray) -> Responses:
        """Responses at frequencies (f,), Hz, above 0 and below half the loop's sampling frequency."""
        f = np.asarray(frequencies, float)
        rig = self.parts.free
        free = self._picked(rig.response(2j * np.pi * f), rig.space.outputs, rig.space.inputs)
        bed, acting = bed_set(self.case, [{}], f), action(self.controller, f)
        matched, unmeasured = (controlled(bed, acting, measured)[0] for measured in (self.case.loop.measured, ()))
        return Responses(f, self.pairs, self.of_vehicle(f), free, matched, unmeasured)

    def held(self, frequencies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Two arrays (f, h) of NaN at frequencies (f,) in Hz: no feed-forward is designed apart from the observer."""
        empty = np.full((len(frequencies), len(self.pairs)), np.nan, complex)
        return empty, empty
