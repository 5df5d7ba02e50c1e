"""What moves as parts 0 … 1 of its range, and back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from matching.frequency.case.case import Move
from matching.frequency.programme.closed_loop import ClosedLoopFunctions

LOGARITHMIC_FROM_RATIO = 4.0  # upper over lower bound, above which a range is scaled by its logarithm


def unscaled(part: Any, move: Move) -> Any:
    """Value of a move in SI from its scaled part 0 … 1 (float or CasADi expression, and so the value)."""
    if is_logarithmic(move):
        return move.lower * (move.upper / move.lower) ** part
    return move.lower + (move.upper - move.lower) * part


def scaled(value: float, move: Move) -> float:
    """Scaled part 0 … 1 of a value in SI."""
    if is_logarithmic(move):
        return float(np.log(value / move.lower) / np.log(move.upper / move.lower))
    return (value - move.lower) / (move.upper - move.lower)


def scale_of(move: Move) -> tuple[float, float]:
    """Lower bound and range, the range of the logarithm where that is scaled."""
    return move.lower, float(np.log(move.upper / move.lower)) if is_logarithmic(move) else move.upper - move.lower


def is_logarithmic(move: Move) -> bool:
    """Whether a move is scaled by its logarithm."""
    return move.lower > 0 and move.upper / move.lower > LOGARITHMIC_FROM_RATIO


def fixed_numbers(loop: ClosedLoopFunctions, moves: Sequence[Move]) -> np.ndarray:
    """Numbers (c,) that the compiled functions take: the loop's, then those that scale each move."""
    scales = [scale_of(move) for move in moves]
    return np.concatenate([loop.fixed, *scales]) if scales else loop.fixed


class ScaledSymbols(NamedTuple):
    """Released quantities (scaled), numbers of :func:`fixed_numbers`, and p as expressions of both."""

    free: ca.SX
    fixed: ca.SX
    p: ca.SX


def symbols(known: int, logarithmic: tuple[bool, ...]) -> ScaledSymbols:
    """Symbols of a programme; ``known`` of the fixed numbers are the loop's."""
    count = len(logarithmic)
    free, fixed = ca.SX.sym("free", count), ca.SX.sym("fixed", known + 2 * count)
    p = ca.SX(count, 1)
    for i, log in enumerate(logarithmic):
        low, span = fixed[known + 2 * i], fixed[known + 2 * i + 1]
        p[i] = low * ca.exp(span * free[i]) if log else low + span * free[i]
    return ScaledSymbols(free, fixed, p)
