"""Frequency responses: amplitude and phase."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from matching.report.style import figure, styled
from matching.report.views.table import table
from modelling.response import Response


def plot(response: Response) -> Figure:
    """Amplitude and phase of every sensor to every input."""
    with styled():
        drawn = figure(7.0, 4.6)
        amplitude, phase = drawn.subplots(2, 1, sharex=True, height_ratios=[2, 1])
        for sensor in response.sensors:
            for source in response.inputs:
                own = response[sensor, source]
                amplitude.loglog(response.frequencies, np.abs(own), label=f"{sensor} to {source}".replace("_", " "))
                phase.semilogx(response.frequencies, np.degrees(np.unwrap(np.angle(own))))
        amplitude.set_ylabel("amplitude in SI unit\nof the sensor per N·m")
        phase.set_ylabel("phase in °")
        phase.set_xlabel("frequency in Hz")
        amplitude.legend(fontsize=7)
    return drawn


def html(response: Response) -> str:
    """Where every response is largest."""
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
    return table(rows)
