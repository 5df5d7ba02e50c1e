"""The curves of a match's figures as tables (CSV), to be calculated with."""

from __future__ import annotations

import numpy as np

from matching.frequency.search.result import MatchResult
from matching.report.common.csv_table import csv_table
from matching.report.common.wording import unit
from matching.report.match.checks import signals
from matching.report.responses.response_figure import curves_of
from modelling.units import SENSOR_UNITS


def curve_data(result: MatchResult) -> dict[str, str]:
    """CSV texts by the name of the figure whose curves they hold."""
    tables = {"responses": _responses(result)}
    if drawn := signals(result):
        columns = {f"{signal.title}, {who} [{signal.label.rpartition(' in ')[2]}]": values
                   for signal in drawn for who, values in signal.curves.items()}  # fmt: skip
        tables["manoeuvre"] = csv_table(["time [s]", *columns], zip(drawn[0].time, *columns.values(), strict=True))
    return tables


def _responses(result: MatchResult) -> str:
    head, columns = ["frequency [Hz]"], [result.curves.frequencies]
    units = {sensor.name: unit(SENSOR_UNITS[sensor.measures]) for sensor in result.case.vehicle.sensors}
    for index, pair in enumerate(result.case.compared):
        for who, values in curves_of(result, index).items():
            name = f"{pair.sensor} / {pair.input}, {who}"
            head += [f"{name}, modulus [{units[pair.sensor]} per N·m]", f"{name}, phase [deg]"]
            columns += [np.abs(values), np.degrees(np.angle(values))]
    return csv_table(head, zip(*columns, strict=True))
