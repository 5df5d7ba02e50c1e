"""Held-out data of a drive that rattles: simulated in windows where the free continuation loses its way, not else."""

from types import SimpleNamespace

import numpy as np
import pytest

from matching.diagnosis import diagnose as diagnosis
from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.holdout import RestartedRest, RestOfRecordings

TIME = np.arange(40) * 0.01
WHOLE = FitData((Segment(TIME, np.zeros((40, 0)), np.zeros((40, 1))),), np.ones(1))


def final(abrupt, noise=True):
    """A hypothesis with a law that may strike, and whether its residual is noise."""
    effects = [SimpleNamespace(law=SimpleNamespace(abrupt=abrupt))]
    return SimpleNamespace(
        noise=noise, fit=SimpleNamespace(problem=SimpleNamespace(system=SimpleNamespace(effects=effects)))
    )


def remembered(error):
    """Held-out data on which every fit leaves this error, in times the noise."""
    motion = SimpleNamespace(errors=np.full((20, 1), error), parts=lambda errors: [errors])
    return SimpleNamespace(simulate=lambda fit: [motion])


@pytest.fixture(autouse=True)
def _noise(monkeypatch):
    monkeypatch.setattr(diagnosis, "at_noise", lambda hypothesis: hypothesis.noise)


def test_a_drive_that_rattles_and_loses_its_way_is_begun_anew_in_windows():
    judge, notes = diagnosis._predictable(final(True), RestOfRecordings(WHOLE, (20,)), remembered(3.0))
    assert isinstance(judge, RestartedRest)
    assert judge.counts == (20,)
    assert notes == ["held-out data are simulated in windows of 1 s: rattling forgets where it began"]


@pytest.mark.parametrize(
    ("hypothesis", "error"), [(final(False), 3.0), (final(True, noise=False), 3.0), (final(True), 1.2)],
    ids=["no law strikes", "the fit itself leaves more than noise", "the way is kept"],
)  # fmt: skip
def test_all_else_goes_on_freely(hypothesis, error):
    kept = remembered(error)
    assert diagnosis._predictable(hypothesis, RestOfRecordings(WHOLE, (20,)), kept) == (kept, [])
