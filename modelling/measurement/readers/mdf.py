"""MDF measurement files, versions 3 and 4, by asammdf: channels by name, units as they stand, on one time base."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from modelling.common.errors import InputError, listed
from modelling.measurement.readers.table import Table

SAME_STAMP = 1e-3  # of a step: nearer time stamps are one
SAME_SHARE = 1e-3  # of a channel's range: channels of one name that differ less are copies of each other
LEAST_NUMBERS = 0.5  # of the samples: a channel with fewer holds states, not a quantity with a status now and then


def is_foreign(_: Path) -> bool:
    """Always: asammdf."""
    return True


@dataclass(frozen=True)
class _Channel:
    """A channel of numbers: samples and their times (t,) in s, NaN where invalid, and the texts among the samples."""

    name: str
    group: int
    unit: str
    time: np.ndarray
    samples: np.ndarray
    texts: tuple[str, ...]

    @property
    def varies(self) -> bool:
        there = self.samples[np.isfinite(self.samples)]
        return bool(len(there)) and bool(np.ptp(there) > 0)


def read(path: Path, used: Collection[str] | None = None, groups: Mapping[str, int] | None = None) -> Table:
    """Read an MDF file on the time base with most samples; slower channels are missing between their samples.

    Only channels that are used are read, and only they decide the time base. A sample that is marked invalid, or is a
    text in place of a number, is missing. Where several groups have the same channel, ``groups`` says which one to
    take; copies of one another, and constant ones beside one that varies, need no choice.

    Raises
    ------
    InputError
        If it is no MDF file, has no channel of numbers, a used channel holds none, or several that differ.
    """
    from asammdf import MDF

    groups = groups or {}
    try:
        with MDF(path) as file:
            masters = set(file.masters_db.items())
            places = {name: [place for place in at if place not in masters] for name, at in file.channels_db.items()}
            wanted = [name for name, at in places.items() if at and (used is None or name in used)]
            for name in wanted:
                _check_group(path, name, groups.get(name), [group for group, _ in places[name]])
            signals = {
                name: [
                    (group, file.select([(name, group, index)], copy_master=False)[0])
                    for group, index in places[name]
                    if groups.get(name, group) == group
                ]
                for name in wanted
            }
    except (InputError, MemoryError):
        raise
    except Exception as fault:  # asammdf raises many kinds for what is not MDF
        if isinstance(fault, OSError) and fault.strerror:
            raise
        raise InputError(str(path), f"is no MDF file: {fault}", "save it as MDF 4") from None
    channels, notes = [], []
    for name, versions in signals.items():
        numeric = [
            version for version in (_numeric(name, group, signal) for group, signal in versions) if version is not None
        ]
        if numeric:
            channel, note = _chosen(path, name, numeric)
            channels.append(channel)
            notes += note
        elif used is not None:
            raise InputError(f"{path}: channel {name!r}", "holds no numbers", "record it as one number a sample")
    others = tuple(name for name, at in places.items() if at and name not in [channel.name for channel in channels])
    if not channels and used is None:
        raise InputError(str(path), "has no channel of numbers", "record inputs and sensors into it")
    if not channels:  # what is missing is told by who asked
        return Table(["time"], ["s"], np.empty((0, 1)), others=others)
    return _table(channels, notes, others)


def _check_group(path: Path, name: str, group: int | None, there: list[int]) -> None:
    if group is not None and group not in there:
        raise InputError(
            f"{path}: channel {name!r}", f"is not in group {group}", f"it is in {listed([str(i) for i in there])}"
        )


def _numeric(name: str, group: int, signal: Any) -> _Channel | None:
    """The numbers of a signal; None where it holds none, or more texts than numbers."""
    samples: np.ndarray = signal.samples
    texts: tuple[str, ...] = ()
    if samples.ndim != 1 or not len(samples):
        return None
    if samples.dtype.kind in "SUO":
        samples, texts = _numbers_among_texts(samples)
        if np.isfinite(samples).mean() < LEAST_NUMBERS:
            return None
    elif samples.dtype.kind not in "fiu":
        return None
    samples = samples.astype(float)
    if signal.invalidation_bits is not None:
        samples[np.asarray(signal.invalidation_bits, dtype=bool)] = np.nan
    return _Channel(name, group, signal.unit or "", signal.timestamps, samples, texts)


def _numbers_among_texts(samples: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Numbers (t,) of a channel whose conversion turns some values into texts, NaN for those; and the texts."""
    texts = [value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value) for value in samples]
    numbers: dict[str, float] = {}
    for text in set(texts):
        try:
            numbers[text] = float(text)
        except ValueError:
            numbers[text] = np.nan
    remaining = sorted(text for text, number in numbers.items() if np.isnan(number))
    return np.array([numbers[text] for text in texts]), tuple(remaining)


