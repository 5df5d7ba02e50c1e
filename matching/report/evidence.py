"""XiL fidelities and uncertainty budgets: figures and reports."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from matching.fidelity import XilFidelity
from matching.report import common
from matching.report.common import csv_table, number, percent, spaced
from matching.report.common import unit as printed_unit
from matching.report.page import Fold, Picture, Report, Step, Table, View, in_terminal, register
from matching.uncertainty.budget import InputQuantity
from matching.uncertainty.propagate import written
from matching.uncertainty.result import MeasurandResult, Row, Uncertainty
from modelling.fidelity.measures import delay_fidelity
from modelling.writing import file_stem

# --- Figures of a fidelity case: fidelity over delay (Fig. 6), what is lost to which cause, and at which frequencies.

LARGEST_CAUSES = 15  # causes in the bar chart
COLOURS = {"dynamics": common.RIG, "model": common.VEHICLE, "measurement": common.NOISE}
HATCHES = {"dynamics": "", "model": "///", "measurement": "..."}
MARKS = {"system_dynamics": ("o", common.RIG), "residual_vehicle_model": ("s", common.VEHICLE)}


def delay_curve(xil: XilFidelity) -> Figure:
    """R_τ over the delay for f_max (Fig. 6) with the case's signals on it."""
    f_max = xil.fidelity.f_max
    points = {  # delays (s, never negative) with R_τ and name, by domain
        domain: sorted((abs(signal.delay.nearest), signal.delay_fidelity, signal.name)
                       for signal in members if signal.delay.nearest is not None)
        for domain, members in xil.fidelity.signals.items()
    }  # fmt: skip
    half_delay = 1 / (6 * f_max)  # s, where R_τ is ½ (Eq. 20)
    longest = max([4 * half_delay, *(1.15 * delay for members in points.values() for delay, *_ in members)])
    delays = np.linspace(0, longest, 400)
    with common.styled():
        fig = common.figure(6.0, 3.6)
        axes = fig.add_subplot()
        axes.plot(1000 * delays, delay_fidelity(delays, f_max), color="black")
        axes.plot([1000 * half_delay, 1000 * half_delay, 0], [0, 0.5, 0.5], color=common.LIMIT, linestyle="--", lw=1,
                  label=f"½ at 1/(6·f_max) = {1000 * half_delay:.2f} ms")  # fmt: skip
        for domain, members in points.items():
            if not members:
                continue
            mark, colour = MARKS[domain]
            axes.plot([1000 * delay for delay, *_ in members], [value for _, value, _ in members], mark, color=colour,
                      clip_on=False, zorder=3, label=spaced(domain))  # fmt: skip
            for place, (delay, value, name) in enumerate(members):
                shift = (6, 5 if place % 2 else -12)  # points; above and below in turn, so that names do not overlap
                axes.annotate(name, (1000 * delay, value), shift, textcoords="offset points", fontsize=8)
        axes.set(xlabel="delay τ in ms", ylabel="R_τ", ylim=(0, 1.08))
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
                place_of = (band.low + high) / 2, 0.94 * (high - band.low)
                for kind, share, floor in (
                    ("amplitude", band.amplitude_share, 0.0), ("phase", band.phase_share, band.amplitude_share),
                ):  # fmt: skip
                    axes.bar(
                        place_of[0], height * share, place_of[1], bottom=height * floor, edgecolor="white",
                        hatch="///" if kind == "phase" else "", color=MARKS[domain][1],
                        label=kind if number == 0 and place == 0 else None,
                    )  # fmt: skip
            axes.axvspan(last, 1.18 * last, color=common.BAND, zorder=0)
            axes.set_xlim(0, 1.18 * last)
            axes.set_ylabel("deviation in % of range")
            axes.set_title(f"{spaced(domain)}: {name}", fontsize=9)
        axes.set_xlabel("frequency in Hz (grey: everything above f_max)")
        if panels:
            fig.legend(loc="outside upper right", ncols=2)
    return fig


# --- The report of an XiL fidelity: the total, what to improve first, what it rests on.

CAPTIONS = {
    "attribution": "What R_XiL would gain if one cause alone were removed.",
    "delay": "Fidelity of a delay, and where the delays of the signals lie on it.",
    "bands": "At which frequencies the signals deviate: amplitude plain, phase hatched.",
}
FIRST_CAUSES = 4  # causes on the first screen
LEAST_SHOWN = 5e-5  # of an uncertainty: less is 0.00 %


