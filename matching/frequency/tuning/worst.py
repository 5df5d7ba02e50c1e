"""The least damped beds of a box: from the least damped ones of a pool to the corners that the gradients point to."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

STARTS = 2  # of the pool's beds, the least damped ones
ROUNDS = 3  # of a descent at most, each with a gradient of its own
DIFFERENCE = 0.02  # of a half-width
SHARES = (1.0, 0.5)  # of the way to the corner that the gradient points to
WORTH_A_ROUND = 0.02  # of the requirement: a round that takes away less is the last


def worst_positions(room: Callable[[np.ndarray], np.ndarray], pool: np.ndarray) -> np.ndarray:
    """Positions (n, p) in the box at which least is left of a requirement, by descents from those of a pool (b, p).

    Parameters
    ----------
    room : callable
        What is left (b,) of the requirement at positions (b, p), each coordinate from −1 to 1.
    """
    if not pool.size:
        return pool[:0]
    begins = pool[np.argsort(room(pool))[:STARTS]]
    return np.unique([_descended(room, begin) for begin in begins], axis=0)


def _descended(room: Callable[[np.ndarray], np.ndarray], position: np.ndarray) -> np.ndarray:
    """The position (p,) with the least room that was met on the way."""
    value = float(room(position[None])[0])
    for _ in range(ROUNDS):
        inward = np.where(position > 0, -DIFFERENCE, DIFFERENCE)
        corner = -np.sign((room(position + np.diag(inward)) - value) / inward)
        tried = np.array([position + share * (corner - position) for share in SHARES])
        rooms = room(tried)
        best = int(np.argmin(rooms))
        worth = rooms[best] < value - WORTH_A_ROUND
        if rooms[best] < value:
            value, position = float(rooms[best]), tried[best]
        if not worth:
            break
    return position
