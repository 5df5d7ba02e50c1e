"""The report of a diagnosis: one HTML page that opens anywhere, without network."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matching.diagnosis.verdict.result import Diagnosis
from matching.report.common.environment import embedded, environment
from matching.report.common.provenance import Provenance
from matching.report.common.wording import number, percent, spaced
from matching.report.diagnosis.captions import CAPTIONS
from matching.report.diagnosis.sentences import (
    answer,
    kind_and_place,
    measured,
    not_identifiable,
    place,
    shape,
    to_correct,
)
from modelling.common.escape import html

MEANING = {
    "adequate": "Every sensor's residual is white noise of its stated uncertainty. Nothing was added to the model.",
    "explained": "With the named causes every sensor's residual is white noise of its stated uncertainty, on fitted "
    "and on held-out data.",
    "unexplained": "More than noise remains. The named causes explain part of it; no known effect explains the rest "
    "well enough, so treat the values of the causes with care.",
}
REASONS = {
    "": "taken",
    "not_better": "takes no more than noise would",
    "not_physical": "its values are not physical",
    "beyond_recording": "its values lie beyond what was recorded",
    "worse_unseen": "held-out data are met worse with it",
    "at_bound": "it ends at the bound of its range",
    "rival": "another explains more",
}
NO_CAUSE = "More than noise remains, and no known effect explains enough of it to be named."


def content(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of ``diagnosis.json``: the answer in a sentence first, then the diagnosis."""
    result = diagnosis.to_dict()
    return {"answer": answer(result), **result}


def page(
    result: Mapping[str, Any], title: str, units: Mapping[str, str], images: Mapping[str, bytes],
    moving: Mapping[str, str] | None = None, made: Provenance | None = None,
) -> str:  # fmt: skip
    """The page as HTML.

    Parameters
    ----------
    result : mapping
        The content of ``diagnosis.json``.
    title : str
        Of the model; may be empty.
    units : dict of str to str
        SI unit of every sensor.
    images : mapping of str to bytes
        Figures by the names of :func:`matching.report.diagnosis.figures.figures`.
    moving : mapping of str to str, optional
        Some of them to act in the browser, as :func:`matching.report.curves.acting_axes.acting` has them.
    made : Provenance, optional
        Where the result comes from.
    """
    verdict, causes = result["verdict"], result["causes"]
    values = {
        "made": made,
        "title": f"Diagnosis: {title}" if title else "Diagnosis of a model",
        "verdict": verdict,
        "answer": result["answer"],
        "meaning": NO_CAUSE if verdict == "unexplained" and not causes else MEANING[verdict],
        "to_do": _to_do(result),
        "causes": [_cause(cause) for cause in causes],
        "errors": [_error(name, units[name], error) for name, error in result["errors"].items()],
        "gain": result["gain"],
        "fidelity": _fidelity(result["fidelity"]) if result["fidelity"] else None,
        "rest": result["rest"],
        "shapes": [shape(curve) for curve in result.get("discrepancy", [])],
        "rivals": _rivals([row for row in result["candidates"] if row["instead_of"]]),
        "not_taken": _not_taken([row for row in result["candidates"] if not row["instead_of"]]),
        "quantities": [
            {"name": name, "value": measured(estimate), "note": estimate.get("note", "")}
            for name, estimate in result["parameters"].items()
        ],
        "notes": result["notes"],
        "figures": {name: embedded(image) for name, image in images.items()},
        "captions": CAPTIONS,
        "moving": moving or {},
    }
    templates = environment()
    templates.filters["share"] = _share
    return templates.get_template("diagnosis.html").render(values)


def _to_do(result: Mapping[str, Any]) -> list[str]:
    """What the reader should do, in sentences."""
    steps = [f"{step[:1].upper()}{step[1:]}." for step in to_correct(result)]
    if result["causes"]:
        steps.append("Use extended.toml: it is the model with the named causes, and every command reads it.")
    if result["next_recording"]:
        words = result["next_recording"]
        steps.append(f"{words[:1].upper()}{words[1:]}.")
    elif result["verdict"] == "unexplained":
        steps.append(
            "Add a sensor near the component where the remaining error is largest, or look for an effect that the "
            "program does not know: no rival of a named cause is left that another recording could separate."
        )
    unidentified = not_identifiable(result)
    if unidentified:
        steps.append(
            f"Do not rely on the fitted values of {', '.join(unidentified)}: these data do not determine them."
        )
    return steps or ["Nothing: the model can be used, and no further recording is needed."]


