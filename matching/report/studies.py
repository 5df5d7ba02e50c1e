"""Maps and tolerance studies: figures and reports."""

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

from matching.match.case import limit_of_all
from matching.match.map import Axis, Map
from matching.match.tolerance import Spread, Tolerance, required_range
from matching.report import common
from matching.report.common import (
    ABSENT,
    amount,
    component,
    csv_table,
    enough_digits,
    enumerated,
    figure,
    image,
    number,
    percent,
    practical,
    sentence,
    spaced,
    styled,
    unit,
)  # fmt: skip
from matching.report.page import Fold, Picture, Report, Step, Table, View, register
from modelling import escape
from modelling.display import counted

# --- Figure of a map: the response error that a match reaches over two quantities, and what limits it where.

LIMITS = {  # what limits the match at a point, in words
    "impossible": "no match possible",
    "stability": "no stable loop found",
    "targets": "target mode not met",
    "twist": "shaft twist above its limit",
    "torque": "shaft torque above its limit",
    "shear_stress": "shear stress above its limit",
    "shear_stress_amplitude": "amplitude of the shear stress above its limit",
    "dynamometer_torque": "dynamometer torque above its limit",
    "dynamometer_speed": "dynamometer speed above its limit",
    "dynamometer_power": "dynamometer power above its limit",
    "modulus_margin": "modulus margin below its limit",
    "response_error": "response error above its tolerance",
    "beds": "drawn beds not stable or damped too little",
    "damping_ratio": "damping ratio below its limit",
    "opened_shafts": "swings on with free play in the cut shafts",
    "dynamometer_torque_over_speed": "dynamometer torque above its curve over speed",
    "standstill": "turns where the vehicle stands",
    "supervision": "the controller leaves emulation",
    "rolled_off": "loop not rolled off",
    "command_noise": "command noise above its limit",
    "sensor_offset": "flange torque unexpected after offsets",
    "feed_forward": "model on known torques rings on",
}
MOST_WRITTEN = 8  # values per axis up to which every field has its number
EQUAL_RELATIVE = 1e-9  # errors that differ by no more count as equal
SHADES = (0.04, 0.66)  # part of the colour map: light enough for black numbers and hatching everywhere
RING_CLEARANCE = 17  # points from the middle of the ring to the number below it
MOST_TICKS = 10  # labels per axis


def limiting_words(point: Mapping[str, Any]) -> str:
    """What limits the match at a point; its status where nothing does."""
    if point["status"] == "impossible":
        return LIMITS["impossible"]
    words = dict.fromkeys(LIMITS[limit_of_all(name).rpartition(".")[2]] for name in point["limited_by"])
    return ", ".join(words) or str(point["status"])


def map_figure(result: Map) -> Figure:
    """A field for every pair of values, coloured by its error and hatched where a limit stands in the way.

    Where measured and unmeasured torques have different errors, each has a panel; where drawn beds judge the matches,
    the share of those that are stable has one as well.
    """
    if result.y is None:
        return sweep_figure(result)
    shown = panels(result)
    columns, rows = shown_factor(result.x) * edges(result.x), shown_factor(result.y) * edges(result.y)
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
                fig.colorbar(fields, ax=axes, label=words)
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


SWEPT = {"error": "measured torques", "unmeasured": "unmeasured torques", "bound": "lower bound, measured torques"}


