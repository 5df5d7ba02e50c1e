"""Views of an uncertainty budget: contributions of the first measurand, and the table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from matching.fidelity import XilFidelity
from matching.report import common
from matching.report.common import (
    PageFigures,
    PageTable,
    Provenance,
    ScreenPoint,
    StudyPage,
    csv_table,
    image,
    number,
    percent,
    preformatted,
    spaced,
    study_page,
)
from matching.report.curves import acting
from matching.uncertainty.budget import InputQuantity
from matching.uncertainty.propagate import written
from matching.uncertainty.result import MeasurandResult, Row, Uncertainty
from modelling import display
from modelling.fidelity.measures import delay_fidelity
from modelling.units import printed
from modelling.writing import file_stem

# --- Figures of a fidelity case: fidelity over delay (Fig. 6), what is lost to which cause, and at which frequencies.

LARGEST_CAUSES = 15  # causes in the bar chart
COLOURS = {"dynamics": common.RIG, "model": common.VEHICLE, "measurement": common.NOISE}
HATCHES = {"dynamics": "", "model": "///", "measurement": "..."}
MARKS = {"system_dynamics": ("o", common.RIG), "residual_vehicle_model": ("s", common.VEHICLE)}


@dataclass(frozen=True)
class _Point:
    """A signal on the curve: its delay in s, never negative, and R_τ."""

    domain: str
    signal: str
    delay: float
    fidelity: float


def delay_curve(xil: XilFidelity) -> Figure:
    """R_τ over the delay for f_max (Fig. 6) with the case's signals on it."""
    f_max = xil.fidelity.f_max
    points = [
        _Point(domain, signal.name, abs(signal.delay.nearest), signal.delay_fidelity)
        for domain, members in xil.fidelity.signals.items()
        for signal in members
        if signal.delay.nearest is not None
    ]
    half_delay = 1 / (6 * f_max)  # s, where R_τ is ½ (Eq. 20)
    longest = max([4 * half_delay, *(1.15 * point.delay for point in points)])
    delays = np.linspace(0, longest, 400)
    with common.styled():
        fig = common.figure(6.0, 3.6)
        axes = fig.add_subplot()
        axes.plot(1000 * delays, delay_fidelity(delays, f_max), color="black")
        axes.plot(
            [1000 * half_delay, 1000 * half_delay, 0],
            [0, 0.5, 0.5],
            color=common.LIMIT,
            linestyle="--",
            lw=1,
            label=f"½ at 1/(6·f_max) = {1000 * half_delay:.2f} ms",
        )
        for domain, (mark, colour) in MARKS.items():
            members = [point for point in points if point.domain == domain]
            if members:
                axes.plot(
                    [1000 * point.delay for point in members],
                    [point.fidelity for point in members],
                    mark,
                    color=colour,
                    clip_on=False,
                    zorder=3,
                    label=spaced(domain),
                )
            for place, point in enumerate(sorted(members, key=lambda member: member.delay)):
                axes.annotate(
                    point.signal,
                    (1000 * point.delay, point.fidelity),
                    (6, 5 if place % 2 else -12),  # points; above and below in turn, so that names do not overlap
                    textcoords="offset points",
                    fontsize=8,
                )
        axes.set_xlabel("delay τ in ms")
        axes.set_ylabel("R_τ")
        axes.set_ylim(0, 1.08)
        axes.set_xlim(left=0)
        axes.set_title(f"Fidelity of a delay, f_max = {f_max:g} Hz (Eqs. 19, 20)", fontsize=9)
        axes.legend(loc="upper right")
    return fig


