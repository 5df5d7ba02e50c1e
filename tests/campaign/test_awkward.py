"""The integrator of the recordings that are made for faults."""

import numpy as np
import pytest

from tests.campaign.awkward import GRID, draw, motions


def test_motions_keep_the_momentum_balance_and_what_stands_stands():
    rng = np.random.default_rng(5)
    drawn = [draw(rng, number) for number in range(16)]
    u, speeds, angles, torques = motions(drawn, 0.6)
    for i, one in enumerate(drawn):
        last = one["count"] - 1
        if one["stands"]:
            assert np.all(speeds[:, i, last] == 0)
        elif one["hidden"] in ("nothing", "play"):
            J, drag, mine = one["J"][: last + 1], one["drag"][: last + 1], speeds[:, i, : last + 1]
            put_in = np.sum(u[:, i].sum(axis=1)[:-1]) * GRID
            lost = np.sum((mine[:-1] + mine[1:]) / 2 @ drag) * GRID
            assert mine[-1] @ J == pytest.approx(put_in - lost, rel=1e-3, abs=1e-3 * np.abs(u[:, i]).sum() * GRID)
        if "play" not in one["hidden"]:
            rate = speeds[:, i, 0] - speeds[:, i, 1]
            expected = one["k"][0] * (angles[:, i, 0] - angles[:, i, 1]) + one["c"][0] * rate
            np.testing.assert_allclose(torques[:, i, 0], expected, atol=0.02 * np.abs(expected).max() + 1e-9)
    free = [i for i, one in enumerate(drawn) if one["hidden"] == "play"]
    assert any(np.mean(torques[1:, i] == 0) > 0.02 for i in free)  # within the play no torque