def _share(value: float | None) -> str:
    return "–" if value is None else f"{number(100 * value, 3)} %"


def _cause(cause: Mapping[str, Any]) -> dict[str, Any]:
    estimates = cause["parameters"].items()
    return {
        "kind": spaced(cause["kind"]),
        "at": place(cause["at"]),
        "values": [(spaced(key), measured(estimate)) for key, estimate in estimates],
        "confidence": f"{cause['confidence']:.2f}",
        "gain": number(cause["gain"], 3),
        "evidence": cause["evidence"],
        "notes": [f"{spaced(key)}: {estimate['note']}" for key, estimate in estimates if "note" in estimate],
    }


def _error(name: str, unit: str, error: Mapping[str, Any]) -> dict[str, Any]:
    after = error["after_holdout"]
    return {"name": name, "unit": unit, **error, "ratio": None if after is None else after / error["noise"]}


def _rivals(candidates: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Candidates by the cause that they could replace, with the second best in words."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for candidate in candidates:
        groups.setdefault(candidate["instead_of"], []).append(candidate)
    out = []
    for cause, rows in groups.items():
        named = next(row["chi_square"] for row in rows if _label(row) == cause)
        table = [
            row | {"kind": spaced(row["kind"]), "at": place(row["at"]), "margin": row["chi_square"] - named,
                   "confidence": f"{row['confidence']:.2g}"}
            for row in rows
        ]  # fmt: skip
        others = [row for row in rows if _label(row) != cause]
        words = "No other candidate was worth a fit."
        if others:
            second = max(others, key=lambda row: (row["confidence"], -row["chi_square"]))
            words = (
                f"Second best: {spaced(second['kind'])} at {place(second['at'])}, whose residual is "
                f"{number(second['misfit'], 3)} times the noise; the χ² of its fit minus that of the cause is "
                f"{number(second['chi_square'] - named, 3)}."
            )
        out.append({"cause": cause, "rows": table, "words": words})
    return out


def _not_taken(candidates: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Candidates that were fitted by themselves and stand in no cause's place, with the reason in words."""
    return [
        row | {"kind": spaced(row["kind"]), "at": place(row["at"]), "reason": REASONS[row["not_taken"] or ""]}
        for row in candidates
    ]


def _label(candidate: Mapping[str, Any]) -> str:
    return kind_and_place(candidate)


def _fidelity(fidelity: Mapping[str, Any]) -> dict[str, Any]:
    before, after = fidelity["before"], fidelity["after"]
    rows = []
    for base, extended in zip(before["signals"], after["signals"], strict=True):
        name = f"<code>{html(base['name'])}</code>"
        delays = f"delay: {_delay(base)} base model, {_delay(extended)} extended"
        rows.append({"name": f"{name}, R<sub>NRMSE</sub>", "what": "deviation over the range of the measurement",
                     "before": percent(base["R_NRMSE"]), "after": percent(extended["R_NRMSE"])})  # fmt: skip
        rows.append({"name": f"{name}, R<sub>τ</sub>", "what": delays,
                     "before": percent(base["R_tau"]), "after": percent(extended["R_tau"])})  # fmt: skip
    for name, u, what in (
        ("R_RVM", "R_RVM_standard_uncertainty", "the model's simulation against the measurement, all sensors (Eq. 21)"),
        ("R_MU", None, "uncertainty of the sensors over the range of the measurement (Eqs. 22, 23)"),
        ("R_XiL", "standard_uncertainty", "both, without R_SD, which needs a test bed (Eq. 16)"),
    ):
        cells = [percent(side[name]) + (f" ± {percent(2 * side[u])}" if u else "") for side in (before, after)]
        rows.append({"name": f"<b>R<sub>{name[2:]}</sub></b>", "before": cells[0], "after": cells[1], "what": what})
    floor = percent(fidelity["noise_floor"]["R_RVM"])
    return {"rows": rows, "f_max": fidelity["f_max"], "notes": fidelity["notes"], "floor": floor}


def _delay(signal: Mapping[str, Any]) -> str:
    if signal["delay"] is None:
        return f"not determined ({signal['delay_undetermined']})"
    return f"{number(1e3 * signal['delay'], 3)} ± {number(1e3 * signal['delay_standard_uncertainty'], 2)} ms"
