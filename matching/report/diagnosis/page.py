"""The report of a diagnosis: one HTML page that opens anywhere, without network."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matching.report.common.environment import embedded, environment
from matching.report.common.wording import number
from matching.report.diagnosis.figures import CAPTIONS
from matching.report.diagnosis.sentences import answer, measured
from matching.report.match.fidelity_rows import percent

MEANING = {
    "adequate": "Every sensor's residual is white noise of its stated uncertainty. Nothing was added to the model.",
    "explained": "The causes named bring every sensor's residual to white noise of its stated uncertainty, "
    "and unseen data are met as well as fitted ones.",
    "unexplained": "More than noise is left. Causes named take part of it; what stays fits nothing in the vocabulary "
    "well enough, so treat their values with care.",
}
NONE_NAMED = "More than noise is left, and nothing in the vocabulary takes enough of it to be named."


def content(found: Any) -> dict[str, Any]:
    """The content of ``diagnosis.json``: the answer in a sentence first, then the diagnosis."""
    result = found.to_dict()
    return {"answer": answer(result), **result}


def page(result: Mapping[str, Any], title: str, units: Mapping[str, str], drawn: Mapping[str, bytes]) -> str:
    """The page.

    Parameters
    ----------
    result : mapping
        The content of ``diagnosis.json``.
    units : dict of str to str
        SI unit of every sensor.
    drawn : mapping of str to bytes
        Figures by the names of :func:`matching.report.diagnosis.figures.figures`.
    """
    values = {
        "title": f"Diagnosis: {title}" if title else "Diagnosis of a model",
        "verdict": result["verdict"],
        "answer": result["answer"],
        "meaning": MEANING[result["verdict"]] if result["causes"] or result["verdict"] != "unexplained" else NONE_NAMED,
        "causes": [_cause(cause) for cause in result["causes"]],
        "errors": [_error(name, units[name], own) for name, own in result["errors"].items()],
        "gain": result["gain"],
        "fidelity": _fidelity(result["fidelity"]) if result["fidelity"] else None,
        "rest": result["rest"],
        "rivals": _rivals(result["candidates"]),
        "quantities": [
            {"name": name, "value": measured(own), "note": own.get("note", "")}
            for name, own in result["parameters"].items()
        ],
        "next": result["next_recording"] or _nothing_to_tell_apart(result["verdict"]),
        "notes": result["notes"],
        "figures": {name: embedded(own) for name, own in drawn.items()},
        "captions": CAPTIONS,
    }
    made = environment()
    made.filters["share"] = _share
    return made.get_template("diagnosis.html").render(values)


def _nothing_to_tell_apart(verdict: str) -> str:
    if verdict == "unexplained":
        return (
            "No rival of a named cause is left to tell apart. What stays may need a sensor nearer to where it sits, "
            "or a law that the vocabulary lacks; see where it is largest."
        )
    return "Nothing: no rival is left that a further recording would have to rule out."


def _share(value: float | None) -> str:
    return "–" if value is None else f"{number(100 * value, 3)} %"


def _cause(cause: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "kind": cause["kind"].replace("_", " "),
        "at": cause["at"],
        "values": [(key.replace("_", " "), measured(own)) for key, own in cause["parameters"].items()],
        "confidence": f"{cause['confidence']:.2f}",
        "gain": number(cause["gain"], 3),
        "evidence": cause["evidence"],
        "notes": [
            f"{key.replace('_', ' ')}: {own['note']}" for key, own in cause["parameters"].items() if "note" in own
        ],
    }


def _error(name: str, unit: str, own: Mapping[str, Any]) -> dict[str, Any]:
    after = own["after_holdout"]
    return {"name": name, "unit": unit, **own, "ratio": None if after is None else after / own["noise"]}


def _rivals(candidates: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Candidates by the cause whose place they take, with runner-up and margin in words."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for one in candidates:
        groups.setdefault(one["instead_of"], []).append(one)
    out = []
    for cause, rows in groups.items():
        named = next(row["chi_square"] for row in rows if f"{row['kind']} at {row['at']}" == cause)
        shown = [
            row | {"kind": row["kind"].replace("_", " "), "margin": row["chi_square"] - named,
                   "confidence": f"{row['confidence']:.2g}"}
            for row in rows
        ]  # fmt: skip
        others = [row for row in rows if f"{row['kind']} at {row['at']}" != cause]
        words = "No other candidate was worth a fit."
        if others:
            runner = max(others, key=lambda row: (row["confidence"], -row["chi_square"]))
            margin = number(runner["chi_square"] - named, 3)
            words = (
                f"Runner-up: {runner['kind'].replace('_', ' ')} at {runner['at']}, which leaves "
                f"{number(runner['misfit'], 3)} times the noise; the χ² of its fit less that of the cause is {margin}."
            )
        out.append({"cause": cause, "rows": shown, "words": words})
    return out


def _fidelity(own: Mapping[str, Any]) -> dict[str, Any]:
    before, after = own["before"], own["after"]
    rows = []
    for one, other in zip(before["signals"], after["signals"], strict=True):
        name, late = f"<code>{one['name']}</code>", f"{_delay(one)} as given, {_delay(other)} extended"
        rows.append({"name": f"{name}, R<sub>NRMSE</sub>", "what": "deviation over the range of the measurement",
                     "before": percent(one["R_NRMSE"]), "after": percent(other["R_NRMSE"])})  # fmt: skip
        rows.append({"name": f"{name}, R<sub>τ</sub>", "what": f"delay: {late}",
                     "before": percent(one["R_tau"]), "after": percent(other["R_tau"])})  # fmt: skip
    for name, u, what in (
        ("R_RVM", "R_RVM_standard_uncertainty", "the model's simulation against the measurement, all sensors (Eq. 21)"),
        ("R_MU", None, "uncertainty of the sensors over the range of the measurement (Eqs. 22, 23)"),
        ("R_XiL", "standard_uncertainty", "both, without R_SD, which needs a test bed (Eq. 16)"),
    ):
        shown = [percent(side[name]) + (f" ± {percent(2 * side[u])}" if u else "") for side in (before, after)]
        rows.append({"name": f"<b>R<sub>{name[2:]}</sub></b>", "before": shown[0], "after": shown[1], "what": what})
    return {"rows": rows, "f_max": own["f_max"], "notes": own["notes"], "floor": percent(own["noise_floor"]["R_RVM"])}


def _delay(one: Mapping[str, Any]) -> str:
    if one["delay"] is None:
        return f"not determined ({one['delay_undetermined']})"
    return f"{number(1e3 * one['delay'], 3)} ± {number(1e3 * one['delay_standard_uncertainty'], 2)} ms"