def sweep_figure(result: Map) -> Figure:
    """Response errors over one quantity; hollow marks are limited, a dashed line is the case as it is."""
    places = shown_factor(result.x) * np.array(result.x.values)
    limited = np.array([point.status != "matched" for point in result.points[0]])
    measured = result.errors()[0]
    with styled():
        fig = figure(6.4, 4.2)
        axes = fig.subplots()
        for number_, (which, words) in enumerate(SWEPT.items()):
            values = result.errors(which)[0]
            same = which != "error" and np.allclose(values, measured, rtol=EQUAL_RELATIVE, equal_nan=True)
            if same or not np.isfinite(values).any():
                continue
            look = common.curve(number_)
            axes.plot(places, values, label=words, **look)
            if which != "bound":
                colour = look["color"]
                axes.plot(places[~limited], values[~limited], "o", color=colour, label="_")
                axes.plot(places[limited], values[limited], "o", color=colour, markerfacecolor="white", label="_")
        if limited.any():
            axes.plot([], [], "o", color=common.INK, markerfacecolor="white", label="limited")
        if result.x.values[0] <= result.x.here <= result.x.values[-1]:
            here = shown_factor(result.x) * result.x.here
            axes.axvline(here, color=common.LIMIT, linestyle="--", label="the case as it is")
        if result.x.by_ratio:
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(FixedLocator(places[:: -(-len(places) // MOST_TICKS)].tolist()))
            axes.xaxis.set_minor_locator(NullLocator())
            axes.xaxis.set_major_formatter(lambda value, _: number(value, 3))
        axes.set_ylim(bottom=0)
        shown_unit = "ms" if result.x.unit == "s" else unit(result.x.unit)
        name = component(result.x.name)
        axes.set_xlabel(f"{name} in {shown_unit}" if shown_unit else name)
        axes.set_ylabel(f"response error, {number(result.band[0])}–{number(result.band[1])} Hz")
        fig.legend(loc="outside lower center", ncols=2)
        if result.title:
            axes.set_title(escape.figure(result.title), fontsize=11)
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
    digits = enough_digits(values.ravel().tolist(), 2, 4)
    assert result.y is not None
    of_x, of_y = shown_factor(result.x), shown_factor(result.y)
    for y, row in zip(result.y.values, values, strict=True):
        for x, value in zip(result.x.values, row, strict=True):
            if np.isfinite(value):
                below = -RING_CLEARANCE if (x, y) == (result.x.here, result.y.here) else 0
                place = of_x * x, of_y * y
                axes.annotate(number(float(value), digits), place, (0, below), textcoords="offset points",
                              ha="center", va="center", fontsize=8, zorder=4)  # fmt: skip


def _mark(axes: Any, result: Map, columns: np.ndarray, rows: np.ndarray) -> None:
    """Hatch what is limited, a ring at the case's own values if they lie on the map."""
    for i, row in enumerate(result.points):
        for j, point in enumerate(row):
            if point.status != "matched":
                size = columns[j + 1] - columns[j], rows[i + 1] - rows[i]
                axes.add_patch(Rectangle((columns[j], rows[i]), *size, zorder=2, hatch="//", linewidth=0,
                                         facecolor="none", edgecolor=common.INK, label="limited"))  # fmt: skip
    if result.y is not None and case_lies_on(result):
        ring: Any = {"markersize": 15, "markerfacecolor": "none", "linestyle": "none", "clip_on": False}
        for colour, width, label in (("white", 5, "_"), (common.RIG, 2.4, "the case as it is")):
            here = shown_factor(result.x) * result.x.here, shown_factor(result.y) * result.y.here
            axes.plot(*here, "o", markeredgecolor=colour, markeredgewidth=width, zorder=6,
                      label=label, **ring)  # fmt: skip


def case_lies_on(result: Map) -> bool:
    """Whether the case's values of both quantities lie within the map."""
    axes = [axis for axis in (result.x, result.y) if axis is not None]
    return all(axis.values[0] <= axis.here <= axis.values[-1] for axis in axes)


def edges(axis: Axis) -> np.ndarray:
    """Borders (n + 1,) of the fields around the n values of an axis."""
    values = np.log(axis.values) if axis.by_ratio else np.asarray(axis.values)
    if len(values) == 1:
        return np.array([0.9, 1.1]) * axis.values[0] if axis.values[0] else np.array([-1.0, 1.0])
    middles = (values[1:] + values[:-1]) / 2
    ends = [values[0] - (middles[0] - values[0]), *middles, values[-1] + (values[-1] - middles[-1])]
    return np.exp(ends) if axis.by_ratio else np.array(ends)


def shown_factor(axis: Axis) -> float:
    """Value on the drawing over that in SI: times are drawn in ms."""
    return 1e3 if axis.unit == "s" else 1.0


def _label(axes: Any, result: Map) -> None:
    assert result.y is not None
    for drawn_axis, axis, scale in ((axes.xaxis, result.x, axes.set_xscale), (axes.yaxis, result.y, axes.set_yscale)):
        if axis.by_ratio:
            scale("log")
        every = -(-len(axis.values) // MOST_TICKS)
        ticks = [shown_factor(axis) * value for value in axis.values[::every]]
        drawn_axis.set_major_locator(FixedLocator(ticks))
        drawn_axis.set_minor_locator(NullLocator())
        drawn_axis.set_ticklabels([number(value, 3) for value in ticks])
        shown_unit = "ms" if axis.unit == "s" else unit(axis.unit)
        name = component(axis.name)
        drawn_axis.set_label_text(f"{name} in {shown_unit}" if shown_unit else name)


# --- The report of a map: the best point, how far a match reaches, what limits it elsewhere; every point to download.

MAP_CAPTION = "Response error that a match reaches at every pair of values; hatched where a limit stands in the way."
SWEEP_CAPTION = "Response error that a match reaches at every value; hollow marks: a limit stands in the way."
CAPTION_OF_RING = " The ring is the case as it is."
NO_MATCH = "no point is matched: widen the limits, the bounds under [move] or the range of the map"


def map_report(content: Mapping[str, Any], folder: str = "", made: Any = None, result: Any = None) -> Report:
    """What a map says."""
    points, kind = content["points"], "Map" if content["y"] else "Sweep"
    known = [point for point in points if point["error"] is not None]
    matched = [point for point in known if point["status"] == "matched"]
    answer = "No point has a response error: no match could be tried."
    if known:
        best = min(matched or known, key=_judged_error)
        limited = "" if matched else ", though limited,"
        answer = (
            f"The least error over drawn beds, of both kinds of torques over their tolerances,{limited} is "
            f"{number(_judged_error(best), 3)}, at {_place(content, best)}."
        )
    improved = [point for point in known if point["objective"] != point["objective_from_own_starts"]]
    return Report(
        title=f"{kind}: {content['title']}" if content["title"] else f"{kind} of the response error",
        status=f"{len(matched)} of {len(points)} matched",
        answer=answer,
        good=bool(matched),
        lists={
            "Where it is best": _where_best(content, matched),
            "How far a match reaches": [_reach(content[key], key, matched) for key in _axes(content)],
            "What stands in the way": _in_the_way(points),
        },
        folds=[Fold("Response errors at all points", [Table(_rows(content))], told=True)],
        notes=[f"{counted(len(improved), 'point')} improved from their neighbours' solutions"] if improved else (),
    )


def point_data(result: Map) -> str:
    """Every point with its tuned values (CSV, SI)."""
    points = [point for row in result.points for point in row]
    names = list(dict.fromkeys(name for point in points for name in point.values))
    axes = [axis for axis in (result.x, result.y) if axis is not None]
    head = [f"{axis.name} [{axis.unit}]" for axis in axes] + [
        "status", "error", "error, unmeasured torques", "bound", "modulus margin", "share of stable beds", "limited by",
    ]  # fmt: skip
    rows = [
        [*(point.x, point.y)[: len(axes)], point.status, point.error, point.unmeasured, point.bound,
         point.modulus_margin, point.stable_beds, " ".join(point.limited_by),
         *(point.values.get(name) for name in names)]
        for point in points
    ]  # fmt: skip
    return csv_table([*head, *names], rows)


NO_DIFFERENCE = 0.02  # relative: an order has to gain as much, so less is no difference


def _where_best(content: Mapping[str, Any], matched: list[Any]) -> list[Step]:
    """Where the matched points are best by the error that also decides on an order; not what to choose.

    A dead time is what the bed has, and an adapter is ordered by a match, which compares delivered controllers.
    """
    if not matched:
        return [Step("Widen what is allowed", NO_MATCH)]
    best = min(matched, key=_judged_error)
    alike = [point for point in matched if _judged_error(point) <= (1 + NO_DIFFERENCE) * _judged_error(best)]
    here = [point for point in alike if all(point[key] == content[key]["value_in_case"] for key in _axes(content))]
    reason = f"error over drawn beds {number(_judged_error(best), 3)}, margin {number(best['modulus_margin'], 3)}"
    steps = [Step(f"Least at {_place(content, best)}", reason)]
    if here:
        steps.append(Step("No better than where the case is", f"the difference is within {100 * NO_DIFFERENCE:.0f} %"))
    elif len(alike) > 1:
        steps.append(
            Step(
                f"As good at {len(alike) - 1} more of {len(matched)} matched points",
                f"within {100 * NO_DIFFERENCE:.0f} %",
            )
        )
    safest = max(matched, key=lambda point: point["modulus_margin"] or 0.0)
    if safest is not best:
        reason = f"{number(safest['modulus_margin'], 3)}; error {number(_judged_error(safest), 3)}"
        steps.append(Step(f"Largest modulus margin at {_place(content, safest)}", reason))
    return steps


def _judged_error(point: Mapping[str, Any]) -> float:
    """Of both kinds of torques over their tolerances: of drawn beds, or of the bed as planned where none were drawn."""
    for key in ("bed_error", "planned_error", "error"):
        if point.get(key) is not None:
            return float(point[key])
    return float("inf")


def _reach(axis: Mapping[str, Any], key: str, matched: list[Any]) -> Step:
    values = sorted({point[key] for point in matched})
    if not values:
        return Step(f"{component(axis['name'])}: nowhere")
    ends = " to ".join(dict.fromkeys(practical(value, axis["unit"]) for value in (values[0], values[-1])))
    whole = values[0] == axis["values"][0] and values[-1] == axis["values"][-1]
    return Step(f"{component(axis['name'])}: {ends}", "the whole range" if whole else "not at all values")


def _in_the_way(points: list[Any]) -> list[Step]:
    reasons = Counter(limiting_words(point) for point in points if point["status"] != "matched")
    if not reasons:
        return [Step("nothing on this map", "every point is matched")]
    return [Step(words, f"at {count} of {len(points)} points") for words, count in reasons.most_common(4)]


def _place(content: Mapping[str, Any], point: Mapping[str, Any]) -> str:
    axes = ((content[key], point[key]) for key in _axes(content))
    return ", ".join(
        f"{component(axis['name'])} {(practical if axis['unit'] == 's' else amount)(value, axis['unit'])}"
        for axis, value in axes
    )


def _axes(content: Mapping[str, Any]) -> str:
    """Keys of the axes; a sweep has one."""
    return "xy" if content["y"] else "x"


def _rows(content: Mapping[str, Any]) -> list[dict[str, str]]:
    """A row for each value of y; of a sweep for each value of its quantity."""
    x, y = content["x"], content["y"]
    if y is None:
        return [
            {
                component(x["name"]): practical(point["x"], x["unit"]), "": point["status"],
                "measured torques": number(point["error"], 3), "unmeasured torques": number(point["unmeasured"], 3),
                "lower bound": number(point["bound"], 3), "modulus margin": number(point["modulus_margin"], 3),
                "what stands in the way": "" if point["status"] == "matched" else limiting_words(point),
            }
            for point in content["points"]
        ]  # fmt: skip
    head = f"{y['name']} \\ {x['name']}"
    errors = iter(content["points"])
    return [
        {head: f"{row:.4g} {y['unit']}"}
        | {f"{column:.4g} {x['unit']}": number(next(errors)["error"], 3) for column in x["values"]}
        for row in y["values"]
    ]


def map_pictures(result: Map) -> dict[str, Picture]:
    """The map."""
    caption = MAP_CAPTION + (CAPTION_OF_RING if case_lies_on(result) else "")
    if result.y is None:
        caption = SWEEP_CAPTION
    return {"map": Picture(lambda: map_figure(result), caption, point_data(result))}


register(
    Map,
    View(
        "map.json", map_report, map_pictures, folder="",
        others=lambda result: {"map.png": image(map_figure(result), "png")},
    ),
)  # fmt: skip


# --- Figure of a tolerance study: distributions with nominal value and limit, and the drivers of each.

ROUNDING = 1e-9  # relative standard deviation of a result up to which it does not spread
LEAST_DRAWN = 0.005  # share of a variance whose bar is seen
DRIVERS_DRAWN = 5  # quantities with the largest shares of the variance


def plot_tolerance(study: Tolerance) -> Figure:
    """One row a result that spreads: its distribution, and the quantities that it comes from."""
    spreads = _spreading(study) or study.spreads
    with styled():
        fig = figure(8.0, 0.8 + 1.75 * len(spreads))
        rows = fig.subplots(len(spreads), 2, squeeze=False, width_ratios=[3, 2])
        for (left, right), spread in zip(rows, spreads, strict=True):
            left.stairs(100 * spread.counts / spread.draws, spread.edges, fill=True, color=common.MATCHED, alpha=0.6)
            left.axvline(spread.nominal, color="black", linewidth=1.2, label="nominal")
            for place, label in zip(_required_values(study, spread), ("required", "_"), strict=False):
                left.axvline(place, color=common.LIMIT, linestyle="--", linewidth=1.2, label=label)
            left.set_xlabel(axis_words(spread.name, spread.unit))
            left.set_ylabel("share of beds\nin %")
            left.locator_params(axis="x", nbins=6)
            left.legend(fontsize=7, loc="lower right", bbox_to_anchor=(1, 1), ncols=2, borderaxespad=0)
            drivers = [one for one in spread.drivers[:DRIVERS_DRAWN] if one[1] >= LEAST_DRAWN][::-1]
            right.barh(range(len(drivers)), [100 * share for _, share in drivers], color=common.VEHICLE)
            right.set_yticks(range(len(drivers)), [component(name) for name, _ in drivers], fontsize=7)
            right.set_xlim(0, 100)
            right.set_xlabel("share of the variance in %", fontsize=8)
        fig.align_ylabels(rows[:, 0])
    return fig


def _spreading(study: Tolerance) -> list[Spread]:
    """Results that differ from bed to bed by more than rounding."""
    return [one for one in study.spreads if one.standard_deviation > ROUNDING * abs(one.mean)]


def _required_values(study: Tolerance, spread: Spread) -> list[float]:
    """Ends of what is required of a result: the margin, and those of a target mode that a draw comes near."""
    if spread.name == "modulus_margin":
        return [study.asked]
    low, high = spread.edges[0], spread.edges[-1]
    return [end for end in required_range(spread.name, study.allowed, study.asked) if low <= end <= high]


OF_TARGET = {  # of a target mode, on an axis
    "frequency_error": "frequency over that of the vehicle, less 1",
    "damping_error": "damping ratio less the vehicle's",
}  # fmt: skip


def axis_words(name: str, unit_: str) -> str:
    """A result of the study at an axis: in words, with its unit."""
    for ending, words in OF_TARGET.items():
        if name.startswith("target_mode_") and name.endswith(f"_{ending}"):
            return f"{result_words(name.removesuffix(f'_{ending}'))}: {words}"
    return result_words(name) + (f" in {unit_}" if unit_ else "")


def result_words(name: str) -> str:
    """A result of the study in words."""
    words = name.replace("target_mode", "target mode", 1).replace("feedback_mode", "feedback mode near vehicle mode", 1)
    return spaced(words.replace("error_unmeasured", "error to unmeasured torques"))


# --- The report of a tolerance study: the yield, what to tighten, what to expect and what fails.

TOLERANCE_CAPTION = (
    "Left: how often a drawn bed has such a result; line: the bed as planned, dashed: what is required. "
    "Right: the quantities whose tolerances cause the spread."
)
WORST_DRIVERS, DRIVERS_PRINTED = 4, 3  # on the first screen; of one result
LEAST_SHARE = 0.05  # of a variance, from which a tighter tolerance pays
LEAST_SHARE_PRINTED = 0.02
LOW, HIGH = "0.05", "0.95"
HOW_TO_READ = (
    "In brackets: where the quantile of all such beds lies with 95 % confidence, by the number of draws; … where the "
    "draws do not bound it."
)


def tolerance_report(content: Mapping[str, Any], folder: str = "", made: Any = None, result: Any = None) -> Report:
    """What a tolerance study says."""
    shares, spreads = content["yield"], content["quantities"]
    of = counted(len(content["varied"]), "quantity", "quantities")
    return Report(
        title=f"Tolerances: {content['title']}" if content["title"] else "Tolerances of the bed",
        status="All beds pass" if shares["all"] == 1.0 else f"{percent(shares['all'], 1)} of beds pass",
        answer=f"{percent(shares['all'], 1)} of {content['draws']} drawn beds are stable and damped and keep what a "
        f"match asks, each against the vehicle with the same specimen; {of} vary.",
        good=shares["all"] == 1.0,
        lists={
            "What to do now": _to_tighten(content),
            "What to watch": _to_watch(content),
        },
        folds=[Fold("Spread of every result", [Table([_row(spread) for spread in spreads], HOW_TO_READ)], told=True)],
    )


def histogram_data(study: Tolerance) -> str:
    """Histograms of all results (CSV): counts of draws between edges."""
    rows = [
        (spread.name, spread.unit, low, high, int(count))
        for spread in study.spreads
        for low, high, count in zip(spread.edges[:-1], spread.edges[1:], spread.counts, strict=True)
    ]
    return csv_table(["result", "unit", "from", "to", "draws"], rows)


def _to_tighten(content: Mapping[str, Any]) -> list[Step]:
    """What scatters most in the results that lose beds; where none is lost there is nothing to do."""
    losing = {name for name, share in content["yield"].items() if share < 1.0}
    if not losing:
        return [Step("Nothing", "every drawn bed keeps what a match asks")]
    specimen = {row["name"] for row in content["varied"] if row.get("specimen")}
    whole = losing & {"stable", "damped"}
    largest: dict[str, tuple[float, str]] = {}
    for spread in content["quantities"]:
        if spread["name"] not in losing and not (whole and spread["name"] == "modulus_margin"):
            continue
        for driver in spread["drivers"]:
            name, share = driver["name"], driver["share"]
            if name not in specimen and share > max(LEAST_SHARE, largest.get(name, (0.0, ""))[0]):
                largest[name] = share, spread["name"]
    ranked = sorted(largest.items(), key=lambda item: -item[1][0])[:WORST_DRIVERS]
    steps = [
        Step(_tighten(name), f"causes {100 * share:.0f} % of the variance of {result_words(of)}")
        for name, (share, of) in ranked
    ]
    nothing = "what the beds differ by belongs to the specimen, or no quantity causes much of it"
    return steps or [Step("Match with a wider [uncertainty]", nothing)]


def _tighten(name: str) -> str:
    """What to do about a quantity that scatters: parts are ordered, the loop and its sensors are measured."""
    if name.startswith("rig."):
        return f"Order {component(name)} with a smaller tolerance"
    return f"Measure {component(name)} on the bed: 'rigmatch excite', then 'rigmatch identify'"


def _to_watch(content: Mapping[str, Any]) -> list[Step]:
    steps = [
        Step(f"{percent(1 - share, 1)} of the beds {_failure(name)}", _required(content, name))
        for name, share in content["yield"].items()
        if name != "all" and share < 1.0
    ]
    return steps or [Step("no drawn bed fails")]


def _failure(name: str) -> str:
    if name in ("stable", "damped"):
        return f"are not {name}"
    return f"lose {result_words(name)}"


def _required(content: Mapping[str, Any], name: str) -> str:
    limit = content["allowed"].get(name)
    if limit is None:
        return "as a match asks it"
    sign = "" if name.startswith("response_error") else "±"
    return f"allowed: {sign}{number(limit)}, against the vehicle with the same specimen"


def _row(spread: Mapping[str, Any]) -> dict[str, str]:
    digits = enough_digits([spread["quantiles"][level] for level in (LOW, HIGH)], 4)
    drivers = [
        f"{component(driver['name'])} {percent(driver['share'], 0)}"
        for driver in spread["drivers"][:DRIVERS_PRINTED]
        if driver["share"] > LEAST_SHARE_PRINTED
    ]
    return {
        "result": _named(spread), "as planned": number(spread["nominal"], digits),
        "mean": number(spread["mean"], digits), "5 %": _quantile(spread, LOW), "95 %": _quantile(spread, HIGH),
        "draws": str(spread["draws"]), "driven by": enumerated(drivers) or ABSENT,
    }  # fmt: skip


def _quantile(spread: Mapping[str, Any], level: str) -> str:
    """A quantile and its confidence interval; an open end where the draws do not bound it."""
    ends = spread["quantile_intervals"][level]
    digits = enough_digits(ends, enough_digits([spread["quantiles"][each] for each in (LOW, HIGH)], 4))
    interval = " to ".join("…" if end is None else number(end, digits) for end in ends)
    return f"{number(spread['quantiles'][level], digits)} ({interval})"


def _named(spread: Mapping[str, Any]) -> str:
    return result_words(spread["name"]) + (f" in {spread['unit']}" if spread["unit"] else "")


def tolerance_pictures(study: Tolerance) -> dict[str, Picture]:
    """Distributions and drivers."""
    same = [axis_words(one.name, "") for one in study.spreads if one not in _spreading(study)]
    of_all = f" The same on every bed, and so not drawn: {sentence(same)}." if same else ""
    return {"tolerance": Picture(lambda: plot_tolerance(study), TOLERANCE_CAPTION + of_all, histogram_data(study))}


register(Tolerance, View("tolerance.json", tolerance_report, tolerance_pictures, folder=""))
