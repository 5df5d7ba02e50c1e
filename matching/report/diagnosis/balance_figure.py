"""The torque balance that the model as given leaves over: which inertia, which shaft, and over what."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from matching.diagnosis.verdict.result import PlotData
from matching.report.common.style import RIG, figure, styled

BINS = 48
LEAST = 12
DOTS = 1500
EDGE = 0.3  # s at either end of a stretch


def balance_figure(plot_data: PlotData) -> Figure:
    """Bars of the torque left over by component, and the largest of either kind over its motion."""
    seen, settled = plot_data.before, _settled(plot_data)
    inertias, shafts = (
        {name: own[settled] for name, own in group.items()} for group in (plot_data.inertias, plot_data.shafts)
    )
    size = {f"inertia {name}": _rms(own) for name, own in inertias.items()}
    size |= {f"shaft {name}": _rms(own) for name, own in shafts.items()}
    names = sorted(size, key=lambda name: size[name])
    inertia = max(inertias, key=lambda name: _rms(inertias[name]))
    shaft = max(shafts, key=lambda name: _rms(shafts[name]), default=None)
    with styled():
        drawn = figure(11, max(3.0, 1.2 + 0.24 * len(names)))
        bars, first, second = drawn.subplots(1, 3, width_ratios=[1.1, 1, 1])
        bars.barh(names, [size[name] for name in names], color=RIG, height=0.6)
        bars.set_xlabel("Torque left over (rms) in N·m")
        bars.grid(axis="y", visible=False)
        _over(first, seen.speed[inertia][settled], inertias[inertia])
        first.set(xlabel=f"Speed of {inertia} in rad/s", ylabel=f"Left over on {inertia} in N·m")
        if shaft is None:
            second.set_axis_off()
        else:
            _over(second, seen.twist[shaft][settled], shafts[shaft])
            second.set(xlabel=f"Twist of {shaft} in rad", ylabel=f"Left over in {shaft} in N·m")
    return drawn


def _settled(plot_data: PlotData) -> np.ndarray:
    """Samples (t,) at which the smoother knows what came before and what comes after."""
    out = np.zeros(len(plot_data.before.time), dtype=bool)
    for part in plot_data.before.segments:
        time = plot_data.before.time[part]
        edge = min(EDGE, 0.2 * float(np.ptp(time)))
        out[part] = (time >= time[0] + edge) & (time <= time[-1] - edge)
    return out


def _rms(own: np.ndarray) -> float:
    return float(np.sqrt(np.mean(own**2)))


def _over(axes: Any, x: np.ndarray, torque: np.ndarray) -> None:
    axes.locator_params(axis="x", nbins=5)
    few = np.linspace(0, len(x) - 1, min(len(x), DOTS)).astype(int)
    axes.plot(x[few], torque[few], ".", color=RIG, markersize=2, alpha=0.3, rasterized=True)
    edges = np.linspace(x.min(), x.max(), BINS + 1)
    bins = np.clip(np.digitize(x, edges) - 1, 0, BINS - 1)
    count = np.bincount(bins, minlength=BINS)
    mean = np.where(count >= LEAST, np.bincount(bins, torque, BINS) / np.maximum(count, 1), np.nan)
    axes.plot((edges[1:] + edges[:-1]) / 2, mean, color="#1a1a1a", linewidth=1.8)
