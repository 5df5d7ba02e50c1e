"""A planned excitation in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matching.report.common.wording import number, unit

NAMED = 8  # quantities in a summary


def summary(result: Mapping[str, Any]) -> str:
    """What the recording is expected to tell, and what of the limits it uses."""
    error = result["response_error"]
    hold = ", ".join(
        f"{name} {number(gains['proportional'], 3)} N·m·s/rad and {number(gains['integral'], 3)} N·m/rad"
        for name, gains in result["speed_hold"].items()
    )
    lines = [
        f"excitation of {number(result['duration'], 3)} s about a rotor speed of {number(result['speed'], 3)} rad/s",
        f"hold the speed slowly beside it: {hold}",
        f"response error from what is not known: {number(error['before'], 2)} now, "
        f"{number(error['after'], 2)} expected with what the recording tells",
    ]
    for quantity in result["expected"][:NAMED]:
        before, after = (number(quantity[f"standard_uncertainty_{when}"], 2) for when in ("before", "after"))
        line = f"{quantity['name']}: {number(quantity['value'], 4)} ± {after} {unit(quantity['unit'])}".rstrip()
        lines.append(f"{line} (known to ± {before})")
    most = max(result["limits_used"], key=result["limits_used"].get)
    lines.append(
        f"limits: {result['beds']} beds within what is not known use at most {result['limits_used'][most]:.0%} of one "
        f"({most}); asked for {1 - result['margin']:.0%}"
    )
    lines.append("± is a standard uncertainty (k = 1) from sensor noise alone: a model that lacks something adds to it")
    return "\n".join(lines + [f"note: {note}" for note in result["notes"]])