def attribution_figure(xil: XilFidelity) -> Figure:
    """Gain in R_XiL if a single cause were removed, largest first."""
    if xil.attribution is None:
        raise ValueError("attribution needs the arithmetic of the definition")
    losses = xil.attribution.losses[:LARGEST_CAUSES]
    with common.styled():
        fig = common.figure(8.2, 1.2 + 0.3 * max(len(losses), 2))
        axes = fig.add_subplot()
        axes.grid(visible=False, axis="y")
        for place, loss in enumerate(losses):
            bar = axes.barh(place, 100 * loss.gain, label=loss.origin, **_look(loss.origin))
            axes.bar_label(bar, [f"{100 * loss.gain:.2g}"], padding=3, fontsize=8)
        axes.set_yticks(range(len(losses)), [f"{loss.signal}: {loss.cause}" for loss in losses])
        axes.invert_yaxis()
        axes.margins(x=0.1)
        now = f"now {100 * xil.R_XiL:.2f} %"
        axes.set_xlabel(f"gain in R_XiL in percentage points if this cause alone were removed ({now})")
        present = {loss.origin for loss in losses}
        shares = xil.attribution.by_origin
        handles: Any = [axes.barh(0, 0, **_look(origin)) for origin in COLOURS if origin in present]
        fig.legend(
            handles,
            [f"{origin}: {100 * shares[origin]:.3g} % of the loss" for origin in COLOURS if origin in present],
            loc="outside right center",
        )
    return fig


def _look(origin: str) -> dict[str, Any]:
    return {"color": COLOURS[origin], "hatch": HATCHES[origin], "edgecolor": "white", "linewidth": 0}


def bands_figure(xil: XilFidelity) -> Figure:
    """Deviation of each signal over frequency: height is the root mean square in the band over the signal's range."""
    panels = [(domain, name, rows) for domain, signals in xil.bands.items() for name, rows in signals.items()]
    with common.styled():
        fig = common.figure(6.4, 0.6 + 1.8 * len(panels))
        for place, (domain, name, rows) in enumerate(panels):
            axes = fig.add_subplot(len(panels), 1, place + 1)
            last = rows[-1].low
            for number, band in enumerate(rows):
                high = band.high if math.isfinite(band.high) else 1.15 * last
                height = 100 * (1 - band.nrmse)
                for share, floor, hatch in (
                    (band.amplitude_share, 0.0, ""),
                    (band.phase_share, band.amplitude_share, "///"),
                ):
                    axes.bar(
                        (band.low + high) / 2,
                        height * share,
                        0.94 * (high - band.low),
                        bottom=height * floor,
                        hatch=hatch,
                        edgecolor="white",
                        color=MARKS[domain][1],
                        label=("phase" if hatch else "amplitude") if number == 0 and place == 0 else None,
                    )
            axes.axvspan(last, 1.18 * last, color=common.BAND, zorder=0)
            axes.set_xlim(0, 1.18 * last)
            axes.set_ylabel("deviation in % of range")
            axes.set_title(f"{spaced(domain)}: {name}", fontsize=9)
        axes.set_xlabel("frequency in Hz (grey: everything above f_max)")
        if panels:
            fig.legend(loc="outside upper right", ncols=2)
    return fig


# --- An XiL fidelity in words and columns, from the content of ``fidelity.json``.

RANKED = 8  # causes that are listed
LEAST_SHOWN = 5e-5  # of an uncertainty: less is 0.00 %


def fidelity_summary(answer: dict[str, Any]) -> str:
    """Total and partial fidelities, then every signal and sensor, then what is lost to which cause."""
    lines = [answer["title"], *_fidelities(answer), "", f"{'':44} {'R_NRMSE':>9} {'R_τ':>9}   delay"]
    for domain, signals in answer["signals"].items():
        for signal in signals:
            name = f"{domain}.{signal['name']}"
            lines.append(f"{name:44} {_percent(signal['R_NRMSE'])} {_percent(signal['R_tau'])}   {_delay(signal)}")
    for sensor in answer["sensors"]:
        lines.append(f"{'measurement_uncertainty.' + sensor['name']:44} {_percent(sensor['fidelity'])}   (1 - U/range)")
    if "attribution" in answer:
        lines += ["", *_losses(answer["attribution"])]
    return "\n".join([*lines, *(f"note: {note}" for note in answer["notes"])]) + "\n"


