"""Writing a recording as CSV."""

from __future__ import annotations

import io
from collections.abc import Mapping

import numpy as np


def csv_text(time: np.ndarray, columns: Mapping[str, np.ndarray], units: Mapping[str, str]) -> str:
    """Text of a CSV recording: ``time [s]``, then ``name [unit]``; nine digits, of time twelve.

    Parameters
    ----------
    time : ndarray (t,)
    columns : mapping of str to ndarray (t,)
    units : mapping of str to str
        By column.
    """
    text = io.StringIO()
    header = ",".join(["time [s]", *(f"{name} [{units[name]}]" for name in columns)])
    formats = ["%.12g", *["%.9g"] * len(columns)]  # twelve: milliseconds of an absolute time stay apart
    np.savetxt(text, np.column_stack([time, *columns.values()]), formats, ",", header=header, comments="")
    return text.getvalue()
