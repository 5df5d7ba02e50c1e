"""How a value changes while a machine warms up or cools down: towards a final value, exponentially from the start."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from sympy import Expr

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import EquationBuilder, Symbols
from modelling.effects.kind import Parameter, State

PARAMETERS = {"change": Parameter("1", lower=-1.0), "time_constant": Parameter("s", lower=1e-3)}
STATE = State("1", "share of the change of {place} that has happened", from_zero=True)
FIRST_SHARE = 1.0  # time constant of the screening, of the longest recording: nearly a straight line
NEARBY_SHARES = (0.3,)  # the same of a further guess, which bends
FASTEST = 0.1  # of a guess: what has changed sooner is a value that is wrong throughout, which has kinds of its own


def factor(p: Symbols, assembly: EquationBuilder, name: str) -> Expr:
    """1 + change·(1 − exp(−t/time_constant)), by a state of that name: t from the start of the recording."""
    done = assembly.add_state(name, lambda z: (1 - z) / p["time_constant"])
    return 1 + p["change"] * done


def done_after(seconds: float, time_constant: float) -> float:
    """Share of the change that has happened ``seconds`` after the start of a recording."""
    return float(-np.expm1(-seconds / time_constant))


def drift_bounds(guess: float) -> tuple[float, float]:
    """Bounds of a time constant, s, in a fit that starts from a guess."""
    return FASTEST * guess, math.inf


def first_guesses(motion: FittedMotion, at: str, signal: np.ndarray, *, bent: bool = False) -> Iterator[Guess]:
    """Guesses of what a value adds at a place as it changes; ``signal`` (t,) is what it contributes itself."""
    longest = float(motion.time.max(initial=0.0))
    for share in NEARBY_SHARES if bent else (FIRST_SHARE,):
        if longest > 0:
            constant = share * longest
            yield Guess(({at: -np.expm1(-motion.time / constant) * signal},), _changed(constant))


def _changed(time_constant: float) -> Callable[[np.ndarray], dict[str, float] | None]:
    def parameters(a: np.ndarray) -> dict[str, float] | None:
        return {"change": float(a[0]), "time_constant": time_constant} if a[0] > -1 else None

    return parameters
