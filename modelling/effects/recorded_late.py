"""By how many seconds a channel is recorded late, whatever the kind of effect that says so."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

LATE_SIGN = {"clock_offset": 1.0, "sensor_delay": 1.0, "dead_time": -1.0}  # an input that acts later is recorded early


def recorded_late(kind: str, time: float) -> float:
    """The time (s) by which the only parameter of a kind says that a channel is recorded late; negative if early."""
    return LATE_SIGN[kind] * time


def known_offsets(value: Mapping[str, float]) -> Iterator[float]:
    """Times (s) by which channels of a model are recorded late, from its quantities by full name."""
    for name, time in value.items():
        kind = name.split(".")[-2] if "." in name else ""
        if kind in LATE_SIGN:
            yield recorded_late(kind, time)
