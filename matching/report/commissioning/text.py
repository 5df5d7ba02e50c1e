"""A commissioning in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matching.report.bed_test.text import with_uncertainty
from matching.report.common.wording import number

MEANING = {
    "as_predicted": "The bed answers as the last match predicted.",
    "short": "The bed still falls short of the prediction; more rounds may help.",
    "undetermined": "The recordings do not decide whether the bed answers as predicted.",
    "waiting": "A recording is waited for.",
}


def summary(result: Mapping[str, Any]) -> str:
    """The answer, then a few lines a round."""
    lines = [f"{result['status']}: {MEANING[result['status']]}"]
    for one in result["rounds"]:
        lines += [f"round {one['round']}: {line}" for line in round_lines(one)]
    if result["waiting_for"]:
        lines.append(f"next: {result['waiting_for']}")
    return "\n".join(lines)


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
        for fidelity in proof["fidelity"]:
            lines.append(f"R_XiL {with_uncertainty(fidelity['R_XiL'], fidelity['standard_uncertainty'])}")
    return lines
