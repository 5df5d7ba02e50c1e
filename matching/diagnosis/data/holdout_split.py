"""Which part of the recordings is fitted and which is held out to judge the fit."""

from __future__ import annotations

from matching.diagnosis.data.segmentation import FEWEST_SAMPLES
from matching.diagnosis.data.segments import FitData, Segment

FITTED_SHARE = 0.7  # of every recording; specification: without --holdout the last 30 % is held out


def split_holdout(data: FitData, share: float = FITTED_SHARE) -> tuple[FitData, list[int]]:
    """The first part of every recording, to be fitted, and how many samples of each segment of ``data`` that is."""
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
    return FitData(tuple(kept), data.noise), counts


def held_out_segments(data: FitData, counts: list[int]) -> list[Segment]:
    """What follows the fitted samples of each segment; empty where all are fitted."""
    return [segment.part(count, len(segment.time)) for segment, count in zip(data.segments, counts, strict=True)]
