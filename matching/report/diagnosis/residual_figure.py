"""Figures of the residual over time, over speed, torque and angle, over frequency and orders of the rotation."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from matplotlib.figure import Figure

from matching.diagnosis.verdict.result import PlotData
from matching.report.common.style import LIMIT, figure, styled
from matching.report.diagnosis.axes import (
    SMOOTH,
    View,
    continuous_time,
    legend,
    line,
    logarithmic,
    noise_band,
    noise_line,
    styled_residuals,
    with_gaps,
)

BINS = 48
MEAN_OVER = 25  # samples of the running mean
DOTS = 1200
LEAST_PER_BIN = 12  # samples, for a mean
LEAST_REVOLUTIONS = 2  # that an order spectrum needs
HIGHEST_ORDER = 12
MOST_SAMPLES = 4_000  # of an order spectrum; more are averaged first
WELCH_SAMPLES = 4096  # of a segment
UNEVEN = 0.1  # share of the longer steps, and of the shorter ones, where a rate is no whole part of that of the grid


def time_figure(plot_data: PlotData, sensor_views: list[View]) -> Figure:
    """Residuals over the fitted data, in times the noise."""
    time = continuous_time(plot_data)
    with styled():
        fig = figure(11, 0.9 + 1.25 * len(sensor_views))
        rows = fig.subplots(len(sensor_views), 1, squeeze=False, sharex=True)[:, 0]
        for axes, view in zip(rows, sensor_views, strict=True):
            for residual, look in _both(plot_data):
                scaled = residual[:, view.index] / plot_data.noise[view.index]
                if len(scaled) != len(time):
                    continue
                pale = look | {"alpha": 0.25, "label": None}
                line(axes, *with_gaps(time, plot_data.before.segments, scaled), pale)
                line(axes, *with_gaps(time, plot_data.before.segments, _running_mean(scaled)), look)
            noise_band([axes])
            axes.set_ylabel(f"{view.sensor.name}\nin times the noise")
        rows[-1].set_xlabel("Time in s")
        legend(fig, rows[0])
    return fig


def where_figure(plot_data: PlotData, sensor_views: list[View]) -> Figure:
    """Residuals over the motion at the sensor's component: dots, and the mean of each bin."""
    with styled():
        fig = figure(11, 0.9 + 2.1 * len(sensor_views))
        grid = fig.subplots(len(sensor_views), 3, squeeze=False, sharey="row")
        for row, view in zip(grid, sensor_views, strict=True):
            motion = _motion(plot_data, view)
            for axes, (name, x) in zip(row, motion.items(), strict=False):
                for residual, look in _both(plot_data):
                    scaled = residual[:, view.index] / plot_data.noise[view.index]
                    if len(scaled) == len(x):
                        _binned(axes, x, scaled, look)
                axes.set_xlabel(name)
                if name.endswith("°"):
                    axes.set_xticks(range(0, 361, 90))
                else:
                    axes.locator_params(axis="x", nbins=5)
            noise_band(row[: len(motion)])
            row[0].set_ylabel(f"{view.sensor.name}\nin times the noise")
            for axes in row[len(motion) :]:
                axes.set_axis_off()
        legend(fig, grid[0, 0])
    return fig


def spectrum_figure(plot_data: PlotData, sensor_views: list[View]) -> Figure:
    """Amplitude spectra over frequency and over orders of the rotation; white noise of the stated size is 1."""
    with styled():
        fig = figure(11, 0.9 + 2.1 * len(sensor_views))
        grid = fig.subplots(len(sensor_views), 2, squeeze=False, sharey="row")
        for (left, right), view in zip(grid, sensor_views, strict=True):
            angle = plot_data.before.angle[view.inertia]
            revolves = float(np.ptp(angle)) / (2 * np.pi) > LEAST_REVOLUTIONS
            for residual, look in _both(plot_data):
                scaled = residual[:, view.index] / plot_data.noise[view.index]
                if len(scaled) != len(plot_data.before.time):
                    continue
                part = max(plot_data.before.segments, key=lambda part: part.stop - part.start)
                x, y = _spectrum(scaled[part], plot_data.before.step)
                line(left, x[1:], y[1:], look)
                if revolves:
                    line(right, *_orders(scaled, angle), look | SMOOTH[look["label"]])
            noise_line(left)
            logarithmic(left)
            left.set(xlabel="Frequency in Hz", ylabel=f"{view.sensor.name}\nin times the noise")
            if not revolves:
                words = f"{view.inertia} makes less than {LEAST_REVOLUTIONS} revolutions"
                right.text(0.5, 0.5, words, transform=right.transAxes, ha="center", color=LIMIT)
                right.set_axis_off()
                continue
            noise_line(right)
            right.set(xlim=(0, HIGHEST_ORDER), xlabel=f"Order, per revolution of {view.inertia}")
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


def _both(plot_data: PlotData) -> tuple[tuple[np.ndarray, dict[str, Any]], ...]:
    return styled_residuals(plot_data.residual_before, plot_data.residual_after)


def _motion(plot_data: PlotData, view: View) -> dict[str, np.ndarray]:
    motion = plot_data.before
    over = {f"Speed of {view.inertia} in rad/s": motion.speed[view.inertia]}
    if view.shaft is not None:
        over[f"Torque of {view.shaft} in N·m"] = motion.torque[view.shaft]
    angle = motion.angle[view.inertia]
    if np.ptp(angle) > 2 * np.pi:
        over[f"Angle of {view.inertia} within a revolution in °"] = np.degrees(angle) % 360
    else:
        over[f"Angle of {view.inertia} in rad"] = angle
    return over


def _binned(axes: Any, x: np.ndarray, residual: np.ndarray, look: dict[str, Any]) -> None:
    present = np.isfinite(residual)
    x, residual = x[present], residual[present]
    few = np.linspace(0, len(x) - 1, min(len(x), DOTS)).astype(int)
    axes.plot(x[few], residual[few], ".", color=look["color"], markersize=1.5, alpha=0.3, rasterized=True, zorder=1.5)
    edges = np.linspace(x.min(), x.max(), BINS + 1)
    bins = np.clip(np.digitize(x, edges) - 1, 0, BINS - 1)
    count = np.bincount(bins, minlength=BINS)
    mean = np.where(count >= LEAST_PER_BIN, np.bincount(bins, residual, BINS) / np.maximum(count, 1), np.nan)
    axes.plot((edges[1:] + edges[:-1]) / 2, mean, **look | SMOOTH[look["label"]])


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
