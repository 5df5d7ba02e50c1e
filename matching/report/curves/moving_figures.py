"""Figures of a report that act: hover, zoom, curves switched by the legend. Bokeh, inline; none where it is missing."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np

from matching.frequency.search.result import MatchResult
from matching.report.common.decimation import decimated
from matching.report.common.line_styles import LINES
from matching.report.common.style import BAND, LIMIT, MATCHED, RIG
from matching.report.controller.sensitivity_figure import sensitivity
from matching.report.curves.embedding import acting_figure, embedded_figures, place_legend
from matching.report.match.checks import signals
from matching.report.match.figures import drawn_modes
from matching.report.responses.response_figure import curves_of, magnitude_label

DASHES = {"vehicle": "solid", "rig": "dashed", "matched": "solid", "unmeasured": "dotted"}


def moving_figures(result: MatchResult) -> dict[str, str]:
    """Scripts and elements by the name of the figure that they stand for; ``library`` is Bokeh itself.

    Empty where Bokeh is not installed: then the report has its pictures alone.
    """
    if find_spec("bokeh") is None:
        return {}
    drawn = {"responses": _responses(result), "manoeuvre": _manoeuvre(result), "sensitivity": _sensitivity(result)}
    return embedded_figures({name: figures for name, figures in drawn.items() if figures}, side_by_side=True)


def _responses(result: MatchResult) -> list[Any]:
    figures: list[Any] = []
    frequencies = result.curves.frequencies
    for index, pair in enumerate(result.case.compared):
        title = f"{pair.input} → {pair.sensor}".replace("_", " ")
        shared = {"x_range": figures[0][0].x_range} if figures else {}
        labels = ("Frequency in Hz", magnitude_label(result, pair))
        modulus = acting_figure(title, *labels, x_axis_type="log", y_axis_type="log", **shared)
        phase = acting_figure("", "Frequency in Hz", "Phase in °", x_axis_type="log", x_range=modulus.x_range)
        for fig in (modulus, phase):
            _band(fig, result.response_error.band)
        for who, values in curves_of(result, index).items():
            line = _line(modulus, frequencies, np.abs(values), who)
            below = _line(phase, frequencies, np.degrees(np.angle(values)), who)
            line.js_link("visible", below, "visible")
        place_legend(modulus)
        phase.legend.visible = False
        figures.append([modulus, phase])
    return figures


def _manoeuvre(result: MatchResult) -> list[Any]:
    figures: list[Any] = []
    for signal in signals(result):
        shared = {"x_range": figures[0].x_range} if figures else {}
        fig = acting_figure(signal.title, "Time in s", signal.label, **shared)
        for who, values in signal.curves.items():
            _line(fig, signal.time, values, who)
        place_legend(fig)
        figures.append(fig)
    return figures


def _sensitivity(result: MatchResult) -> list[Any]:
    loop = sensitivity(result.tuned, drawn_modes(result), result.robust.required if result.robust else None)
    fig = acting_figure("", "Frequency in Hz", "Largest singular value", x_axis_type="log", y_axis_type="log")
    _curve(fig, loop.frequencies, loop.S, "|S|", color=MATCHED, line_width=1.6)
    _curve(fig, loop.frequencies, loop.T, "|T|", color=RIG, line_width=1.4, line_dash="dashed")
    for limit in loop.limits:
        ends = np.array([limit.begins, loop.frequencies[-1]])
        _curve(fig, ends, np.full(2, limit.largest), limit.words, color=LIMIT, line_width=1.2, line_dash="dotted")
    place_legend(fig)
    return [fig]


def _band(fig: Any, band: tuple[float, float]) -> None:
    """The matched band, Hz."""
    from bokeh.models import BoxAnnotation

    fig.add_layout(BoxAnnotation(left=band[0], right=band[1], fill_color=BAND, fill_alpha=1, level="image"))


def _line(fig: Any, x: np.ndarray, y: np.ndarray, who: str) -> Any:
    """A curve of vehicle, rig or matched rig."""
    style = LINES[who]
    looks = {"color": style["color"], "line_width": style["linewidth"], "alpha": style.get("alpha", 1.0)}
    return _curve(fig, x, y, style["label"], line_dash=DASHES[who], **looks)


def _curve(fig: Any, x: np.ndarray, y: np.ndarray, label: str, **looks: Any) -> Any:
    x, y = decimated(x, y)
    return fig.line(x.astype(np.float32), y.astype(np.float32), legend_label=label, name=label, **looks)
