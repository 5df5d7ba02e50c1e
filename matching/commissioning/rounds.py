"""The rounds of a commissioning: what each found, when they end, and which controller is the best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matching.bed_test.errors import NEGLIGIBLE
from matching.bed_test.result import COVERAGE_FACTOR
from modelling.common.display import Displayed

NEAR_ENOUGH_RATIO = 1.5  # times what a match with the true values reaches: as near as a further round is worth


@dataclass(frozen=True)
class Round:
    """What a round found; None where it has not come so far.

    Attributes
    ----------
    number : int
        From 1 on.
    identification : mapping, optional
        What the recording of the bed without emulation says: the content of ``identification.json`` for the bed.
    match : mapping, optional
        ``status`` and ``limits`` as in ``result.json``.
    verification : mapping, optional
        The content of ``verification.json`` in the round's folder.
    against_last_vehicle : mapping, optional
        Errors, functions, modes and fidelity of the same recording, judged against the vehicle of the last round.
    """

    number: int
    identification: Mapping[str, Any] | None = None
    match: Mapping[str, Any] | None = None
    verification: Mapping[str, Any] | None = None
    against_last_vehicle: Mapping[str, Any] | None = None

    def to_dict(self) -> dict[str, Any]:
        """As ``commission.json`` holds it; without what the round has not come to."""
        steps = {
            "identification": self.identification, "match": self.match, "verification": self.verification,
            "against_last_vehicle": self.against_last_vehicle,
        }  # fmt: skip
        return {"round": self.number, **{step: dict(content) for step, content in steps.items() if content is not None}}


@dataclass(frozen=True)
class Commissioning(Displayed):
    """How far a commissioning has come.

    Attributes
    ----------
    rounds : tuple of Round
    end : str or None
        Why no further round would gain; None where one may.
    waiting_for : str or None
        The recording that it waits for, in words.
    vehicle : mapping, optional
        What recordings of the road say: the content of ``identification.json`` for the vehicle.
    """

    rounds: tuple[Round, ...]
    end: str | None = None
    waiting_for: str | None = None
    vehicle: Mapping[str, Any] | None = None

    @property
    def status(self) -> str | None:
        """``waiting``, else that of the last verification: ``as_predicted``, ``short`` or ``undetermined``."""
        if self.waiting_for:
            return "waiting"
        return next((entry.verification["status"] for entry in reversed(self.rounds) if entry.verification), None)

    @property
    def best_round(self) -> int | None:
        """Number of the round with the least measured error; None without any."""
        return best_round(self.rounds)

    def to_dict(self) -> dict[str, Any]:
        """As ``commission.json`` holds it."""
        return {
            "status": self.status, "waiting_for": self.waiting_for, "end": self.end, "best_round": self.best_round,
            "vehicle": None if self.vehicle is None else dict(self.vehicle),
            "rounds": [entry.to_dict() for entry in self.rounds],
        }  # fmt: skip


def end_of(rounds: Sequence[Round]) -> str | None:
    """Why no further round would gain, in a sentence; None where one would, or nothing was verified yet."""
    now = rounds[-1].verification
    if now is None:
        return None
    before = rounds[-2].verification if len(rounds) > 1 else None
    if before is not None and not _gained(before, now):
        return "the last round gained nothing that could be measured"
    if now["status"] != "as_predicted" or any(_could_gain(error) for error in now["errors"]):
        return None
    return "the bed answers as well as the match can make it"


def _could_gain(error: Mapping[str, Any]) -> bool:
    """Whether an error is larger than what a match with the bed's true values would leave, beyond its uncertainty."""
    reached = NEAR_ENOUGH_RATIO * max(error["predicted"], NEGLIGIBLE * error["allowed"])
    return error["error"] is None or bool(error["error"] - COVERAGE_FACTOR * error["standard_uncertainty"] > reached)


def _gained(before: Mapping[str, Any], now: Mapping[str, Any]) -> bool:
    """Whether an error fell by more than the uncertainty of both; errors that are not determined say nothing."""
    known = [
        (old, new)
        for old, new in zip(before["errors"], now["errors"], strict=False)
        if old["error"] is not None and new["error"] is not None
    ]
    if not known:
        return True
    return any(old["error"] - new["error"] > old["standard_uncertainty"] + new["standard_uncertainty"]
               for old, new in known)  # fmt: skip


def best_round(rounds: Sequence[Round]) -> int | None:
    """Number of the round with the least measured error, all against the vehicle of the last; None without any."""
    errors = {}
    for entry in rounds:
        measured = entry.against_last_vehicle or entry.verification or {}
        known = [error["error"] for error in measured.get("errors", ()) if error["error"] is not None]
        if known:
            errors[entry.number] = sum(error**2 for error in known) / len(known)
    return min(errors, key=lambda number: errors[number]) if errors else None
