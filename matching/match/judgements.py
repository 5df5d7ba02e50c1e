"""What a judge in time found, as data: sentences are made of it, never the other way round."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Judgement:
    """One requirement that beds in time do not keep.

    Attributes
    ----------
    what : str
        ``free_play``, ``standing`` or ``emulation``.
    size, allowed : float
        In ``unit``: of the worst bed, and what is allowed of it.
    unit : str
    where : str
        Which signal, and in which run.
    beds, of : int
        How many of the beds that were run.
    cause : str
        The key of the case that causes it; empty where none was found.
    remedy : tuple of (str, float), optional
        A key and the value (SI) with which the same controller keeps it, run; empty where none was found.
    """

    what: str
    size: float
    allowed: float
    unit: str
    where: str
    beds: int
    of: int
    cause: str = ""
    remedy: tuple[str, float] | tuple[()] = ()

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {**vars(self), "size": self.size if np.isfinite(self.size) else None, "remedy": list(self.remedy)}
