"""Maps and tolerance studies: figures, pages and text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import LinearSegmentedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import FixedLocator, NullLocator

from matching.match.map import Axis, Map, Point
from matching.match.tolerance import Spread, Tolerance, required_range
from matching.report.common import (
    ABSENT,
    INK,
    LIMIT,
    MATCHED,
    RIG,
    VEHICLE,
    PageFigures,
    PageTable,
    Provenance,
    ScreenPoint,
    StudyPage,
    aligned,
    amount,
    component,
    counted,
    csv_table,
    enough_digits,
    figure,
    image,
    number,
    percent,
    practical,
    preformatted,
    spaced,
    study_page,
    styled,
    table,
    unit,
)
from matching.report.curves import acting
from modelling import display, escape

# --- Figure of a map: the response error that a match reaches over two quantities, and what limits it where.

LIMITS = {  # what limits the match at a point, in words
    "impossible": "no match possible",
    "stability": "no stable loop found",
    "targets": "target mode not met",
    "twist": "shaft twist above its limit",
    "torque": "shaft torque above its limit",
    "dynamometer_torque": "dynamometer torque above its limit",
    "dynamometer_speed": "dynamometer speed above its limit",
    "dynamometer_power": "dynamometer power above its limit",
    "modulus_margin": "modulus margin below its limit",
    "response_error": "response error above its tolerance",
    "beds": "drawn beds not stable or damped too little",
    "damping_ratio": "damping ratio below its limit",
}
MOST_WRITTEN = 8  # values per axis up to which every field has its number
EQUAL_RELATIVE = 1e-9  # errors that differ by no more count as equal
SHADES = (0.04, 0.66)  # part of the colour map: light enough for black numbers and hatching everywhere
RING_CLEARANCE = 17  # points from the middle of the ring to the number below it
MOST_TICKS = 10  # labels per axis


def limiting_words(point: Point) -> str:
    """What limits the match at a point; its status where nothing does."""
    if point.status == "impossible":
        return LIMITS["impossible"]
    return ", ".join(dict.fromkeys(LIMITS[name.rpartition(".")[2]] for name in point.limited_by)) or point.status


def map_figure(result: Map) -> Figure:
    """A field for every pair of values, coloured by its error and hatched where a limit stands in the way.

    Where measured and unmeasured torques have different errors, each has a panel; where drawn beds judge the matches,
    the share of those that are stable has one as well.
    """
    shown = panels(result)
    columns, rows = edges(result.x), edges(result.y)
    with styled():
        fig = figure(1.2 + 5.4 * len(shown), 5.4)
        for axes, (title, values, words) in zip(fig.subplots(1, len(shown), squeeze=False)[0], shown, strict=True):
            _label(axes, result)
            share = words.endswith("%")
            colours = LinearSegmentedColormap.from_list(
                "fields", colormaps["viridis" if share else "viridis_r"](np.linspace(*SHADES, 64))
            )
            known = values[np.isfinite(values)]
            if known.size:
                scale = Normalize(0, 100) if share else LogNorm(known.min() / 1.02, known.max() * 1.02)
                masked = np.ma.masked_invalid(values)
                fields = axes.pcolormesh(columns, rows, masked, cmap=colours, norm=scale, label=f"_{words}")
                fig.colorbar(fields, ax=axes, format="%g", label=words)
            axes.set(xlim=columns[[0, -1]], ylim=rows[[0, -1]])
            _write(axes, result, values)
            _mark(axes, result, columns, rows)
            axes.set_title(title, fontsize=10)
            axes.grid(False)
        entries = dict(zip(*reversed(fig.axes[0].get_legend_handles_labels()), strict=True))
        if entries:
            fig.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=2, handleheight=1.6)
        if result.title:
            fig.suptitle(escape.figure(result.title), fontsize=11)
    return fig


def panels(result: Map) -> list[tuple[str, np.ndarray, str]]:
    """Title, values (y, x) and what they are of every panel."""
    measured, unmeasured = result.errors(), result.errors("unmeasured")
    known = np.isfinite(measured) & np.isfinite(unmeasured)
    words = f"response error, {number(result.band[0])}–{number(result.band[1])} Hz"
    shown = [("Response error to measured torques", measured, words)]
    if np.allclose(measured[known], unmeasured[known], rtol=EQUAL_RELATIVE, atol=0):
        shown = [("Response error that a match reaches", measured, words)]
    else:
        shown.append(("Response error to unmeasured torques", unmeasured, words))
    shares = 100 * result.errors("stable_beds")
    if np.isfinite(shares).any():
        shown.append(("Share of drawn beds that are stable", shares, "stable beds in %"))
    return shown


def _write(axes: Any, result: Map, values: np.ndarray) -> None:
    """The value of each field, below the ring where the case is; nothing where there are many."""
    if max(values.shape) > MOST_WRITTEN:
        return
    for y, row in zip(result.y.values, values, strict=True):
        for x, value in zip(result.x.values, row, strict=True):
            if np.isfinite(value):
                below = -RING_CLEARANCE if (x, y) == (result.x.here, result.y.here) else 0
                axes.annotate(number(float(value), 2), (x, y), (0, below), textcoords="offset points",
                              ha="center", va="center", fontsize=8, zorder=4)  # fmt: skip


def _mark(axes: Any, result: Map, columns: np.ndarray, rows: np.ndarray) -> None:
    """Hatch what is limited, a ring at the case's own values if they lie on the map."""
    for i, row in enumerate(result.points):
        for j, point in enumerate(row):
            if point.status != "matched":
                size = columns[j + 1] - columns[j], rows[i + 1] - rows[i]
                axes.add_patch(Rectangle((columns[j], rows[i]), *size, zorder=2, hatch="//", linewidth=0,
                                         facecolor="none", edgecolor=INK, label="limited"))  # fmt: skip
    if case_lies_on(result):
        ring: Any = {"markersize": 15, "markerfacecolor": "none", "linestyle": "none", "clip_on": False}
        for colour, width, label in (("white", 5, "_"), (RIG, 2.4, "the case as it is")):
            axes.plot(result.x.here, result.y.here, "o", markeredgecolor=colour, markeredgewidth=width, zorder=6,
                      label=label, **ring)  # fmt: skip


