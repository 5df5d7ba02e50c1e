"""Which verdict a diagnosis reaches, from what it found."""

from types import SimpleNamespace

import numpy as np
import pytest

from matching.diagnosis import diagnose as diagnosis
from matching.diagnosis.diagnose import EXPLAINED_HOLDOUT_RATIO as RATIO

NAN = float("nan")


@pytest.mark.parametrize(("at_noise", "causes", "after_holdout", "verdict"), [
    (False, [], [0.5], "unexplained"),  # more than noise remains in the data that were fitted
    (False, ["lash"], [0.5], "unexplained"),
    (True, [], [0.99 * RATIO], "adequate"),  # nothing but noise, and nothing had to be added
    (True, [], [1.01 * RATIO], "unexplained"),  # something happens in the held-out data alone
    (True, ["lash"], [0.9, 0.99 * RATIO], "explained"),
    (True, ["lash"], [0.9, 1.01 * RATIO], "unexplained"),  # one sensor that was not fitted disagrees
    (True, ["lash"], [1.01 * RATIO, NAN], "unexplained"),
    (True, ["lash"], [1.0, NAN], "explained"),  # a sensor without held-out data says nothing
    (True, ["lash"], [], "explained"),
])  # fmt: skip
def test_verdict(monkeypatch, at_noise, causes, after_holdout, verdict):
    monkeypatch.setattr(diagnosis, "at_noise", lambda final: at_noise)
    updated = [np.tile(np.array([after_holdout]), (4, 1))]
    monkeypatch.setattr(diagnosis, "adapted", lambda *_: updated)
    judge = SimpleNamespace(simulate=lambda fit: [])
    final = SimpleNamespace(causes=causes, fit=None)
    assert diagnosis._verdict(final, judge, np.array(after_holdout)) == verdict


def test_blocks_that_noise_alone_fills_need_no_hold_out_recording(monkeypatch):
    """How uncertain its quantities are does not speak against a model that leaves noise everywhere."""
    monkeypatch.setattr(diagnosis, "at_noise", lambda final: True)
    assert diagnosis._verdict(SimpleNamespace(causes=[], fit=None), None, np.array([3.0])) == "adequate"
