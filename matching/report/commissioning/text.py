"""A commissioning in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matching.report.bed_test.text import error_words, with_uncertainty
from matching.report.common.wording import number, spaced

MEANING = {
    "as_predicted": "The bed answers as the last match predicted, within what the case states as uncertain.",
    "short": "The bed falls short of what the last match predicted.",
    "undetermined": "The recordings do not decide whether the bed answers as predicted.",
    "waiting": "A recording is waited for.",
}


def summary(result: Mapping[str, Any]) -> str:
    """The answer, then a few lines a round."""
    lines = [f"{result['status']}: {MEANING[result['status']]}", *ending(result)]
    if result.get("vehicle"):
        lines += [f"vehicle: {line}" for line in identification_lines(result["vehicle"])]
    for entry in result["rounds"]:
        lines += [f"round {entry['round']}: {line}" for line in round_lines(entry)]
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


def identification_lines(identification: Mapping[str, Any]) -> list[str]:
    """What a diagnosis found, a sentence each."""
    causes = ", ".join(f"{cause['kind']} at {cause['at']}" for cause in identification["causes"]) or "no further cause"
    moved = sorted(
        identification["values"],
        key=lambda value: -abs(value["after"] / value["before"] - 1) if value["before"] else 0,
    )
    pairs = [f"{value['name']} {number(value['before'], 4)} → {number(value['after'], 4)}" for value in moved[:4]]
    return [
        f"diagnosis {identification['verdict']}: {causes}", f"moved most: {', '.join(pairs)}", *identification["notes"],
    ]  # fmt: skip


def round_lines(entry: Mapping[str, Any]) -> list[str]:
    """What a round found, a sentence each."""
    lines = identification_lines(entry["identification"]) if "identification" in entry else []
    if "match" in entry:
        lines.append(f"match {entry['match']['status']}")
    if "verification" in entry:
        proof = entry["verification"]
        for error in proof["errors"]:
            lines.append(f"{spaced(proof['status'])}: response error to {error['name']} torques {error_words(error)}")
        lines += [f"not judged: {note}" for note in proof["notes"] if "left out" in note]
        lines += _fidelity(proof, "")
    if "against_last_vehicle" in entry:
        same = entry["against_last_vehicle"]
        for error in same["errors"]:
            measured = with_uncertainty(error["error"], error["standard_uncertainty"])
            lines.append(f"against the last round's vehicle: response error to {error['name']} torques {measured}")
        lines += _fidelity(same, " against the last round's vehicle")
    return lines


def _fidelity(judged: Mapping[str, Any], against: str) -> list[str]:
    return [
        f"R_XiL{against} {with_uncertainty(fidelity['R_XiL'], fidelity['standard_uncertainty'])}"
        for fidelity in judged["fidelity"]
    ]
