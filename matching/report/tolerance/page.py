"""The page of a tolerance study: yield, what to order more tightly, how far results spread; histograms to download."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.frequency.studies.distribution import Spread
from matching.frequency.studies.tolerance import Tolerance, required_range
from matching.report.common.csv_table import csv_table
from matching.report.common.provenance import Provenance
from matching.report.common.screen_point import ScreenPoint
from matching.report.common.wording import enough_digits, number, percent
from matching.report.curves.acting_axes import acting
from matching.report.study.page import PageFigures, PageTable, StudyPage, study_page
from matching.report.tolerance.view import result_words, short_name

CAPTION = (
    "Left: how often a drawn bed has such a result; line: the bed as planned, dashed: what is required. "
    "Right: the quantities whose tolerances cause the spread."
)
WORST_DRIVERS = 4  # on the first screen
LEAST_SHARE = 0.05  # of a variance, from which a tighter tolerance pays
LOW, HIGH = 0.05, 0.95


def page(study: Tolerance, figure: Figure, image: bytes, made: Provenance | None = None) -> str:
    """The page as HTML, from a study, its figure and the figure's picture."""
    good = study.shares["all"]
    content = StudyPage(
        title=f"Tolerances: {study.title}" if study.title else "Tolerances of the bed",
        status=percent(good, 1),
        answer=f"{percent(good, 1)} of {study.draws} drawn beds are stable, keep the required margin and every target "
        f"mode with the controller as it is.",
        good=good == 1.0,
        first_screen={
            "What to order more tightly": _to_tighten(study),
            "What to expect": [_expected(spread) for spread in study.spreads],
            "What to watch": _to_watch(study),
        },
        captions={"tolerance": CAPTION},
        tables=[PageTable("Spread of every result", [_row(spread) for spread in study.spreads], _HOW_TO_READ)],
    )
    figures = PageFigures({"tolerance": image}, acting({"tolerance": figure}), {"tolerance": histogram_data(study)})
    return study_page(content, figures, made)


_HOW_TO_READ = (
    "In brackets: where the quantile of all such beds lies with 95 % confidence, by the number of draws; … where the "
    "draws do not bound it."
)


def histogram_data(study: Tolerance) -> str:
    """Histograms of all results (CSV): counts of draws between edges."""
    rows = [
        (spread.name, spread.unit, low, high, int(count))
        for spread in study.spreads
        for low, high, count in zip(spread.edges[:-1], spread.edges[1:], spread.counts, strict=True)
    ]
    return csv_table(["result", "unit", "from", "to", "draws"], rows)


def _to_tighten(study: Tolerance) -> list[ScreenPoint]:
    largest: dict[str, tuple[float, Spread]] = {}
    for spread in study.spreads:
        for name, share in spread.drivers:
            if share > max(LEAST_SHARE, largest.get(name, (0.0, spread))[0]):
                largest[name] = share, spread
    ranked = sorted(largest.items(), key=lambda item: -item[1][0])[:WORST_DRIVERS]
    points = [
        ScreenPoint(short_name(name), f"causes {100 * share:.0f} % of the variance of {result_words(spread.name)}")
        for name, (share, spread) in ranked
    ]
    return points or [ScreenPoint("nothing", f"no quantity causes {percent(LEAST_SHARE, 0)} of a variance")]


def _expected(spread: Spread) -> ScreenPoint:
    digits = _digits(spread)
    low, high = (number(spread.quantiles[level], digits) for level in (LOW, HIGH))
    ends = " and ".join(_interval(spread, level) for level in (LOW, HIGH))
    planned = number(spread.nominal, digits)
    note = f"9 of 10 beds; by {spread.draws} draws the ends lie within {ends}; as planned {planned}"
    return ScreenPoint(f"{_named(spread)}: {low} to {high}", note)


def _digits(spread: Spread) -> int:
    return enough_digits([spread.quantiles[LOW], spread.quantiles[HIGH]])


def _to_watch(study: Tolerance) -> list[ScreenPoint]:
    points = [
        ScreenPoint(f"{percent(1 - share, 1)} of the beds {_failure(name)}", _required(study, name))
        for name, share in study.shares.items()
        if name != "all" and share < 1.0
    ]
    worst = max(study.differences.values(), default=0.0)
    checked = ScreenPoint(
        "accuracy of this study", f"draws worked out exactly differ by {number(worst, 2)} at most, relative"
    )
    return [*(points or [ScreenPoint("no drawn bed fails")]), checked]


def _failure(name: str) -> str:
    if name == "stable":
        return "are not stable"
    return "fall below the required modulus margin" if name == "modulus_margin" else f"lose {result_words(name)}"


def _required(study: Tolerance, name: str) -> str:
    if name == "modulus_margin":
        return f"required: {number(study.asked)} from {number(study.asked_from, 3)} Hz on"
    for spread in study.spreads:
        if spread.name == name:
            ends = required_range(name, spread.nominal, study.asked)
            low, high = (number(end, enough_digits(ends)) for end in ends)
            return f"required: {low} to {high}{f' {spread.unit}' if spread.unit else ''}, about the bed as planned"
    return ""


def _row(spread: Spread) -> dict[str, str]:
    digits = max(_digits(spread), 4)
    return {
        "result": _named(spread), "as planned": number(spread.nominal, digits), "mean": number(spread.mean, digits),
        "5 %": _quantile(spread, LOW), "95 %": _quantile(spread, HIGH), "draws": str(spread.draws),
    }  # fmt: skip


def _quantile(spread: Spread, level: float) -> str:
    digits = max(_digits(spread), enough_digits(spread.intervals[level], 4))
    return f"{number(spread.quantiles[level], digits)} ({_interval(spread, level)})"


def _interval(spread: Spread, level: float) -> str:
    """Confidence interval of a quantile."""
    ends = spread.intervals[level]
    return " to ".join("…" if end is None else number(end, enough_digits(ends)) for end in ends)


def _named(spread: Spread) -> str:
    return result_words(spread.name) + (f" in {spread.unit}" if spread.unit else "")
