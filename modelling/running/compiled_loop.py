"""The loop of ``rows.c``, compiled, and the vehicles that it can step."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from modelling.simulation.compiled import library_of

OPTIMISATION = "-O2 -ffp-contract=off"  # as NumPy rounds


@cache
def compiled_loop() -> ctypes.CDLL | None:
    """The library of ``rows.c``; None without a compiler."""
    source = Path(__file__).with_name("rows.c").read_text(encoding="utf-8")
    return library_of(source, OPTIMISATION, ["run_rows", "step_vehicles", "run_in_vehicles"])


@runtime_checkable
class CompiledVehicle(Protocol):
    """A vehicle of others whose process runs whole beds in C.

    Attributes
    ----------
    in_c : bool
        Whether it can: a compiler, FMI 2.0, one process for all rows.
    """

    in_c: bool

    def run_rows(
        self, functions: Mapping[str, tuple[ctypes.CDLL, str]], numbers: Mapping[str, Any],
        arrays: Mapping[str, np.ndarray], shares: Mapping[str, np.ndarray], given: Mapping[str, Any],
        chunks: Iterable[tuple[int, int, np.ndarray | None]], total: int,
    ) -> dict[str, np.ndarray]:  # fmt: skip
        """What C made of a run; see :class:`modelling.running.rows.RowsRun`.

        Parameters
        ----------
        functions : mapping of str to (CDLL, str)
            Library, and the name there.
        given : mapping
            Of :func:`modelling.running.rows.vehicles_given`.
        chunks : iterable of (int, int, ndarray or None)
            First sample, end, and the noise of these samples.
        total : int
            Samples.
        """
