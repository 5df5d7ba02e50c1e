"""Simulations of held-out data are made once with each fit."""

from types import SimpleNamespace

import numpy as np
import pytest

from matching.diagnosis import search as remembered
from matching.diagnosis.search import RememberedHoldout


class Counted:
    """Held-out data of three readings that count their simulations."""

    data, count = "data", 0

    def simulate(self, fit):
        self.count += 1
        return [SimpleNamespace(residual=np.full(3, fit.value))]

    def segments(self, fit):
        return [fit]


def test_a_fit_is_simulated_once_and_another_by_itself() -> None:
    inside, fits = Counted(), [SimpleNamespace(value=value) for value in (1.0, 2.0)]
    kept = RememberedHoldout(inside)
    for _ in range(2):
        for fit in fits:
            (run,) = kept.simulate(fit)
            assert run.residual[0] == fit.value
    assert inside.count == 2
    assert (kept.data, kept.segments(fits[0])) == ("data", [fits[0]])


def test_what_memory_does_not_hold_is_simulated_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remembered, "MOST_KEPT_READINGS", 5)
    inside, fits = Counted(), [SimpleNamespace(value=value) for value in (1.0, 2.0)]
    kept = RememberedHoldout(inside)
    for _ in range(3):
        for fit in fits:
            kept.simulate(fit)
    assert inside.count == 1 + 3
