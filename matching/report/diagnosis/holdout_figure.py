"""Figures of the base model and of the extended model on held-out data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, StrMethodFormatter

from matching.diagnosis.data.holdout_residuals import HoldoutData
from matching.diagnosis.verdict.result import SensorErrors
from matching.report.common.style import NOISE, figure, styled
from matching.report.common.wording import number
from matching.report.diagnosis.axes import (
    AFTER,
    BEFORE,
    MEASURED,
    SMOOTH,
    View,
    label,
    legend,
    line,
    noise_band,
    recorded,
    styled_residuals,
    with_gaps,
)

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
        axes.set_yticks(range(len(names)), names)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("Root mean square error on held-out data, in times the noise")
        legend(fig, axes)
    return fig


def holdout_figure(data: HoldoutData, sensor_views: list[View]) -> Figure:
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


def _traces(axes: Any, data: HoldoutData, view: View) -> None:
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
