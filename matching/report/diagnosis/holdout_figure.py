"""Before and after on data that no fit saw."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, StrMethodFormatter

from matching.diagnosis.data.holdout_fidelity import HoldoutData
from matching.diagnosis.verdict.result import Diagnosis
from matching.report.common.style import NOISE, figure, styled
from matching.report.common.wording import number
from matching.report.diagnosis.axes import (
    AFTER,
    BEFORE,
    MEASURED,
    SMOOTH,
    View,
    broken,
    label,
    legend,
    line,
    noise_band,
    told_apart,
)

CLOSE = 120  # samples to either side of the worst moment


def errors_figure(found: Diagnosis) -> Figure:
    """Errors on unseen data in times the noise, sensor by sensor."""
    names = list(found.errors)[::-1]
    keys: dict[str, tuple[dict[str, Any], float]] = {"before_holdout": (BEFORE | {"hatch": "////"}, 0.17)}
    keys["after_holdout"] = (AFTER | {"hatch": None}, -0.17)
    if all(own["before_holdout"] == own["after_holdout"] for own in found.errors.values()):
        keys = {"before_holdout": (keys["before_holdout"][0], 0.0)}
    with styled():
        drawn = figure(7.2, 1.1 + 0.42 * len(names))
        axes = drawn.subplots()
        most = 2.0
        for key, (look, shift) in keys.items():
            rows = [(i, found.errors[name][key], found.errors[name]["noise"]) for i, name in enumerate(names)]
            known = [(i, value / noise) for i, value, noise in rows if value is not None and noise]
            places, ratios = [i + shift for i, _ in known], [ratio for _, ratio in known]
            axes.barh(
                places, ratios, height=0.3, color=look["color"], label=look["label"], hatch=look["hatch"],
                edgecolor="white", linewidth=0,
            )  # fmt: skip
            for place, ratio in zip(places, ratios, strict=True):
                axes.annotate(f" {number(ratio, 3)}", (max(ratio, 1.0), place), va="center", fontsize=8)
            most = max([most, *ratios])
        axes.axvline(1.0, color=NOISE, linewidth=1.6, label="noise")
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        if most < 10:
            axes.xaxis.set_minor_locator(LogLocator(subs=(2, 3, 5)))
            axes.xaxis.set_minor_formatter(StrMethodFormatter("{x:g}"))
        axes.set_xlim(0.5, 2.2 * most)
        axes.set_yticks(range(len(names)), names)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("Root mean square error on unseen data, in times the noise")
        legend(drawn, axes)
    return drawn


def unseen_figure(found: Diagnosis, shown: list[View]) -> Figure:
    """Traces about the worst moment, and what is left over the whole."""
    data = found.plot_data.holdout
    with styled():
        drawn = figure(11, 0.9 + 1.75 * len(shown))
        rows = drawn.subplots(len(shown), 2, squeeze=False, width_ratios=[1, 1.3])
        for (close, whole), view in zip(rows, shown, strict=True):
            _traces(close, data, view)
            for residual, look in told_apart(data.before, data.after):
                x, y = broken(data.time, data.parts, residual[:, view.index] / data.noise[view.index])
                line(whole, x, y, look)
            noise_band([whole])
            whole.set_ylabel("error in times\nthe noise")
        for axes in rows[-1]:
            axes.set_xlabel("Time in s")
        legend(drawn, rows[0, 0])
    return drawn


def _traces(axes: Any, data: HoldoutData, view: View) -> None:
    j = view.index
    off = np.abs(np.nan_to_num(data.before[:, j]))
    smooth = np.convolve(off, np.ones(25) / 25, "same")
    worst = int(np.argmax(smooth))
    part = next(part for part in data.parts if part.start <= worst < part.stop)
    cut = slice(max(worst - CLOSE, part.start), min(worst + CLOSE, part.stop))
    measured = data.measured[cut, j]
    line(axes, data.time[cut], measured, MEASURED)
    axes.locator_params(axis="x", nbins=5)
    for residual, look in told_apart(data.before, data.after):
        line(axes, data.time[cut], measured - residual[cut, j], look | SMOOTH[look["label"]] | {"linewidth": 1.3})
    axes.set_ylabel(label(view.sensor))
