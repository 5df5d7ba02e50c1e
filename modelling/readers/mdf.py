"""MDF4 measurement files, by asammdf: channels by name, units as they stand, on one time base."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from modelling.errors import InputError
from modelling.readers import Table
from modelling.system import listed

SAME = 1e-3  # of a step: nearer time stamps are one


def read(path: Path) -> Table:
    """Read an MDF4 file on the time base with most samples; slower channels are missing between their samples.

    Raises
    ------
    InputError
        If it is no MDF file or has no channel of numbers.
    """
    from asammdf import MDF

    try:
        with MDF(path) as file:
            signals = [
                signal
                for signal in file.iter_channels(skip_master=True)
                if signal.samples.ndim == 1 and signal.samples.dtype.kind in "fiu" and len(signal.samples)
            ]
    except OSError:
        raise
    except Exception as fault:  # asammdf raises many kinds for what is not MDF
        raise InputError(str(path), f"is no MDF file: {fault}", "save it as MDF 4") from None
    if not signals:
        raise InputError(str(path), "has no channel of numbers", "record inputs and sensors into it")
    time = max((signal.timestamps for signal in signals), key=len)
    values = np.full((len(time), len(signals) + 1), np.nan)
    values[:, 0] = time
    moved = {}
    for column, signal in enumerate(signals, 1):
        values[:, column], between = _placed(time, signal.timestamps, signal.samples.astype(float))
        if between:
            moved[signal.name] = between
    header = ["time [s]", *(f"{signal.name} [{signal.unit}]" if signal.unit else signal.name for signal in signals)]
    return Table(header, values, notes=_told(moved))


def _placed(time: np.ndarray, own: np.ndarray, samples: np.ndarray) -> tuple[np.ndarray, int]:
    """Samples on a time base (t,): each at the row nearest to it, nothing in between; and how many had to be moved.

    A sample that lies beside its row is moved there on the straight line to its neighbour, at most half a step, so that
    a slow channel stays as slow as it is and none is made up.
    """
    placed = np.full(len(time), np.nan)
    there = np.isfinite(own) & np.isfinite(samples)
    own, samples = own[there], samples[there]
    if not len(own) or len(time) < 2:
        return placed, 0
    step = float(np.median(np.diff(time)))
    inside = (own >= time[0] - 0.5 * step) & (own <= time[-1] + 0.5 * step)
    right = np.clip(np.searchsorted(time, own), 1, len(time) - 1)
    rows = np.where(own - time[right - 1] <= time[right] - own, right - 1, right)
    beside = np.abs(own - time[rows]) > SAME * step
    known = inside & (~beside | ((time[rows] >= own[0]) & (time[rows] <= own[-1])))
    values = np.where(beside, np.interp(time[rows], own, samples), samples)
    placed[rows[known]] = values[known]
    return placed, int((known & beside).sum())


def _told(moved: dict[str, int]) -> tuple[str, ...]:
    if not moved:
        return ()
    several = f"channels sampled at other times, brought to the time base with most samples: {listed(list(moved))}"
    return (f"{several}; straight lines between samples",)
