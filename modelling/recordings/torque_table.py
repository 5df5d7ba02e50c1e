"""A table of a torque amplitude over speed, and over load: what a simulation of an engine's gas and mass torques gives.

Columns ``speed [1/min]``, ``torque [N*m]``; if there are, ``phase [deg]`` of the order's own cycle, and ``load``.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from modelling.errors import InputError, listed
from modelling.recordings.readers import read_table
from modelling.recordings.table import Column
from modelling.units import unit_of

COLUMNS = {"speed": "rad/s", "torque": "N*m", "phase": "rad", "load": "1"}
REACHES = 1e-6  # of the speed, by which a range may exceed its table: the rounding of written numbers


def torque_table(path: Path, unit: str, load: float | None) -> Callable[[np.ndarray], np.ndarray]:
    """Complex amplitude over speed, rad/s: linear between the rows.

    Parameters
    ----------
    unit : str
        SI unit of the amplitude: ``N*m``, or that of an imposed motion.
    load : float or None
        At which a table over load is read; linear between its loads.

    Raises
    ------
    InputError
        If a column is missing, a value is not a number, a load is needed or not covered; the function that is returned
        raises it for speeds that the table does not cover.
    """
    columns = {one.name.strip().lower(): one for one in read_table(path).columns}
    for name in ("speed", "torque"):
        if name not in columns:
            raise InputError(str(path), f"has no column {name!r}", f"it has {listed(list(columns))}")
    speed = _in_si(path, columns["speed"], "rad/s")
    amplitude = _in_si(path, columns["torque"], unit).astype(complex)
    if "phase" in columns:
        amplitude = amplitude * np.exp(1j * _in_si(path, columns["phase"], "rad"))
    if "load" in columns:
        speed, amplitude = _at_load(path, speed, amplitude, _in_si(path, columns["load"], "1"), load)
    order = np.argsort(speed)
    speed, amplitude = speed[order], amplitude[order]
    if len(speed) < 2 or (np.diff(speed) <= 0).any():
        raise InputError(str(path), "has no two different speeds, or one speed twice", "a row for every speed")

    def read(speeds: np.ndarray) -> np.ndarray:
        outside = (speeds < speed[0] * (1 - REACHES)) | (speeds > speed[-1] * (1 + REACHES))
        if outside.any():
            ends, asked = (30 / np.pi * np.array([each[0], each[-1]]) for each in (speed, np.sort(speeds)))
            raise InputError(
                str(path), f"covers {ends[0]:.6g} to {ends[1]:.6g} 1/min, not {asked[0]:.6g} to {asked[1]:.6g} 1/min",
                "ask for a range within the table, or add rows",
            )  # fmt: skip
        return np.interp(speeds, speed, amplitude.real) + 1j * np.interp(speeds, speed, amplitude.imag)

    return read


def _in_si(path: Path, column: Column, unit: str) -> np.ndarray:
    where = f"{path}: {column.name}"
    if not np.isfinite(column.values).all():
        raise InputError(where, "has rows without a number", "a number in every row")
    wanted = unit_of(unit, where)
    if not column.unit:
        if column.name.strip().lower() == "speed":
            raise InputError(where, "has no unit", "write speed [1/min] or speed [rad/s]")
        return column.values
    stated = unit_of(column.unit, where)
    if stated.dimension != wanted.dimension or stated.counts == "cycles":
        raise InputError(where, f"the unit {column.unit!r} does not fit", f"write one of {unit}")
    return np.asarray(stated.value_to_si(column.values) / wanted.scale)


def _at_load(
    path: Path, speed: np.ndarray, amplitude: np.ndarray, loads: np.ndarray, load: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Speeds and amplitudes at one load, between the two nearest ones of the table."""
    known = np.unique(loads)
    if load is None:
        raise InputError("load", f"{path} is a table over load", f"state one, e.g. --load {known[-1]:g}")
    if not known[0] <= load <= known[-1]:
        raise InputError("load", f"{load:g} is not in {path}", f"{known[0]:g} to {known[-1]:g}")
    above = min(int(np.searchsorted(known, load)), len(known) - 1)
    below = max(above - 1, 0) if known[above] != load else above
    rows = []
    for each in (known[below], known[above]):
        own = loads == each
        order = np.argsort(speed[own])
        rows.append((speed[own][order], amplitude[own][order]))
    (low_speeds, low), (high_speeds, high) = rows
    if len(low_speeds) != len(high_speeds) or not np.allclose(low_speeds, high_speeds, rtol=1e-9):
        raise InputError(str(path), "has other speeds at one load than at another", "the same speeds at every load")
    share = 0.0 if above == below else (load - known[below]) / (known[above] - known[below])
    return low_speeds, (1 - share) * low + share * high
