"""MDF4 measurement files, by asammdf: channels by name, units as they stand, on one time base."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from modelling.errors import InputError
from modelling.readers import Table


def read(path: Path) -> Table:
    """Read an MDF4 file; channels of a slower group are missing between their samples.

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
    time = np.unique(np.concatenate([signal.timestamps for signal in signals]))
    values = np.full((len(time), len(signals) + 1), np.nan)
    values[:, 0] = time
    for column, signal in enumerate(signals, 1):
        values[np.searchsorted(time, signal.timestamps), column] = signal.samples
    header = ["time [s]", *(f"{signal.name} [{signal.unit}]" if signal.unit else signal.name for signal in signals)]
    return Table(header, values)
