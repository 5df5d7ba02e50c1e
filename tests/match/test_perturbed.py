"""What starts agree on is left again by searches from about it; the local search is a made-up one."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np

from matching.match.case_file import load_case
from matching.match.solve import solve
from tests.match import drawn
from tests.match.programme import programme_of


@dataclass
class MadeUp:
    """A programme of two quantities, nothing of which is solved."""

    moves: tuple = (SimpleNamespace(name="loop.integral_gain"), SimpleNamespace(name="rig.J"))
    lower: np.ndarray = field(default_factory=lambda: np.zeros(2))
    upper: np.ndarray = field(default_factory=lambda: np.ones(2))


BEGINS: list[float] = []
HELD: list[float] = []


def test_a_wider_bound_does_not_worsen_the_answer(tmp_path):
    """A drawn case whose starts agree on a small integral gain with a heavy residual vehicle.

    A gain at its bound with a lighter one is better by a tenth; the wider the bounds, the fewer starts came there.
    """
    task = programme_of(load_case(drawn.draw(34, tmp_path)))
    wider = replace(
        task,
        moves=tuple(
            replace(move, upper=3 * move.upper) if move.name.startswith("loop.") else move for move in task.moves
        ),
    )
    narrow_answer, wide_answer = solve(task, 0), solve(wider, 0)
    poor = min(objective for objective in narrow_answer.starts if objective is not None)
    assert narrow_answer.objective < 0.95 * poor
    assert wide_answer.objective < 0.95 * narrow_answer.objective
