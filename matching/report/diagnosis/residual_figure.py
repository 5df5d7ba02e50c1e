"""Where the residual sits: in time, over speed, torque and angle, in frequency and in orders of the turn."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.ndimage import uniform_filter1d
from scipy.signal import lombscargle, welch

from matching.diagnosis.verdict.result import PlotData
from matching.report.common.style import LIMIT, figure, styled
from matching.report.diagnosis.axes import (
    SMOOTH,
    View,
    broken,
    legend,
    line,
    logarithmic,
    noise_band,
    over_noise,
    running,
    told_apart,
)

BINS = 48
RUNNING = 25  # samples of the mean that stands out of the noise
DOTS = 1200
LEAST = 12  # readings in a bin
TURNS = 2  # that an order spectrum needs
ORDERS = 12
SAMPLES = 4_000  # that an order spectrum takes; more are averaged


def time_figure(plot_data: PlotData, shown: list[View]) -> Figure:
    """Residuals over the fitted data, in times the noise."""
    time = running(plot_data)
    with styled():
        drawn = figure(11, 0.9 + 1.25 * len(shown))
        rows = drawn.subplots(len(shown), 1, squeeze=False, sharex=True)[:, 0]
        for axes, view in zip(rows, shown, strict=True):
            for residual, look in _both(plot_data):
                own = residual[:, view.index] / plot_data.noise[view.index]
                if len(own) != len(time):
                    continue
                line(axes, *broken(time, plot_data.before.segments, own), look | {"alpha": 0.25, "label": None})
                line(axes, *broken(time, plot_data.before.segments, _running_mean(own)), look)
            noise_band([axes])
            axes.set_ylabel(f"{view.sensor.name}\nin times the noise")
        rows[-1].set_xlabel("Time in s")
        legend(drawn, rows[0])
    return drawn


def where_figure(plot_data: PlotData, shown: list[View]) -> Figure:
    """Residuals over the motion at the sensor's place: dots, and the mean of each bin."""
    with styled():
        drawn = figure(11, 0.9 + 2.1 * len(shown))
        grid = drawn.subplots(len(shown), 3, squeeze=False, sharey="row")
        for row, view in zip(grid, shown, strict=True):
            motion = _motion(plot_data, view)
            for axes, (name, x) in zip(row, motion.items(), strict=False):
                for residual, look in _both(plot_data):
                    own = residual[:, view.index] / plot_data.noise[view.index]
                    if len(own) == len(x):
                        _binned(axes, x, own, look)
                axes.set_xlabel(name)
                if name.endswith("°"):
                    axes.set_xticks(range(0, 361, 90))
                else:
                    axes.locator_params(axis="x", nbins=5)
            noise_band(row[: len(motion)])
            row[0].set_ylabel(f"{view.sensor.name}\nin times the noise")
            for axes in row[len(motion) :]:
                axes.set_axis_off()
        legend(drawn, grid[0, 0])
    return drawn


def spectrum_figure(plot_data: PlotData, shown: list[View]) -> Figure:
    """Amplitude spectra over frequency and over orders of the turn; white noise of the stated size is 1 everywhere."""
    with styled():
        drawn = figure(11, 0.9 + 2.1 * len(shown))
        grid = drawn.subplots(len(shown), 2, squeeze=False, sharey="row")
        for (left, right), view in zip(grid, shown, strict=True):
            angle = plot_data.before.angle[view.inertia]
            turns = float(np.ptp(angle)) / (2 * np.pi) > TURNS
            for residual, look in _both(plot_data):
                own = residual[:, view.index] / plot_data.noise[view.index]
                if len(own) != len(plot_data.before.time):
                    continue
                part = max(plot_data.before.segments, key=lambda part: part.stop - part.start)
                x, y = _spectrum(own[part], plot_data.before.step)
                line(left, x[1:], y[1:], look)
                if turns:
                    line(right, *_orders(own, angle), look | SMOOTH[look["label"]])
            over_noise(left)
            logarithmic(left)
            left.set(xlabel="Frequency in Hz", ylabel=f"{view.sensor.name}\nin times the noise")
            if not turns:
                words = f"{view.inertia} turns less than {TURNS} times"
                right.text(0.5, 0.5, words, transform=right.transAxes, ha="center", color=LIMIT)
                right.set_axis_off()
                continue
            over_noise(right)
            right.set(xlim=(0, ORDERS), xlabel=f"Order per turn of {view.inertia}")
            right.set_xticks(range(ORDERS + 1))
        legend(drawn, grid[0, 0])
    return drawn


def _running_mean(own: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(own), uniform_filter1d(np.nan_to_num(own), RUNNING), np.nan)


def _both(plot_data: PlotData) -> tuple[tuple[np.ndarray, dict[str, Any]], ...]:
    return told_apart(plot_data.residual_before, plot_data.residual_after)


def _motion(plot_data: PlotData, view: View) -> dict[str, np.ndarray]:
    seen = plot_data.before
    out = {f"Speed of {view.inertia} in rad/s": seen.speed[view.inertia]}
    if view.shaft is not None:
        out[f"Torque of {view.shaft} in N·m"] = seen.torque[view.shaft]
    angle = seen.angle[view.inertia]
    if np.ptp(angle) > 2 * np.pi:
        out[f"Angle of {view.inertia} within a turn in °"] = np.degrees(angle) % 360
    else:
        out[f"Angle of {view.inertia} in rad"] = angle
    return out


def _binned(axes: Any, x: np.ndarray, own: np.ndarray, look: dict[str, Any]) -> None:
    there = np.isfinite(own)
    x, own = x[there], own[there]
    few = np.linspace(0, len(x) - 1, min(len(x), DOTS)).astype(int)
    axes.plot(x[few], own[few], ".", color=look["color"], markersize=1.5, alpha=0.3, rasterized=True, zorder=1.5)
    edges = np.linspace(x.min(), x.max(), BINS + 1)
    bins = np.clip(np.digitize(x, edges) - 1, 0, BINS - 1)
    count = np.bincount(bins, minlength=BINS)
    mean = np.where(count >= LEAST, np.bincount(bins, own, BINS) / np.maximum(count, 1), np.nan)
    axes.plot((edges[1:] + edges[:-1]) / 2, mean, **look | SMOOTH[look["label"]])


def _spectrum(own: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (f,) and amplitudes (f,), 1 for white noise of the stated size; missing samples count as 0."""
    length = min(len(own), 4096)
    frequency, power = welch(np.nan_to_num(own), 1 / step, nperseg=length, detrend=False)
    return frequency, np.sqrt(power / (2 * step))


def _orders(own: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Orders (f,) and amplitudes of a residual over an angle, 1 for white noise.

    Lomb (1976) and Scargle (1982): the angle need not grow evenly, nor always one way.
    """
    orders = np.arange(0.1, ORDERS + 0.05, 0.05)
    there = np.isfinite(own)
    block = max(-(-there.sum() // SAMPLES), 1)
    count = there.sum() // block
    angle, own = (one[there][: count * block].reshape(count, block).mean(axis=1) for one in (angle, own))
    return orders, np.sqrt(block * lombscargle(angle, own, orders))  # a mean of n has 1/n of the noise's power
