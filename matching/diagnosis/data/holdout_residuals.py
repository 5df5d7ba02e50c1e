"""What base and extended model leave of held-out data, side by side on one time axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from matching.diagnosis.data.segments import Segment
from modelling.measurement.gaps import longest_bridge


@dataclass(frozen=True)
class ModelResiduals:
    """Residuals of one model: on each segment (t, y), measured − simulated, in times the noise."""

    segments: Sequence[Segment]
    residuals: Sequence[np.ndarray]


@dataclass(frozen=True)
class HoldoutData:
    """Held-out readings and what both models leave of them.

    Attributes
    ----------
    time : ndarray (t,)
        s, from the start of each recording; parts one after another.
    parts : tuple of slice
        Parts without a gap.
    measured : ndarray (t, y)
        SI; NaN where nothing was measured.
    before, after : ndarray (t, y)
        Measured − simulated of base and extended model, SI; NaN where nothing was measured or simulated.
    noise : ndarray (y,)
        SI.
    """

    time: np.ndarray
    parts: tuple[slice, ...]
    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray
    noise: np.ndarray


def holdout_data(noise: np.ndarray, base: ModelResiduals, extended: ModelResiduals) -> HoldoutData:
    """Order the held-out samples of two models, which may be cut into other segments, by recording and time.

    Parameters
    ----------
    noise : ndarray (y,)
        SI.
    base, extended : ModelResiduals
    """
    names, time, order = _by_recording_and_time(base)
    _, _, extended_order = _by_recording_and_time(extended)
    measured = np.concatenate([segment.readings for segment in base.segments])[order]
    before = np.concatenate(base.residuals)[order] * noise
    after = np.concatenate(extended.residuals)[extended_order] * noise
    starts = np.flatnonzero((names[1:] != names[:-1]) | (np.diff(time) > longest_bridge(time))) + 1
    edges = [0, *(int(start) for start in starts), len(time)]
    return HoldoutData(time, tuple(slice(a, b) for a, b in pairwise(edges)), measured, before, after, noise)


def _by_recording_and_time(model: ModelResiduals) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Names (t,) and times (t,) of all samples in order, and that order (t,)."""
    names = np.concatenate([np.full(len(segment.time), segment.name) for segment in model.segments])
    time = np.concatenate([segment.time for segment in model.segments])
    order = np.lexsort((time, names))
    return names[order], time[order], order
