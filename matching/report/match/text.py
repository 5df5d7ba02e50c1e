"""A match in words, from the content of ``result.json``: one sentence, and at most twenty lines for a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from matching.frequency.search.result import MatchResult
from matching.report.common.wording import change, component, hertz, number, practical, sentence, unit
from matching.report.match.checks import needs
from matching.report.match.fidelity_rows import fidelity_line
from modelling.bed.structures import STRUCTURES

MOST = 20


def content(result: MatchResult) -> dict[str, Any]:
    """The content of ``result.json``: the result, what was ``asked`` for, what the manoeuvre ``needs``."""
    own = result.to_dict()
    if not math.isfinite(result.objective):  # no start ended within the limits
        own["objective"] = None
    return own | {"asked": dict(result.case.limits), "needs": [vars(need) for need in needs(result)]}


def answer(result: Mapping[str, Any]) -> str:
    """The answer in one sentence."""
    error = result["response_error"]
    before, after = error["before"], number(error["after"], 2)
    fall = f"is {after}" if before is None else f"falls from {number(before, 2)} to {after}"
    if result["status"] == "matched":
        aims = sentence([f"{hertz(target['vehicle'])} Hz" for target in result["targets"]])
        mode = "mode" if len(result["targets"]) == 1 else "modes"
        return (
            f"The rig answers like the vehicle: it shows the target {mode} at {aims} within tolerance, "
            f"and its response error over {_band(error)} {fall}."
        )
    first = result["limits"][0] if result["limits"] else "a check fails"
    first = first[:1].lower() + first[1:] if first[1:2].islower() else first
    return f"The rig cannot be made to answer like the vehicle within these bounds: {first.rstrip('.')}."


def summary(result: Mapping[str, Any]) -> str:
    """The result for a terminal, at most twenty lines."""
    error, asked = result["response_error"], result.get("asked", {})
    head = [f"{result['status'].upper()}  {result.get('title', '')}".rstrip(), answer(result)]
    body = [_target(target) for target in result["targets"][:4]]
    free = "" if error["before"] is None else f", free rig {number(error['before'], 3)}"
    alone = f"; {number(error['unannounced'], 3)} for an unmeasured torque"
    if not STRUCTURES[result["structure"]].has_feed_forward:  # feedback answers all torques alike
        alone = ""
    body.append(
        f"error {_band(error)}: {number(error['after'], 3)} matched{free}{alone}; "
        f"dead time leaves {number(error['bound'], 3)} sampled, {number(error['bound_unsampled'], 3)} unsampled"
    )
    if fidelity := result.get("fidelity"):
        body.append(fidelity_line(fidelity))
    margin = f" (asked {number(asked['modulus_margin'], 3)})" if "modulus_margin" in asked else ""
    body.append(
        f"loop {'stable' if result['stable'] else 'NOT STABLE'}, modulus margin {number(result['modulus_margin'], 3)}"
        f"{margin}, slowest pole {number(result['spectral_abscissa'], 3)} 1/s"
    )
    body += _needed(result.get("needs", []))[:4]
    tail = [f"also: {limit}" for limit in result["limits"][1:3]]
    frozen = [component(own["name"]) for own in result["parameters"] if own["frozen"]]
    if frozen:
        more = f" and {len(frozen) - 3} more" if len(frozen) > 3 else ""
        tail.append(f"needs no identification: {'; '.join(frozen[:3])}{more}")
    moved = [own for own in result["parameters"] if not own["frozen"] and own["tuned"] != own["start"]]
    moved.sort(key=lambda own: -abs(own["tuned"] - own["start"]) / (own["upper"] - own["lower"]))
    room = max(0, MOST - len(head) - len(body) - len(tail))
    checked = result.get("verification", {}).get("notes", [])
    told = [f"note: {note}" for note in result.get("notes", []) if note not in checked]  # where there is room
    return "\n".join([*head, *body, *(_moved(own) for own in moved[:room]), *tail, *told][:MOST])


def _band(error: Mapping[str, Any]) -> str:
    return f"{number(error['band'][0])}–{number(error['band'][1])} Hz"


def _needed(rows: list[Mapping[str, Any]]) -> list[str]:
    """One line for each dynamometer and shaft."""
    by_place: dict[str, list[str]] = {}
    for need in rows:
        allowed = f" of {practical(need['limit'], need['unit'])}" if need["limit"] else ""
        place = component(need["what"].rsplit(".", 1)[0])
        by_place.setdefault(place, []).append(f"{practical(need['peak'], need['unit'])}{allowed}")
    return [f"{place} needs {sentence(parts)}" for place, parts in by_place.items()]


def _target(target: Mapping[str, Any]) -> str:
    side = target["symmetry"].replace("none", "")
    return (
        f"mode {target['vehicle_mode']:<3}{side:13} vehicle {hertz(target['vehicle'])} Hz, "
        f"rig {hertz(target['rig'])}, matched {hertz(target['matched'])}, "
        f"seen in simulation {hertz(target['seen_in_simulation'])}: {'met' if target['met'] else 'NOT MET'}"
    )


def _moved(own: Mapping[str, Any]) -> str:
    much = ", ".join(filter(None, [change(own["start"], own["tuned"]), "at its bound" if own["at_bound"] else ""]))
    moved = f"{own['name']}: {number(own['start'])} → {number(own['tuned'])} {unit(own['unit'])}".rstrip()
    return f"{moved} ({much})" if much else moved
