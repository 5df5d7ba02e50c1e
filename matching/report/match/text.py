"""A match in words, from the content of ``result.json``: one sentence, and at most twenty lines for a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from matching.frequency.search.result import MatchResult
from matching.report.common.wording import change, component, hertz, number, percent, practical, sentence, spaced, unit
from matching.report.in_time.in_words import in_time_lines
from matching.report.match.checks import needs
from matching.report.match.fidelity_rows import fidelity_line
from modelling.bed.structures import STRUCTURES

MOST_LINES, MOST_TARGETS, MOST_NEEDS, MOST_NAMES = 19, 4, 4, 3  # of the summary for a terminal

BELOW = 0.99  # of the lower bound: an error below it by more than rounding


def content(result: MatchResult) -> dict[str, Any]:
    """The content of ``result.json``: the result, what was ``asked`` for, what the manoeuvre ``needs``."""
    entries = result.to_dict()
    if not math.isfinite(result.objective):  # no start ended within the limits
        entries["objective"] = None
    return entries | {"asked": dict(result.case.limits), "needs": [vars(need) for need in needs(result)]}


def answer(result: Mapping[str, Any]) -> str:
    """The answer in one sentence."""
    error = result["response_error"]
    before, after = error["before"], number(error["after"], 2)
    fall = f"is {after}" if before is None else f"falls from {number(before, 2)} to {after}"
    if result["status"] == "matched":
        frequencies = sentence([f"{hertz(target['vehicle'])} Hz" for target in result["targets"]])
        mode = "mode" if len(result["targets"]) == 1 else "modes"
        return (
            f"The rig reproduces the vehicle's response: it has the target {mode} at {frequencies} within tolerance, "
            f"and its response error over {_band(error)} {fall}."
        )
    first = result["limits"][0] if result["limits"] else "a check fails"
    first = first[:1].lower() + first[1:] if first[1:2].islower() else first
    return f"The rig cannot reproduce the vehicle's response within these bounds: {first.rstrip('.')}."


def summary(result: Mapping[str, Any]) -> str:
    """The result for a terminal, at most nineteen lines: the answer, what limits it, targets and errors, what moved."""
    head = [f"{result['status'].upper()}  {result.get('title', '')}".rstrip(), answer(result)]
    head += [f"also: {limit}" for limit in result["limits"][1:3]]
    body = [_target(target) for target in result["targets"][:MOST_TARGETS]]
    body += [_errors(result), *_fidelity(result), _loop(result), *_beds(result), *in_time_lines(result)]
    body += [operating_point(result), *_needed(result.get("needs", []))[:MOST_NEEDS]]
    tail = _not_moved(result["parameters"])
    moved = [row for row in result["parameters"] if not row["fixed"] and row["tuned"] != row["start"]]
    moved.sort(key=lambda row: -abs(row["tuned"] - row["start"]) / (row["upper"] - row["lower"]))
    room = max(1, MOST_LINES - len(head) - len(body) - len(tail))
    of_checks = result.get("verification", {}).get("notes", [])
    notes = [f"note: {note}" for note in result.get("notes", []) if note not in of_checks]  # where there is room
    return "\n".join([*head, *body, *_all_moved(moved, room), *tail, *notes][:MOST_LINES])


def _band(error: Mapping[str, Any]) -> str:
    return f"{number(error['band'][0])}–{number(error['band'][1])} Hz"


def _errors(result: Mapping[str, Any]) -> str:
    error = result["response_error"]
    before = "" if error["before"] is None else f", rig without control {number(error['before'], 3)}"
    unmeasured = f"; {number(error['unmeasured_after'], 3)} for an unmeasured torque"
    if error.get("unmeasured_bound") is not None:
        unmeasured += f" ({number(error['unmeasured_bound'], 2)} with an ideal estimator on these sensors)"
    structure = STRUCTURES[result["structure"]]
    if not structure.has_feed_forward and not structure.is_observer:  # the same for all torques
        unmeasured = ""
    below = ""
    if error["after"] < BELOW * error["bound"]:
        below = " (of torques that step; the match is below it within its band)"
    return (
        f"response error {_band(error)}: {number(error['after'], 3)} matched{before}{unmeasured}; lower bound set by "
        f"the dead time{below} {number(error['bound'], 2)} as sampled, {number(error['bound_unsampled'], 2)} without "
        "sampling"
    )


def _fidelity(result: Mapping[str, Any]) -> list[str]:
    fidelity = result.get("fidelity")
    return [fidelity_line(fidelity)] if fidelity else []


def _loop(result: Mapping[str, Any]) -> str:
    limits = result.get("asked", {})
    required = f" (required {number(limits['modulus_margin'], 3)})" if "modulus_margin" in limits else ""
    counted_from = result.get("modulus_margin_from", 0.0)
    counted = f" from {number(counted_from, 3)} Hz on" if counted_from > 0 else ""
    return (
        f"loop {'stable' if result['stable'] else 'NOT STABLE'}, modulus margin {number(result['modulus_margin'], 3)}"
        f"{counted}{required}, slowest pole {number(result['spectral_abscissa'], 3)} 1/s"
    )


def operating_point(result: Mapping[str, Any]) -> str:
    """The steady motion from which the manoeuvre begins, in one line."""
    speeds, torques = result.get("operating_point", {}), result.get("operating_torques", {})
    if not any(speeds.values()):
        return "operating point: none stated, standstill assumed; torques, speeds and powers count from there"
    turning = [f"{spaced(name)} {practical(speed, 'rad/s', 4)}" for name, speed in speeds.items()]
    driven = [f"{spaced(name)} {practical(torque, 'N*m')}" for name, torque in torques.items()]
    return f"operating point: {sentence(_ends(turning))}; {sentence(_ends(driven))}"


def _ends(parts: list[str]) -> list[str]:
    """The first, and as many of the last as the rest of a line takes: drive first, dynamometers last."""
    return parts if len(parts) <= MOST_NAMES else [parts[0], *parts[1 - MOST_NAMES :]]


def _beds(result: Mapping[str, Any]) -> list[str]:
    """What drawn beds and sensor noise do under an observer; nothing for feedback laws."""
    beds, margin = result.get("beds"), result.get("margin")
    if not beds or not margin or not beds["drawn"]:
        return []
    noise = max(result["command_noise"].values())
    return [
        f"{beds['stable']} of {beds['drawn']} beds drawn within [uncertainty] stable, least damping ratio "
        f"{number(beds['smallest_damping_ratio'], 3)} (required {number(beds['required_damping_ratio'], 3)}"
        f"{_of_its_own(beds)}{_worst(beds.get('worst'))}); their "
        f"response error: measured torques {_spread(beds, 'error')}, unmeasured {_spread(beds, 'unmeasured')}"
        f"{_largest(beds.get('largest_error'))}{_simulated(result)}",
        f"modulus margin {number(margin['modulus'], 3)} from {number(margin['from'], 3)} Hz on, |T| at most "
        f"{number(margin['largest_rolled_off'], 3)} from {number(margin['rolled_off_from'], 3)} Hz on, sensor noise "
        f"makes {number(noise, 3)} N·m rms of command",
    ]


def _of_its_own(beds: Mapping[str, Any]) -> str:
    """Why beds count as damped with a mode that has less than is required."""
    if beds["damped"] < beds["drawn"] or beds["smallest_damping_ratio"] >= beds["required_damping_ratio"]:
        return ""
    return "; less is a mode of the bed's own beyond the roll-off"


def _simulated(result: Mapping[str, Any]) -> str:
    """What the beds' errors count otherwise than that of the bed as planned; nothing without a feed-forward."""
    functions = result["response_error"].get("functions", ())
    with_two_errors = any(row["before"] is None and row["unmeasured"] != row["after"] for row in functions)
    if not STRUCTURES[result["structure"]].has_feed_forward or not with_two_errors:
        return ""
    return " (torques inside the residual vehicle count as measured on the beds, as unmeasured in the error above)"