def _fidelities(answer: dict[str, Any]) -> list[str]:
    lines = []
    for name, value in [("R_XiL", answer["R_XiL"]), *answer["domains"].items()]:
        spread = answer["uncertainty"]["total" if name == "R_XiL" else name]
        weight = f"weight {answer['weights'][name]:g}" if name in answer["weights"] else "total"
        lines.append(f"{name:44} {_percent(value)}   {_uncertainty(spread):32} {weight}")
    return lines


def _uncertainty(spread: dict[str, Any]) -> str:
    if spread["standard_uncertainty"] < LEAST_SHOWN:
        return "without uncertainty"
    low, high = spread["interval"]
    return f"u = {100 * spread['standard_uncertainty']:.2f} %, {100 * low:.2f} ... {100 * high:.2f} %"


def _losses(attribution: dict[str, Any]) -> list[str]:
    shares = ", ".join(f"{origin} {100 * share:.1f} %" for origin, share in attribution["by_origin"].items())
    return [f"lost to {shares}"] + [
        f"  {loss['origin']:12} {loss['signal']:24} {loss['cause']:12} "
        f"R_XiL would rise by {100 * loss['gain']:.2f} percentage points"
        for loss in attribution["ranked"][:RANKED]
    ]


def _percent(share: float) -> str:
    return f"{100 * share:7.2f} %"


def _delay(signal: dict[str, Any]) -> str:
    if signal["delay"] is None:
        return f"undetermined: {signal['delay_undetermined']}"
    uncertainty = signal["delay_standard_uncertainty"]
    return f"{1000 * signal['delay']:.3f} ms" + (f" (u = {1000 * uncertainty:.3f} ms)" if uncertainty else "")


# --- The page of an XiL fidelity: the total, what to improve first, what it rests on; signals and causes to download.

CAPTIONS = {
    "attribution": "What R_XiL would gain if one cause alone were removed.",
    "delay": "Fidelity of a delay, and where the delays of the signals lie on it.",
    "bands": "At which frequencies the signals deviate: amplitude plain, phase hatched.",
}
FIRST_CAUSES = 4  # causes on the first screen


def fidelity_page(
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
            "What to improve first": _causes_to_improve(answer),
            "What it rests on": _rests_on(answer),
            "What to watch": [ScreenPoint(note) for note in answer["notes"]] or [ScreenPoint("nothing was left out")],
        },
        captions=CAPTIONS,
        tables=[PageTable("Signals", _signals(answer)), PageTable("Sensors", _sensors(answer))],
    )
    data = {name: text for name, text in _data(answer).items() if name in images}
    return study_page(content, PageFigures(images, acting(figures), data), made)


def _causes_to_improve(answer: Mapping[str, Any]) -> list[ScreenPoint]:
    if "attribution" not in answer:
        return [ScreenPoint("not known", "the published arithmetic does not split the loss by cause")]
    return [
        ScreenPoint(
            f"{spaced(loss['signal'])}: {spaced(loss['cause'])} ({loss['origin']})",
            f"without it R_XiL would be {100 * loss['gain']:.2f} percentage points higher",
        )
        for loss in answer["attribution"]["ranked"][:FIRST_CAUSES]
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
            "R_τ": percent(signal["R_tau"]), "delay": _delay_cell(signal),
        }
        for domain, signals in answer["signals"].items()
        for signal in signals
    ]  # fmt: skip


def _delay_cell(signal: Mapping[str, Any]) -> str:
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


# --- Views of an XiL fidelity: what is lost and to what, and the table.


@display.plot.register
def plot_fidelity(fidelity: XilFidelity) -> Figure:
    """What is lost to what, ranked; the delay curve where the case names values instead of signals."""
    return delay_curve(fidelity) if fidelity.attribution is None else attribution_figure(fidelity)


