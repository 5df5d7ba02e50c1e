"""The page of an XiL fidelity: the total, what to improve first, what it rests on; signals and causes to download."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from matching.report.common.csv_table import csv_table
from matching.report.common.provenance import Provenance
from matching.report.common.screen_point import ScreenPoint
from matching.report.common.wording import percent, spaced
from matching.report.curves.acting_axes import acting
from matching.report.fidelity.text import LEAST_SHOWN
from matching.report.study.page import PageFigures, PageTable, StudyPage, study_page
from matching.validity.fidelity.result import XilFidelity

CAPTIONS = {
    "attribution": "What R_XiL would gain if one cause alone were removed.",
    "delay": "Fidelity of a delay, and where the delays of the signals lie on it.",
    "bands": "At which frequencies the signals deviate: amplitude plain, phase hatched.",
}
FIRST = 4  # causes on the first screen


def page(
    fidelity: XilFidelity, figures: Mapping[str, Figure], images: Mapping[str, bytes], made: Provenance | None = None
) -> str:
    """The page as HTML, from a fidelity, its figures and their pictures by name."""
    answer = fidelity.to_dict()
    total = answer["uncertainty"]["total"]
    low, high = total["interval"]
    words = f"R_XiL = {percent(fidelity.R_XiL)}"
    if total["standard_uncertainty"] > LEAST_SHOWN:
        words += f" (u = {percent(total['standard_uncertainty'])}, 95 % between {percent(low)} and {percent(high)})"
    content = StudyPage(
        title=f"XiL fidelity: {fidelity.title}" if fidelity.title else "XiL fidelity",
        status=percent(fidelity.R_XiL, 1),
        answer=f"{words}: how faithfully the bed reproduces this manoeuvre up to {answer['f_max']:g} Hz.",
        good=False,
        first_screen={
            "What to improve first": _to_improve(answer),
            "What it rests on": _rests_on(answer),
            "What to watch": [ScreenPoint(note) for note in answer["notes"]] or [ScreenPoint("nothing was left out")],
        },
        captions=CAPTIONS,
        tables=[PageTable("Signals", _signals(answer)), PageTable("Sensors", _sensors(answer))],
    )
    data = {name: text for name, text in _data(answer).items() if name in images}
    return study_page(content, PageFigures(images, acting(figures), data), made)


def _to_improve(answer: Mapping[str, Any]) -> list[ScreenPoint]:
    if "attribution" not in answer:
        return [ScreenPoint("not known", "the published arithmetic does not split the loss by cause")]
    return [
        ScreenPoint(
            f"{spaced(loss['signal'])}: {spaced(loss['cause'])} ({loss['origin']})",
            f"without it R_XiL would be {100 * loss['gain']:.2f} percentage points higher",
        )
        for loss in answer["attribution"]["ranked"][:FIRST]
    ] or [ScreenPoint("nothing", "no cause loses anything")]


def _rests_on(answer: Mapping[str, Any]) -> list[ScreenPoint]:
    return [
        ScreenPoint(f"{spaced(name)}: {percent(value)}", f"weight {answer['weights'].get(name, 0):g}")
        for name, value in answer["domains"].items()
    ]


def _signals(answer: Mapping[str, Any]) -> list[dict[str, str]]:
    return [
        {
            "domain": spaced(domain), "signal": signal["name"], "R_NRMSE": percent(signal["R_NRMSE"]),
            "R_τ": percent(signal["R_tau"]), "delay": _delay(signal),
        }
        for domain, signals in answer["signals"].items()
        for signal in signals
    ]  # fmt: skip


def _delay(signal: Mapping[str, Any]) -> str:
    if signal["delay"] is None:
        return f"undetermined: {signal['delay_undetermined']}"
    return f"{1000 * signal['delay']:.3f} ms"


def _sensors(answer: Mapping[str, Any]) -> list[dict[str, str]]:
    return [
        {
            "sensor": sensor["name"],
            "U over range": percent(sensor["uncertainty_over_range"]),
            "fidelity": percent(sensor["fidelity"]),
        }
        for sensor in answer["sensors"]
    ]


def _data(answer: Mapping[str, Any]) -> dict[str, str]:
    """Tables (CSV) by the name of the figure that they belong to."""
    rows = [
        (domain, signal["name"], signal["R_NRMSE"], signal["R_tau"], signal["nearest_delay"])
        for domain, signals in answer["signals"].items()
        for signal in signals
    ]
    tables = {"delay": csv_table(["domain", "signal", "R_NRMSE", "R_tau", "delay [s]"], rows)}
    if "attribution" in answer:
        losses = [
            [loss[key] for key in ("origin", "signal", "cause", "gain")] for loss in answer["attribution"]["ranked"]
        ]
        tables["attribution"] = csv_table(["origin", "signal", "cause", "gain in R_XiL"], losses)
    bands = [
        (domain, name, band["low"], band["high"], band["nrmse"], band["amplitude_share"], band["phase_share"])
        for domain, signals in answer.get("bands", {}).items()
        for name, spectrum in signals.items()
        for band in spectrum
    ]
    tables["bands"] = csv_table(
        ["domain", "signal", "from [Hz]", "to [Hz]", "R_NRMSE", "amplitude share", "phase share"], bands
    )
    return tables
