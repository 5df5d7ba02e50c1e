"""Figure of the torque balance: the torque that each component lacks in the base model, over its motion."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from matching.diagnosis.verdict.result import PlotData
from matching.report.common.style import INK, RIG, figure, styled

BINS = 48
LEAST_PER_BIN = 12  # samples, for a mean
DOTS = 1500
EDGE_S = 0.3  # left out at either end of a recording: the smoother has no data beyond
EDGE_SHARE = 0.2  # of a short recording


def balance_figure(plot_data: PlotData) -> Figure:
    """Bars of the unexplained torque by component; that of the worst inertia and the worst shaft over their motion."""
    motion, inner = plot_data.before, _inner(plot_data)
    inertias, shafts = (
        {name: torque[inner] for name, torque in group.items()} for group in (plot_data.inertias, plot_data.shafts)
    )
    size = {f"inertia {name}": _rms(torque) for name, torque in inertias.items()}
    size |= {f"shaft {name}": _rms(torque) for name, torque in shafts.items()}
    names = sorted(size, key=lambda name: size[name])
    inertia = max(inertias, key=lambda name: _rms(inertias[name]))
    shaft = max(shafts, key=lambda name: _rms(shafts[name]), default=None)
    with styled():
        fig = figure(11, max(3.0, 1.2 + 0.24 * len(names)))
        bars, first, second = fig.subplots(1, 3, width_ratios=[1.1, 1, 1])
        bars.barh(names, [size[name] for name in names], color=RIG, height=0.6)
        bars.set_xlabel("Unexplained torque (rms) in N·m")
        bars.grid(axis="y", visible=False)
        _over(first, motion.speed[inertia][inner], inertias[inertia])
        first.set(xlabel=f"Speed of {inertia} in rad/s", ylabel=f"Unexplained on {inertia} in N·m")
        if shaft is None:
            second.set_axis_off()
        else:
            _over(second, motion.twist[shaft][inner], shafts[shaft])
            second.set(xlabel=f"Twist of {shaft} in rad", ylabel=f"Unexplained in {shaft} in N·m")
    return fig


def _inner(plot_data: PlotData) -> np.ndarray:
    """Mask (t,) of the samples away from the ends, where the smoother has data on both sides."""
    mask = np.zeros(len(plot_data.before.time), dtype=bool)
    for part in plot_data.before.segments:
        time = plot_data.before.time[part]
        edge = min(EDGE_S, EDGE_SHARE * float(np.ptp(time)))
        mask[part] = (time >= time[0] + edge) & (time <= time[-1] - edge)
    return mask


def _rms(torque: np.ndarray) -> float:
    return float(np.sqrt(np.mean(torque**2)))


def _over(axes: Any, x: np.ndarray, torque: np.ndarray) -> None:
    axes.locator_params(axis="x", nbins=5)
    few = np.linspace(0, len(x) - 1, min(len(x), DOTS)).astype(int)
    axes.plot(x[few], torque[few], ".", color=RIG, markersize=2, alpha=0.3, rasterized=True)
    edges = np.linspace(x.min(), x.max(), BINS + 1)
    bins = np.clip(np.digitize(x, edges) - 1, 0, BINS - 1)
    count = np.bincount(bins, minlength=BINS)
    mean = np.where(count >= LEAST_PER_BIN, np.bincount(bins, torque, BINS) / np.maximum(count, 1), np.nan)
    axes.plot((edges[1:] + edges[:-1]) / 2, mean, color=INK, linewidth=1.8)
