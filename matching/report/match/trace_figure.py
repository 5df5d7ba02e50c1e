"""The simulated manoeuvre over time: vehicle, rig without control and matched rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from matching.report.common.decimation import decimated
from matching.report.common.line_styles import LINES, legend_above
from matching.report.common.style import LIMIT, figure, styled

CLOSE_UP_S = 1.2  # after the beginning: some periods of a shuffle
NEAR_LIMIT = 0.6  # share of a limit from which it is drawn


@dataclass(frozen=True)
class Signal:
    """One quantity over time.

    Attributes
    ----------
    title, label : str
        What it is; quantity and unit for the axis.
    time : ndarray (t,)
        s.
    curves : mapping of str to ndarray (t,)
        By system: ``vehicle``, ``rig``, ``matched``, ``unmeasured``.
    limit : float, optional
        Largest amount allowed.
    """

    title: str
    label: str
    time: np.ndarray
    curves: Mapping[str, np.ndarray]
    limit: float | None = None


def trace_figure(signals: Sequence[Signal], begins: float) -> Figure:
    """Every signal over time: the whole manoeuvre on the left, a close-up of its beginning (s) on the right."""
    with styled():
        fig = figure(12.4, 0.7 + 1.75 * len(signals))
        rows = fig.subplots(len(signals), 2, squeeze=False, sharex="col", width_ratios=[1.5, 1])
        for (whole, close), signal in zip(rows, signals):
            trace(whole, signal)
            trace(close, signal, (begins - 0.1, begins + CLOSE_UP_S))
            close.set_ylabel("")
        for axes in rows[-1]:
            axes.set_xlabel("Time in s")
        first = max(range(len(signals)), key=lambda i: len(signals[i].curves))
        legend_above(fig, rows[first, 0])
    return fig


def trace(axes: Any, signal: Signal, window: tuple[float, float] | None = None) -> None:
    """One signal, within a window (s) if there is one, and its peak as a share of its limit."""
    inside = np.ones(len(signal.time), bool)
    if window is not None:
        inside = (signal.time >= window[0]) & (signal.time <= window[1])
    time = signal.time[inside]
    for name, values in signal.curves.items():
        axes.plot(*decimated(time, values[inside]), **LINES[name])
    axes.set_xlim(time[0], time[-1])
    axes.set_ylabel(signal.label)
    axes.set_title(signal.title, fontsize=9)
    relevant = [values for name, values in signal.curves.items() if name != "rig"] or list(signal.curves.values())
    low, high = min(values[inside].min() for values in relevant), max(values[inside].max() for values in relevant)
    room = 0.08 * (high - low) or 1.0
    axes.set_ylim(low - room, high + room)  # a rig without control may leave the picture
    if signal.limit is None or window is not None:
        return
    share = max(float(np.abs(values).max()) for values in relevant) / signal.limit
    axes.annotate(
        f"peak {100 * share:.0f} % of the limit", (0.98, 0.04), xycoords="axes fraction", fontsize=8, ha="right"
    )
    if share > NEAR_LIMIT:
        for side in (-signal.limit, signal.limit):
            axes.axhline(side, color=LIMIT, linestyle="--", linewidth=1.2)
        axes.set_ylim(*_reaching(low - room, high + room, signal.limit))


def _reaching(low: float, high: float, limit: float) -> tuple[float, float]:
    """The range, widened to the limits that the signal comes near."""
    return (-1.08 * limit if low < -NEAR_LIMIT * limit else low, 1.08 * limit if high > NEAR_LIMIT * limit else high)