def _worst(worst: Mapping[str, Any] | None) -> str:
    return "" if worst is None else f"; of the worst bed of the box {number(worst['damping_ratio'], 3)}"


def _largest(largest: Mapping[str, Any] | None) -> str:
    return "" if largest is None else f", largest found in the box {number(largest['unmeasured'], 3)}"


def _spread(beds: Mapping[str, Any], name: str) -> str:
    return f"{number(beds[f'{name}_median'], 3)} (median) and {number(beds[f'{name}_95'], 3)} (95 %)"


def _needed(rows: list[Mapping[str, Any]]) -> list[str]:
    """One line for each dynamometer and shaft."""
    by_component: dict[str, list[str]] = {}
    for need in rows:
        limit = f" of {practical(need['limit'], need['unit'])}" if need["limit"] else ""
        name = component(need["what"].rsplit(".", 1)[0])
        share = need["what"].endswith(".torque_over_speed")
        peak = (
            f"{percent(need['peak'], 0)} of its torque at its speed" if share else practical(need["peak"], need["unit"])
        )
        by_component.setdefault(name, []).append(peak if share else peak + limit)
    return [f"{name} needs {sentence(parts)}" for name, parts in by_component.items()]


def _not_moved(parameters: list[Mapping[str, Any]]) -> list[str]:
    names = [component(row["name"]) for row in parameters if row["fixed"]]
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return [f"need not be identified accurately: {'; '.join(names[:MOST_NAMES])}{more}"] if names else []


def _target(target: Mapping[str, Any]) -> str:
    side = target["symmetry"].replace("none", "")
    return (
        f"mode {target['vehicle_mode']:<3}{side:13} vehicle {hertz(target['vehicle'])} Hz, "
        f"rig {hertz(target['rig'])}, matched {hertz(target['matched'])}, "
        f"from simulation {hertz(target['seen_in_simulation'])}: {'met' if target['met'] else 'NOT MET'}"
    )


def _all_moved(rows: list[Mapping[str, Any]], room: int) -> list[str]:
    """A line for each quantity that moved; those for which there is no room in one line."""
    if len(rows) <= room:
        return [_moved(row) for row in rows]
    rest = [f"{row['name']} {number(row['tuned'])} {unit(row['unit'])}".rstrip() for row in rows[room - 1 :]]
    return [*(_moved(row) for row in rows[: room - 1]), f"also moved: {', '.join(rest)}"]


def _moved(row: Mapping[str, Any]) -> str:
    remarks = [change(row["start"], row["tuned"]), "at its bound" if row["at_bound"] else ""]
    moved = f"{row['name']}: {number(row['start'])} → {number(row['tuned'])} {unit(row['unit'])}".rstrip()
    return f"{moved} ({', '.join(filter(None, remarks))})" if any(remarks) else moved
