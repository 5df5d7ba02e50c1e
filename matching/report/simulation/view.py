"""A simulation: every reading over time."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.report.common.style import VEHICLE, figure, styled
from matching.report.common.table import aligned, table
from modelling.common import display
from modelling.simulation.result import Simulation


@display.plot.register
def plot(done: Simulation) -> Figure:
    """Every reading over time."""
    with styled():
        drawn = figure(7.0, 1.0 + 1.5 * max(1, len(done.readings)))
        axes = drawn.subplots(max(1, len(done.readings)), 1, sharex=True, squeeze=False)[:, 0]
        for one, (name, value) in zip(axes, done.readings.items()):
            one.plot(done.time, value, color=VEHICLE, linewidth=0.9)
            one.set_ylabel(f"{name.replace('_', ' ')}\nin {done.units[name].replace('*', '·').replace('^2', '²')}")
            one.margins(x=0)
        axes[-1].set_xlabel("time in s")
        drawn.align_ylabels(axes)
    return drawn


@display.text.register
def said(done: Simulation) -> str:
    """Range of every reading."""
    return aligned(_rows(done), _title(done))


@display.html.register
def html(done: Simulation) -> str:
    """The same for a notebook."""
    return table(_rows(done), _title(done))


def _title(done: Simulation) -> str:
    return f"{len(done.time)} samples over {done.time[-1] - done.time[0]:g} s"


def _rows(done: Simulation) -> list[dict[str, str]]:
    return [
        {"reading": name, "from": f"{value.min():.4g}", "to": f"{value.max():.4g}", "unit": done.units[name]}
        for name, value in done.readings.items()
    ]
