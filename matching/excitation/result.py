"""A planned excitation with what it is expected to tell."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from modelling.common.display import Displayed
from modelling.measurement.write import csv_text


@dataclass(frozen=True)
class Expected:
    """A quantity before and after the recording: standard uncertainties in its SI unit, and its part of the error.

    ``share_before`` and ``share_after`` are response errors (rms over the compared functions and the band) that come
    from not knowing this quantity alone.
    """

    name: str
    value: float
    unit: str
    before: float
    after: float
    share_before: float
    share_after: float

    def to_dict(self) -> dict[str, Any]:
        """As ``excite.json`` holds it."""
        return {
            "name": self.name, "value": self.value, "unit": self.unit, "standard_uncertainty_before": self.before,
            "standard_uncertainty_after": self.after, "response_error_before": self.share_before,
            "response_error_after": self.share_after,
        }  # fmt: skip


@dataclass(frozen=True)
class Part:
    """A part of an excitation: what it is, begin and end (s), and its factor on the shape."""

    kind: str
    begin: float
    end: float
    amplitude: float


@dataclass(frozen=True)
class ExcitationPlan(Displayed):
    """A planned excitation; t samples, u inputs.

    Attributes
    ----------
    speed : float
        rad/s: the rotors' steady speed, held slowly beside the excitation.
    hold : dict
        Gains of that speed hold by dynamometer.
    time, torques : ndarray (t,), (t, u)
        Demanded torques beside the speed hold's, N·m.
    parts : tuple of Part
    fitted_until : float
        s: the recording up to here is for the fit, the rest for judging it.
    expected : tuple of Expected
        What matters most for the match first.
    error_before, error_after : float
        Response error from all that is not known together.
    used : dict
        Largest share of each limit over the beds that were simulated.
    margin, beds : float, int
        Share of every limit left free, and number of beds simulated.
    notes : tuple of str
        What the user should know.
    """

    title: str
    speed: float
    hold: dict[str, tuple[float, float]]
    inputs: tuple[str, ...]
    time: np.ndarray = field(repr=False)
    torques: np.ndarray = field(repr=False)
    parts: tuple[Part, ...]
    fitted_until: float
    expected: tuple[Expected, ...]
    error_before: float
    error_after: float
    used: dict[str, float]
    margin: float
    beds: int
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """As ``excite.json`` holds it."""
        return {
            "title": self.title,
            "file": "excitation.csv",
            "speed": self.speed,
            "speed_hold": {name: {"proportional": p, "integral": i} for name, (p, i) in self.hold.items()},
            "duration": float(self.time[-1]),
            "parts": [vars(part) for part in self.parts],
            "fitted_until": self.fitted_until,
            "response_error": {"before": self.error_before, "after": self.error_after},
            "expected": [quantity.to_dict() for quantity in self.expected],
            "limits_used": self.used,
            "margin": self.margin,
            "beds": self.beds,
            "notes": list(self.notes),
        }


def excitation_csv(plan: ExcitationPlan) -> str:
    """Text of ``excitation.csv``: demanded torques beside the speed hold's, linear between samples."""
    columns = {name: plan.torques[:, j] for j, name in enumerate(plan.inputs)}
    return csv_text(plan.time, columns, dict.fromkeys(plan.inputs, "N*m"))
