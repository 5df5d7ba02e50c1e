"""What the figures of a diagnosis share: how models are drawn, which sensors are shown, what a sensor goes with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.ticker import FixedLocator, LogLocator, NullFormatter, NullLocator, StrMethodFormatter

from matching.diagnosis.verdict.result import PlotData
from matching.report.common.style import BAND, MATCHED, NOISE, RIG, VEHICLE
from matching.report.common.wording import unit
from modelling.model.components import Sensor
from modelling.model.system import System

# In grey too: broad and pale against fine and full, and smooth curves dashed against solid.
BEFORE: dict[str, Any] = {
    "color": RIG, "linewidth": 1.8, "alpha": 0.5, "label": "model as given, fitted", "zorder": 2.2,
}  # fmt: skip
AFTER: dict[str, Any] = {"color": MATCHED, "linewidth": 0.8, "label": "extended model", "zorder": 2.4}
SMOOTH: dict[str, dict[str, Any]] = {
    BEFORE["label"]: {"linestyle": (0, (5, 1.6)), "linewidth": 1.6, "alpha": 1.0},
    AFTER["label"]: {"linewidth": 1.6},
}
MEASURED: dict[str, Any] = {"color": VEHICLE, "linewidth": 3.6, "alpha": 0.4, "label": "measured", "zorder": 2.0}
MOST = 4  # sensors that a figure shows
SHORT = 200  # of the high to the low end of a logarithmic axis, up to which the ticks between decades are told
MANY = 1500  # points beyond which a line is kept as pixels, so that files stay small


@dataclass(frozen=True)
class View:
    """One sensor with the motion at its place: speed and angle of an inertia, torque of a shaft, by label."""

    index: int
    sensor: Sensor
    inertia: str
    shaft: str | None


def views(system: System, plot_data: PlotData) -> list[View]:
    """The sensors that are off most before, worst first."""
    with np.errstate(invalid="ignore"):
        off = _rms(plot_data.residual_before) / plot_data.noise
    order = [int(j) for j in np.argsort(-np.nan_to_num(off, nan=-1.0)) if np.isfinite(off[j])]
    return [_view(system, plot_data, j) for j in order[:MOST]]


def _view(system: System, plot_data: PlotData, j: int) -> View:
    sensor, seen = system.sensors[j], plot_data.before
    if sensor.measures == "torque":
        return View(j, sensor, seen.ends[sensor.of][0], sensor.of)
    near = [name for name, ends in seen.ends.items() if sensor.of in ends]
    return View(j, sensor, sensor.of, max(near, key=lambda name: float(np.std(seen.torque[name])), default=None))


def _rms(residual: np.ndarray) -> np.ndarray:
    count = np.isfinite(residual).sum(axis=0)
    return np.where(count, np.sqrt(np.nansum(residual**2, axis=0) / np.maximum(count, 1)), np.nan)


def told_apart(before: np.ndarray, after: np.ndarray) -> tuple[tuple[np.ndarray, dict[str, Any]], ...]:
    """Residuals before and after with their looks; one of them where no effect was added."""
    if np.array_equal(before, after, equal_nan=True):
        return ((before, BEFORE),)
    return (before, BEFORE), (after, AFTER)


def label(sensor: Sensor) -> str:
    """Name and unit of a sensor's reading."""
    return f"{sensor.name}\nin {unit(sensor.unit)}"


def line(axes: Any, x: np.ndarray, y: np.ndarray, look: dict[str, Any]) -> None:
    """A line, as pixels where it is long."""
    axes.plot(x, y, rasterized=len(x) > MANY, **look)


def noise_band(row: Sequence[Any]) -> None:
    """Where 95 % of pure noise lies, on axes that share one in times the noise, linear near 0."""
    for axes in row:
        axes.axhspan(-2, 2, color=BAND, zorder=1, label="95 % of noise")
    first = row[0]
    first.set_yscale("symlog", linthresh=10)
    low, high = first.get_ylim()
    first.set_ylim(min(low, -6.0), max(high, 6.0))
    low, high = first.get_ylim()
    decades = [sign * 10.0**k for sign in (-1, 1) for k in range(1, 10)]
    shown = [tick for tick in (-5.0, 0.0, 5.0, *decades) if low <= tick <= high]
    first.yaxis.set_major_locator(FixedLocator(shown))
    first.yaxis.set_minor_locator(NullLocator())
    first.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))


def logarithmic(axes: Any) -> None:
    """Logarithmic axes with a tick at 1, 2 and 5 of a decade (each takes its time to draw), all told on a short one."""
    axes.set(xscale="log", yscale="log")
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_locator(LogLocator(subs=(2, 5)))
        axis.set_minor_formatter(StrMethodFormatter("{x:g}") if high < SHORT * low else NullFormatter())


def over_noise(axes: Any) -> None:
    """A horizontal line at the noise."""
    axes.axhline(1.0, color=NOISE, linewidth=2.2, linestyle=(0, (1, 1)), label="noise", zorder=3)


def broken(time: np.ndarray, parts: tuple[slice, ...], values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Time and values with a NaN after each part, so that no line is drawn across a gap."""
    pieces = [(np.append(time[p], time[p][-1]), np.append(values[p], np.nan)) for p in parts if p.stop > p.start]
    return np.concatenate([one for one, _ in pieces]), np.concatenate([one for _, one in pieces])


def running(plot_data: PlotData) -> np.ndarray:
    """Time (t,) that goes on from recording to recording."""
    seen, out, at = plot_data.before, [], 0.0
    for i, part in enumerate(seen.segments):
        own = seen.time[part]
        at = own[0] if i == 0 else max(at + seen.step, own[0])
        out.append(own - own[0] + at)
        at = float(out[-1][-1])
    return np.concatenate(out)


def legend(drawn: Any, axes: Any) -> None:
    """One legend for the whole figure."""
    handles, labels = axes.get_legend_handles_labels()
    drawn.legend(handles, labels, loc="outside upper center", ncols=4)
