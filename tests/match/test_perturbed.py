"""What starts agree on is left again by searches from about it; the local search is a made-up one."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np


@dataclass
class MadeUp:
    """A programme of two quantities, nothing of which is solved."""

    moves: tuple = (SimpleNamespace(name="loop.integral_gain"), SimpleNamespace(name="rig.J"))
    lower: np.ndarray = field(default_factory=lambda: np.zeros(2))
    upper: np.ndarray = field(default_factory=lambda: np.ones(2))


BEGINS: list[float] = []
HELD: list[float] = []
