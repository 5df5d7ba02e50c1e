"""The verification of a bed in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matching.report.common.wording import number

MEANING = {
    "as_predicted": "The bed answers as the match predicted, within what was measured and what the case states as "
    "uncertain, and no worse than the case allows.",
    "short": "The bed falls short of the prediction by more than the uncertainty of the measurement.",
    "undetermined": "The recordings do not decide it: record longer, or excite the bed more.",
}


def answer(result: Mapping[str, Any]) -> str:
    """The answer in one sentence, with what is short or open."""
    parts = [MEANING[result["status"]]]
    for status, words in (("short", "Short"), ("undetermined", "Open")):
        names = [f"{error['name']} torques" for error in result["errors"] if error["status"] == status]
        names += [f"vehicle mode {mode['vehicle_mode']}" for mode in result["modes"] if mode["status"] == status]
        if names:
            parts.append(f"{words}: {', '.join(names)}.")
    return " ".join(parts)


def with_uncertainty(value: float | None, standard: float | None, digits: int = 3) -> str:
    """A value with its expanded uncertainty, k = 2."""
    if value is None or standard is None:
        return "not determined"
    return f"{number(value, digits)} ± {number(2 * standard, 2)}"


def summary(result: Mapping[str, Any]) -> str:
    """At most twenty lines for a terminal."""
    lines = [f"{result['status']}: {answer(result)}"]
    for error in result["errors"]:
        lines.append(f"response error to {error['name']} torques: {error_words(error)}: {error['status']}")
    for mode in result["modes"]:
        lines.append(f"vehicle mode {mode['vehicle_mode']}: {mode_words(mode)}: {mode['status']}")
    for fidelity in result["fidelity"]:
        lines.append(
            f"R_XiL of {fidelity['recording']}: {with_uncertainty(fidelity['R_XiL'], fidelity['standard_uncertainty'])}"
        )
    lines += [f"why: {sentence}" for sentence in why(result)]
    lines.append(f"uncertainties: k = {number(result['coverage_factor'])}, about 95 %")
    return "\n".join(lines + [f"note: {note}" for note in result["notes"]])


def error_words(error: Mapping[str, Any]) -> str:
    """A measured response error beside what it is judged by."""
    measured = with_uncertainty(error["error"], error["standard_uncertainty"])
    predicted, expected, allowed = (number(error[key], 3) for key in ("predicted", "expected", "allowed"))
    return f"{measured} (predicted {predicted}, on 95 % of drawn beds below {expected}, allowed {allowed})"


def why(result: Mapping[str, Any]) -> list[str]:
    """What a diagnosis of the recordings says, where the bed falls short."""
    return list((result.get("diagnosis") or {}).get("sentences", ()))


def interim(result: Mapping[str, Any]) -> str:
    """One line on what a recording shows that is still being written."""
    errors = [
        f"{error['name']} torques {with_uncertainty(error['error'], error['standard_uncertainty'])}"
        for error in result["errors"]
    ]
    return f"so far {result['status']}: response error to {', '.join(errors)}"


def mode_words(mode: Mapping[str, Any]) -> str:
    """Frequency and damping ratio of vehicle, prediction and bed."""
    parts = [f"vehicle {_pair(mode['vehicle'])}", f"predicted {_pair(mode['predicted'])}"]
    measured = mode["measured"]
    if measured is None:
        return ", ".join([*parts, "measured: does not show"])
    return ", ".join(
        [
            *parts,
            f"measured {with_uncertainty(measured['frequency'], measured['frequency_uncertainty'], 4)} Hz, "
            f"damping ratio {with_uncertainty(measured['damping_ratio'], measured['damping_uncertainty'])}",
        ]
    )


def _pair(values: Mapping[str, float] | None) -> str:
    if values is None:
        return "does not show"
    return f"{number(values['frequency'], 4)} Hz, {number(values['damping_ratio'], 3)}"
