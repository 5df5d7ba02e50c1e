"""Which part of the recordings is fitted and which is held out to judge the fit."""

from __future__ import annotations

import math

from matching.diagnosis.data.segmentation import FEWEST_SAMPLES
from matching.diagnosis.data.segments import FitData, Segment
from modelling.common.errors import InputError

FITTED_SHARE = 0.7  # of every recording; specification: without --holdout the last 30 % is held out


def split_holdout(data: FitData, share: float = FITTED_SHARE) -> tuple[FitData, list[int]]:
    """The first part of every recording, to be fitted, and how many samples of each segment of ``data`` that is.

    Raises
    ------
    InputError
        If no part is long enough to be fitted.
    """
    kept, counts = [], []
    for name in dict.fromkeys(segment.name for segment in data.segments):
        segments = [segment for segment in data.segments if segment.name == name]
        left = round(share * sum(len(segment.time) for segment in segments))
        for segment in segments:
            take = min(len(segment.time), left)
            count = take if take >= FEWEST_SAMPLES else 0
            counts.append(count)
            if count:
                kept.append(segment.part(0, count))
            left -= take
    if not kept:
        longest = max(data.segments, key=lambda segment: len(segment.time))
        wrong = f"has {len(longest.time)} samples without a gap, of which the last {1 - share:.0%} are held out"
        right = (
            f"record {math.ceil(FEWEST_SAMPLES / share)} or more in one piece, or give another recording as --holdout"
        )
        raise InputError(longest.name, wrong, right)
    return FitData(tuple(kept), data.noise), counts


def held_out_segments(data: FitData, counts: list[int]) -> list[Segment]:
    """What follows the fitted samples of each segment; empty where all are fitted."""
    return [segment.part(count, len(segment.time)) for segment, count in zip(data.segments, counts, strict=True)]
