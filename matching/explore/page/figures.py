"""Bokeh figures of the page: responses with a cursor, energies of a mode, signals."""

from __future__ import annotations

from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, CrosshairTool, HoverTool, Span
from bokeh.plotting import figure

from matching.explore.signals.measured import MeasuredCurves
from matching.report.common.style import LIMIT, NOISE, RIG, VEHICLE

TOOLS = "pan,wheel_zoom,box_zoom,reset,save"
HEIGHT = 260  # px


def plain_figure(title: str, x: str, y: str, **options: Any) -> Any:
    """An empty figure as wide as the page."""
    fig = figure(
        title=title, x_axis_label=x, y_axis_label=y, tools=TOOLS, active_drag="pan", height=HEIGHT,
        sizing_mode="stretch_width", output_backend="canvas", toolbar_location="above", **options,
    )  # fmt: skip
    fig.toolbar.logo = None
    fig.toolbar.autohide = False
    return fig


class ResponseFigures:
    """Modulus and phase of one response: of the file, with what is tried, and measured."""

    def __init__(self) -> None:
        self.before, self.now, self.measured = (ColumnDataSource({"f": [], "size": [], "phase": []}) for _ in range(3))
        cursor = Span(dimension="height", line_color=LIMIT, line_width=1)
        self.modulus = plain_figure("Modulus", "frequency [Hz]", "modulus", x_axis_type="log", y_axis_type="log")
        self.phase = plain_figure(
            "Phase", "frequency [Hz]", "phase [°]", x_axis_type="log", x_range=self.modulus.x_range
        )
        for fig, key, unit in ((self.modulus, "size", ""), (self.phase, "phase", "°")):
            fig.line("f", key, source=self.before, color=VEHICLE, line_width=4, alpha=0.4, legend_label="file")
            line = fig.line("f", key, source=self.now, color=RIG, line_width=1.6, legend_label="tried")
            fig.scatter("f", key, source=self.measured, color=NOISE, size=5, legend_label="measured")
            tips = [("f", "@f{0.000} Hz"), (key, f"@{key}{{0.0000}} {unit}")]
            fig.add_tools(HoverTool(renderers=[line], mode="vline", tooltips=tips), CrosshairTool(overlay=cursor))
            fig.legend.click_policy = "hide"
            fig.legend.location = "bottom_left"

    def show(self, source: ColumnDataSource, frequencies: np.ndarray, values: np.ndarray) -> None:
        """Put ``values`` (f,) at ``frequencies`` (f,), Hz, into one of the sources."""
        source.data = {"f": frequencies, "size": np.abs(values), "phase": np.degrees(np.angle(values))}

    def show_measured(self, curves: MeasuredCurves | None, sensor: str, source: str) -> None:
        """Put a measured response into its source, or nothing."""
        known = curves is not None and sensor in curves.sensors and source in curves.inputs
        for fig in (self.modulus, self.phase):
            fig.legend.items[-1].visible = known
        if curves is None or not known:
            self.show(self.measured, np.empty(0), np.empty(0, complex))
            return
        values = curves.values[:, curves.sensors.index(sensor), curves.inputs.index(source)]
        kept = np.isfinite(values)
        self.show(self.measured, curves.frequencies[kept], values[kept])


class EnergyBars:
    """Shares of the components in the energies of one mode."""

    def __init__(self, names: list[str]):
        self.source = ColumnDataSource({"name": names, "share": [0.0] * len(names)})
        self.figure = figure(
            title="Energy of the mode", y_range=names[::-1], x_range=(0, 1), x_axis_label="share of kinetic or "
            "potential energy", height=max(120, 40 + 16 * len(names)), sizing_mode="stretch_width", tools="save",
        )  # fmt: skip
        self.figure.toolbar.logo = None
        self.figure.hbar(y="name", right="share", height=0.7, source=self.source, color="#E69F00", line_color="#222222")
        self.figure.add_tools(HoverTool(tooltips=[("", "@name"), ("share", "@share{0.0 %}")]))

    def show(self, shares: dict[str, float]) -> None:
        """Show other shares, by name."""
        names = self.source.data["name"]
        self.source.data = {"name": names, "share": [shares.get(name, 0.0) for name in names]}