@display.files.register
def fidelity_files(fidelity: XilFidelity, folder: str, made: Provenance | None = None) -> display.ResultFiles:
    """``fidelity.json``, table, page and figures."""
    figures = {"delay": delay_curve(fidelity)}
    if fidelity.attribution is not None:
        figures["attribution"] = attribution_figure(fidelity)
    if fidelity.bands:
        figures["bands"] = bands_figure(fidelity)
    answer, images = fidelity.to_dict(), {name: image(drawn) for name, drawn in figures.items()}
    others: dict[str, str | bytes] = {f"{name}.svg": picture for name, picture in images.items()}
    others["fidelity.txt"] = fidelity_summary(answer)
    others["fidelity.html"] = fidelity_page(fidelity, figures, images, made)
    return "fidelity.json", answer, others


@display.text.register
def fidelity_text(fidelity: XilFidelity) -> str:
    """Total and partial fidelities with their uncertainty."""
    return fidelity_summary(fidelity.to_dict())


@display.html.register
def fidelity_html(fidelity: XilFidelity) -> str:
    """The text of the result as HTML for a notebook."""
    return preformatted(fidelity_text(fidelity))


# --- Figures of an uncertainty budget: contributions as bars, causes as Ishikawa diagram (like Figs. 4 and 5).

LARGEST_INPUTS = 20  # inputs in the bar chart; more would not be readable
TWIG = 1.75  # inches, length of an input's line in the Ishikawa diagram


def contributions(result: MeasurandResult) -> Figure:
    """Bars of |c|·u(x) of each input, largest on top, with the combined standard uncertainty as line."""
    rows = [row for row in result.rows if row.contribution > 0][:LARGEST_INPUTS]
    unit = result.measurand.unit
    sizes = [unit.difference_from_si(row.contribution) for row in rows]
    with common.styled():
        fig = common.figure(6.4, 1.2 + 0.3 * max(len(rows), 2))
        axes = fig.add_subplot()
        axes.grid(visible=False, axis="y")
        bars = axes.barh([row.name for row in rows], sizes, color=common.VEHICLE)
        axes.bar_label(bars, [f"{100 * row.share:.3g} %" for row in rows], padding=3, fontsize=8)
        combined = unit.difference_from_si(result.propagation.first_order)
        axes.axvline(combined, color=common.LIMIT, linestyle="--", label=f"combined, {combined:.3g}{_unit(result)}")
        axes.invert_yaxis()
        axes.margins(x=0.12)
        axes.set_xlabel(f"contribution |c|·u(x) to u({result.measurand.name}){_axis_unit(result)}; labels: share of u²")
        fig.legend(loc="outside lower right")
        axes.set_title(result.statement, fontsize=9)
    return fig


