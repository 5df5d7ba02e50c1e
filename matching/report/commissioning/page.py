"""The page of a commissioning: the circle with what each round gained."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matching.report.commissioning.text import MEANING, ending, identification_lines, round_lines
from matching.report.common.environment import environment
from matching.report.common.provenance import Provenance


def page(result: Mapping[str, Any], made: Provenance | None = None) -> str:
    """The content of ``commission.json`` as HTML, and where it comes from."""
    rounds = [
        {
            "id": f"round-{entry['round']}", "title": f"Round {entry['round']}", "lines": round_lines(entry),
            "values": entry.get("identification", {}).get("values"),
        }
        for entry in result["rounds"]
    ]  # fmt: skip
    if result.get("vehicle"):
        lines = identification_lines(result["vehicle"])
        values = result["vehicle"]["values"]
        rounds.insert(0, {"id": "vehicle", "title": "Vehicle on the road", "lines": lines, "values": values})
    return (
        environment()
        .get_template("commission.html")
        .render(
            title="Commissioning", status=result["status"], answer=MEANING[result["status"]], rounds=rounds,
            waiting=result["waiting_for"], ending=ending(result), gain=gain(result), figures={}, captions={}, made=made,
        )
    )  # fmt: skip


def gain(result: Mapping[str, Any]) -> float | None:
    """Measured response error of the first round over that of the last; None where one is not determined.

    Both are against the vehicle of the last round, which holds the specimen as it is known best.
    """
    judged = [entry.get("against_last_vehicle", entry.get("verification")) for entry in result["rounds"]]
    errors = [verification["errors"][0]["error"] for verification in judged if verification and verification["errors"]]
    if len(errors) < 2 or errors[0] is None or not errors[-1]:
        return None
    return float(errors[0] / errors[-1])
