"""The curves of a verification's figure as a table (CSV), to be calculated with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from matching.bed_test.result import COVERAGE_FACTOR, FunctionCurves
from matching.report.common.csv_table import csv_table
from matching.report.common.wording import unit


def curve_data(curves: Sequence[FunctionCurves]) -> str:
    """A row per frequency: moduli and phases of vehicle, prediction and bed, and what the bed's modulus is known to.

    Functions may have frequencies of their own: the table has all of them, and no value where a function has none.
    """
    frequencies = np.unique(np.concatenate([curve.frequencies for curve in curves])) if curves else np.empty(0)
    head, columns = ["frequency [Hz]"], [frequencies]
    for curve in curves:
        row = np.searchsorted(frequencies, curve.frequencies)
        per = f"{unit(curve.unit)} per N·m"
        for who in ("vehicle", "predicted", "measured"):
            values, name = getattr(curve, who), f"{curve.sensor} / {curve.input}, {who}"
            head += [f"{name}, modulus [{per}]", f"{name}, phase [deg]"]
            columns += [
                _placed(np.abs(values), row, frequencies),
                _placed(np.degrees(np.angle(values)), row, frequencies),
            ]
        head.append(f"{curve.sensor} / {curve.input}, expanded uncertainty (k = {COVERAGE_FACTOR:g}) [{per}]")
        columns.append(_placed(COVERAGE_FACTOR * curve.uncertainty, row, frequencies))
    return csv_table(head, ([_known(value) for value in row] for row in zip(*columns, strict=True)))


def _placed(values: np.ndarray, row: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    placed = np.full(len(frequencies), np.nan)
    placed[row] = values
    return placed


def _known(value: Any) -> Any:
    return value if np.isfinite(value) else None
