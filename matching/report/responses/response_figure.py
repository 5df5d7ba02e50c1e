"""Frequency responses of the compared functions: vehicle, rig without control and matched rig, with band and error."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MultipleLocator, NullLocator

from matching.frequency.case.case import Compared
from matching.frequency.search.result import MatchResult
from matching.report.common.line_styles import LINES, legend_above
from matching.report.common.log_ticks import plain_ticks
from matching.report.common.style import BAND, figure, styled
from matching.report.common.wording import number, unit
from modelling.units import SENSOR_UNITS

_ACROSS = 3


def response_figure(result: MatchResult) -> Figure:
    """Magnitude over phase for every compared function, three functions side by side."""
    compared = result.case.compared
    across = min(len(compared), _ACROSS)
    down = -(-len(compared) // across)
    with styled():
        fig = figure(0.8 + 3.9 * across, 0.6 + 3.9 * down)
        cells = fig.subplots(2 * down, across, squeeze=False, sharex=True, height_ratios=[2, 1] * down)
        for number_, pair in enumerate(compared):
            row, column = divmod(number_, across)
            upper, lower = cells[2 * row, column], cells[2 * row + 1, column]
            magnitude(upper, result, number_)
            phase(lower, result, number_)
            upper.set_ylabel(magnitude_label(result, pair), fontsize=8)
            if column == 0:
                lower.set_ylabel("Phase in °", fontsize=8)
            lower.set_xlabel("Frequency in Hz" if number_ + across >= len(compared) else "")
        for spare in range(len(compared), down * across):
            row, column = divmod(spare, across)
            cells[2 * row, column].set_visible(False)
            cells[2 * row + 1, column].set_visible(False)
        legend_above(fig, cells[0, 0])
    return fig


def curves_of(result: MatchResult, index: int) -> dict[str, np.ndarray]:
    """Responses (f,) of a compared function by system; without those that have no path."""
    named = {name: getattr(result.curves, name)[:, index] for name in LINES}
    if np.array_equal(named["unmeasured"], named["matched"]):
        del named["unmeasured"]  # without feed-forward the rig reacts to all torques alike
    return {name: values for name, values in named.items() if np.isfinite(values).all()}


def magnitude(axes: Any, result: MatchResult, index: int, title: bool = True) -> None:
    """Magnitude of one compared function, with the band shaded and the error above."""
    f = result.curves.frequencies
    curves = curves_of(result, index)
    shade(axes, result.response_error.band)
    for name, values in curves.items():
        axes.plot(f, np.abs(values), **LINES[name])
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(f[0], f[-1])
    plain_ticks(axes.xaxis)
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_locator(LogLocator(numticks=7))
    largest = max(np.abs(values).max() for values in curves.values())
    smallest = min(np.abs(values).min() for name, values in curves.items() if name in ("vehicle", "matched"))
    axes.set_ylim(smallest / 3, largest * 2)
    axes.annotate(
        _error(result, index), (0.5, 1), (0, 4), "axes fraction", textcoords="offset points", ha="center", fontsize=8
    )
    if title:
        pair = result.case.compared[index]
        axes.set_title(f"{_said(pair.input)} → {_said(pair.sensor)}", fontsize=9, pad=16)


def phase(axes: Any, result: MatchResult, index: int) -> None:
    """Phase of one compared function, shifted by multiples of 360° to lie near the vehicle's."""
    f = result.curves.frequencies
    band = result.response_error.band
    inside = (f >= band[0]) & (f <= band[1])
    shade(axes, band)
    phases = {name: np.degrees(np.unwrap(np.angle(values))) for name, values in curves_of(result, index).items()}
    for name, values in phases.items():
        turns = np.round(np.mean((values - phases["vehicle"])[inside]) / 360)
        axes.plot(f, values - 360 * turns, **LINES[name])
    axes.set_xlim(f[0], f[-1])
    axes.yaxis.set_major_locator(MultipleLocator(90 * max(1, round(np.ptp(axes.get_ylim()) / 360))))


def shade(axes: Any, band: tuple[float, float]) -> None:
    """Shade the matched band."""
    axes.axvspan(*band, color=BAND, zorder=0, linewidth=0)


def magnitude_label(result: MatchResult, pair: Compared) -> str:
    """Quantity and unit of a compared function."""
    sensor = next(part for part in result.case.vehicle.sensors if part.name == pair.sensor)
    return f"{sensor.measures.capitalize()} in {unit(SENSOR_UNITS[sensor.measures])} per N·m"


def _error(result: MatchResult, index: int) -> str:
    errors = result.response_error.functions[index]
    parts = [f"error {number(errors.after, 2)}"]
    if errors.before is not None:
        parts.append(f"without control {number(errors.before, 2)}")
    if "unmeasured" in curves_of(result, index):
        parts.append(f"not measured {number(errors.unmeasured, 2)}")
    return ", ".join(parts)


def _said(name: str) -> str:
    return name.replace("_", " ")