def fidelity_report(content: Mapping[str, Any], folder: str = "", made: Any = None, result: Any = None) -> Report:
    """What an XiL fidelity says."""
    spread = content["uncertainty"]
    rows = [
        {"": name, "fidelity": percent(value), "standard uncertainty": _spread(spread[key]), "weight": weight}
        for name, key, value, weight in [("R_XiL, total", "total", content["R_XiL"], "")]
        + [(spaced(name), name, value, f"{content['weights'][name]:g}") for name, value in content["domains"].items()]
    ]  # fmt: skip
    signals = [
        {"domain": spaced(domain), "signal": signal["name"], "R_NRMSE": percent(signal["R_NRMSE"]),
         "R_τ": percent(signal["R_tau"]), "delay": _delay(signal)}
        for domain, members in content["signals"].items()
        for signal in members
    ]  # fmt: skip
    sensors = [
        {"sensor": sensor["name"], "U over range": percent(sensor["uncertainty_over_range"]),
         "fidelity": percent(sensor["fidelity"])}
        for sensor in content["sensors"]
    ]  # fmt: skip
    return Report(
        title=f"XiL fidelity: {content['title']}" if content["title"] else "XiL fidelity",
        status=percent(content["R_XiL"], 1),
        answer=f"R_XiL = {percent(content['R_XiL'])}, {_spread(spread['total']) or 'without uncertainty'}: how "
        f"faithfully the bed reproduces this manoeuvre up to {content['f_max']:g} Hz.",
        lists={"What to improve first": _causes_to_improve(content)},
        table=Table(rows),
        folds=[Fold("Signals", [Table(signals)], told=True), Fold("Sensors", [Table(sensors)], told=True)],
        notes=content["notes"],
    )


def _spread(spread: Mapping[str, Any]) -> str:
    if spread["standard_uncertainty"] < LEAST_SHOWN:
        return ""
    low, high = spread["interval"]
    return f"u = {percent(spread['standard_uncertainty'])}, 95 % between {percent(low)} and {percent(high)}"


def _causes_to_improve(content: Mapping[str, Any]) -> list[Step]:
    if "attribution" not in content:
        return [Step("not known", "the published arithmetic does not split the loss by cause")]
    return [
        Step(
            f"{spaced(loss['signal'])}: {spaced(loss['cause'])} ({loss['origin']})",
            f"without it R_XiL would be {100 * loss['gain']:.2f} percentage points higher",
        )
        for loss in content["attribution"]["ranked"][:FIRST_CAUSES]
    ] or [Step("nothing", "no cause loses anything")]


def _delay(signal: Mapping[str, Any]) -> str:
    if signal["delay"] is None:
        return f"undetermined: {signal['delay_undetermined']}"
    uncertainty = signal["delay_standard_uncertainty"]
    return f"{1000 * signal['delay']:.3f} ms" + (f" (u = {1000 * uncertainty:.3f} ms)" if uncertainty else "")


def fidelity_pictures(xil: XilFidelity) -> dict[str, Picture]:
    """What is lost to what, ranked; the delay curve first where the case names values instead of signals."""
    answer = xil.to_dict()
    rows = [
        (domain, signal["name"], signal["R_NRMSE"], signal["R_tau"], signal["nearest_delay"])
        for domain, signals in answer["signals"].items()
        for signal in signals
    ]
    delays = csv_table(["domain", "signal", "R_NRMSE", "R_tau", "delay [s]"], rows)
    pictures = {"delay": Picture(lambda: delay_curve(xil), CAPTIONS["delay"], delays)}
    if xil.attribution is not None:
        keys = ("origin", "signal", "cause", "gain")
        losses = [[loss[key] for key in keys] for loss in answer["attribution"]["ranked"]]
        ranked = csv_table(["origin", "signal", "cause", "gain in R_XiL"], losses)
        pictures = {"attribution": Picture(lambda: attribution_figure(xil), CAPTIONS["attribution"], ranked)} | pictures
    if xil.bands:
        head = ["domain", "signal", "from [Hz]", "to [Hz]", "R_NRMSE", "amplitude share", "phase share"]
        bands = [
            (domain, name, band["low"], band["high"], band["nrmse"], band["amplitude_share"], band["phase_share"])
            for domain, signals in answer["bands"].items()
            for name, spectrum in signals.items()
            for band in spectrum
        ]
        pictures["bands"] = Picture(lambda: bands_figure(xil), CAPTIONS["bands"], csv_table(head, bands))
    return pictures


register(
    XilFidelity,
    View(
        "fidelity.json", fidelity_report, fidelity_pictures, page="fidelity.html", folder="",
        others=lambda xil: {"fidelity.txt": in_terminal(fidelity_report(xil.to_dict()))},
    ),
)  # fmt: skip


# --- Figures of an uncertainty budget: contributions as bars, causes as Ishikawa diagram (like Figs. 4 and 5).

