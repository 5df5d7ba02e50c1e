"""Free forces: what a torque that follows no law would take where a cause is, once the cause is fitted.

A kind that the vocabulary lacks is imitated by one that it has, at the right place: rubber by hysteresis, a rate limit
by a lag. What the imitation leaves is then again a force of that place. If a free force (a smooth curve over twist,
speed, load, angle or time, or a force with a memory) predicts much of that on data it was not fitted to, the place is
right and the kind is not. A cap on the size of the residual would be wrong: friction is found right beside large errors
of the model, which lie elsewhere, or are small beside the friction.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from matching.diagnosis.hypotheses import Hypothesis
from matching.diagnosis.screening import Screening
from modelling.effects.effect import FittedMotion, members
from modelling.system import System

KNOTS, TIMES = 9, 3  # of a curve, and of its slow change
ORDERS = (1, 2, 3, 4)  # of the angle of a machine, over which its input may change
MEMORIES = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)  # s, over which a force may remember what drives it
BLOCKS = 8  # of the data, each predicted by a force that was fitted to the others
RIDGE = 1e-6  # of the mean diagonal of the normal equations
OVER_SPEED, OVER_ANGLE = "its input and speed", "its input and angle"
MOST_VALUES = 30_000_000  # of the signatures of a family; 240 MB


@dataclass(frozen=True)
class FreeForce:
    """The free force that predicts most of the residual.

    Attributes
    ----------
    family : str
        What it depends on.
    decrease : float
        Of χ² on data it was not fitted to; 0 where none predicts anything.
    """

    family: str
    decrease: float


def free_force(final: Hypothesis, screening: Screening, at: str, only: Sequence[str] = ()) -> FreeForce:
    """The free force at a place beside a hypothesis, to first order, after fitted quantities and start states took what
    they can.

    Parameters
    ----------
    screening : Screening
        Of the hypothesis.
    only : sequence of str, optional
        What it may depend on; anything if not given.
    """
    best = FreeForce("", 0.0)
    edges = np.linspace(0, len(screening.mask), BLOCKS + 1).astype(int) * screening.mask.shape[1]
    for family, columns in _families(screening.motion, screening.system, members(at)[0]):
        if (only and family not in only) or not columns or len(columns) * len(screening.residual) > MOST_VALUES:
            continue
        place = ".".join(at.split(".")[:2]) if "+" not in at else ""
        places = [place] if place else members(at)
        rows = np.array([screening.signature(dict.fromkeys(places, column)) for column in columns])
        rows -= (rows @ screening.basis) @ screening.basis.T
        if np.isfinite(rows).all():
            best = max(best, FreeForce(family, _predicted(rows, screening.residual, edges)), key=lambda f: f.decrease)
    return best


def map_force(rest: Hypothesis, screening: Screening, at: str) -> FreeForce:
    """What the input of the machine at a place, times a curve over its speed or waves over its angle, predicts of a
    hypothesis's residual: its map, or a ripple that grows with the load."""
    return free_force(rest, screening, at, (OVER_SPEED, OVER_ANGLE))


def _predicted(rows: np.ndarray, residual: np.ndarray, edges: np.ndarray) -> float:
    """Decrease of the sum of squares of a residual (r,), every block predicted from the others."""
    parts = [slice(a, b) for a, b in pairwise(edges)]
    grams = [rows[:, p] @ rows[:, p].T for p in parts]
    alongs = [rows[:, p] @ residual[p] for p in parts]
    gram, along = np.sum(grams, axis=0), np.sum(alongs, axis=0)
    ridge = RIDGE * np.trace(gram) / len(gram) * np.eye(len(gram))
    out = 0.0
    for own, toward in zip(grams, alongs, strict=True):
        size = np.linalg.lstsq(gram - own + ridge, along - toward, rcond=None)[0]
        out += float(2 * size @ toward - size @ own @ size)
    return out


def _families(motion: FittedMotion, system: System, at: str) -> Iterator[tuple[str, list[np.ndarray]]]:
    """What a free force may depend on at a place, and the shapes (t,) it is made of."""
    table, name = at.split(".")[:2]
    if table == "shafts":
        twist = motion.twist[name]
        yield "the twist", _curve(twist)
        yield "the twist rate", _curve(motion.twist_rate[name])
        yield "the past of the twist", _memories(twist, motion)
        yield "twist and time", _changing(twist, motion, [twist])
    elif table == "inertias":
        speed = motion.speed[name]
        yield "the speed", _curve(speed)
        yield "the angle", _curve(motion.angle[name])
        yield "the past of the speed", _memories(speed, motion)
        yield "speed and time", _changing(speed, motion, _curve(speed, 5))
        loads = [motion.torque[shaft] for shaft, ends in motion.ends.items() if name in ends]
        if loads:
            yield "the load", _curve(np.sum(loads, axis=0))
        for part in system.inputs:
            if part.on == name and part.name not in system.imposed_by:
                yield from _products(motion, part.name, name)
    elif table in ("inputs", "sensors"):
        signal = (motion.input if table == "inputs" else motion.reading)[name]
        yield "its size", _curve(signal)
        yield "its rate of change", _curve(motion.per_segment(lambda t, s: np.gradient(s, t), signal))
        yield "its past", _memories(signal, motion)
        yield "size and time", _changing(signal, motion, [signal, np.ones_like(signal)])
        if table == "inputs":
            yield from _products(motion, name, next(part.on for part in system.inputs if part.name == name))


def _products(motion: FittedMotion, name: str, machine: str) -> Iterator[tuple[str, list[np.ndarray]]]:
    """What no force over one signal is: an input times a curve over the speed of its machine (the map of a motor), and
    times waves over its angle (a ripple that grows with the load, a crank)."""
    signal, angle = motion.input[name], motion.angle[machine]
    yield OVER_SPEED, [signal * hat for hat in _curve(motion.speed[machine])]
    waves = [wave(order * angle) for order in ORDERS for wave in (np.cos, np.sin)]
    if np.ptp(angle) > 2 * np.pi:
        yield OVER_ANGLE, [signal * wave for wave in waves]


def _curve(values: np.ndarray, knots: int = KNOTS) -> list[np.ndarray]:
    """Hats (t,) over values (t,), between their quantiles."""
    grid = np.unique(np.quantile(values, np.linspace(0, 1, knots)))
    return [np.interp(values, grid, unit) for unit in np.eye(len(grid))] if len(grid) > 2 else []


def _memories(values: np.ndarray, motion: FittedMotion) -> list[np.ndarray]:
    """Values (t,) without their slow part, for several memories."""
    return [values - values.mean(), *(values - motion.lagged(values, memory) for memory in MEMORIES)]


def _changing(values: np.ndarray, motion: FittedMotion, shapes: list[np.ndarray]) -> list[np.ndarray]:
    """Shapes (t,) each of which grows or falls over time."""
    grid = np.linspace(motion.time.min(), motion.time.max(), TIMES)
    return [shape * np.interp(motion.time, grid, unit) for shape in shapes for unit in np.eye(TIMES)]
