"""What the exported controller tracked while the bed ran, read from a recording of its outputs, and what to measure
anew."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from matching.bed.stated import Deviation, case_line, off_words
from matching.match.case import Case
from modelling.bed.bed import Dynamometer
from modelling.controller.tracking import DRIFTED
from modelling.recordings.channel_faults import with_uncertainty
from modelling.recordings.recording import Recording

OUTPUTS = {"torque gain": "tracked_gain", "flange zero": "tracked_zero", "dead time": "tracked_delay"}


@dataclass(frozen=True)
class TrackedQuantity:
    """A quantity of a dynamometer as the controller tracked it last.

    Attributes
    ----------
    dynamometer, quantity : str
        Name; one of :data:`OUTPUTS`.
    value, uncertainty : float
        SI; the uncertainty is a standard one. Of the gain of calibrated commands, and of the dead time beyond the
        planned one.
    drifted : bool
        Whether the controller warned of it at the end of the recording.
    words : str
        For people.
    line : str or None
        What the case needs where it has drifted and a file states it.
    """

    dynamometer: str
    quantity: str
    value: float
    uncertainty: float
    drifted: bool
    words: str
    line: str | None

    @property
    def advice(self) -> str:
        """What to do about a drift."""
        return f"{self.words}: identify it anew" + (f", or write {self.line}" if self.line else "")

    def to_dict(self) -> dict[str, Any]:
        """As ``verification.json`` holds it."""
        return {
            "dynamometer": self.dynamometer, "quantity": self.quantity, "value": self.value,
            "standard_uncertainty": self.uncertainty, "drifted": self.drifted, "words": self.words, "line": self.line,
        }  # fmt: skip


def outputs_of(case: Case) -> list[str]:
    """Names of the controller's outputs that a recording may hold."""
    keys = [f"{key}{more}" for key in OUTPUTS.values() for more in ("", "_uncertainty")]
    return [f"{one.name}.{key}" for one in case.loop.dynamometers for key in (*keys, "drifted")]


def tracked_quantities(case: Case, recordings: Sequence[Recording]) -> tuple[TrackedQuantity, ...]:
    """What was tracked at the end of the last recording that holds it, of every dynamometer."""
    found = []
    for one in case.loop.dynamometers:
        for quantity, key in OUTPUTS.items():
            names = f"{one.name}.{key}", f"{one.name}.{key}_uncertainty", f"{one.name}.drifted"
            held = [each for each in recordings if all(name in each.channels for name in names)]
            if not held:
                continue
            value, uncertainty, bits = (float(held[-1][name][-1]) for name in names)
            if math.isfinite(value) and math.isfinite(uncertainty) and math.isfinite(bits):
                found.append(_quantity(case, one, quantity, value, uncertainty, round(bits)))
    return tuple(found)


def _quantity(
    case: Case, one: Dynamometer, quantity: str, value: float, uncertainty: float, bits: int
) -> TrackedQuantity:
    drifted, name = bool(bits & DRIFTED[quantity]), f"dynamometers.{one.name}"
    if quantity == "flange zero":
        size = with_uncertainty(value, uncertainty)
        words = f"{one.torque_sensor} has a zero of {size} N·m, friction of the rotor included"
        return TrackedQuantity(one.name, quantity, value, uncertainty, drifted, words, None)
    if quantity == "torque gain":
        found = Deviation(f"{name}.torque_gain", 1.0, value, uncertainty, 0.0)
        written = Deviation(found.name, one.torque_gain, one.torque_gain * value, uncertainty, 0.0)
    else:
        planned = case.loop["dead_time"] if one.dead_time is None else one.dead_time
        found = written = Deviation(f"{name}.dead_time", planned, planned + value, uncertainty, 0.0)
    line = case_line(written) if drifted else None
    return TrackedQuantity(one.name, quantity, value, uncertainty, drifted, off_words(found), line)
