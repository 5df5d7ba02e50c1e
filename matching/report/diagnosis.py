"""A diagnosis: figures, sentences, report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Formatter
from typing import Any

import numpy as np
import scipy
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, LogLocator, NullLocator, StrMethodFormatter

from matching.diagnosis.audit import AuditedChannel
from matching.diagnosis.holdout import HoldoutData
from matching.diagnosis.result import (
    BEST_SO_FAR,
    UNITS,
    Diagnosis,
    DiscrepancyCurve,
    NamedCause,
    PlotData,
    SensorErrors,
)
from matching.report.common import (
    BAND,
    EXTENDED,
    INK,
    LIMIT,
    NOISE,
    RIG,
    VEHICLE,
    csv_table,
    decimated,
    figure,
    number,
    percent,
    plus_minus,
    spaced,
    styled,
    unit,
)
from matching.report.page import (
    Fold,
    Picture,
    Provenance,
    Report,
    Show,
    Step,
    Table,
    View,
    in_terminal,
    made_from,
    register,
)
from modelling.effects import EFFECTS
from modelling.effects.effect import place_in_words, shared_place
from modelling.effects.turning_sensors import SensorRipple, correction
from modelling.model_file import dumps
from modelling.system import Sensor, System

# --- What the figures of a diagnosis share: line styles, the sensors they show, and axes in multiples of the noise.

# Different in grey too: broad and pale against thin and dark; smooth curves dashed against solid.
BEFORE: dict[str, Any] = {
    "color": RIG, "linewidth": 1.8, "alpha": 0.5, "label": "base model, fitted", "zorder": 2.2,
}  # fmt: skip
AFTER: dict[str, Any] = {"color": EXTENDED, "linewidth": 0.8, "label": "extended model", "zorder": 2.4}
SMOOTH: dict[str, dict[str, Any]] = {
    BEFORE["label"]: {"linestyle": (0, (5, 1.6)), "linewidth": 1.6, "alpha": 1.0},
    AFTER["label"]: {"linewidth": 1.6},
}
MEASURED: dict[str, Any] = {"color": VEHICLE, "linewidth": 3.6, "alpha": 0.4, "label": "measured", "zorder": 2.0}
SENSORS_SHOWN = 4
LONGEST_JOINED = 3  # times the usual distance of a sensor's samples: what is longer is a gap
LINEAR_TO = 10  # times the noise; beyond, the axis is logarithmic
LEAST_RANGE = 6.0  # times the noise, either way


@dataclass(frozen=True)
class SensorView:
    """One sensor and the components whose motion it is drawn over.

    Attributes
    ----------
    index : int
        Place among the model's sensors.
    sensor : Sensor
    inertia : str
        Whose speed and angle.
    shaft : str or None
        Whose torque.
    """

    index: int
    sensor: Sensor
    inertia: str
    shaft: str | None


def views(system: System, plot_data: PlotData) -> list[SensorView]:
    """The sensors with the largest residuals of the base model, in times their noise, largest first."""
    with np.errstate(invalid="ignore"):
        misfit = _rms_by_sensor(plot_data.residual_before) / plot_data.noise
    order = [int(j) for j in np.argsort(-np.nan_to_num(misfit, nan=-1.0)) if np.isfinite(misfit[j])]
    return [_view(system, plot_data, j) for j in order[:SENSORS_SHOWN]]


def _view(system: System, plot_data: PlotData, j: int) -> SensorView:
    sensor, motion = system.sensors[j], plot_data.before
    if sensor.measures == "torque":
        return SensorView(j, sensor, motion.ends[sensor.of][0], sensor.of)
    attached = [name for name, ends in motion.ends.items() if sensor.of in ends]
    liveliest = max(attached, key=lambda name: float(np.std(motion.torque[name])), default=None)
    return SensorView(j, sensor, sensor.of, liveliest)


def _rms_by_sensor(residual: np.ndarray) -> np.ndarray:
    count = np.isfinite(residual).sum(axis=0)
    return np.where(count, np.sqrt(np.nansum(residual**2, axis=0) / np.maximum(count, 1)), np.nan)


def styled_residuals(before: np.ndarray, after: np.ndarray) -> tuple[tuple[np.ndarray, dict[str, Any]], ...]:
    """Residuals (t,) before and after with their line styles; only those before where no effect was added."""
    if np.array_equal(before, after, equal_nan=True):
        return ((before, BEFORE),)
    return (before, BEFORE), (after, AFTER)


def label(sensor: Sensor) -> str:
    """Name and unit of a sensor's reading."""
    return f"{spaced(sensor.name)}\nin {unit(sensor.unit)}"


def line(axes: Any, x: np.ndarray, y: np.ndarray, look: dict[str, Any]) -> None:
    """A line through points x (t,), y (t,), of a long one its least and largest values."""
    axes.plot(*decimated(x, y), **look)


def noise_band(row: Sequence[Any]) -> None:
    """A band that holds 95 % of pure noise, on axes that share a scale in times the noise, linear near 0."""
    for axes in row:
        axes.axhspan(-2, 2, color=BAND, zorder=1, label="95 % of noise")
    first = row[0]
    first.set_yscale("symlog", linthresh=LINEAR_TO)
    low, high = first.get_ylim()
    first.set_ylim(min(low, -LEAST_RANGE), max(high, LEAST_RANGE))
    low, high = first.get_ylim()
    decades = [sign * 10.0**k for sign in (-1, 1) for k in range(1, 10)]
    ticks = [tick for tick in (-5.0, 0.0, 5.0, *decades) if low <= tick <= high]
    first.yaxis.set_major_locator(FixedLocator(ticks))
    first.yaxis.set_minor_locator(NullLocator())
    first.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))


def noise_line(axes: Any) -> None:
    """A horizontal line at 1, the noise."""
    axes.axhline(1.0, color=NOISE, linewidth=2.2, linestyle=(0, (1, 1)), label="noise", zorder=3)


