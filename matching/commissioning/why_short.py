"""Why a controlled bed falls short: the diagnosis of the recordings that showed it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matching.bed_test.result import BedVerification
from matching.commissioning.bed_system import bed_system
from matching.commissioning.identified import identified_case
from matching.diagnosis.diagnosis import diagnose
from matching.frequency.case.case import Case
from modelling.measurement.channels import Channel
from modelling.measurement.read import read_recording, read_signals

LEAST_SHIFT = 1.0  # in half-widths of the case: a quantity that is further from its stated value is named


@dataclass(frozen=True)
class Reason:
    """What a diagnosis of the bed behind its controller says.

    Attributes
    ----------
    verdict : str
        Of the diagnosis; empty where there was none.
    sentences : tuple of str
        Causes with their evidence, quantities that are further off than the case states, or why nothing was diagnosed.
    """

    verdict: str
    sentences: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """As ``verification.json`` holds it."""
        return {"verdict": self.verdict or None, "sentences": list(self.sentences)}


def why_short(
    case: Case,
    verification: BedVerification,
    recordings: Sequence[str | Path],
    channels: Mapping[str, Channel] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Reason | None:
    """Diagnose the recordings of a verification that is ``short``; None for any other.

    They need the torque commands beside the sensors: between commands and readings the bed is as it is without
    control, whatever the controller does.

    Raises
    ------
    InputError
        If a recording cannot be read or fitted.
    """
    if verification.status != "short":
        return None
    system = bed_system(case)
    inputs = [part.name for part in system.inputs]
    for path in recordings:
        missing = sorted(set(inputs) - set(read_signals(Path(path), set(inputs), channels).channels))
        if missing:
            needed = f"{path} does not hold {', '.join(missing)}: record the torque commands as well, or use commission"
            return Reason("", (needed,))
    read = [read_recording(path, system, channels) for path in recordings]
    diagnosis = diagnose(system, read, None, progress)
    causes = [f"{cause['kind']} at {cause['at']}: {cause['evidence']}" for cause in diagnosis.to_dict()["causes"]]
    new = identified_case(case, diagnosis)
    gains = [
        f"{after.name} gives {after.torque_gain:.4g} times what it is asked for, not {before.torque_gain:.4g}"
        for before, after in zip(case.loop.dynamometers, new.case.loop.dynamometers, strict=True)
        if abs(after.torque_gain / before.torque_gain - 1)
        > LEAST_SHIFT * _half_width(case, f"dynamometers.{before.name}")
    ]
    moved = [
        f"{before.name} is {after.value:.4g}, not {before.value:.4g}"
        for before, after in zip(case.uncertainty.uncertain, new.case.uncertainty.uncertain, strict=True)
        if not before.name.endswith("_gain") and abs(after.value - before.value) > LEAST_SHIFT * before.half_width
    ]
    nothing = "The diagnosis finds no cause beyond what the case states as uncertain."
    return Reason(diagnosis.verdict, tuple([*causes, *gains, *moved] or [nothing]))


def _half_width(case: Case, dynamometer: str) -> float:
    widths = {quantity.name: quantity.half_width for quantity in case.uncertainty.uncertain}
    return widths.get(f"{dynamometer}.torque_gain", 0.0)
