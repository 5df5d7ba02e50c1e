"""A diagnosis in words, from the content of ``diagnosis.json``: one sentence, and a summary for a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from string import Formatter
from typing import Any

from matching.report.common.wording import number, percent, spaced, unit
from modelling.effects import EFFECTS
from modelling.effects.place import place_in_words, shared_place

PLACES = {
    "shafts": "the shaft", "gears": "the gear", "inertias": "the inertia",
    "inputs": "the input", "sensors": "the sensor",
}  # fmt: skip
LEAST_RIVAL_CONFIDENCE = 0.1  # from which the answer names a rival
PLAIN_POWERS = range(-4, 6)  # powers of ten that are written without exponent
MOST_DECIMALS = 8


def answer(result: Mapping[str, Any]) -> str:
    """The answer in one sentence."""
    causes, worst = result["causes"], _worst(result["errors"])
    if result["verdict"] == "adequate":
        largest = max((_in_noise(error, "after_holdout") or 0.0 for error in result["errors"].values()), default=0.0)
        return (
            "The model is adequate: on held-out data no sensor's error is larger than "
            f"{number(largest, 3)} times its noise."
        )
    if not causes:
        size = "" if worst is None else f": the error of {worst[0]} is {number(worst[1], 3)} times the noise"
        return f"None of the known effects explains what the model misses{size} on held-out data."
    clauses = [clause(cause) + _rivals(cause) for cause in causes]
    text = clauses[0] if len(clauses) == 1 else f"{', '.join(clauses[:-1])}, and {clauses[-1]}"
    text = text[:1].upper() + text[1:] if text.startswith(("the ", "each ")) else text
    if worst is not None:
        name, before, after = worst
        text += f"; with {'it' if len(causes) == 1 else 'them'} the error of {_pooled(result)}{name} "
        text += (
            f"{'rises' if after > before else 'falls'} from {number(before, 3)} to {number(after, 3)} times the noise"
        )
        text += " on held-out data"
    return text + ("." if result["verdict"] == "explained" else ", and an unexplained error remains.")


def _pooled(result: Mapping[str, Any]) -> str:
    """The error of all sensors together on held-out data, over their ranges; empty for a single sensor."""
    gain = result.get("gain", {})
    before, after = gain.get("nrmse_before"), gain.get("nrmse_after")
    if len(result["errors"]) < 2 or before is None or after is None:
        return ""
    falls = "rises" if after > before else "falls"
    return f"all sensors {falls} from {percent(before)} to {percent(after)} of their range; that of the worst sensor "


def clause(cause: Mapping[str, Any]) -> str:
    """A cause as a clause: the shaft link has 0.0210 ± 0.0010 rad of free play."""
    kind, values = cause["kind"], {key: measured(estimate) for key, estimate in cause["parameters"].items()}
    words = EFFECTS[kind].words or "has " + spaced(kind)
    places = [cause["at"]] if isinstance(cause["at"], str) else cause["at"]
    if kind in EFFECTS and EFFECTS[kind].follows:
        places, values = places[:1], values | {"second": _subject(places[1])}
    in_words = {"second"} | {key for _, key, _, _ in Formatter().parse(words) if key}
    further = [f"{spaced(key)} {value}" for key, value in values.items() if key not in in_words]
    return f"{_subject(places)} {words.format_map(values)}" + (f" ({', '.join(further)})" if further else "")


def _subject(at: str | Sequence[str]) -> str:
    """A place with its article: the shaft link; of several that share an effect: each of the sensors a and b."""
    places = [at] if isinstance(at, str) else at
    table, name = places[0].split(".", 1)
    if len(places) > 1:
        names = [place.split(".", 1)[1] for place in places]
        return f"each of {PLACES[table]}s {', '.join(names[:-1])} and {names[-1]}"
    return f"{PLACES[table]} {name}" if "." not in name else places[0]


def kind_and_place(cause: Mapping[str, Any]) -> str:
    """A cause or candidate by kind and place: backlash at shafts.link."""
    return f"{cause['kind']} at {place(cause['at'])}"


def place(at: str | list[str]) -> str:
    """A place of ``diagnosis.json`` for a sentence or a table."""
    return place_in_words(at if isinstance(at, str) else shared_place(at))


def _rivals(cause: Mapping[str, Any]) -> str:
    rivals = [kind_and_place(rival) for rival in cause["alternatives"] if rival["confidence"] > LEAST_RIVAL_CONFIDENCE]
    return f" (these data do not rule out {' or '.join(rivals)} instead)" if rivals else ""


def measured(estimate: Mapping[str, Any]) -> str:
    """A value with its standard uncertainty, to two digits of that (JCGM 100, 7.2.6), and its unit."""
    value, u = estimate["value"], estimate["standard_uncertainty"]
    printed_unit = unit(estimate["unit"])
    if not u or not math.isfinite(u):
        return f"{number(value)} {printed_unit}".rstrip()
    u = float(f"{u:.1e}")  # 0.0996 is 0.10
    decimals = 1 - math.floor(math.log10(u))
    power = math.floor(math.log10(max(abs(value), u)))
    if power in PLAIN_POWERS and decimals <= MOST_DECIMALS:
        places = max(decimals, 0)
        text = f"{round(value, decimals):.{places}f} ± {round(u, decimals):.{places}f}"
    else:
        places = max(decimals + power, 0)
        text = f"{value / 10.0**power:.{places}f}e{power} ± {u / 10.0**power:.{places}f}e{power}"
    return f"{text} {printed_unit}".rstrip()


def _in_noise(error: Mapping[str, float | None], key: str) -> float | None:
    """A root mean square error in times the sensor's noise; None where it is unknown."""
    value, noise = error[key], error["noise"]
    return None if value is None or not noise else value / noise