def recorded(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times (k,) in s and values (k,) where a sensor has some, with a NaN in each gap.

    A sensor that is recorded more slowly than others has no value between its samples; that is no gap.
    """
    present = np.flatnonzero(np.isfinite(values))
    between = np.diff(present)
    if not len(between) or len(present) == len(values):
        return time, values
    gaps = 1 + np.flatnonzero(between > LONGEST_JOINED * np.median(between))
    return np.insert(time[present], gaps, time[present[gaps]]), np.insert(values[present], gaps, np.nan)


def with_gaps(time: np.ndarray, parts: tuple[slice, ...], values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times (t,) in s and values (t,) with a NaN after each part, so that no line is drawn across a gap."""
    samples = [recorded(time[p], values[p]) for p in parts if p.stop > p.start]
    pieces = [(np.append(times, times[-1]), np.append(readings, np.nan)) for times, readings in samples]
    return np.concatenate([times for times, _ in pieces]), np.concatenate([readings for _, readings in pieces])


def continuous_time(plot_data: PlotData) -> np.ndarray:
    """Time (t,) in s that goes on from recording to recording."""
    motion, pieces, end = plot_data.before, [], 0.0
    for i, part in enumerate(motion.segments):
        time = motion.time[part]
        start = time[0] if i == 0 else max(end + motion.step, time[0])
        pieces.append(time - time[0] + start)
        end = float(pieces[-1][-1])
    return np.concatenate(pieces)


def legend(fig: Any, axes: Any) -> None:
    """One legend for the whole figure."""
    handles, labels = axes.get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper center", ncols=4)


# --- Figure of the torque balance: the torque that each component lacks in the base model, over its motion.

BINS = 48
LEAST_PER_BIN = 12  # samples, for a mean
DOTS = 1500  # of a cloud
EDGE_S = 0.3  # left out at either end of a recording: the smoother has no data beyond
EDGE_SHARE = 0.2  # of a short recording


def balance_figure(plot_data: PlotData) -> Figure:
    """Bars of the unexplained torque by component; that of the worst inertia and the worst shaft over their motion."""
    motion, inner = plot_data.before, _inner(plot_data)
    inertias, shafts = (
        {name: torque[inner] for name, torque in group.items()} for group in (plot_data.inertias, plot_data.shafts)
    )
    size = {f"inertia {name}": _rms_torque(torque) for name, torque in inertias.items()}
    size |= {f"shaft {name}": _rms_torque(torque) for name, torque in shafts.items()}
    names = sorted(size, key=lambda name: size[name])
    inertia = max(inertias, key=lambda name: _rms_torque(inertias[name]))
    shaft = max(shafts, key=lambda name: _rms_torque(shafts[name]), default=None)
    with styled():
        fig = figure(11, max(3.0, 1.2 + 0.24 * len(names)))
        bars, first, second = fig.subplots(1, 3, width_ratios=[1.1, 1, 1])
        bars.barh([*map(spaced, names)], [size[name] for name in names], color=RIG, height=0.6)
        bars.set_xlabel("Unexplained torque (rms) in N·m")
        bars.grid(axis="y", visible=False)
        _over(first, motion.speed[inertia][inner], inertias[inertia])
        first.set(xlabel=f"Speed of {spaced(inertia)} in rad/s", ylabel=f"Unexplained on {spaced(inertia)} in N·m")
        if shaft is None:
            second.set_axis_off()
        else:
            _over(second, motion.twist[shaft][inner], shafts[shaft])
            second.set(xlabel=f"Twist of {spaced(shaft)} in rad", ylabel=f"Unexplained in {spaced(shaft)} in N·m")
    return fig


def _inner(plot_data: PlotData) -> np.ndarray:
    """Mask (t,) of the samples away from the ends, where the smoother has data on both sides."""
    mask = np.zeros(len(plot_data.before.time), dtype=bool)
    for part in plot_data.before.segments:
        time = plot_data.before.time[part]
        edge = min(EDGE_S, EDGE_SHARE * float(np.ptp(time)))
        mask[part] = (time >= time[0] + edge) & (time <= time[-1] - edge)
    return mask


def _rms_torque(torque: np.ndarray) -> float:
    return float(np.sqrt(np.mean(torque**2)))


def _over(axes: Any, x: np.ndarray, torque: np.ndarray) -> None:
    axes.locator_params(axis="x", nbins=5)
    binned(axes, x, torque, {"color": RIG, "markersize": 2}, {"color": INK, "linewidth": 1.8})


def binned(axes: Any, x: np.ndarray, values: np.ndarray, dot: dict[str, Any], mean: dict[str, Any]) -> None:
    """Values (t,) over x (t,) as dots, of many some, and the mean of each bin as a line."""
    present = np.isfinite(values)
    x, values = x[present], values[present]
    few = np.linspace(0, len(x) - 1, min(len(x), DOTS)).astype(int)
    axes.plot(x[few], values[few], ".", alpha=0.3, rasterized=True, zorder=1.5, **dot)
    edges = np.linspace(x.min(), x.max(), BINS + 1)
    bins = np.clip(np.digitize(x, edges) - 1, 0, BINS - 1)
    count = np.bincount(bins, minlength=BINS)
    means = np.where(count >= LEAST_PER_BIN, np.bincount(bins, values, BINS) / np.maximum(count, 1), np.nan)
    axes.plot((edges[1:] + edges[:-1]) / 2, means, **mean)


# --- The captions of the figures of a diagnosis, for pages too that others draw for.

CAPTIONS = {
    "discrepancy": "What no named cause explains: a torque beside the extended model that would take most of it, with "
    "a band of two standard uncertainties. What the model's own parameters can take is not in it.",
    "errors": "Simulation of held-out data, which no fit used. At 1 the error equals the sensor's stated noise.",
    "unseen": "Held-out data. Left: around the largest error of the base model. Right: measured minus simulated over "
    "all held-out data, linear near zero and logarithmic beyond.",
    "time": "Fitted data: measured minus simulated over time (pale) and its running mean.",
    "where": "Measured minus simulated over the motion at the sensor's component; dots are samples, lines the mean of "
    "a bin. A step at zero speed indicates dry friction, a kink over the twist free play or hardening, a wave over "
    "the angle torque ripple.",
    "channels": "Each channel where they move most, and its samples over those that the base model simulates: on the "
    "line they have the right sign and gain, in an ellipse another time. A channel whose time is another than that of "
    "most is drawn set back as well.",
    "spectrum": "Amplitude of the residual over frequency and over orders of the rotation. White noise of the stated "
    "size lies at 1.",
    "balance": "Torque that the measurement requires in addition to the base model, for each component alone (smoothed "
    "with the linear model, without differentiation). It shows where to look, not the cause: neighbouring components "
    "share what no sensor separates.",
}


# --- Figure of the torques that no cause explains, over speed, angle, load, twist or time.

CURVES_SHOWN = 3
COVERAGE_FACTOR = 2.0  # of the band


def discrepancy_figure(curves: Sequence[DiscrepancyCurve]) -> Figure:
    """The curves that would take most, each with its band."""
    shown = curves[:CURVES_SHOWN]
    with styled():
        fig = figure(11, 3.2)
        for axes, curve in zip(fig.subplots(1, len(shown), squeeze=False)[0], shown, strict=True):
            band = COVERAGE_FACTOR * curve.standard_uncertainty
            axes.fill_between(curve.grid, curve.torque - band, curve.torque + band, color=RIG, alpha=0.25, lw=0)
            axes.plot(curve.grid, curve.torque, color=RIG)
            table, name = map(spaced, curve.at.split("."))
            where = f"{curve.over.capitalize()} of {name}" if curve.over != "time" else "Time"
            side = "on" if table == "inertias" else "in"
            unit = UNITS[curve.over].replace("*", "·")
            axes.set(xlabel=f"{where} in {unit}", ylabel=f"Unexplained {side} {name} in N·m")
            axes.set_title(f"takes {100 * curve.share:.0f} % of the rest")
    return fig


# --- Figures of the base model and of the extended model on held-out data.

WINDOW = 120  # samples to either side of the largest error
MEAN_OVER = 25  # samples of the running mean by which the largest error is located
BAR_OFFSET = 0.17  # of a bar from its sensor's line


def errors_figure(errors: Mapping[str, SensorErrors]) -> Figure:
    """Errors on held-out data in times the noise, by sensor."""
    names = list(errors)[::-1]
    keys: dict[str, tuple[dict[str, Any], float]] = {"before_holdout": (BEFORE | {"hatch": "////"}, BAR_OFFSET)}
    keys["after_holdout"] = (AFTER | {"hatch": None}, -BAR_OFFSET)
    if all(error.before_holdout == error.after_holdout for error in errors.values()):
        keys = {"before_holdout": (keys["before_holdout"][0], 0.0)}
    with styled():
        fig = figure(7.2, 1.1 + 0.42 * len(names))
        axes = fig.subplots()
        largest = 2.0
        for key, (look, shift) in keys.items():
            rows = [(i, getattr(errors[name], key), errors[name].noise) for i, name in enumerate(names)]
            known = [(i, value / noise) for i, value, noise in rows if np.isfinite(value) and noise]
            places, ratios = [i + shift for i, _ in known], [ratio for _, ratio in known]
            axes.barh(
                places, ratios, height=0.3, color=look["color"], label=look["label"], hatch=look["hatch"],
                edgecolor="white", linewidth=0,
            )  # fmt: skip
            for place, ratio in zip(places, ratios, strict=True):
                axes.annotate(
                    number(ratio, 3), (max(ratio, 1.0), place), xytext=(3, 0), textcoords="offset points",
                    va="center", fontsize=8,
                )  # fmt: skip
            largest = max([largest, *ratios])
        axes.axvline(1.0, color=NOISE, linewidth=1.6, label="noise")
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        if largest < 10:
            axes.xaxis.set_minor_locator(LogLocator(subs=(2, 3, 5)))
            axes.xaxis.set_minor_formatter(StrMethodFormatter("{x:g}"))
        axes.set_xlim(0.5, 2.2 * largest)
        axes.set_yticks(range(len(names)), [*map(spaced, names)])
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("Root mean square error on held-out data, in times the noise")
        legend(fig, axes)
    return fig


def holdout_figure(data: HoldoutData, sensor_views: list[SensorView]) -> Figure:
    """Traces around the largest error of the base model, and the residuals of all held-out data."""
    with styled():
        fig = figure(11, 0.9 + 1.75 * len(sensor_views))
        rows = fig.subplots(len(sensor_views), 2, squeeze=False, width_ratios=[1, 1.3])
        for (close, whole), view in zip(rows, sensor_views, strict=True):
            _traces(close, data, view)
            for residual, look in styled_residuals(data.before, data.after):
                x, y = with_gaps(data.time, data.parts, residual[:, view.index] / data.noise[view.index])
                line(whole, x, y, look)
            noise_band([whole])
            whole.set_ylabel("error in times\nthe noise")
        for axes in rows[-1]:
            axes.set_xlabel("Time in s")
        legend(fig, rows[0, 0])
    return fig


def _traces(axes: Any, data: HoldoutData, view: SensorView) -> None:
    j = view.index
    error = np.abs(np.nan_to_num(data.before[:, j]))
    smooth = np.convolve(error, np.ones(MEAN_OVER) / MEAN_OVER, "same")
    worst = int(np.argmax(smooth))
    part = next(part for part in data.parts if part.start <= worst < part.stop)
    cut = slice(max(worst - WINDOW, part.start), min(worst + WINDOW, part.stop))
    measured = data.measured[cut, j]
    line(axes, *recorded(data.time[cut], measured), MEASURED)
    axes.locator_params(axis="x", nbins=5)
    for residual, look in styled_residuals(data.before, data.after):
        simulated = recorded(data.time[cut], measured - residual[cut, j])
        line(axes, *simulated, look | SMOOTH[look["label"]] | {"linewidth": 1.3})
    axes.set_ylabel(label(view.sensor))


# --- Figures of the residual over time, over speed, torque and angle, over frequency and orders of the rotation.

LEAST_REVOLUTIONS = 2  # that an order spectrum needs
HIGHEST_ORDER = 12
MOST_SAMPLES = 4_000  # of an order spectrum; more are averaged first
WELCH_SAMPLES = 4096  # of a segment
UNEVEN = 0.1  # share of the longer steps, and of the shorter ones, where a rate is no whole part of that of the grid


STRETCH, STRETCHES = 400, 40  # samples that are drawn of a channel, and how many places are looked at for them
DOTS = 1500  # samples that are drawn over those simulated


def channels_figure(plot_data: PlotData, system: System, channels: Sequence[AuditedChannel]) -> Figure:
    """Each channel over a stretch in which they move most, and its samples over those simulated, by the base model."""
    time, audited = continuous_time(plot_data), {channel.name: channel for channel in channels}
    shown = [j for j, sensor in enumerate(system.sensors) if sensor.name in audited]
    part = _liveliest(plot_data.before.segments, plot_data.measured[:, shown])
    with styled():
        fig = figure(11, 0.9 + 1.5 * len(shown))
        grid = fig.subplots(len(shown), 2, squeeze=False, width_ratios=(4, 1))
        for (left, right), j in zip(grid, shown, strict=True):
            sensor, channel = system.sensors[j], audited[system.sensors[j].name]
            own, model = plot_data.measured[:, j], plot_data.before.reading[sensor.name]
            left.plot(time[part], own[part], **MEASURED)
            left.plot(time[part], model[part], **BEFORE)
            if np.isfinite(channel.delay) and abs(channel.delay) > LATE * channel.delay_uncertainty:
                earlier = {"color": INK, "linewidth": 0.8, "linestyle": (0, (3, 1.5)), "label": "measured, set back"}
                left.plot(time[part] - channel.delay, own[part], **earlier)
            left.set_ylabel(label(sensor))
            some = slice(None, None, -(-len(own) // DOTS))
            right.plot(model[some], own[some], ".", color=VEHICLE, markersize=2.0, alpha=0.5)
            ends = [np.nanmin(model), np.nanmax(model)]
            right.plot(ends, ends, color=INK, linewidth=0.8)
            right.set_ylabel("measured")
        grid[-1, 0].set_xlabel("Time in s")
        grid[-1, 1].set_xlabel("simulated")
        legend(fig, max(grid[:, 0], key=lambda axes: len(axes.lines)))
    return fig


def _liveliest(segments: Sequence[slice], values: np.ndarray) -> slice:
    """The stretch of the longest segment in which channels (t, y) move most, each in units of its spread."""
    values = values / np.maximum(np.nanstd(values, axis=0), 1e-300)
    longest = max(segments, key=lambda part: part.stop - part.start)
    begins = np.unique(np.linspace(longest.start, max(longest.stop - STRETCH, longest.start), STRETCHES).astype(int))
    changes = np.nan_to_num(np.diff(values, axis=0)) ** 2
    moves = [float(changes[begin : begin + STRETCH].sum()) for begin in begins.tolist()]
    begin = int(begins[int(np.argmax(moves))])
    return slice(begin, min(begin + STRETCH, longest.stop))


LATE = 4.0  # standard uncertainties, from which a channel is drawn at its own time as well


def time_figure(plot_data: PlotData, sensor_views: list[SensorView]) -> Figure:
    """Residuals over the fitted data, in times the noise."""
    time = continuous_time(plot_data)
    with styled():
        fig = figure(11, 0.9 + 1.25 * len(sensor_views))
        rows = fig.subplots(len(sensor_views), 1, squeeze=False, sharex=True)[:, 0]
        for axes, view in zip(rows, sensor_views, strict=True):
            for scaled, look in _in_noise_of(plot_data, view):
                pale = look | {"alpha": 0.25, "label": None}
                line(axes, *with_gaps(time, plot_data.before.segments, scaled), pale)
                line(axes, *with_gaps(time, plot_data.before.segments, _running_mean(scaled)), look)
            noise_band([axes])
            axes.set_ylabel(f"{spaced(view.sensor.name)}\nin times the noise")
        rows[-1].set_xlabel("Time in s")
        legend(fig, rows[0])
    return fig


def where_figure(plot_data: PlotData, sensor_views: list[SensorView]) -> Figure:
    """Residuals over the motion at the sensor's component: dots, and the mean of each bin."""
    with styled():
        fig = figure(11, 0.9 + 2.1 * len(sensor_views))
        grid = fig.subplots(len(sensor_views), 3, squeeze=False, sharey="row")
        for row, view in zip(grid, sensor_views, strict=True):
            motion = _motion(plot_data, view)
            for axes, (name, x) in zip(row, motion.items(), strict=False):
                for scaled, look in _in_noise_of(plot_data, view):
                    binned(axes, x, scaled, {"color": look["color"], "markersize": 1.5}, look | SMOOTH[look["label"]])
                axes.set_xlabel(name)
                if name.endswith("°"):
                    axes.set_xticks(range(0, 361, 90))
                else:
                    axes.locator_params(axis="x", nbins=5)
            noise_band(row[: len(motion)])
            row[0].set_ylabel(f"{spaced(view.sensor.name)}\nin times the noise")
            for axes in row[len(motion) :]:
                axes.set_axis_off()
        legend(fig, grid[0, 0])
    return fig


def spectrum_figure(plot_data: PlotData, sensor_views: list[SensorView]) -> Figure:
    """Amplitude spectra over frequency and over orders of the rotation; white noise of the stated size is 1."""
    with styled():
        fig = figure(11, 0.9 + 2.1 * len(sensor_views))
        grid = fig.subplots(len(sensor_views), 2, squeeze=False, sharey="row")
        for (left, right), view in zip(grid, sensor_views, strict=True):
            angle = plot_data.before.angle[view.inertia]
            revolves = float(np.ptp(angle)) / (2 * np.pi) > LEAST_REVOLUTIONS
            for scaled, look in _in_noise_of(plot_data, view):
                part = max(plot_data.before.segments, key=lambda part: part.stop - part.start)
                x, y = _spectrum(scaled[part], plot_data.before.step)
                line(left, x[1:], y[1:], look)
                if revolves:
                    line(right, *_orders(scaled, angle), look | SMOOTH[look["label"]])
            noise_line(left)
            left.set(
                xscale="log",
                yscale="log",
                xlabel="Frequency in Hz",
                ylabel=f"{spaced(view.sensor.name)}\nin times the noise",
            )
            if not revolves:
                words = f"{spaced(view.inertia)} makes less than {LEAST_REVOLUTIONS} revolutions"
                right.text(0.5, 0.5, words, transform=right.transAxes, ha="center", color=LIMIT)
                right.set_axis_off()
                continue
            noise_line(right)
            right.set(xlim=(0, HIGHEST_ORDER), xlabel=f"Order, per revolution of {spaced(view.inertia)}")
            right.set_xticks(range(HIGHEST_ORDER + 1))
        legend(fig, grid[0, 0])
    return fig


def _running_mean(residual: np.ndarray) -> np.ndarray:
    """Mean (t,) of the values about each sample, NaN where there is none."""
    present = np.isfinite(residual)
    total, count = (
        scipy.ndimage.uniform_filter1d(values, MEAN_OVER) for values in (np.nan_to_num(residual), present.astype(float))
    )
    return np.divide(total, count, out=np.full(len(residual), np.nan), where=present)


def _in_noise_of(plot_data: PlotData, view: SensorView) -> Iterator[tuple[np.ndarray, dict[str, Any]]]:
    """A sensor's residuals (t,) in times its noise, with their line styles; of those of the whole recording."""
    for residual, look in styled_residuals(plot_data.residual_before, plot_data.residual_after):
        if len(residual) == len(plot_data.before.time):
            yield residual[:, view.index] / plot_data.noise[view.index], look


def _motion(plot_data: PlotData, view: SensorView) -> dict[str, np.ndarray]:
    motion = plot_data.before
    over = {f"Speed of {spaced(view.inertia)} in rad/s": motion.speed[view.inertia]}
    if view.shaft is not None:
        over[f"Torque of {spaced(view.shaft)} in N·m"] = motion.torque[view.shaft]
    angle = motion.angle[view.inertia]
    if np.ptp(angle) > 2 * np.pi:
        over[f"Angle of {spaced(view.inertia)} within a revolution in °"] = np.degrees(angle) % 360
    else:
        over[f"Angle of {spaced(view.inertia)} in rad"] = angle
    return over


def _spectrum(residual: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (f,) and amplitudes (f,), 1 for white noise of the stated size; missing samples count as 0.

    A sensor that is recorded more slowly than others is taken at its own rate.
    """
    residual, every = _at_its_rate(residual)
    step *= every
    length = min(len(residual), WELCH_SAMPLES)
    frequency, power = scipy.signal.welch(np.nan_to_num(residual), 1 / step, nperseg=length, detrend=False)
    return frequency, np.sqrt(power / (2 * step))


def _at_its_rate(residual: np.ndarray) -> tuple[np.ndarray, float]:
    """A residual at the rate at which its sensor was recorded, and how many samples apart that is."""
    present = np.flatnonzero(np.isfinite(residual))
    steps = np.diff(present)
    if not len(steps):
        return residual, 1
    if steps.max() == steps.min() + 1 and UNEVEN < np.mean(steps == steps.max()) < 1 - UNEVEN:  # 2.5 apart, say
        even = np.linspace(present[0], present[-1], len(present))
        return np.interp(even, present, residual[present]), float(even[1] - even[0])
    every = int(np.median(steps))
    return residual[present[0] % every :: every] if every > 1 else residual, every


def _orders(residual: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Orders (f,) and amplitudes (f,) of a residual over an angle (t,) in rad, 1 for white noise.

    Lomb (1976) and Scargle (1982): the angle need not grow evenly, nor always in one direction.
    """
    orders = np.arange(0.1, HIGHEST_ORDER + 0.05, 0.05)
    present = np.isfinite(residual)
    size = max(-(-present.sum() // MOST_SAMPLES), 1)
    count = present.sum() // size
    angle, residual = (
        values[present][: count * size].reshape(count, size).mean(axis=1) for values in (angle, residual)
    )
    # a mean of n has 1/n of the noise's power
    return orders, np.sqrt(size * scipy.signal.lombscargle(angle, residual, orders))


# --- The figures of a diagnosis by name, with their captions.

SENSORS_IN_DETAIL = 3  # with a row each in the figures over motion and frequency


def pictures(diagnosis: Diagnosis) -> dict[str, Picture]:
    """Measured and simulated on held-out data first; errors, residuals over time, motion and frequency, balance."""
    shown, system = diagnosis.pictured, diagnosis.extended
    plot_data = shown.plot_data
    sensor_views = views(system, plot_data)
    detailed = sensor_views[:SENSORS_IN_DETAIL]
    draw: dict[str, Callable[[], Figure]] = {
        "channels": lambda: channels_figure(plot_data, system, diagnosis.channels),
        "unseen": lambda: holdout_figure(plot_data.holdout, sensor_views),
        "errors": lambda: errors_figure(shown.errors),
        "balance": lambda: balance_figure(plot_data),
        "time": lambda: time_figure(plot_data, sensor_views),
        "where": lambda: where_figure(plot_data, detailed),
        "spectrum": lambda: spectrum_figure(plot_data, detailed),
    }
    if shown.discrepancy:
        draw["discrepancy"] = lambda: discrepancy_figure(shown.discrepancy)
    return {name: Picture(make, CAPTIONS[name]) for name, make in draw.items()}


# --- A diagnosis in words, from the content of ``diagnosis.json``: one sentence, and a summary for a terminal.

PLACES = {
    "shafts": "the shaft", "gears": "the gear", "inertias": "the inertia",
    "inputs": "the input", "sensors": "the sensor",
}  # fmt: skip
LEAST_RIVAL_CONFIDENCE = 0.1  # from which the answer names a rival
LEAST_BESIDE = 0.3  # of what a cause leaves, from which the answer says over what a free torque takes it
ALIKE_SHARE = 0.9  # of the share of a cause, from which another one ties with it
MOST_RIVALS = 3  # that the answer names beside one cause
LEAST_SHOWN = 2.5e-5  # of a fidelity's standard uncertainty: twice that is 0.00 % where it is less


def answer(result: Mapping[str, Any]) -> str:
    """The answer in one sentence."""
    moved = [row["name"] for row in result.get("channels", []) if row["exchanged_with"]]
    if moved:
        rest = answer({**result, "channels": []})
        names = f"{', '.join(moved[:-1])} and {moved[-1]}"
        return f"The channels {names} look exchanged. Put in order: {rest[:1].lower()}{rest[1:]}"
    causes = certain(result)
    if result["verdict"] == "adequate":
        largest = max((_in_noise(error, "after_holdout") or 0.0 for error in result["errors"].values()), default=0.0)
        return (
            "The model is adequate: on held-out data no sensor's error is larger than "
            f"{number(largest, 3)} times its noise."
        )
    if not causes:
        worst = _worst(result["errors"])
        size = "" if worst is None else f": the error of {worst[0]} is {number(worst[1], 3)} times the noise"
        ended = any(note.endswith(BEST_SO_FAR) for note in result.get("notes", []))
        none = "None of the effects that were tried before the end" if ended else "None of the known effects"
        return f"{none} explains what the model misses{size} on held-out data{_doubtful(result)}."
    clauses = [clause(cause) + _rivals(cause) if named(cause) else _something(cause) for cause in causes]
    text = clauses[0] if len(clauses) == 1 else f"{', '.join(clauses[:-1])}, and {clauses[-1]}"
    text = (
        "in this recording " if result.get("judged_by") == "blocks" and result["verdict"] != "explained" else ""
    ) + text
    text = text[:1].upper() + text[1:] if text.startswith(("the ", "each ", "in ", "something ")) else text
    if changed := _changed_most(result["errors"]):
        text += f"; with {'it' if len(causes) == 1 else 'them'} the error of {_pooled(result)}{' and '.join(changed)}"
        text += " times the noise on held-out data"
    return text + (
        "." if result["verdict"] == "explained" else f", and an unexplained error remains{_doubtful(result)}."
    )


def certain(result: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The causes that the extended model has."""
    return [cause for cause in result["causes"] if cause.get("in_model", True)]


NAMED = 0.5  # share of a kind from which the answer gives its name, as DiagnosisSettings.named


def named(cause: Mapping[str, Any]) -> bool:
    """Whether the kind of a cause is told from its rivals and from a free force."""
    return bool(cause.get("confidence", 1.0) >= NAMED)


def _something(cause: Mapping[str, Any]) -> str:
    """A cause in the model whose kind is open: something is at the shaft link, most like hysteresis (0.28)."""
    values = ", ".join(f"{spaced(key)} {measured(estimate)}" for key, estimate in cause["parameters"].items())
    text = f"something is at {_subject(cause['at'])}, most like {spaced(cause['kind'])}"
    text += f" ({cause['confidence']:.2f}; {values})"
    least = max(LEAST_RIVAL_CONFIDENCE, ALIKE_SHARE * cause["confidence"])
    rivals = [kind_and_place(rival) for rival in cause["alternatives"] if rival["confidence"] >= least]
    if rivals:
        return text + f", not told from {' or '.join(rivals[:MOST_RIVALS])}"
    beside = cause.get("beside", {"share": 0.0})
    if beside["share"] > LEAST_BESIDE:
        text += f", beside which a free torque over {beside['over']} takes {percent(beside['share'])} of the rest"
    return text


def there(cause: Mapping[str, Any]) -> float:
    """Probability that something is at the place of a cause; of an older result, its confidence in the place."""
    return float(cause.get("there", cause.get("place_confidence", 1.0)))


def _left_by(cause: Mapping[str, Any]) -> str:
    """Error of the sensor that gains most by a cause, without and with it, in times the noise."""
    rows = [(name, pair["without"], pair["with"]) for name, pair in cause.get("left", {}).items()]
    if not rows:
        return ""
    name, before, after = min(rows, key=lambda row: row[2] / max(row[1], SMALLEST_ERROR))
    return f"{name} {number(before, 3)} → {number(after, 3)}"


def _doubtful(result: Mapping[str, Any]) -> str:
    """Where something is whose kind or size is not known, as the end of a sentence; empty where nothing is."""
    rest = [cause for cause in result["causes"] if not cause.get("in_model", True)]
    where = dict.fromkeys(_subject(cause["at"]) for cause in rest)
    reasons = dict.fromkeys(WHY_NOT.get(cause.get("why_not") or "", UNKNOWN_WHY) for cause in rest)
    return f"; something may be at {' and at '.join(where)}, but {' or '.join(reasons)}" if where else ""


UNKNOWN_WHY = "its kind or its size is not certain"
WHY_NOT = {
    "by_chance": "unseen data gain no more by it than by chance",
    "within_uncertainty": "its values are no larger than their uncertainty",
    "explains_little": "it explains little of what is left",
    "second_recording": "a second recording is met worse with it",
    "table": "a table of the torque takes its place",
    "map": "the input of a machine times a curve over its speed or angle explains more: look at its torque map",
}


def _pooled(result: Mapping[str, Any]) -> str:
    """The error of all sensors together on held-out data, over their ranges; empty for a single sensor."""
    gain = result.get("gain", {})
    before, after = gain.get("nrmse_before"), gain.get("nrmse_after")
    if len(result["errors"]) < 2 or before is None or after is None:
        return ""
    falls = "rises" if after > before else "falls"
    return f"all sensors {falls} from {percent(before)} to {percent(after)} of their range, that of "


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
    text = plus_minus(estimate["value"], estimate["standard_uncertainty"])
    return f"{text} {unit(estimate['unit'])}".rstrip()


def _in_noise(error: Mapping[str, float | None], key: str) -> float | None:
    """A root mean square error in times the sensor's noise; None where it is unknown."""
    value, noise = error[key], error["noise"]
    return None if value is None or not noise else value / noise


def _by_sensor(errors: Mapping[str, Mapping[str, float | None]]) -> list[tuple[str, float, float]]:
    """Errors on held-out data before and after, in times the noise, of the sensors where both are known."""
    rows = [
        (name, _in_noise(error, "before_holdout"), _in_noise(error, "after_holdout")) for name, error in errors.items()
    ]
    return [(name, before, after) for name, before, after in rows if before is not None and after is not None]


def _worst(errors: Mapping[str, Mapping[str, float | None]]) -> tuple[str, float, float] | None:
    """The sensor with the largest error that is left on held-out data; before and after in times its noise."""
    return max(_by_sensor(errors), key=lambda row: row[2], default=None)


RISES = 1.05  # ratio of errors from which that of a sensor is said to rise beside one that falls
SMALLEST_ERROR = 1e-12  # in times the noise: of a sensor that is met exactly


def _changed_most(errors: Mapping[str, Mapping[str, float | None]]) -> list[str]:
    """How far the error falls of the sensor that gains most, and rises of that which loses most, if one does."""
    ratios = sorted(_by_sensor(errors), key=lambda row: row[2] / max(row[1], SMALLEST_ERROR))
    shown = ratios[:1]
    if ratios[1:] and ratios[-1][2] > RISES * max(ratios[-1][1], 1.0):
        shown.append(ratios[-1])
    return [
        f"{'that of ' if i else ''}{name} {'rises' if after > before else 'falls'} from {number(before, 3)} to "
        f"{number(after, 3)}"
        for i, (name, before, after) in enumerate(shown)
    ]


def summary(result: Mapping[str, Any]) -> str:
    """The result for a terminal: the answer, what to do next, then the evidence."""
    return in_terminal(report(result))


def shape(curve: Mapping[str, Any]) -> str:
    """What no cause explains, as a torque over one variable."""
    text = f"what remains has a shape: a torque over the {curve['over']} of {curve['at']} would take "
    text += f"{percent(curve['share'])} of it"
    if curve["repeats"] is not None:
        text += f"; the curves of both halves of the data correlate by {number(curve['repeats'], 2)}"
    return text


def to_correct(result: Mapping[str, Any]) -> list[str]:
    """What to correct in the model or channel file before the causes are believed: exchanged or reversed channels, and
    ranges that are too narrow, for what a quantity at its bound cannot take a false cause may have taken."""
    steps = [
        f"{row['name']} has the readings of {row['exchanged_with']}: exchange them in the channel file"
        for row in result.get("channels", [])
        if row["exchanged_with"]
    ]
    for cause in result["causes"]:
        if _sign_is_reversed(cause, result["errors"]):
            steps.append(f"the sign of {place(cause['at'])} is probably reversed: change it in the channel file")
    at_bound = [name for name, estimate in result["parameters"].items() if "at the bound" in estimate.get("note", "")]
    if at_bound:
        ends = "ends at the bound of its range" if len(at_bound) == 1 else "end at the bounds of their ranges"
        steps.append(f"{', '.join(at_bound)} {ends}: widen that in the model file, unless physics sets it")
    return [f"{step}, and run again" for step in steps]


REVERSED = 0.05  # distance of a factor from −1 up to which it says that a sign is reversed
NEAR_NOISE = 2.0  # error in times the noise up to which a reversed sign explains a channel


def _sign_is_reversed(cause: Mapping[str, Any], errors: Mapping[str, Any]) -> bool:
    """Whether a cause is a factor of −1 within its uncertainty, and leaves no more than noise of what it acts on."""
    gain = cause["parameters"].get("factor")  # of an input or a sensor
    if gain is None:
        return False
    uncertainty = gain.get("standard_uncertainty") or 0.0
    if not (abs(gain["value"] + 1) <= max(2 * uncertainty, REVERSED) and gain["value"] < -2 * uncertainty):
        return False
    places = [cause["at"]] if isinstance(cause["at"], str) else cause["at"]
    names = [at.split(".")[1] for at in places if at.startswith("sensors.")] or list(errors)
    return all((errors[name]["after"] or 0.0) <= NEAR_NOISE * errors[name]["noise"] for name in names)


def not_identifiable(result: Mapping[str, Any]) -> list[str]:
    """Names of the quantities that these recordings do not determine."""
    parameters = result["parameters"].items()
    return [name for name, estimate in parameters if "not identifiable" in estimate.get("note", "")]


# --- The report of a diagnosis.

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
    "within_uncertainty": "its values do not differ from those of no effect",
    "negligible": "its torque is too small to matter",
    "by_chance": "held-out data are not met better with it beyond chance",
    "no_fit": "it has no fit",
}
NO_CAUSE = "More than noise remains, and no known effect explains enough of it to be named."
NOTHING_NAMED = "No cause is named and no effect is added: extended.toml is the base model with its fitted values."
HOW_CHANNELS = (
    "Times, signs and gains against most channels, from pairs: one channel drives the part of the model between them, "
    "the other is compared (nothing where that is open). Measured over simulated, by the model as given, fitted, from "
    "least squares: a wrong model shows there as well."
)
HOW_ERRORS = (
    "Root mean square of measured minus simulated; the simulation starts from fitted states and uses no measured "
    "sensor afterwards."
)
HOW_CAUSES = (
    "There: probability that unseen data are met better with it. Kind: its share among its rivals, at most what a free "
    "force at its place leaves of it. Left: error of the sensor that gains most, on unseen data, without and with it."
)
HOW_CANDIDATES = (
    "Every candidate was refitted together with all uncertain quantities. The confidence weighs fitted and held-out "
    "data; χ² counts independent samples."
)


def content(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of ``diagnosis.json``: the answer in a sentence first, then the diagnosis."""
    result = diagnosis.to_dict()
    return {"answer": answer(result), **result}


def report(
    result: Mapping[str, Any], folder: str = "", made: Provenance | None = None, diagnosis: Diagnosis | None = None
) -> Report:
    """What a diagnosis says."""
    verdict, causes, system = result["verdict"], result["causes"], diagnosis.extended if diagnosis else None
    units = {sensor.name: unit(sensor.unit) for sensor in system.sensors} if system else {}
    title = system.title if system else ""
    rest = [
        {"sensor": row["sensor"], "in times the noise": number(row["ratio"], 3),
         "at its largest": number(row["worst_ratio"], 3), "from … to": f"{row['from']:.4g} to {row['to']:.4g} s",
         "speeds there, rad/s": _spans(row["speed"]), "torques there, N·m": _spans(row["torque"])}
        for row in result["rest"]
    ]  # fmt: skip
    quantities = [
        {"quantity": name, "value, standard uncertainty": measured(estimate), "": estimate.get("note", "")}
        for name, estimate in result["parameters"].items()
    ]
    return Report(
        title=f"Diagnosis: {title}" if title else "Diagnosis of a model",
        status=verdict,
        answer=answer(result),
        good=verdict != "unexplained",
        lists={"What to do next": [Step(step) for step in _to_do(result)]},
        table=Table([_cause(cause, result.get("discrepancy", [])) for cause in causes], HOW_CAUSES if causes else ""),
        folds=[
            Fold("The channels, before any physics",
                 [*_channels(result.get("channels", []), units), Show("channels")], told=True),
            Fold("What the verdict means", [NO_CAUSE if verdict == "unexplained" and not causes else MEANING[verdict]]),
            Fold("Evidence for the causes", [_evidence(cause) for cause in causes] or [NOTHING_NAMED], told=True),
            Fold("Errors before and after, on fitted and on held-out data",
                 [Table(_errors(result, units), HOW_ERRORS), Show("errors")], told=True),
            Fold("Where the base model fails", [Show("balance"), Show("time"), Show("where"), Show("spectrum")]),
            Fold("Error that remains after the extension",
                 [Table(rest), [*map(shape, result.get("discrepancy", [])), *_kept(result)], Show("discrepancy")]
                 if rest or result.get("discrepancy") else [], told=bool(rest)),
            Fold("Fidelity as a residual vehicle model",
                 _fidelity(result["fidelity"]) if result["fidelity"] else [], told=True),
            Fold("Candidates", _candidates(result["candidates"])),
            Fold("Fit report: values, standard uncertainties, correlations",
                 [Table(quantities), Table(_correlations(result))] if quantities or result.get("correlations")
                 else ["Only the start states were fitted."]),
        ],
        notes=result["notes"],
    )  # fmt: skip


def _channels(channels: Sequence[Mapping[str, Any]], units: Mapping[str, str]) -> list[Any]:
    """The audit of the channels, a row each."""
    rows = []
    for row in channels:
        late, step = row["delay"], row["resolution"]
        rows.append({
            "channel": row["name"], "readings of": row["exchanged_with"],
            "late": "" if late is None else f"{number(1e3 * late, 3)} ± {number(1e3 * row['delay_uncertainty'], 2)} ms",
            "gain": "" if row["gain"] is None else f"{number(row['gain'], 4)} ± {number(row['gain_uncertainty'], 2)}",
            "measured over simulated": "" if row["over_simulated"] is None else number(row["over_simulated"], 4),
            "rounded to": f"{number(step, 3)} {units.get(row['name'], '')}".rstrip() if step else "",
            "between samples": row["between"], "hum": row["hum"],
        })  # fmt: skip
    return [Table(rows, HOW_CHANNELS)] if rows else []


def _correlations(result: Mapping[str, Any]) -> list[dict[str, str]]:
    """Pairs of fitted values that the recording does not tell apart well, the most correlated first."""
    return [
        {"value": row["first"], "and": row["second"], "correlation": number(row["correlation"], 3)}
        for row in result.get("correlations", [])
    ]


def _spans(spans: Mapping[str, Sequence[float]]) -> str:
    return "; ".join(f"{name} {number(low, 3)} … {number(high, 3)}" for name, (low, high) in spans.items())


def _to_do(result: Mapping[str, Any]) -> list[str]:
    """What the reader should do, in sentences."""
    steps = [f"{step[:1].upper()}{step[1:]}." for step in to_correct(result)]
    if certain(result):
        gain = result.get("gain", {})
        before, after = gain.get("nrmse_before"), gain.get("nrmse_after")
        if before is None or after is None or after < before:
            steps.append("Use extended.toml: it is the model with the named causes, and every command reads it.")
        else:
            steps.append("Do not use extended.toml: unseen data are not met better with it.")
        if result.get("judged_by") == "blocks" and result["verdict"] != "explained":
            steps.append(
                "Record another drive and give it with --holdout: blocks of one drive share its temperature and its "
                "excitation, so they cannot tell whether the causes hold elsewhere."
            )
    for cause in certain(result):
        if cause["kind"] == SensorRipple.kind:
            name = cause["at"].split(".")[1]
            steps.append(
                f"Mount {name} anew or correct it where it is read: its error turns with its shaft, and "
                f"correction_{name}.csv has it over one turn."
                if _repeats(cause["parameters"]["order"])
                else f"Look at {name}: its error turns with a shaft, but not with a whole number of periods a turn."
            )
    if result["next_recording"]:
        words = result["next_recording"]
        steps.append(f"{words[:1].upper()}{words[1:]}.")
    elif result["verdict"] == "unexplained":
        steps.append(
            "Add a sensor near the component where the remaining error is largest, or look for an effect that the "
            "program does not know: no rival of a named cause is left that another recording could separate."
        )
    if unidentified := not_identifiable(result):
        steps.append(
            f"Do not rely on the fitted values of {', '.join(unidentified)}: these data do not determine them "
            "(not identifiable)."
        )
    return steps or ["Nothing: the model can be used, and no further recording is needed."]


def _cause(cause: Mapping[str, Any], curves: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """A row of the table; of a cause that is not sure of its kind or size: something at its place, and its shape."""
    values = [f"{spaced(key)} {measured(estimate)}" for key, estimate in cause["parameters"].items()]
    known, where = cause.get("in_model", True), [cause["at"]] if isinstance(cause["at"], str) else cause["at"]
    sure = named(cause)
    shapes = [curve for curve in curves if any(at.startswith(curve["at"]) for at in where)]
    looks = [f"torque over the {one['over']}, {number(100 * one['share'], 2)} % of the rest" for one in shapes[:1]]
    return {
        "cause": spaced(cause["kind"]) if sure else f"something, most like {spaced(cause['kind'])}",
        "at": place(cause["at"]), "values, standard uncertainty": ", ".join(values),
        "there": f"{there(cause):.2f}", "kind": f"{cause['confidence']:.2f}",
        "left, in times the noise": _left_by(cause),
        "in extended.toml": "yes" if known else f"no: {WHY_NOT.get(cause.get('why_not') or '', UNKNOWN_WHY)}",
        "shape": "; ".join(looks) if not (known and sure) else "",
    }  # fmt: skip


def _evidence(cause: Mapping[str, Any]) -> list[str]:
    notes = [f"{key}: {estimate['note']}" for key, estimate in cause["parameters"].items() if "note" in estimate]
    rivals = [f"{kind_and_place(rival)} ({rival['confidence']:.2f})" for rival in cause["alternatives"][:3]]
    said = f"{kind_and_place(cause)}, there {there(cause):.2f}, kind {cause['confidence']:.2f}: {cause['evidence']}"
    return [said, *notes, *([f"rivals: {', '.join(rivals)}"] if rivals else [])]


def _errors(result: Mapping[str, Any], units: Mapping[str, str]) -> list[dict[str, str]]:
    """A row a sensor; the last one for all of them, each over its range."""
    keys = {
        "before": "base model, fitted data", "after": "extended, fitted data",
        "before_holdout": "base model, held-out data", "after_holdout": "extended, held-out data",
    }  # fmt: skip
    rows = [
        {"sensor": name, "noise": f"{number(error['noise'], 3)} {units.get(name, '')}".rstrip()}
        | {head: number(error[key], 3) for key, head in keys.items()}
        | {"in times the noise": number(_in_noise(error, "after_holdout"), 3)}
        for name, error in result["errors"].items()
    ]
    gain = result["gain"]
    shares = (gain["noise_floor"], None, None, gain["nrmse_before"], gain["nrmse_after"])
    cells = [percent(share) if share is not None else "" for share in shares]
    heads = ("noise", *keys.values())
    return [*rows, {"sensor": "all sensors, each over its range", **dict(zip(heads, cells, strict=True)),
                    "in times the noise": ""}]  # fmt: skip


def _kept(result: Mapping[str, Any]) -> list[str]:
    """Of the torque that the extended model keeps as a table."""
    if not (kept := result.get("kept_discrepancy")):
        return []
    before, after = percent(kept["nrmse_before"]), percent(kept["nrmse_after"])
    return [
        f"the extended model keeps the torque over the {kept['over']} of {kept['at']} as a table: the error of "
        f"held-out data falls from {before} to {after} of the sensors' ranges"
    ]


def _candidates(candidates: Sequence[Mapping[str, Any]]) -> list[Any]:
    """By the cause that they could replace, then those that were fitted by themselves."""
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for candidate in candidates:
        groups.setdefault(candidate["instead_of"] or "", []).append(candidate)
    alone = groups.pop("", [])
    blocks: list[Any] = []
    for cause, rows in groups.items():
        named = next(row["chi_square"] for row in rows if kind_and_place(row) == cause)
        blocks += [
            f"Instead of {cause}:",
            Table([
                {"candidate": spaced(row["kind"]), "at": place(row["at"]),
                 "residual, in times the noise": number(row["misfit"]),
                 "χ² minus that of the cause": number(row["chi_square"] - named, 3),
                 "confidence": f"{row['confidence']:.2g}"}
                for row in rows
            ], HOW_CANDIDATES),
        ]  # fmt: skip
    if alone:
        rows = [
            {"candidate": spaced(row["kind"]), "at": place(row["at"]),
             "residual, in times the noise": number(row["misfit"]), "held-out data": number(row["misfit_holdout"]),
             "why it was not taken": REASONS[row["not_taken"] or ""] + (f": {row['why']}" if "why" in row else "")}
            for row in alone
        ]  # fmt: skip
        blocks += ["Fitted alone and not taken:", Table(rows, HOW_CANDIDATES)]
    return blocks or ["No candidate was worth a fit."]


def _fidelity(fidelity: Mapping[str, Any]) -> list[Any]:
    before, after = fidelity["before"], fidelity["after"]
    rows: list[tuple[str, ...]] = []
    for base, extended in zip(before["signals"], after["signals"], strict=True):
        delays = f"delay: {_delay(base)} base model, {_delay(extended)} extended"
        for key, what in (("R_NRMSE", "deviation over the range of the measurement"), ("R_tau", delays)):
            rows.append(
                (f"{base['name']}, {key.replace('tau', 'τ')}", percent(base[key]), percent(extended[key]), what)
            )
    for name, u, what in (
        ("R_RVM", "R_RVM_standard_uncertainty", "the model's simulation against the measurement, all sensors (Eq. 21)"),
        ("R_MU", None, "uncertainty of the sensors over the range of the measurement (Eqs. 22, 23)"),
        ("R_XiL", "standard_uncertainty", "both, without R_SD, which needs a test bed (Eq. 16)"),
    ):
        cells = [percent(side[name]) + (f" ± {percent(2 * side[u])}" if u and side[u] > LEAST_SHOWN else "")
                 for side in (before, after)]  # fmt: skip
        rows.append((name, *cells, what))
    note = (
        f"XiL fidelity by Eqs. 14 to 23 of the paper as defined, delay included, on held-out data up to "
        f"{number(fidelity['f_max'])} Hz; the uncertainty (k = 2) is that of the noise and of the delays. A perfect "
        f"model reaches R_RVM = {percent(fidelity['noise_floor']['R_RVM'])} because of the noise."
    )
    heads = ("", "base model", "extended", "what it compares")
    return [Table([dict(zip(heads, row, strict=True)) for row in rows], note), list(fidelity["notes"])]


def _delay(signal: Mapping[str, Any]) -> str:
    if signal["delay"] is None:
        return f"not determined ({signal['delay_undetermined']})"
    return f"{number(1e3 * signal['delay'], 3)} ± {number(1e3 * signal['delay_standard_uncertainty'], 2)} ms"


# --- The errors of sensors that turn with their shafts, as tables to load where the sensor is read.

WHOLE = 0.02  # of an order, from a whole number: an error of another order does not repeat every turn
SURE = 3.0  # standard uncertainties of the order, by which it may be further away


def corrections(diagnosis: Diagnosis) -> dict[str, str]:
    """``correction_SENSOR.csv`` of every error of a sensor in the extended model that repeats every turn."""
    return {
        f"correction_{cause.at.split('.')[1]}.csv": _correction(cause, diagnosis.extended)
        for cause in diagnosis.causes
        if cause.kind == SensorRipple.kind and cause.in_model and _repeats(cause.parameters["order"].to_dict())
    }


def _repeats(order: Mapping[str, Any]) -> bool:
    """Whether an order, with its uncertainty, may be a whole number."""
    away = abs(order["value"] - round(order["value"]))
    return round(order["value"]) > 0 and away < max(WHOLE, SURE * (order.get("standard_uncertainty") or 0.0))


def _correction(cause: NamedCause, system: System) -> str:
    table = correction({key: estimate.value for key, estimate in cause.parameters.items()})
    sensor = next(sensor for sensor in system.sensors if f"sensors.{sensor.name}" == cause.at)
    angle, error = (np.degrees(table[:, i]) for i in (0, 1))
    if sensor.measures == "angle":
        head = ["true angle in deg", "subtract from the reading in deg"]
        return csv_table(head, zip(angle, error, strict=True))
    head = ["angle from where the recording begins in deg", "divide the reading by"]
    return csv_table(head, zip(angle, 1 + table[:, 2], strict=True))


# --- The extended model as a file: its values with their uncertainty, where they come from, and the three answers.

RANGE = 3.0  # standard uncertainties to each side of a fitted quantity: its range from now on


def extended_file(diagnosis: Diagnosis) -> str:
    """The text of ``extended.toml``: comments that say how sure every value is, then the model. The range of a fitted
    quantity is the stated one as far as the fit leaves it open."""
    result = diagnosis.to_dict()
    sources = ", ".join(dict.fromkeys(Path(source).name for source in diagnosis.sources))
    lines = [f"Fitted to {sources or 'a recording'}, {made_from('', None).date}. Value ± standard uncertainty:"]
    lines += [_sure(name, estimate) for name, estimate in result["parameters"].items()]
    for cause in certain(result):
        lines.append(f"effect {kind_and_place(cause)}:")
        lines += [f"  {_sure(key, estimate)}" for key, estimate in cause["parameters"].items()]
        left = _left_by(cause)
        lines.append(f"  there {there(cause):.2f}, kind {cause['confidence']:.2f}" + (f", left {left}" if left else ""))
    if len(lines) > 1 or certain(result):
        return "".join(f"# {line}\n" for line in lines) + "\n" + dumps(_with_ranges(diagnosis))
    return dumps(diagnosis.extended)


def _sure(name: str, estimate: Mapping[str, Any]) -> str:
    return f"{name} = {measured(estimate)}" + (f", {estimate['note']}" if estimate.get("note") else "")


def _with_ranges(diagnosis: Diagnosis) -> System:
    """The extended model with the ranges of its fitted quantities as the fit leaves them; one at a bound, or that the
    recording does not determine, keeps its range."""
    ranges = {}
    for name, estimate in diagnosis.parameters.items():
        quantity = diagnosis.extended.parameters.get(name)
        if quantity is None or quantity.lower is None or quantity.upper is None or estimate.note:
            continue
        away = RANGE * estimate.standard_uncertainty
        low, high = max(quantity.lower, quantity.value - away), min(quantity.upper, quantity.value + away)
        if low < quantity.value < high:
            ranges[name] = low, high
    return diagnosis.extended.with_ranges(ranges)


register(
    Diagnosis,
    View(
        "diagnosis.json", report, pictures, content,
        others=lambda diagnosis: {"extended.toml": extended_file(diagnosis), **corrections(diagnosis)},
    ),
)  # fmt: skip
