"""The match at a glance: response, manoeuvre and target modes in one figure, 1200 pixels wide at 150 dpi."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from matching.frequency.search.result import MatchResult, TargetResult
from matching.report.common.line_styles import LINES, legend_above
from matching.report.common.log_ticks import plain_ticks
from matching.report.common.style import MATCHED, RIG, VEHICLE, figure, styled
from matching.report.common.wording import hertz
from matching.report.match.trace_figure import Signal, trace
from matching.report.responses.response_figure import curves_of, magnitude, magnitude_label


def overview_figure(result: MatchResult, signals: Sequence[Signal]) -> Figure:
    """Two responses on top, one signal and the target modes below."""
    with styled():
        fig = figure(8.0, 6.6)
        cells = fig.subplots(2, 2)
        for axes, index in zip(cells[0], _telling(result)):
            magnitude(axes, result, index)
            axes.set_ylabel(magnitude_label(result, result.case.compared[index]))
            axes.set_xlabel("Frequency in Hz")
        if len(result.case.compared) == 1:
            cells[0, 1].set_visible(False)
        if signals:
            trace(cells[1, 0], _telling_signal(signals))
            begins = min(manoeuvre.at for manoeuvre in result.case.manoeuvre.values())
            cells[1, 0].set_xlim(0, min(begins + 3, cells[1, 0].get_xlim()[1]))
            cells[1, 0].set_xlabel("Time in s")
        else:
            cells[1, 0].set_visible(False)
        _targets(cells[1, 1], result)
        legend_above(fig, cells[0, 0], 4, fontsize=8)
    return fig


def _telling(result: MatchResult) -> list[int]:
    """The function whose rig is farthest off, and one without a path on the rig without control, or the next."""
    rows = result.response_error.functions
    far = max(range(len(rows)), key=lambda i: rows[i].before or 0.0)
    others = [i for i in range(len(rows)) if i != far]
    blind = [i for i in others if "rig" not in curves_of(result, i)]
    ranked = sorted(blind or others, key=lambda i: -rows[i].after)
    return [far, *ranked[:1]]


def _telling_signal(signals: Sequence[Signal]) -> Signal:
    """The first torque that vehicle and matched rig both have, else the first signal."""
    both = [signal for signal in signals if {"vehicle", "matched"} <= set(signal.curves)]
    torques = [signal for signal in both if "N·m" in signal.label]
    return (torques or both or list(signals))[0]


def _name(target: TargetResult) -> str:
    side = f", {target.symmetry}" if target.symmetry != "none" else ""
    return f"mode {target.vehicle_mode}{side}"


def _targets(axes: Any, result: MatchResult) -> None:
    places = {"vehicle": 2, "rig": 1, "matched": 0}
    colours = {"vehicle": VEHICLE, "rig": RIG, "matched": MATCHED}
    marks = "osD^v"
    for count, (target, mark) in enumerate(zip(result.targets, marks * 9)):
        frequencies = {name: getattr(target, name) for name in places}
        known = [name for name in places if frequencies[name] is not None]
        path = [frequencies[name] for name in known]
        axes.plot(path, [places[name] for name in known], color="#999999", linewidth=0.9, linestyle=":", zorder=1)
        for name in known:
            axes.plot(
                frequencies[name],
                places[name],
                mark,
                color=colours[name],
                markersize=9,
                markeredgecolor="#222222",
                zorder=3,
            )
            axes.annotate(
                f"{hertz(frequencies[name])} Hz",
                (frequencies[name], places[name]),
                (0, -18 if count % 2 else 9),
                textcoords="offset points",
                ha="center",
                fontsize=8,
            )
        axes.plot(
            [],
            [],
            mark,
            color="white",
            markeredgecolor="#222222",
            label=_name(target),
        )
    for name, place in places.items():
        if all(getattr(target, name) is None for target in result.targets):
            axes.annotate("not found", (0.5, place), xycoords=("axes fraction", "data"), ha="center", fontsize=8)
    everything = np.array(
        [value for target in result.targets for value in (target.vehicle, target.rig, target.matched) if value]
    )
    axes.set_xscale("log")
    axes.set_xlim(everything.min() / 1.8, everything.max() * 1.8)
    plain_ticks(axes.xaxis)
    axes.set_ylim(-0.9, 2.6)
    axes.set_yticks(list(places.values()), [LINES[name]["label"] for name in places])
    axes.grid(False, axis="y")
    axes.set_xlabel("Frequency of the target modes in Hz")
    axes.legend(loc="lower center", bbox_to_anchor=(0.4, 1.0), fontsize=7.5, ncols=2, borderaxespad=0.1)
