"""Which gear of a gearbox a recording is in, by a channel with its number or by what the clutches carry.

A channel that has the gearbox's name holds the number of the gear that is engaged, as a bus sends it: 1, 2, …; any
other value is no gear. Without it, a gear is engaged where its clutch alone carries torque and is closed.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from modelling.errors import InputError
from modelling.recordings.recording import Recording, longest_bridge
from modelling.system import Gearbox, System


@dataclass(frozen=True)
class GearSettings:
    """When a gear counts as engaged.

    Attributes
    ----------
    settled : float
        s before and after a change that are left out: a bus sends the number at the shift's begin or at its end, and a
        shift of a car takes up to half a second.
    closed, open : float
        Of the largest torque that the clutch can carry in the recording: from ``closed`` on it does not slip, up to
        ``open`` it carries nothing. A clutch is pressed with a reserve of some ten per cent.
    """

    settled: float = 0.5
    closed: float = 0.9
    open: float = 0.02


SETTINGS = GearSettings()


def in_one_gear(
    system: System, fitted: Sequence[Recording], judging: Sequence[Recording], settings: GearSettings = SETTINGS
) -> tuple[System, list[Recording], list[Recording]]:
    """A drivetrain in the gear that recordings were driven in most, and their rows in that gear.

    A drivetrain without a gearbox and its recordings stay as they are.

    Parameters
    ----------
    system : System
    fitted, judging : sequence of Recording
        The gear is chosen by the first ones.

    Raises
    ------
    InputError
        If nothing tells the gear, or a recording is never in the chosen one.
    """
    if not system.gearboxes:
        return system, [*fitted], [*judging]
    boxes = system.gearboxes
    found = [_gears(system, one, settings) for one in (*fitted, *judging)]
    chosen = _most_driven(fitted, found[: len(fitted)])
    words = gear_words(dict(zip((box.name for box in boxes), chosen, strict=True)))
    kept = []
    for recording, gears in zip((*fitted, *judging), found, strict=True):
        rows = (gears == chosen).all(axis=1)
        if not rows.any():
            raise InputError(
                recording.source, f"is never in {words} for longer than {2 * settings.settled:g} s",
                "give a recording in this gear",
            )  # fmt: skip
        step = float(np.median(np.diff(recording.time)))
        note = f"in {words} for {rows.sum() * step:.4g} of {len(rows) * step:.4g} s; the rest is left out"
        kept.append(replace(_rows(system, recording, rows), notes=(*recording.notes, note)))
    one_gear = system.in_gear(dict(zip((box.name for box in boxes), chosen, strict=True)))
    return one_gear, kept[: len(fitted)], kept[len(fitted) :]


def stretches(
    system: System, recordings: Sequence[Recording], settings: GearSettings = SETTINGS
) -> list[tuple[dict[str, int], Recording]]:
    """Parts of recordings without a gap in which one gear is engaged throughout, for as long as a shift's neighbourhood
    at least: the gear of each gearbox, and the rows."""
    found = list[tuple[dict[str, int], Recording]]()
    for recording in recordings if system.gearboxes else ():
        gears = _gears(system, recording, settings).astype(int)
        changed = np.diff(gears, axis=0).any(axis=1) | (np.diff(recording.time) > longest_bridge(recording.time))
        for first, last in itertools.pairwise([0, *(np.flatnonzero(changed) + 1), len(gears)]):
            rows = _rows(system, recording, slice(first, last))
            if gears[first].all() and np.ptp(rows.time) >= 2 * settings.settled:
                names = (box.name for box in system.gearboxes)
                found.append((dict(zip(names, gears[first].tolist(), strict=True)), rows))
    return found


def _gears(system: System, recording: Recording, settings: GearSettings) -> np.ndarray:
    """Number of the gear of each gearbox (t, g), 0 where none is engaged, and near a change."""
    return np.column_stack([_engaged(box, recording, settings) for box in system.gearboxes])


def _rows(system: System, recording: Recording, rows: np.ndarray | slice) -> Recording:
    """Some rows of a recording, without the channels that say the gear."""
    gone = {*(box.name for box in system.gearboxes), *system.capacities}
    channels = {name: values[rows] for name, values in recording.channels.items() if name not in gone}
    return replace(recording, time=recording.time[rows], channels=channels)


def gear_words(gears: Mapping[str, int]) -> str:
    """The gear of each gearbox."""
    return " and ".join(f"gear {gear} of gearboxes.{name}" for name, gear in gears.items())


def _engaged(box: Gearbox, recording: Recording, settings: GearSettings) -> np.ndarray:
    """Number of the gear (t,) of one gearbox, 0 where none is engaged, and near a change."""
    number = np.zeros(len(recording.time))
    if box.name in recording.channels:
        number = _held(recording[box.name])
        number = np.where(np.isin(number, np.arange(1, len(box.ratios) + 1)), number, 0.0)
    elif all(name in recording.channels for name in box.capacities):
        torques = np.column_stack([recording[name] for name in box.capacities])
        share = torques / np.maximum(torques.max(axis=0), np.finfo(float).tiny)
        closed, carries = share >= settings.closed, share > settings.open
        alone = closed.any(axis=1) & (carries.sum(axis=1) == 1)
        number = np.where(alone, closed.argmax(axis=1) + 1.0, 0.0)
    else:
        raise InputError(
            recording.source, f"does not say which gear gearboxes.{box.name} is in",
            f"record its number as channel {box.name!r} (1 is the first gear), or {', '.join(box.capacities)}",
        )  # fmt: skip
    changes = recording.time[np.flatnonzero(np.diff(number)) + 1]
    if len(changes):
        after = np.searchsorted(changes, recording.time, side="right")
        since = recording.time - np.append(-np.inf, changes)[after]
        until = np.append(changes, np.inf)[after] - recording.time
        number[np.minimum(since, until) < settings.settled] = 0.0
    return number


def _held(values: np.ndarray) -> np.ndarray:
    """Values (t,) with the last one before it where there is none, and the first one before that."""
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return np.zeros(len(values))
    return values[known[np.maximum(np.searchsorted(known, np.arange(len(values)), side="right") - 1, 0)]]


def _most_driven(recordings: Sequence[Recording], gears: Sequence[np.ndarray]) -> tuple[int, ...]:
    """The gears (of each gearbox) of most seconds; the lowest ones where no gear is engaged."""
    seconds: dict[tuple[int, ...], float] = {}
    for recording, each in zip(recordings, gears, strict=True):
        for row, step in zip(each.astype(int), np.gradient(recording.time), strict=True):
            if row.all():
                seconds[tuple(row)] = seconds.get(tuple(row), 0.0) + float(step)
    return max(seconds, key=lambda gear: seconds[gear]) if seconds else (1,) * gears[0].shape[1]
