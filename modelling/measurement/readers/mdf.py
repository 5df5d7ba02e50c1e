"""MDF measurement files, versions 3 and 4, by asammdf: channels by name, units as they stand, on one time base."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from modelling.common.errors import InputError, listed
from modelling.measurement.readers.table import Table

SAME = 1e-3  # of a step: nearer time stamps are one


def read(path: Path, used: Collection[str] | None = None) -> Table:
    """Read an MDF file on the time base with most samples; slower channels are missing between their samples.

    Only channels that are used are read, and only they decide the time base. A sample marked invalid is missing. Where
    groups hold the same channel the one with most samples is taken.

    Raises
    ------
    InputError
        If it is no MDF file, has no channel of numbers, or a used channel holds none.
    """
    from asammdf import MDF

    try:
        with MDF(path) as file:
            masters = set(file.masters_db.items())
            places = {name: [one for one in at if one not in masters] for name, at in file.channels_db.items()}
            wanted = [name for name, at in places.items() if at and (used is None or name in used)]
            found = {
                name: max(file.select([(name, *one) for one in places[name]], copy_master=False), key=len)
                for name in wanted
            }
    except OSError:
        raise
    except Exception as fault:  # asammdf raises many kinds for what is not MDF
        raise InputError(str(path), f"is no MDF file: {fault}", "save it as MDF 4") from None
    signals = {name: own for name, own in found.items() if _numbers(own)}
    for name in found:
        if used is not None and name not in signals:
            raise InputError(f"{path}: channel {name!r}", "holds no numbers", "record it as one number a sample")
    others = tuple(name for name, at in places.items() if at and name not in signals)
    if not signals:
        if used is not None and others:
            return Table(["time"], ["s"], np.empty((0, 1)), others=others)  # what is missing is told by who asked
        raise InputError(str(path), "has no channel of numbers", "record inputs and sensors into it")
    time = max((signal.timestamps for signal in signals.values()), key=len)
    values = np.full((len(time), len(signals) + 1), np.nan)
    values[:, 0] = time
    moved = []
    for column, (name, signal) in enumerate(signals.items(), 1):
        samples = signal.samples.astype(float)
        if signal.invalidation_bits is not None:
            samples[np.asarray(signal.invalidation_bits, dtype=bool)] = np.nan
        values[:, column], between = _placed(time, signal.timestamps, samples)
        if between:
            moved.append(name)
    units = ["s", *(signal.unit or "" for signal in signals.values())]
    return Table(
        ["time", *signals],
        units,
        values,
        notes=_told(moved, [name for name in signals if len(places[name]) > 1]),
        others=others,
    )


def _numbers(signal: Any) -> bool:
    return signal.samples.ndim == 1 and signal.samples.dtype.kind in "fiu" and len(signal.samples) > 0


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


def _told(moved: list[str], several: list[str]) -> tuple[str, ...]:
    notes = []
    if moved:
        notes.append(
            f"channels sampled at other times, brought to the time base with most samples: {listed(moved)}; straight "
            "lines between samples"
        )
    if several:
        notes.append(f"in several groups, of which the one with most samples is taken: {listed(several)}")
    return tuple(notes)