def _worst(errors: Mapping[str, Mapping[str, float | None]]) -> tuple[str, float, float] | None:
    """The sensor with the largest error that is left on held-out data; before and after in times its noise."""
    rows = [
        (name, _in_noise(error, "before_holdout"), _in_noise(error, "after_holdout")) for name, error in errors.items()
    ]
    known = [(name, before, after) for name, before, after in rows if before is not None and after is not None]
    return max(known, key=lambda row: row[2], default=None)


def summary(result: Mapping[str, Any]) -> str:
    """The result for a terminal: the answer, what to do next, then the evidence."""
    lines = [answer(result), *(f"  first: {step}" for step in to_correct(result))]
    if result["next_recording"]:
        lines.append(f"  next: {result['next_recording']}")
    for cause in result["causes"]:
        lines += _evidence(cause)
    for name, error in result["errors"].items():
        before, after = (number(_in_noise(error, key), 3) for key in ("before_holdout", "after_holdout"))
        lines.append(f"  {name}: error on held-out data from {before} to {after} times the noise")
    if result["fidelity"]:
        before, after = result["fidelity"]["before"], result["fidelity"]["after"]
        lines.append(
            f"  fidelity on held-out data: R_RVM from {percent(before['R_RVM'])} to {percent(after['R_RVM'])}"
            f" (a perfect model: {percent(result['fidelity']['noise_floor']['R_RVM'])})"
        )
    for row in result["rest"]:
        lines.append(
            f"  remaining error of {row['sensor']}: largest from {row['from']:g} to {row['to']:g} s, "
            f"{number(row['worst_ratio'], 3)} times the noise"
        )
    lines += [f"  {shape(curve)}" for curve in result.get("discrepancy", [])[:1]]
    if kept := result.get("kept_discrepancy"):
        before, after = percent(kept["nrmse_before"]), percent(kept["nrmse_after"])
        lines.append(
            f"  the extended model keeps the torque over the {kept['over']} of {kept['at']} as a table: the error of "
            f"held-out data falls from {before} to {after} of the sensors' ranges"
        )
    unidentified = not_identifiable(result)
    if unidentified:
        lines.append(f"  not identifiable from these data: {', '.join(unidentified)}")
    return "\n".join([*lines, *(f"  note: {note}" for note in result["notes"])])


def shape(curve: Mapping[str, Any]) -> str:
    """What no cause explains, as a torque over one variable."""
    text = f"what remains has a shape: a torque over the {curve['over']} of {curve['at']} would take "
    text += f"{percent(curve['share'])} of it"
    if curve["repeats"] is not None:
        text += f"; the curves of both halves of the data correlate by {number(curve['repeats'], 2)}"
    return text


def _evidence(cause: Mapping[str, Any]) -> list[str]:
    lines = [f"  {kind_and_place(cause)}, confidence {cause['confidence']:.2f}: {cause['evidence']}"]
    lines += [f"    {key}: {estimate['note']}" for key, estimate in cause["parameters"].items() if "note" in estimate]
    rivals = [f"{kind_and_place(rival)} ({rival['confidence']:.2f})" for rival in cause["alternatives"][:3]]
    return [*lines, f"    rivals: {', '.join(rivals)}"] if rivals else lines


def to_correct(result: Mapping[str, Any]) -> list[str]:
    """What to correct in the model or channel file before the causes are believed: channels with a reversed sign, and
    ranges that are too narrow, for what a quantity at its bound cannot take a false cause may have taken."""
    steps = []
    for cause in result["causes"]:
        gain = cause["parameters"].get("factor")  # of an input or a sensor
        if gain is not None and gain["value"] < 0:
            steps.append(f"the sign of {place(cause['at'])} is probably reversed: change it in the channel file")
    at_bound = [name for name, estimate in result["parameters"].items() if "at the bound" in estimate.get("note", "")]
    if at_bound:
        ends = "ends at the bound of its range" if len(at_bound) == 1 else "end at the bounds of their ranges"
        steps.append(f"{', '.join(at_bound)} {ends}: widen that in the model file, unless physics sets it")
    return [f"{step}, and run again" for step in steps]


def not_identifiable(result: Mapping[str, Any]) -> list[str]:
    """Names of the quantities that these recordings do not determine."""
    parameters = result["parameters"].items()
    return [name for name, estimate in parameters if "not identifiable" in estimate.get("note", "")]