LARGEST_INPUTS = 20  # inputs in the bar chart; more would not be readable
TWIG = 1.75  # inches, length of an input's line in the Ishikawa diagram


def contributions(result: MeasurandResult) -> Figure:
    """Bars of |c|·u(x) of each input, largest on top, with the combined standard uncertainty as line."""
    by_draws = result.method == "monte_carlo"
    # inputs that were read together may make the variance smaller: their share is negative
    rows = [row for row in result.rows if (abs(row.share) if by_draws else row.contribution) > 0][:LARGEST_INPUTS]
    unit = result.measurand.unit
    sizes = [100 * row.share if by_draws else unit.difference_from_si(row.contribution) for row in rows]
    with common.styled():
        fig = common.figure(6.4, 1.2 + 0.3 * max(len(rows), 2))
        axes = fig.add_subplot()
        axes.grid(visible=False, axis="y")
        bars = axes.barh([row.name for row in rows], sizes, color=common.VEHICLE)
        axes.bar_label(bars, [f"{100 * row.share:.3g} %" for row in rows], padding=3, fontsize=8)
        axes.invert_yaxis()
        axes.margins(x=0.12)
        name = result.measurand.name
        if by_draws:
            rises = " (below 0: rise)" if min(sizes, default=0.0) < 0 else ""
            axes.set_xlabel(f"by how much u²({name}) would fall{rises} if this input were known exactly, in %")
        else:
            combined = unit.difference_from_si(result.propagation.first_order)
            axes.axvline(combined, color=common.LIMIT, linestyle="--", label=f"combined, {combined:.3g}{_unit(result)}")
            axes.set_xlabel(f"contribution |c|·u(x) to u({name}){_axis_unit(result)}; labels: share of u²")
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
    return f" {printed_unit(result.measurand.unit.text)}".rstrip()


def _axis_unit(result: MeasurandResult) -> str:
    text = printed_unit(result.measurand.unit.text)
    return f" in {text}" if text else ""


# --- The report of an uncertainty budget: the result as it is reported, what to improve first.

NO_CAUSE = InputQuantity.cause  # of an input for which none is stated
FIRST_INPUTS = 3  # inputs of a measurand on the first screen
LEAST_GAIN = 1e-3  # of u²: to improve what holds less is no advice
BARS = (
    "Contribution of each input to the standard uncertainty; dashed: all together. Of a result by Monte Carlo: by how "
    "much the variance would fall if the input were known exactly."
)
BONES = "Causes of the uncertainty; line widths and numbers follow the share of u²."
COLUMNS = (
    "name", "value", "standard_uncertainty", "unit", "distribution", "cause", "sensitivity", "contribution", "share",
)  # fmt: skip


def uncertainty_report(content: Mapping[str, Any], folder: str = "", made: Any = None, result: Any = None) -> Report:
    """What an evaluated budget says."""
    measurands = content["measurands"]
    names = [measurand["name"] for measurand in measurands]
    by_draws = " (Monte Carlo)" if content.get("correlation_method") == "monte_carlo" else ""
    correlations = [
        f"r({first}, {second}) = {content['correlation'][i][j]:+.3f}{by_draws}"
        for i, first in enumerate(names)
        for j, second in enumerate(names)
        if j > i
    ]
    folds = [
        Fold(
            f"Budget of {each['name']}",
            [Table([_row(row, each["method"]) for row in each["budget"]]), _checks(each)],
            told=True,
        )
        for each in measurands
    ]
    return Report(
        title=f"Uncertainty budget: {content['title']}" if content["title"] else "Uncertainty budget",
        status="result" if len(measurands) == 1 else f"{len(measurands)} results",
        answer=f"{measurands[0]['statement']}{_by(measurands[0])}.",
        lists={
            "Further results": [Step(each["statement"] + _by(each)) for each in measurands[1:]],
            "What to improve first": [step for each in measurands for step in _inputs_to_improve(each)]
            + [Step(line) for wish in content.get("inverse", []) for line in _improvements(wish)],
            "What to watch": _to_watch(content),
        },
        folds=[*folds, Fold("Correlation of the results", [correlations] if correlations else [], told=True)],
    )


def budget_data(measurand: Mapping[str, Any]) -> str:
    """The budget of a measurand (CSV)."""
    rows = [[measurand["name"], *(row[key] for key in COLUMNS)] for row in measurand["budget"]]
    return csv_table(["measurand", *COLUMNS], rows)


def _by(measurand: Mapping[str, Any]) -> str:
    if measurand["method"] == "first_order":
        return ", by the law of propagation"
    if measurand.get("first_order_check", {}).get("verdict") == "open":
        return ": the draws do not decide whether the law of propagation holds"
    return ": the law of propagation does not hold here"


