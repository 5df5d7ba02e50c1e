"""A commissioning in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matching.report.bed_test.text import with_uncertainty
from matching.report.common.wording import number

MEANING = {
    "as_predicted": "The bed answers as the last match predicted.",
    "short": "The bed falls short of what the last match predicted.",
    "undetermined": "The recordings do not decide whether the bed answers as predicted.",
    "waiting": "A recording is waited for.",
}


def summary(result: Mapping[str, Any]) -> str:
    """The answer, then a few lines a round."""
    lines = [f"{result['status']}: {MEANING[result['status']]}", *ending(result)]
    for one in result["rounds"]:
        lines += [f"round {one['round']}: {line}" for line in round_lines(one)]
    if result["waiting_for"]:
        lines.append(f"next: {result['waiting_for']}")
    return "\n".join(lines)


def ending(result: Mapping[str, Any]) -> list[str]:
    """Why the circle ended, and which controller to use, a sentence each."""
    lines = []
    if result["end"]:
        lines.append(f"It ended with round {result['rounds'][-1]['round']}: {result['end']}.")
    elif result["status"] in ("short", "undetermined", "as_predicted"):
        lines.append("It ended with the last round that was asked for; a further one may gain.")
    if result["best_round"]:
        lines.append(f"The controller with the least error on the bed: {result['best_round']}_export/controller.fmu.")
    return lines


def round_lines(one: Mapping[str, Any]) -> list[str]:
    """What a round found, a sentence each."""
    lines = []
    if "identification" in one:
        found = one["identification"]
        causes = ", ".join(f"{cause['kind']} at {cause['at']}" for cause in found["causes"]) or "no further cause"
        lines.append(f"diagnosis {found['verdict']}: {causes}")
        moved = sorted(found["values"], key=lambda own: -abs(own["after"] / own["before"] - 1) if own["before"] else 0)
        lines.append(
            "moved most: "
            + ", ".join(f"{own['name']} {number(own['before'], 4)} → {number(own['after'], 4)}" for own in moved[:4])
        )
        lines += found["notes"]
    if "match" in one:
        lines.append(f"match {one['match']['status']}")
    if "verification" in one:
        proof = one["verification"]
        for error in proof["errors"]:
            measured = with_uncertainty(error["error"], error["standard_uncertainty"])
            lines.append(
                f"{proof['status']}: response error to {error['name']} torques {measured} "
                f"(predicted {number(error['predicted'], 3)})"
            )
        lines += [f"not judged: {note}" for note in proof["notes"] if "left out" in note]
        lines += _fidelity(proof, "")
    if "against_last_vehicle" in one:
        same = one["against_last_vehicle"]
        for error in same["errors"]:
            measured = with_uncertainty(error["error"], error["standard_uncertainty"])
            lines.append(f"against the last round's vehicle: response error to {error['name']} torques {measured}")
        lines += _fidelity(same, " against the last round's vehicle")
    return lines


def _fidelity(judged: Mapping[str, Any], against: str) -> list[str]:
    return [
        f"R_XiL{against} {with_uncertainty(one['R_XiL'], one['standard_uncertainty'])}" for one in judged["fidelity"]
    ]
