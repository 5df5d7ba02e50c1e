"""The page of an uncertainty budget: the result as it is reported, what to improve first; the budget to download."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from matching.report.common.csv_table import csv_table
from matching.report.common.provenance import Provenance
from matching.report.common.screen_point import ScreenPoint
from matching.report.common.wording import number
from matching.report.curves.acting_axes import acting
from matching.report.study.page import PageFigures, PageTable, StudyPage, study_page
from matching.validity.budget.budget import InputQuantity
from matching.validity.uncertainty.result import Uncertainty

NO_CAUSE = InputQuantity.cause  # of an input for which none is stated
FIRST = 3  # inputs of a measurand on the first screen
COLUMNS = (
    "name",
    "value",
    "standard_uncertainty",
    "unit",
    "distribution",
    "cause",
    "sensitivity",
    "contribution",
    "share",
)


def page(
    uncertainty: Uncertainty, figures: Mapping[str, Figure], images: Mapping[str, bytes],
    made: Provenance | None = None,
) -> str:  # fmt: skip
    """The page as HTML, from an evaluated budget, its figures and their pictures by name."""
    answer = uncertainty.to_dict()
    measurands = answer["measurands"]
    content = StudyPage(
        title=f"Uncertainty budget: {answer['title']}" if answer["title"] else "Uncertainty budget",
        status="result" if len(measurands) == 1 else f"{len(measurands)} results",
        answer=measurands[0]["statement"],
        good=False,
        first_screen={
            "What to report": [ScreenPoint(each["statement"], _by(each)) for each in measurands],
            "What to improve first": [point for each in measurands for point in _to_improve(each)],
            "What to watch": _to_watch(answer),
        },
        captions={name: _caption(name) for name in images},
        tables=[PageTable(f"Budget of {each['name']}", [_row(row) for row in each["budget"]]) for each in measurands],
    )
    bars = [name for name in images if not name.endswith("ishikawa")]
    data = {name: budget_data([each]) for name, each in zip(bars, measurands, strict=False)}
    return study_page(content, PageFigures(images, acting(figures), data), made)


def budget_data(measurands: Sequence[Mapping[str, Any]]) -> str:
    """The budgets of measurands (CSV)."""
    rows = [[each["name"], *(row[key] for key in COLUMNS)] for each in measurands for row in each["budget"]]
    return csv_table(["measurand", *COLUMNS], rows)


def _by(measurand: Mapping[str, Any]) -> str:
    if measurand["method"] == "first_order":
        return "by the law of propagation"
    undecided = measurand.get("first_order_check", {}).get("verdict") == "open"
    why = (
        "the draws do not decide whether the law of propagation holds"
        if undecided
        else "the law of propagation does not hold here"
    )
    return f"by Monte Carlo: {why}"


def _to_improve(measurand: Mapping[str, Any]) -> list[ScreenPoint]:
    return [
        ScreenPoint(
            row["name"],
            f"{100 * row['share']:.3g} % of u² of {measurand['name']}"
            + (f"; {row['cause']}" if row["cause"] != NO_CAUSE else ""),
        )
        for row in measurand["budget"][:FIRST]
        if row["share"] > 0
    ]


def _to_watch(answer: Mapping[str, Any]) -> list[ScreenPoint]:
    points = []
    several = len(answer["measurands"]) > 1
    for measurand in answer["measurands"]:
        of_it = f"{measurand['name']}: " if several else ""
        points += [ScreenPoint(f"{of_it}{warning}") for warning in measurand["warnings"]]
        if measurand.get("first_order_check", {}).get("verdict") == "good":  # of the others a warning speaks
            points.append(
                ScreenPoint(f"{measurand['name']}: propagation and Monte Carlo agree", "check of JCGM 101, 8")
            )
    for wish in answer.get("inverse", []):
        reached = wish["present"] <= wish["wanted"]
        points.append(
            ScreenPoint(
                f"{wish['name']}: wanted U {wish['wanted']:.3g} {wish['unit']}, now {wish['present']:.3g}",
                "reached" if reached else "which inputs have to improve, and to what, stands in uncertainty.txt",
            )
        )
    return points or [ScreenPoint("nothing")]


def _caption(name: str) -> str:
    if name.endswith("ishikawa"):
        return "Causes of the uncertainty; line widths and numbers follow the share of u²."
    return "Contribution of each input to the standard uncertainty; dashed: all together."


def _row(row: Mapping[str, Any]) -> dict[str, str]:
    return {
        "input": row["name"], "value": f"{row['value']:.8g} {row['unit']}".removesuffix(" 1"),
        "u(x)": number(row["standard_uncertainty"], 4), "distribution": row["distribution"],
        "|c|·u": number(row["contribution"], 4), "share of u²": f"{100 * row['share']:.2f} %", "cause": row["cause"],
    }  # fmt: skip