def _inputs_to_improve(measurand: Mapping[str, Any]) -> list[Step]:
    return [
        Step(
            row["name"],
            (
                f"{100 * row['share']:.3g} % of u² of {measurand['name']}"
                if measurand["method"] == "first_order"
                else f"known exactly, it would lower u² of {measurand['name']} by {100 * row['share']:.3g} %"
            )
            + (f"; {row['cause']}" if row["cause"] != NO_CAUSE else ""),
        )
        for row in measurand["budget"][:FIRST_INPUTS]
        if row["share"] > LEAST_GAIN
    ]


def _to_watch(content: Mapping[str, Any]) -> list[Step]:
    steps = []
    for measurand in content["measurands"]:
        of_it = f"{measurand['name']}: " if len(content["measurands"]) > 1 else ""
        steps += [Step(f"{of_it}{warning}") for warning in measurand["warnings"]]
        if measurand.get("first_order_check", {}).get("verdict") == "good":  # of the others a warning speaks
            steps.append(Step(f"{measurand['name']}: propagation and Monte Carlo agree", "check of JCGM 101, 8"))
    return steps


def _row(row: Mapping[str, Any], method: str) -> dict[str, str]:
    share = "share of u²" if method == "first_order" else "u² falls, if known"
    freedom = row["degrees_of_freedom"]
    return {
        "input": row["name"], "value": f"{row['value']:.8g} {printed_unit(row['unit'])}".rstrip(),
        "u(x)": number(row["standard_uncertainty"], 4), "distribution": row["distribution"],
        "ν": "∞" if freedom is None else number(freedom, 3), "|c|·u": number(row["contribution"], 4),
        share: f"{100 * row['share']:.2f} %", "cause": row["cause"],
    }  # fmt: skip


def _checks(measurand: Mapping[str, Any]) -> list[str]:
    unit = f" {printed_unit(measurand['unit'])}".rstrip()
    freedom, second = measurand["degrees_of_freedom"], measurand["standard_uncertainty_second_order"]
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
            f"shortest {100 * measurand['coverage']:.4g} % interval {low} ... {high}{unit}, {sampled['draws']} draws",
            f"first order against Monte Carlo (JCGM 101, 8): {check['verdict']} "
            f"(d = {check['distances'][0]:.2g}, {check['distances'][1]:.2g}; δ = {check['tolerance']:.2g}{unit})",
        ]
    return lines


def _improvements(wish: Mapping[str, Any]) -> list[str]:
    """What has to improve for a wanted uncertainty, a sentence each."""
    name, unit, wanted = wish["name"], printed_unit(wish["unit"]), f"{wish['wanted']:.4g}"
    if wish["present"] <= wish["wanted"]:
        return [f"{name}: U = {wish['present']:.4g} {unit} is already within the wanted {wanted}"]
    lines = [
        f"from U({name}) = {wish['present']:.4g} to {wanted} {unit}: {own} alone to u = {item['needed']:.4g} "
        f"{printed_unit(item['unit'])} ({100 * item['ratio']:.3g} % of today)"
        for step in wish["alone"]
        for own, item in step.items()
    ] or [f"to reach U({name}) = {wanted} {unit} no improvement of a single input is enough"]
    needed = [
        f"{own} to u = {item['needed']:.4g} {printed_unit(item['unit'])}" for own, item in wish["together"].items()
    ]
    return [*lines, f"or all of these together, the largest contributions reduced to one level: {', '.join(needed)}"]


def uncertainty_pictures(found: Uncertainty) -> dict[str, Picture]:
    """Contributions and causes of every measurand."""
    pictures, prefixes = dict[str, Picture](), list[str]()
    for result, content in zip(found.measurands, found.to_dict()["measurands"], strict=True):
        prefix = f"{file_stem(result.measurand.name)}_" if len(found.measurands) > 1 else ""
        prefixes.append(f"{prefix}{len(prefixes) + 1}_" if prefix in prefixes else prefix)
        bars, bones = (functools.partial(draw, result) for draw in (contributions, ishikawa))
        pictures[f"{prefixes[-1]}contributions"] = Picture(bars, BARS, budget_data(content))
        pictures[f"{prefixes[-1]}ishikawa"] = Picture(bones, BONES)
    return pictures


register(
    Uncertainty,
    View(
        "uncertainty.json", uncertainty_report, uncertainty_pictures, page="uncertainty.html", folder="",
        others=lambda found: {"uncertainty.txt": in_terminal(uncertainty_report(found.to_dict()))},
    ),
)  # fmt: skip
