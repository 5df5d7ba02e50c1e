"""Views of frequency responses and of simulations."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from matching.report.common import LIMIT, VEHICLE, csv_table, curve, figure, image, spaced, styled, unit
from matching.report.page import register_table
from modelling import display
from modelling.linear.state_space import Response
from modelling.recordings.read import csv_text
from modelling.simulation.stepping import Simulation
from modelling.units import of_input

# --- Views of frequency responses: amplitude and phase, and where each is largest.


@display.plot.register
def plot_response(response: Response) -> Figure:
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
        per = " or ".join(dict.fromkeys(unit(of_input(response.units[name])) for name in response.inputs))
        grid[0, 0].set_ylabel(f"amplitude in SI unit\nof the sensor per {per}")
        grid[1, 0].set_ylabel("phase in °")
        fig.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=7)
    return fig


@display.files.register
def response_files(response: Response, folder: str, made: Any = None) -> display.ResultFiles:
    """Modulus and phase over frequency as CSV and as a figure; no result file, as JSON has no complex numbers."""
    head, columns = ["frequency [Hz]"], [response.frequencies]
    for sensor, source in itertools.product(response.sensors, response.inputs):
        pair = f"{sensor} / {source}"
        head += [f"{pair} modulus [{response.unit(sensor, source)}]", f"{pair} phase [deg]"]
        columns += [np.abs(response[sensor, source]), np.degrees(np.angle(response[sensor, source]))]
    others: dict[str, str | bytes] = {
        "response.csv": csv_table(head, zip(*columns, strict=True)),
        "response.svg": image(plot_response(response)),
    }
    return "", {}, others


def _response_rows(response: Response) -> list[dict[str, str]]:
    """Where every response is largest."""
    rows = []
    for sensor, source in itertools.product(response.sensors, response.inputs):
        size = np.abs(response[sensor, source])
        at = response.frequencies[int(size.argmax())]
        rows.append({"sensor": sensor, "input": source, "largest": f"{size.max():.4g}", "at [Hz]": f"{at:.4g}"})
    return rows


register_table(Response, _response_rows)


# --- Views of a simulation: every sensor reading over time, with the measured one behind it if there is one.

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
def plot_simulation(simulation: Simulation) -> Figure:
    """Every reading over time."""
    return simulation_figure(simulation)


@display.files.register
def simulation_files(
    simulation: Simulation, folder: str = "", made: Any = None, measured: Mapping[str, np.ndarray] | None = None
) -> display.ResultFiles:
    """Every reading over time as CSV and as a figure, recorded ones (t,) by sensor behind them; no result file."""
    others: dict[str, str | bytes] = {"simulated.csv": csv_text(simulation.time, simulation.readings, simulation.units)}
    if simulation.readings:
        others["simulated.svg"] = image(simulation_figure(simulation, measured))
    return "", {}, others


def _title(simulation: Simulation) -> str:
    return f"{len(simulation.time)} samples over {simulation.time[-1] - simulation.time[0]:g} s"


def _simulation_rows(simulation: Simulation) -> list[dict[str, str]]:
    """Range of every reading."""
    return [
        {"reading": name, "from": f"{values.min():.4g}", "to": f"{values.max():.4g}",
         "unit": unit(simulation.units[name])}
        for name, values in simulation.readings.items()
    ]  # fmt: skip


register_table(Simulation, _simulation_rows, _title)
