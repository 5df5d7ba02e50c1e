"""A diagnosis in words, from the content of ``diagnosis.json``: one sentence, and a summary for a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from string import Formatter
from typing import Any

from matching.report.common.wording import number, unit
from matching.report.match.fidelity_rows import percent
from modelling.effects import EFFECTS

PLACES = {"shafts": "the shaft", "inertias": "the inertia", "inputs": "the input", "sensors": "the sensor"}
RIVAL = 0.1  # confidence from which a rival is told with the answer


def answer(result: Mapping[str, Any]) -> str:
    """The answer in one sentence."""
    causes, worst = result["causes"], _worst(result["errors"])
    if result["verdict"] == "adequate":
        most = max((_over(own, "after_holdout") or 0.0 for own in result["errors"].values()), default=0.0)
        return f"The model is adequate: on unseen data no sensor is off by more than {number(most, 3)} times its noise."
    if not causes:
        over = "" if worst is None else f": the error of {worst[0]} is {number(worst[1], 3)} times the noise"
        return f"What the model misses fits nothing in the vocabulary of causes{over} on unseen data."
    said = [says(cause) + _or(cause) for cause in causes]
    text = said[0] if len(said) == 1 else f"{', '.join(said[:-1])}, and {said[-1]}"
    text = text[:1].upper() + text[1:] if text.startswith("the ") else text
    if worst is not None:
        name, before, after = worst
        text += f"; with {'it' if len(causes) == 1 else 'them'} the error of {name} falls from {number(before, 3)}"
        text += f" to {number(after, 3)} times the noise on unseen data"
    return text + ("." if result["verdict"] == "explained" else ", and something unexplained remains.")


def says(cause: Mapping[str, Any]) -> str:
    """A cause as a clause: the shaft link has 0.0210 ± 0.0010 rad of free play."""
    table, name = cause["at"].split(".", 1)
    place = f"{PLACES[table]} {name}" if "." not in name else cause["at"]
    kind, values = cause["kind"], {key: measured(own) for key, own in cause["parameters"].items()}
    words = EFFECTS[kind].words or "has " + kind.replace("_", " ")
    told = {key for _, key, _, _ in Formatter().parse(words) if key}
    rest = [f"{key.replace('_', ' ')} {value}" for key, value in values.items() if key not in told]
    return f"{place} {words.format_map(values)}" + (f" ({', '.join(rest)})" if rest else "")


def _or(cause: Mapping[str, Any]) -> str:
    near = [f"{one['kind']} at {one['at']}" for one in cause["alternatives"] if one["confidence"] > RIVAL]
    return f" (these data do not rule out {' or '.join(near)} instead)" if near else ""


def measured(own: Mapping[str, Any]) -> str:
    """A value with its standard uncertainty, to two digits of that (JCGM 100, 7.2.6), and its unit."""
    value, u = own["value"], own["standard_uncertainty"]
    shown = unit(own["unit"])
    if not u or not math.isfinite(u):
        return f"{number(value)} {shown}".rstrip()
    u = float(f"{u:.1e}")  # 0.0996 is 0.10
    digits = 1 - math.floor(math.log10(u))
    power = math.floor(math.log10(max(abs(value), u)))
    if -5 < power < 6 and digits < 9:
        text = f"{round(value, digits):.{max(digits, 0)}f} ± {round(u, digits):.{max(digits, 0)}f}"
    else:
        places = max(digits + power, 0)
        text = f"({value / 10.0**power:.{places}f} ± {u / 10.0**power:.{places}f})·10^{power}"
    return f"{text} {shown}".rstrip().replace("-", "−")


def _over(own: Mapping[str, float | None], key: str) -> float | None:
    value, noise = own[key], own["noise"]
    return None if value is None or not noise else value / noise


def _worst(errors: Mapping[str, Mapping[str, float | None]]) -> tuple[str, float, float] | None:
    """The sensor that is off most on unseen data, before and after in times its noise."""
    rows = [(name, _over(own, "before_holdout"), _over(own, "after_holdout")) for name, own in errors.items()]
    known = [(name, before, after) for name, before, after in rows if before is not None and after is not None]
    return max(known, key=lambda row: row[1], default=None)


def summary(result: Mapping[str, Any]) -> str:
    """The result for a terminal."""
    lines = [answer(result)]
    for cause in result["causes"]:
        lines.append(f"  {cause['kind']} at {cause['at']}, confidence {cause['confidence']:.2f}: {cause['evidence']}")
        lines += [f"    {key}: {own['note']}" for key, own in cause["parameters"].items() if "note" in own]
        rivals = [f"{one['kind']} at {one['at']} ({one['confidence']:.2f})" for one in cause["alternatives"][:3]]
        if rivals:
            lines.append(f"    rivals: {', '.join(rivals)}")
    for name, own in result["errors"].items():
        before, after = (number(_over(own, key), 3) for key in ("before_holdout", "after_holdout"))
        lines.append(f"  {name}: error on unseen data from {before} to {after} times the noise")
    if result["fidelity"]:
        before, after = result["fidelity"]["before"], result["fidelity"]["after"]
        lines.append(
            f"  fidelity on unseen data: R_RVM from {percent(before['R_RVM'])} to {percent(after['R_RVM'])}"
            f" (a perfect model: {percent(result['fidelity']['noise_floor']['R_RVM'])})"
        )
    for one in result["rest"]:
        lines.append(
            f"  left over: {one['sensor']}, most from {one['from']:g} to {one['to']:g} s, "
            f"{number(one['worst_ratio'], 3)} times the noise"
        )
    open_ = [name for name, own in result["parameters"].items() if own.get("note", "").startswith("not identifiable")]
    if open_:
        lines.append(f"  not identifiable from these data: {', '.join(open_)}")
    if result["next_recording"]:
        lines.append(f"  next: {result['next_recording']}")
    return "\n".join([*lines, *(f"  note: {note}" for note in result["notes"])])
