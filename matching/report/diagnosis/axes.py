"""What the figures of a diagnosis share: line styles, the sensors they show, and axes in multiples of the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.ticker import FixedLocator, NullLocator, StrMethodFormatter

from matching.diagnosis.verdict.result import PlotData
from matching.report.common.log_ticks import plain_ticks
from matching.report.common.style import BAND, EXTENDED, NOISE, RIG, VEHICLE
from matching.report.common.wording import unit
from modelling.model.components import Sensor
from modelling.model.system import System

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
MOST_VECTOR_POINTS = 1500  # a longer line is stored as pixels, so that files stay small
LONGEST_JOINED = 3  # times the usual distance of a sensor's samples: what is longer is a gap
LINEAR_TO = 10  # times the noise; beyond, the axis is logarithmic
LEAST_RANGE = 6.0  # times the noise, either way


@dataclass(frozen=True)
class View:
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


def views(system: System, plot_data: PlotData) -> list[View]:
    """The sensors with the largest residuals of the base model, in times their noise, largest first."""
    with np.errstate(invalid="ignore"):
        misfit = _rms(plot_data.residual_before) / plot_data.noise
    order = [int(j) for j in np.argsort(-np.nan_to_num(misfit, nan=-1.0)) if np.isfinite(misfit[j])]
    return [_view(system, plot_data, j) for j in order[:SENSORS_SHOWN]]


def _view(system: System, plot_data: PlotData, j: int) -> View:
    sensor, motion = system.sensors[j], plot_data.before
    if sensor.measures == "torque":
        return View(j, sensor, motion.ends[sensor.of][0], sensor.of)
    attached = [name for name, ends in motion.ends.items() if sensor.of in ends]
    liveliest = max(attached, key=lambda name: float(np.std(motion.torque[name])), default=None)
    return View(j, sensor, sensor.of, liveliest)


def _rms(residual: np.ndarray) -> np.ndarray:
    count = np.isfinite(residual).sum(axis=0)
    return np.where(count, np.sqrt(np.nansum(residual**2, axis=0) / np.maximum(count, 1)), np.nan)


def styled_residuals(before: np.ndarray, after: np.ndarray) -> tuple[tuple[np.ndarray, dict[str, Any]], ...]:
    """Residuals (t,) before and after with their line styles; only those before where no effect was added."""
    if np.array_equal(before, after, equal_nan=True):
        return ((before, BEFORE),)
    return (before, BEFORE), (after, AFTER)


def label(sensor: Sensor) -> str:
    """Name and unit of a sensor's reading."""
    return f"{sensor.name}\nin {unit(sensor.unit)}"


def line(axes: Any, x: np.ndarray, y: np.ndarray, look: dict[str, Any]) -> None:
    """A line through points x (t,), y (t,), stored as pixels if it is long."""
    axes.plot(x, y, rasterized=len(x) > MOST_VECTOR_POINTS, **look)


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


def logarithmic(axes: Any) -> None:
    """Logarithmic axes with few ticks and plain numbers."""
    axes.set(xscale="log", yscale="log")
    plain_ticks(axes.xaxis)
    plain_ticks(axes.yaxis)


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
