"""Views of frequency responses: amplitude and phase, and where each is largest."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from matching.report.common.style import curve, figure, styled
from matching.report.common.table import aligned, table
from matching.report.common.wording import spaced
from modelling.common import display
from modelling.linear.response import Response


@display.plot.register
def plot(response: Response) -> Figure:
    """Amplitude and phase of every sensor, a column an input."""
    columns = len(response.inputs)
    with styled():
        fig = figure(max(7.0, 3.4 * columns), 5.4)
        grid = fig.subplots(2, columns, sharex=True, sharey="row", height_ratios=[2, 1], squeeze=False)
        for source, (amplitude, phase) in zip(response.inputs, grid.T, strict=True):
            for place, sensor in enumerate(response.sensors):
                values, look = response[sensor, source], curve(place)
                amplitude.loglog(response.frequencies, np.abs(values), label=spaced(sensor), **look)
                phase.semilogx(response.frequencies, np.degrees(np.unwrap(np.angle(values))), **look)
            amplitude.set_title(f"to {spaced(source)}", fontsize=9)
            phase.set_xlabel("frequency in Hz")
        grid[0, 0].set_ylabel("amplitude in SI unit\nof the sensor per N·m")
        grid[1, 0].set_ylabel("phase in °")
        fig.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=7)
    return fig


@display.text.register
def as_text(response: Response) -> str:
    """Where every response is largest."""
    return aligned(_rows(response))


@display.html.register
def as_html(response: Response) -> str:
    """The result as HTML for a notebook."""
    return table(_rows(response))


def _rows(response: Response) -> list[dict[str, str]]:
    rows = []
    for sensor in response.sensors:
        for source in response.inputs:
            size = np.abs(response[sensor, source])
            rows.append(
                {
                    "sensor": sensor,
                    "input": source,
                    "largest": f"{size.max():.4g}",
                    "at [Hz]": f"{response.frequencies[int(size.argmax())]:.4g}",
                }
            )
    return rows