def case_lies_on(result: Map) -> bool:
    """Whether the case's values of both quantities lie within the map."""
    return all(axis.values[0] <= axis.here <= axis.values[-1] for axis in (result.x, result.y))


def edges(axis: Axis) -> np.ndarray:
    """Borders (n + 1,) of the fields around the n values of an axis."""
    values = np.log(axis.values) if axis.by_ratio else np.asarray(axis.values)
    if len(values) == 1:
        return np.array([0.9, 1.1]) * axis.values[0] if axis.values[0] else np.array([-1.0, 1.0])
    middles = (values[1:] + values[:-1]) / 2
    ends = [values[0] - (middles[0] - values[0]), *middles, values[-1] + (values[-1] - middles[-1])]
    return np.exp(ends) if axis.by_ratio else np.array(ends)


def _label(axes: Any, result: Map) -> None:
    for drawn_axis, axis, scale in ((axes.xaxis, result.x, axes.set_xscale), (axes.yaxis, result.y, axes.set_yscale)):
        if axis.by_ratio:
            scale("log")
        in_ms = axis.unit == "s"
        every = -(-len(axis.values) // MOST_TICKS)
        ticks = axis.values[::every]
        drawn_axis.set_major_locator(FixedLocator(list(ticks)))
        drawn_axis.set_minor_locator(NullLocator())
        drawn_axis.set_ticklabels([number(1e3 * value if in_ms else value, 3) for value in ticks])
        shown_unit = "ms" if in_ms else unit(axis.unit)
        name = component(axis.name)
        drawn_axis.set_label_text(f"{name} in {shown_unit}" if shown_unit else name)


# --- The page of a map: the best point, how far a match reaches, what limits it elsewhere; every point to download.

MAP_CAPTION = "Response error that a match reaches at every pair of values; hatched where a limit stands in the way."
CAPTION_OF_RING = "The ring is the case as it is."
NO_MATCH = "no point is matched: widen the limits, the bounds under [move] or the range of the map"


def map_page(result: Map, figure: Figure, image: bytes, made: Provenance | None = None) -> str:
    """The page as HTML, from a map, its figure and the figure's picture."""
    points = [point for row in result.points for point in row]
    matched = [point for point in points if point.status == "matched" and point.error is not None]
    content = StudyPage(
        title=f"Map: {result.title}" if result.title else "Map of the response error",
        status=f"{len(matched)} of {len(points)} matched",
        answer=_answer(result, points, matched),
        good=bool(matched),
        first_screen={
            "What to do now": _to_choose(result, matched),
            "How far a match reaches": [
                _reach(axis, name, matched) for name, axis in (("x", result.x), ("y", result.y))
            ],
            "What stands in the way": _in_the_way(points),
        },
        captions={"map": f"{MAP_CAPTION} {CAPTION_OF_RING}" if case_lies_on(result) else MAP_CAPTION},
    )
    moving = acting({"map": figure})
    return study_page(content, PageFigures({"map": image}, moving, {"map": point_data(result)}), made)


def point_data(result: Map) -> str:
    """Every point with its tuned values (CSV, SI)."""
    points = [point for row in result.points for point in row]
    names = list(dict.fromkeys(name for point in points for name in point.values))
    head = [f"{axis.name} [{axis.unit}]" for axis in (result.x, result.y)]
    head += [
        "status",
        "error",
        "error, unmeasured torques",
        "bound",
        "modulus margin",
        "share of stable beds",
        "limited by",
        *names,
    ]
    rows = [
        [point.x, point.y, point.status, point.error, point.unmeasured, point.bound, point.modulus_margin,
         point.stable_beds, " ".join(point.limited_by), *(point.values.get(name) for name in names)]
        for point in points
    ]  # fmt: skip
    return csv_table(head, rows)


def _answer(result: Map, points: list[Point], matched: list[Point]) -> str:
    known = matched or [point for point in points if point.error is not None]
    if not known:
        return "No point has a response error: no match could be tried."
    best = min(known, key=_error)
    limited = "" if matched else ", though limited,"
    return f"The least response error{limited} is {number(best.error, 3)}, at {_place(result, best)}."


def _to_choose(result: Map, matched: list[Point]) -> list[ScreenPoint]:
    if not matched:
        return [ScreenPoint("Widen what is allowed", NO_MATCH)]
    best = min(matched, key=_error)
    chosen = [
        ScreenPoint(
            f"Choose {_place(result, best)}",
            f"least error of all matched points, margin {number(best.modulus_margin, 3)}",
        )
    ]
    safest = max(matched, key=lambda point: point.modulus_margin or 0.0)
    if safest is not best:
        reason = f"largest modulus margin, {number(safest.modulus_margin, 3)}; error {number(safest.error, 3)}"
        chosen.append(ScreenPoint(f"For more margin choose {_place(result, safest)}", reason))
    return chosen


def _reach(axis: Axis, key: str, matched: list[Point]) -> ScreenPoint:
    values = sorted({getattr(point, key) for point in matched})
    if not values:
        return ScreenPoint(f"{component(axis.name)}: nowhere")
    ends = " to ".join(dict.fromkeys(practical(value, axis.unit) for value in (values[0], values[-1])))
    whole = values[0] == axis.values[0] and values[-1] == axis.values[-1]
    return ScreenPoint(
        f"{component(axis.name)}: {ends}", "the whole range of the map" if whole else "with some value of the other"
    )


def _in_the_way(points: list[Point]) -> list[ScreenPoint]:
    counted = Counter(limiting_words(point) for point in points if point.status != "matched")
    if not counted:
        return [ScreenPoint("nothing on this map", "every point is matched")]
    return [ScreenPoint(words, f"at {count} of {len(points)} points") for words, count in counted.most_common(4)]


def _place(result: Map, point: Point) -> str:
    return ", ".join(
        f"{component(axis.name)} {practical(value, axis.unit) if axis.unit == 's' else amount(value, axis.unit)}"
        for axis, value in ((result.x, point.x), (result.y, point.y))
    )


def _error(point: Point) -> float:
    return float("inf") if point.error is None else point.error


# --- Views of a map: the response error that a match reaches over two quantities.


@display.files.register
def map_files(result: Map, folder: str, made: Provenance | None = None) -> display.ResultFiles:
    """``map.json``, report and figure."""
    drawn = map_figure(result)
    picture = image(drawn)
    others: dict[str, str | bytes] = {"map.svg": picture, "map.png": image(drawn, "png")}
    return "map.json", result.to_dict(), others | {"report.html": map_page(result, drawn, picture, made)}


@display.plot.register
def plot_map(result: Map) -> Figure:
    """Response error over both quantities."""
    return map_figure(result)


@display.text.register
def map_text(result: Map) -> str:
    """Response errors, one row for each value of y."""
    return aligned(_rows(result), result.title)


@display.html.register
def map_html(result: Map) -> str:
    """The text of the result as HTML for a notebook."""
    return table(_rows(result), result.title)


def _rows(result: Map) -> list[dict[str, str]]:
    rows = []
    for y, errors in zip(result.y.values, result.errors(), strict=True):
        cells = zip(result.x.values, errors, strict=True)
        rows.append({f"{result.y.name} \\ {result.x.name}": f"{y:.4g} {result.y.unit}"})
        rows[-1] |= {f"{x:.4g} {result.x.unit}": f"{error:.3g}" for x, error in cells}
    return rows


# --- Views of a tolerance study: distributions with nominal value and limit, and the drivers of each.

DRIVERS_DRAWN, DRIVERS_PRINTED = 5, 3  # quantities with the largest shares of the variance
LEAST_SHARE_PRINTED = 0.02


@display.plot.register
def plot_tolerance(study: Tolerance) -> Figure:
    """One row a result: its distribution, and the quantities that it comes from."""
    with styled():
        fig = figure(8.0, 0.8 + 1.75 * len(study.spreads))
        rows = fig.subplots(len(study.spreads), 2, squeeze=False, width_ratios=[3, 2])
        for (left, right), spread in zip(rows, study.spreads, strict=True):
            left.stairs(100 * spread.counts / spread.draws, spread.edges, fill=True, color=MATCHED, alpha=0.6)
            left.axvline(spread.nominal, color="black", linewidth=1.2, label="nominal")
            for place, label in zip(_required_values(study, spread), ("required", "_"), strict=False):
                left.axvline(place, color=LIMIT, linestyle="--", linewidth=1.2, label=label)
            left.set_xlabel(result_words(spread.name) + (f" in {spread.unit}" if spread.unit else ""))
            left.set_ylabel("share of draws\nin %")
            left.locator_params(axis="x", nbins=6)
            left.legend(fontsize=7, loc="lower right", bbox_to_anchor=(1, 1), ncols=2, borderaxespad=0)
            drivers = spread.drivers[:DRIVERS_DRAWN][::-1]
            right.barh(range(len(drivers)), [100 * share for _, share in drivers], color=VEHICLE)
            right.set_yticks(range(len(drivers)), [short_name(name) for name, _ in drivers], fontsize=7)
            right.set_xlim(0, 100)
            right.set_xlabel("share of the variance in %", fontsize=8)
        fig.align_ylabels(rows[:, 0])
    return fig


def _required_values(study: Tolerance, spread: Spread) -> list[float]:
    """Ends of what is required of a result: the margin, and those of a target mode that a draw comes near."""
    if spread.name == "modulus_margin":
        return [study.asked]
    low, high = spread.edges[0], spread.edges[-1]
    return [end for end in required_range(spread.name, spread.nominal, study.asked) if low <= end <= high]


@display.text.register
def tolerance_text(study: Tolerance) -> str:
    """Yield, spread and drivers."""
    return summary(study.to_dict())


@display.html.register
def tolerance_html(study: Tolerance) -> str:
    """The text of the result as HTML for a notebook."""
    return preformatted(tolerance_text(study))


def summary(result: Mapping[str, Any]) -> str:
    """Yield, spread and drivers in a few lines, from the content of ``tolerance.json``."""
    shares = result["yield"]
    lines = [
        f"{result['title'] or 'Tolerances of the bed'}: {result['draws']} draws of "
        f"{counted(len(result['varied']), 'quantity', 'quantities')}",
        f"yield {shares['all']:.1%}: stable {shares['stable']:.1%}, modulus margin of at least "
        f"{result['modulus_margin_asked']:g} from {result['modulus_margin_from']:.3g} Hz on "
        f"{shares['modulus_margin']:.1%}"
        + "".join(f", {result_words(name)} {share:.1%}" for name, share in shares.items() if name.startswith("target")),
        f"{'':46} {'nominal':>9} {'5 %':>9} {'(interval)':23} {'95 %':>9} {'(interval)':23} {'draws':>8}   driven by",
    ]
    for spread in result["quantities"]:
        drivers = [
            f"{short_name(driver['name'])} {driver['share']:.0%}"
            for driver in spread["drivers"][:DRIVERS_PRINTED]
            if driver["share"] > LEAST_SHARE_PRINTED
        ]
        low, high = (_quantile_at(spread, level) for level in ("0.05", "0.95"))
        name = result_words(spread["name"]) + (f" [{spread['unit']}]" if spread["unit"] else "")
        lines.append(
            f"{name:46} {spread['nominal']:9.4g} {low} {high} {spread['draws']:8}   {', '.join(drivers) or ABSENT}"
        )
    lines.append("interval: where the quantile of all such beds lies with 95 % confidence, by the number of draws")
    return "\n".join(lines)


def _quantile_at(spread: Mapping[str, Any], level: str) -> str:
    """A quantile and its confidence interval; an open end where the draws do not bound it."""
    ends = spread["quantile_intervals"][level]
    digits = max(enough_digits(ends, 4), enough_digits(list(spread["quantiles"].values())))
    low, high = (number(end, digits) if end is not None else "…" for end in ends)
    return f"{number(spread['quantiles'][level], digits):>9} {f'({low} to {high})':23}"


def result_words(name: str) -> str:
    """A result of the study in words."""
    words = name.replace("target_mode", "target mode", 1).replace("feedback_mode", "feedback mode near vehicle mode", 1)
    return spaced(words.replace("error_unmeasured", "error to unmeasured torques"))


def short_name(name: str) -> str:
    """A quantity as figures name it."""
    return name.removeprefix("rig.")


# --- Page

TOLERANCE_CAPTION = (
    "Left: how often a drawn bed has such a result; line: the bed as planned, dashed: what is required. "
    "Right: the quantities whose tolerances cause the spread."
)
WORST_DRIVERS = 4  # on the first screen
LEAST_SHARE = 0.05  # of a variance, from which a tighter tolerance pays
LOW, HIGH = 0.05, 0.95


@display.files.register
def tolerance_files(study: Tolerance, folder: str, made: Provenance | None = None) -> display.ResultFiles:
    """``tolerance.json``, report and figure."""
    drawn = plot_tolerance(study)
    picture = image(drawn)
    others: dict[str, str | bytes] = {
        "tolerance.svg": picture,
        "report.html": tolerance_page(study, drawn, picture, made),
    }
    return "tolerance.json", study.to_dict(), others


def tolerance_page(study: Tolerance, figure: Figure, image: bytes, made: Provenance | None = None) -> str:
    """The page as HTML, from a study, its figure and the figure's picture."""
    good = study.shares["all"]
    content = StudyPage(
        title=f"Tolerances: {study.title}" if study.title else "Tolerances of the bed",
        status=percent(good, 1),
        answer=f"{percent(good, 1)} of {study.draws} drawn beds are stable, keep the required margin and every target "
        f"mode with the controller as it is.",
        good=good == 1.0,
        first_screen={
            "What to do now": _to_tighten(study),
            "What to expect": [_expected(spread) for spread in study.spreads],
            "What to watch": _to_watch(study),
        },
        captions={"tolerance": TOLERANCE_CAPTION},
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
        ScreenPoint(_tighten(name), f"causes {100 * share:.0f} % of the variance of {result_words(spread.name)}")
        for name, (share, spread) in ranked
    ]
    return points or [ScreenPoint("Nothing", f"no quantity causes {percent(LEAST_SHARE, 0)} of a variance")]


def _tighten(name: str) -> str:
    """What to do about a quantity that scatters: parts are ordered, the loop and its sensors are measured."""
    if name.startswith("rig."):
        return f"Order {component(name)} with a smaller tolerance"
    return f"Measure {component(name)} on the bed: 'rigmatch excite', then 'rigmatch identify'"


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
    return points or [ScreenPoint("no drawn bed fails")]


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
