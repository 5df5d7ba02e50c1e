"""The plant against recordings of another plant: with what their answers tell, it follows them to the noise."""

import json
from pathlib import Path

import numpy as np
import pytest

from plant.following import remaining

PRACTICE = Path(__file__).parents[2].parent / "shared" / "practice"


@pytest.mark.skipif(not PRACTICE.exists(), reason="the shared practice recordings are not here")
@pytest.mark.parametrize(
    ("case", "free", "length"),
    [
        ("case00", (), 3000),
        ("case01", ("torque",), 3000),
        ("case02", ("gap",), 3200),
        ("case04", ("cubic",), 3000),
        ("case06", ("delay",), 3000),
    ],
)
def test_follows_the_practice_recordings_to_the_noise(case: str, free: tuple[str, ...], length: int) -> None:
    answer = json.loads((PRACTICE / "answers.json").read_text())[case]
    left, found = remaining(PRACTICE / case, answer, free, length)
    assert max(left.values()) < 1 + 4 / np.sqrt(2 * length)
    for name in free:
        assert found[name] == pytest.approx(1.0, abs=0.01)
