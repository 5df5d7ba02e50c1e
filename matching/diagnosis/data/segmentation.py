"""A gap in a recording: the samples before and after it are fitted as segments, each with its own start state."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from modelling.common.errors import InputError
from modelling.measurement.gaps import longest_bridge

FEWEST_SAMPLES = 64  # of a segment; a start state of its own costs as much as fewer samples tell


def segments_between_gaps(time: np.ndarray, source: str) -> tuple[list[slice], list[str]]:
    """Samples between gaps too long to bridge (:mod:`modelling.measurement.gaps`), and notes on those left out.

    Parameters
    ----------
    time : ndarray (t,)
        s, increasing.
    source : str
        The recording, for messages.

    Raises
    ------
    InputError
        If a recording without a gap has fewer than ``FEWEST_SAMPLES`` samples.
    """
    edges = [0, *(np.flatnonzero(np.diff(time) > longest_bridge(time)) + 1), len(time)]
    kept, notes = [], []
    for first, last in pairwise(int(edge) for edge in edges):
        if last - first >= FEWEST_SAMPLES:
            kept.append(slice(first, last))
        elif len(edges) > 2:
            notes.append(f"{last - first} samples between gaps at {time[first]:g} s are left out")
        else:
            raise InputError(source, f"has {last - first} samples", f"at least {FEWEST_SAMPLES} are needed")
    return kept, notes
