"""Views of a simulation: every sensor reading over time, with the measured one behind it if there is one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from matching.report.common.style import LIMIT, VEHICLE, figure, styled
from matching.report.common.table import aligned, table
from matching.report.common.wording import spaced, unit
from modelling.common import display
from modelling.simulation.result import Simulation

ROW_HEIGHT = 1.5  # inches


def simulation_figure(simulation: Simulation, measured: Mapping[str, np.ndarray] | None = None) -> Figure:
    """Every reading over time, a row each.

    Parameters
    ----------
    simulation : Simulation
    measured : mapping of str to ndarray (t,), optional
        Recorded readings by sensor, at the times of the simulation.
    """
    measured = measured or {}
    count = max(1, len(simulation.readings))
    with styled():
        fig = figure(7.0, 1.0 + ROW_HEIGHT * count)
        rows = fig.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
        for axes, (name, values) in zip(rows, simulation.readings.items()):
            if name in measured:
                read = np.isfinite(measured[name])  # a slower channel has no reading at most times
                axes.plot(
                    simulation.time[read], measured[name][read], color=LIMIT, linewidth=3.2, alpha=0.35,
                    label="recorded",
                )  # fmt: skip
            axes.plot(simulation.time, values, color=VEHICLE, linewidth=0.8, label="simulated")
            axes.set_ylabel(f"{spaced(name)}\nin {unit(simulation.units[name])}")
            axes.margins(x=0)
        rows[-1].set_xlabel("time in s")
        if measured:
            entries = max((axes.get_legend_handles_labels() for axes in rows), key=lambda entry: len(entry[0]))
            fig.legend(*entries, loc="outside upper right", ncols=2)
        fig.align_ylabels()
    return fig


@display.plot.register
def plot(simulation: Simulation) -> Figure:
    """Every reading over time."""
    return simulation_figure(simulation)


@display.text.register
def as_text(simulation: Simulation) -> str:
    """Range of every reading."""
    return aligned(_rows(simulation), _title(simulation))


@display.html.register
def as_html(simulation: Simulation) -> str:
    """The text of the result as HTML for a notebook."""
    return table(_rows(simulation), _title(simulation))


def _title(simulation: Simulation) -> str:
    return f"{len(simulation.time)} samples over {simulation.time[-1] - simulation.time[0]:g} s"


def _rows(simulation: Simulation) -> list[dict[str, str]]:
    return [
        {
            "reading": name,
            "from": f"{values.min():.4g}",
            "to": f"{values.max():.4g}",
            "unit": unit(simulation.units[name]),
        }
        for name, values in simulation.readings.items()
    ]
