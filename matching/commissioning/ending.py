"""When a commissioning ends, and which of its controllers is the best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matching.bed_test.errors import NEGLIGIBLE
from matching.bed_test.result import COVERAGE_FACTOR

NEAR_ENOUGH_RATIO = 1.5  # times what a match with the true values reaches: as near as a further round is worth


def end_of(rounds: Sequence[Mapping[str, Any]]) -> str | None:
    """Why no further round would gain, in a sentence; None where one would."""
    now = rounds[-1]["verification"]
    if len(rounds) > 1 and not _gained(rounds[-2]["verification"], now):
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


def best_round(rounds: Sequence[Mapping[str, Any]]) -> int | None:
    """Number of the round with the least measured error, all against the vehicle of the last; None without any."""
    errors = {}
    for entry in rounds:
        measured = entry.get("against_last_vehicle", entry.get("verification"))
        known = [error["error"] for error in (measured or {}).get("errors", ()) if error["error"] is not None]
        if known:
            errors[entry["round"]] = sum(error**2 for error in known) / len(known)
    return min(errors, key=lambda number: errors[number]) if errors else None