def _chosen(path: Path, name: str, versions: list[_Channel]) -> tuple[_Channel, list[str]]:
    """Which of the channels of one name to take, and notes of it.

    Raises
    ------
    InputError
        If they differ.
    """
    varying = [version for version in versions if version.varies] or versions
    best = max(varying, key=lambda version: len(version.time))
    different = [version for version in varying if version is not best and not _same(best, version)]
    if different:
        there = listed(
            [str(version.group) for version in sorted([best, *different], key=lambda version: version.group)]
        )
        raise InputError(
            f"{path}: channel {name!r}",
            f"has different values in the groups {there}",
            f'choose one in a channel file: {name} = {{ channel = "{name}", group = {best.group} }}',
        )
    notes = []
    if len(versions) > 1:
        why = "the one that varies" if len(varying) < len(versions) else "with most samples"
        notes.append(f"{name} is in {len(versions)} groups, taken from group {best.group}: {why}")
    if best.texts:
        notes.append(f"{name} has the texts {listed(list(best.texts), 3)} among its numbers: those samples are missing")
    return best, notes


def _same(first: _Channel, second: _Channel) -> bool:
    """Whether the second agrees with the first wherever it has samples."""
    both = np.isfinite(first.samples)
    there = np.isfinite(second.samples) & (second.time >= first.time[0]) & (second.time <= first.time[-1])
    if not both.any() or not there.any() or first.unit != second.unit:
        return False
    expected = np.interp(second.time[there], first.time[both], first.samples[both])
    return bool(np.abs(second.samples[there] - expected).max() <= SAME_SHARE * np.ptp(first.samples[both]))


def _table(channels: list[_Channel], notes: list[str], others: tuple[str, ...]) -> Table:
    time = max((channel.time for channel in channels), key=len)
    values = np.full((len(time), len(channels) + 1), np.nan)
    values[:, 0] = time
    moved = []
    for column, channel in enumerate(channels, 1):
        values[:, column], between = _placed(time, channel.time, channel.samples)
        if between:
            moved.append(channel.name)
    if moved:
        notes = [
            f"channels sampled at other times, brought to the time base with most samples: {listed(moved)}; straight "
            "lines between samples",
            *notes,
        ]
    names, units = ["time", *(channel.name for channel in channels)], ["s", *(channel.unit for channel in channels)]
    return Table(names, units, values, notes=tuple(notes), others=others)


def _placed(time: np.ndarray, stamps: np.ndarray, samples: np.ndarray) -> tuple[np.ndarray, int]:
    """Samples on a time base (t,): each at the row nearest to it, nothing in between; and how many had to be moved.

    A sample that lies beside its row is moved there on the straight line to its neighbour, at most half a step, so that
    a slow channel stays as slow as it is and none is made up.
    """
    placed = np.full(len(time), np.nan)
    there = np.isfinite(stamps) & np.isfinite(samples)
    stamps, samples = stamps[there], samples[there]
    if not len(stamps) or len(time) < 2:
        return placed, 0
    step = float(np.median(np.diff(time)))
    inside = (stamps >= time[0] - 0.5 * step) & (stamps <= time[-1] + 0.5 * step)
    right = np.clip(np.searchsorted(time, stamps), 1, len(time) - 1)
    rows = np.where(stamps - time[right - 1] <= time[right] - stamps, right - 1, right)
    beside = np.abs(stamps - time[rows]) > SAME_STAMP * step
    known = inside & (~beside | ((time[rows] >= stamps[0]) & (time[rows] <= stamps[-1])))
    values = np.where(beside, np.interp(time[rows], stamps, samples), samples)
    placed[rows[known]] = values[known]
    return placed, int((known & beside).sum())
