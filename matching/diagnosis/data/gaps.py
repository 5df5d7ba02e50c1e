"""A gap in a recording: the samples before and after it are fitted as segments, each with its own start state."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from modelling.common.errors import InputError

LONGEST_GAP = 0.1  # s between two samples; over a longer time inputs cannot be taken as linear
FEWEST_SAMPLES = 64  # of a segment; a start state of its own costs as much as fewer samples tell


def segments_between_gaps(time: np.ndarray, source: str) -> tuple[list[slice], list[str]]:
    """Samples between gaps of more than ``LONGEST_GAP``, and notes on those left out.

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
    edges = [0, *(np.flatnonzero(np.diff(time) > LONGEST_GAP) + 1), len(time)]
    kept, notes = [], []
    for first, last in pairwise(int(edge) for edge in edges):
        if last - first >= FEWEST_SAMPLES:
            kept.append(slice(first, last))
        elif len(edges) > 2:
            notes.append(f"{last - first} samples between gaps at {time[first]:g} s are left out")
        else:
            raise InputError(source, f"has {last - first} samples", f"at least {FEWEST_SAMPLES} are needed")
    return kept, notes