def ishikawa(result: MeasurandResult) -> Figure:
    """The causes as branches of an arrow that ends in the measurand; line widths and numbers follow the share of u²."""
    branches = _branches(result.rows)
    columns = math.ceil(len(branches) / 2)
    expanded = result.measurand.unit.difference_from_si(result.expanded)
    longest = max(len(rows) for _, rows in branches)
    width, reach = 3.1, 0.42 * (longest + 1)  # of a branch, inches
    with common.styled():
        below = -reach - 0.7 if len(branches) > 1 else -0.4  # no empty half where one cause stands alone
        fig = common.figure(2.2 + width * columns, max(3.2, 2 * reach + 1.2) if len(branches) > 1 else reach + 1.2)
        axes = fig.add_subplot()
        axes.set_axis_off()
        end = width * columns + 0.8
        axes.annotate("", (end, 0), (-0.2, 0), arrowprops={"arrowstyle": "-|>", "lw": 2.2, "color": "black"})
        axes.text(
            end + 0.08,
            0,
            f"{result.measurand.name}\nU = {expanded:.3g}{_unit(result)}",
            va="center",
            ha="left",
            fontweight="bold",
        )
        for place, (cause, rows) in enumerate(branches):
            _branch(axes, width * (place // 2 + 1), 1 if place % 2 == 0 else -1, cause, rows, reach)
        axes.set_xlim(-0.9, end + 1.6)
        axes.set_ylim(below, reach + 0.7)
    return fig


def _branch(axes: Any, foot: float, side: int, cause: str, rows: list[Row], reach: float) -> None:
    slant = 0.35 * reach
    share = sum(row.share for row in rows)
    axes.plot([foot - slant, foot], [side * reach, 0], color=common.VEHICLE, lw=1 + 3 * max(0.0, min(1.0, share)))
    axes.text(
        foot - slant,
        side * (reach + 0.12),
        f"{cause}\n{100 * share:.3g} %" if side > 0 else f"{100 * share:.3g} %\n{cause}",
        ha="center",
        va="bottom" if side > 0 else "top",
        fontweight="bold",
    )
    for number, row in enumerate(rows):
        height = reach * (1 - (number + 0.6) / (len(rows) + 0.4))
        end = foot - slant * height / reach
        axes.plot([end - TWIG, end], [side * height] * 2, color=common.LIMIT, lw=0.9)
        axes.text(end - TWIG, side * height + 0.04, f"{row.name}  {100 * row.share:.3g} %", fontsize=8, va="bottom")


def _branches(rows: Sequence[Row]) -> list[tuple[str, list[Row]]]:
    """Uncertain inputs by cause, the cause with the largest share first."""
    causes: dict[str, list[Row]] = {}
    for row in rows:
        if row.standard_uncertainty > 0:
            causes.setdefault(row.cause, []).append(row)
    if not causes:
        return [("no uncertain input", [])]
    return sorted(causes.items(), key=lambda item: -sum(row.share for row in item[1]))


def _unit(result: MeasurandResult) -> str:
    text = result.measurand.unit.text
    return "" if text == "1" else f" {printed(text)}"


def _axis_unit(result: MeasurandResult) -> str:
    text = result.measurand.unit.text
    return "" if text == "1" else f" in {printed(text)}"


# --- The page of an uncertainty budget: the result as it is reported, what to improve first; the budget to download.

NO_CAUSE = InputQuantity.cause  # of an input for which none is stated
FIRST_INPUTS = 3  # inputs of a measurand on the first screen
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


def uncertainty_page(
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
            "What to improve first": [point for each in measurands for point in _inputs_to_improve(each)],
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


def _inputs_to_improve(measurand: Mapping[str, Any]) -> list[ScreenPoint]:
    return [
        ScreenPoint(
            row["name"],
            f"{100 * row['share']:.3g} % of u² of {measurand['name']}"
            + (f"; {row['cause']}" if row["cause"] != NO_CAUSE else ""),
        )
        for row in measurand["budget"][:FIRST_INPUTS]
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


# --- An uncertainty budget in words and columns, from the content of ``uncertainty.json``.


def uncertainty_summary(answer: dict[str, Any]) -> str:
    """Statement of every measurand, then its budget table, checks and correlations; last what would have to improve."""
    measurands = answer["measurands"]
    lines = [answer["title"], *(measurand["statement"] for measurand in measurands)]
    for measurand in measurands:
        notes = (f"note: {line}" for line in measurand["warnings"])
        heading = [f"{measurand['name']}:"] if len(measurands) > 1 else []
        lines += ["", *heading, *_table(measurand), "", *_checks(measurand), *notes]
    names = [measurand["name"] for measurand in measurands]
    for i, first in enumerate(names):
        lines += [
            f"r({first}, {second}) = {answer['correlation'][i][j]:+.3f}" for j, second in enumerate(names) if j > i
        ]
    for wish in answer.get("inverse", []):
        lines += ["", *_improvements(wish)]
    return "\n".join(lines) + "\n"


def _table(measurand: dict[str, Any]) -> list[str]:
    head = (
        f"{'input':24} {'value':>14} {'u(x)':>11} {'unit':10} {'distribution':13} {'ν':>5} {'|c|·u':>11} {'share':>8}"
    )
    lines = [head, "-" * len(head)]
    for row in measurand["budget"]:
        freedom = "∞" if row["degrees_of_freedom"] is None else f"{row['degrees_of_freedom']:.3g}"
        lines.append(
            f"{row['name']:24} {row['value']:14.8g} {row['standard_uncertainty']:11.4g} {row['unit']:10} "
            f"{row['distribution']:13} {freedom:>5} {row['contribution']:11.4g} {100 * row['share']:7.2f}%"
        )
    return lines


def _checks(measurand: dict[str, Any]) -> list[str]:
    unit = "" if measurand["unit"] == "1" else f" {measurand['unit']}"
    freedom = measurand["degrees_of_freedom"]
    second = measurand["standard_uncertainty_second_order"]
    refused = measurand["degrees_of_freedom_refused"]
    effective = "refused" if refused else "∞" if freedom is None else f"{freedom:.1f}"
    lines = [
        f"standard uncertainty {measurand['standard_uncertainty']:.4g}{unit} (first order), "
        f"{'none' if second is None else f'{second:.4g}{unit}'} (second order), "
        f"effective degrees of freedom {effective}"
    ]
    if "monte_carlo" in measurand:
        sampled, check = measurand["monte_carlo"], measurand["first_order_check"]
        low, high = (written(end, sampled["standard_uncertainty"])[0] for end in sampled["shortest_interval"])
        lines += [
            f"Monte Carlo: u = {sampled['standard_uncertainty']:.4g}{unit}, "
            f"shortest {100 * measurand['coverage']:.4g} % interval "
            f"{low} ... {high}{unit}, {sampled['draws']} draws",
            f"first order against Monte Carlo (JCGM 101, 8): {check['verdict']} "
            f"(d = {check['distances'][0]:.2g}, {check['distances'][1]:.2g}; δ = {check['tolerance']:.2g}{unit})",
        ]
    return lines


def _improvements(wish: dict[str, Any]) -> list[str]:
    if wish["present"] <= wish["wanted"]:
        return [
            f"{wish['name']}: U = {wish['present']:.4g} {wish['unit']} "
            f"is already within the wanted {wish['wanted']:.4g}"
        ]
    lines = [f"{wish['name']}: from U = {wish['present']:.4g} to {wish['wanted']:.4g} {wish['unit']}"]
    lines += [
        f"  either {name} alone to u = {item['needed']:.4g} {item['unit']} ({100 * item['ratio']:.3g} % of today)"
        for step in wish["alone"]
        for name, item in step.items()
    ]
    if not wish["alone"]:
        lines.append("  no improvement of a single input is enough")
    needed = [f"{name} to u = {item['needed']:.4g} {item['unit']}" for name, item in wish["together"].items()]
    return [*lines, f"  or all of these together, the largest contributions reduced to one level: {', '.join(needed)}"]


# --- View


@display.plot.register
def plot_uncertainty(uncertainty: Uncertainty) -> Figure:
    """Contributions of the inputs to the first measurand."""
    return contributions(uncertainty.measurands[0])


@display.files.register
def uncertainty_files(found: Uncertainty, folder: str, made: Provenance | None = None) -> display.ResultFiles:
    """``uncertainty.json``, table, page, and the figures of every measurand."""
    answer, prefixes, figures = found.to_dict(), list[str](), dict[str, Figure]()
    for result in found.measurands:
        prefix = f"{file_stem(result.measurand.name)}_" if len(found.measurands) > 1 else ""
        prefixes.append(f"{prefix}{len(prefixes) + 1}_" if prefix in prefixes else prefix)
        figures[f"{prefixes[-1]}contributions"] = contributions(result)
        figures[f"{prefixes[-1]}ishikawa"] = ishikawa(result)
    images = {name: image(drawn) for name, drawn in figures.items()}
    others: dict[str, str | bytes] = {"uncertainty.txt": uncertainty_summary(answer)}
    others |= {f"{name}.svg": picture for name, picture in images.items()}
    others["uncertainty.html"] = uncertainty_page(found, figures, images, made)
    return "uncertainty.json", answer, others


@display.text.register
def uncertainty_text(uncertainty: Uncertainty) -> str:
    """Statement, budget table and checks."""
    return uncertainty_summary(uncertainty.to_dict())


@display.html.register
def uncertainty_html(uncertainty: Uncertainty) -> str:
    """The text of the result as HTML for a notebook."""
    return preformatted(uncertainty_text(uncertainty))
