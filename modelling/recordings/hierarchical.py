"""Files that hold channels in groups, as they were saved: plain HDF5 by h5py, and TDMS of LabVIEW by npTDMS."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from modelling.errors import InputError
from modelling.recordings.matlab import sizes_in
from modelling.recordings.table import TIME_NAMES, Column, Table, check_size, name_and_unit

MOST_COLUMNS = 64  # of a matrix that are channels; what is wider is none
UNIT_NAMES = ("unit", "units", "Unit", "Units", "unit_string")  # attributes that hold a unit
LEAST_SAMPLES = 2


@dataclass(frozen=True)
class _Channel:
    """A channel: its last name, the group it is in, its unit, and its values (t,)."""

    name: str
    group: str
    unit: str
    values: np.ndarray


def read_hdf5(path: Path, used: Collection[str] | None = None) -> Table:
    """Read an HDF5 file: every vector, column of a matrix and field of a table is a channel.

    A channel is called as its dataset; where two are called alike, by its path. A unit is an attribute ``unit`` or
    stands behind the name. The channels have the length of the time, or of most of them.

    Raises
    ------
    InputError
        If it is no HDF5 file, or holds no channel of numbers.
    """
    import h5py

    try:
        with h5py.File(path) as file:
            check_size(path, sizes_in(file))
            channels = [*_of_group(file, "")]
    except OSError as fault:
        if fault.strerror and fault.errno:
            raise
        raise InputError(str(path), f"is no HDF5 file: {fault}", "save it again, or as CSV") from None
    return _table(path, channels, used)


def _of_group(group: Any, place: str) -> Iterator[_Channel]:
    import h5py

    for name in group:
        link = group.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink | h5py.SoftLink):
            continue  # another file, or what is read where it stands
        member = group[name]
        if isinstance(member, h5py.Group):
            yield from _of_group(member, f"{place}/{name}" if place else name)
            continue
        if not isinstance(member, h5py.Dataset) or member.external or member.is_virtual or member.shape is None:
            continue
        stated = next((_text(member.attrs[key]) for key in UNIT_NAMES if key in member.attrs), "")
        if member.dtype.names and member.ndim == 1:  # a table
            for key in member.dtype.names:
                if member.dtype[key].kind in "iuf" and member.dtype[key].shape == ():
                    yield _channel(key, f"{place}/{name}" if place else name, "", member.fields(key)[:])
        elif member.dtype.kind in "iufb" and member.ndim == 1:
            yield _channel(name, place, stated, member[:])
        elif member.dtype.kind in "iuf" and member.ndim == 2:
            values = (
                member[:] if member.shape[1] <= MOST_COLUMNS else member[:].T if len(member) <= MOST_COLUMNS else None
            )
            for column, own in enumerate(() if values is None else values.T):
                yield _channel(
                    f"{name}[:,{column}]" if values is not None and values.shape[1] > 1 else name, place, stated, own
                )


def _channel(name: str, group: str, unit: str, values: np.ndarray) -> _Channel:
    own, in_name = name_and_unit(name)
    return _Channel(own, group, unit or in_name, np.asarray(values, float))


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if isinstance(value, np.ndarray):
        return _text(value.ravel()[0]) if value.size else ""
    return str(value)


def read_tdms(path: Path, used: Collection[str] | None = None) -> Table:
    """Read a TDMS file: each channel by its name, with ``unit_string``; times from a channel or from its waveform.

    Raises
    ------
    InputError
        If it is no TDMS file, or holds no channel of numbers.
    """
    from nptdms import TdmsFile

    channels = []
    try:
        for group in TdmsFile.read(path).groups():
            for channel in group.channels():
                values = channel[:]
                if np.asarray(values).dtype.kind not in "iufM":
                    continue
                unit = next((_text(channel.properties[key]) for key in UNIT_NAMES if key in channel.properties), "")
                if np.asarray(values).dtype.kind == "M":
                    values, unit = (values - values[:1]) / np.timedelta64(1, "ns") * 1e-9, "s"
                channels.append(_channel(channel.name, group.name, unit, values))
                step = channel.properties.get("wf_increment")
                if step:
                    begin = float(channel.properties.get("wf_start_offset", 0.0))
                    channels.append(_Channel("time", group.name, "s", begin + step * np.arange(len(values))))
    except (InputError, MemoryError):
        raise
    except Exception as fault:  # the library raises many kinds for what is no TDMS file
        if isinstance(fault, OSError) and fault.strerror:
            raise
        raise InputError(str(path), f"is no TDMS file: {fault}", "save it again, or as CSV") from None
    return _table(path, channels, used)


def _table(path: Path, channels: list[_Channel], used: Collection[str] | None) -> Table:
    """The channels of one length: that of the times of those that are used, or of most."""
    channels = [one for one in channels if len(one.values) >= LEAST_SAMPLES]
    if not channels:
        raise InputError(str(path), "has no channel of numbers", "save inputs and sensors as vectors")
    times = [one for one in channels if one.name.strip().lower() in TIME_NAMES]
    distinct = [one for i, one in enumerate(channels) if not _repeats(one, channels[:i])]
    count = Counter(one.name for one in distinct)
    named = {one.name if count[one.name] == 1 else f"{one.group}/{one.name}": one for one in distinct}
    wanted = [one for name, one in named.items() if used is not None and name in used and one not in times]
    lengths = Counter(len(one.values) for one in wanted or times or channels)
    length = lengths.most_common(1)[0][0]
    fits = [one for one in times if len(one.values) == length]
    if fits and not any(one is named.get("time") for one in fits):
        group = Counter(one.group for one in wanted).most_common(1)[0][0] if wanted else fits[0].group
        own = next((one for one in fits if one.group == group), fits[0])
        named = {name: one for name, one in named.items() if one is not own}
        named = {"time" if own.name == "time" else own.name: own, **named}
    kept = {name: one for name, one in named.items() if len(one.values) == length}
    left = [f"{name} ({len(one.values)})" for name, one in named.items() if name not in kept]
    notes = (f"not listed, for they have another number of values: {', '.join(left)}",) if left and used is None else ()
    columns = tuple(Column(name, one.unit, one.values) for name, one in kept.items() if used is None or name in used)
    read = {column.name for column in columns}
    return Table(columns, notes=notes, others=tuple(name for name in named if name not in read))


def _repeats(one: _Channel, before: list[_Channel]) -> bool:
    """Whether a time of a waveform says what another channel's in its group has said."""
    return one.name == "time" and any(
        other.name == "time" and other.group == one.group and np.array_equal(other.values, one.values)
        for other in before
    )
