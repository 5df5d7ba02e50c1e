"""What no fit saw: readings, what both models leave of them, and the fidelity that follows (R_RVM of Eq. 21).

A model that is diagnosed is what a residual vehicle model is cut out of, so R_RVM is what its errors cost a test bed.
Reference is the measurement, test the free simulation; R_MU takes U = 2·u of the sensors (Eqs. 22, 23).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from matching.diagnosis.data.preparation import LONG_GAP
from matching.diagnosis.data.segments import Segment
from modelling.fidelity.assess import Fidelity, Sensor, SignalFidelity, SignalPair, assemble, assess_signal
from modelling.fidelity.measures import WEIGHTS, delay_fidelity, dynamics_fidelity
from modelling.fidelity.spread import spread
from modelling.model.system import System

F_MAX = 30.0  # Hz, of drivability; a quarter of the sampling frequency where that is less
LONGEST_DELAY = 0.25  # s
SHORT_GAP = 0.02  # s without a reading that is bridged by a straight line
LEAST = 64  # samples of a stretch
DRAWS = 5_000
COVERAGE_FACTOR = 2.0
DOMAINS = {"residual_vehicle_model": "R_RVM", "measurement_uncertainty": "R_MU"}


@dataclass(frozen=True)
class HoldoutData:
    """Data that no fit saw.

    Attributes
    ----------
    time : ndarray (t,)
        s, from the start of each recording; stretches one after another.
    parts : tuple of slice
    measured, before, after : ndarray (t, y)
        Readings, and measured − simulated of base and extended model, SI; NaN where nothing was measured or simulated.
    noise : ndarray (y,)
    """

    time: np.ndarray
    parts: tuple[slice, ...]
    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray
    noise: np.ndarray


def holdout_data(noise: np.ndarray, *models: tuple[Sequence[Segment], Sequence[np.ndarray]]) -> HoldoutData:
    """Lay out what base and extended model leave of unseen data.

    Parameters
    ----------
    noise : ndarray (y,)
    models : pairs of list of Segment and list of ndarray (t, y)
        For base and extended model: the stretches, each in an order of its own, and the residuals on them one after
        another, in times the noise.
    """
    rows, residuals = [], []
    for segments, left in models:
        names = np.concatenate([np.full(len(own.time), own.name) for own in segments])
        time = np.concatenate([own.time for own in segments])
        order = np.lexsort((time, names))
        rows.append((names[order], time[order], order))
        residuals.append(np.concatenate(left)[order] * noise)
    names, time, order = rows[0]
    measured = np.concatenate([own.readings for own in models[0][0]])[order]
    cuts = np.flatnonzero((names[1:] != names[:-1]) | (np.diff(time) > LONG_GAP)) + 1
    ends = [0, *(int(cut) for cut in cuts), len(time)]
    parts = tuple(slice(a, b) for a, b in pairwise(ends))
    return HoldoutData(time, parts, measured, residuals[0], residuals[1], noise)


def fidelity(system: System, data: HoldoutData) -> dict[str, Any] | None:
    """R_RVM and R_MU before and after the extension, by sensor, by domain and in total; None if no sensor tells.

    A sensor's figures are those of its longest stretch without a gap. ``noise_floor`` is what a perfect model would
    score, for the measurement's noise counts against any.
    """
    step = float(np.median(np.diff(data.time[data.parts[0]])))
    f_max = min(F_MAX, 0.25 / step)
    signals: dict[str, list[SignalFidelity]] = {"before": [], "after": []}
    floor, sensors, seconds, notes = [], [], {}, []
    for j, sensor in enumerate(system.sensors):
        if not np.isfinite(data.measured[:, j]).any():
            continue
        cut = _stretch(data, j)
        if cut is None:
            notes.append(f"{sensor.name} has no stretch of unseen data long enough for its fidelity")
            continue
        measured, before, after, length = cut
        if not np.ptp(measured) > 4 * data.noise[j]:
            notes.append(f"{sensor.name} hardly moves on unseen data and does not count in the fidelity")
            continue
        u, width = float(data.noise[j]), float(np.ptp(measured))
        tests = {"before": measured - before, "after": measured - after}
        for key, test in tests.items():
            own = SignalPair(measured, test, noise=(u, 0.0))
            signals[key].append(assess_signal(sensor.name, own, step, f_max, longest_delay=LONGEST_DELAY))
        floor.append(max(0.0, 1 - u / width))
        sensors.append(Sensor(sensor.name, COVERAGE_FACTOR * u / width))
        seconds[sensor.name] = length
    if not sensors:
        return None
    total = sum(WEIGHTS[name] for name in DOMAINS)
    weights = {name: WEIGHTS[name] / total for name in DOMAINS}
    made = {
        key: assemble({"residual_vehicle_model": tuple(own)}, tuple(sensors), weights, f_max, step=step)
        for key, own in signals.items()
    }
    return {
        "f_max": f_max, "weights": {DOMAINS[name]: share for name, share in weights.items()},
        "before": _described(made["before"]), "after": _described(made["after"]),
        "noise_floor": {"R_RVM": dynamics_fidelity(floor, [float(delay_fidelity(0.0, f_max))] * len(floor))},
        "seconds": seconds, "notes": notes,
    }  # fmt: skip


def _stretch(data: HoldoutData, j: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float] | None:
    """Measured and both residuals of a sensor over its longest stretch without a long gap, evenly spaced; its s."""
    best: tuple[int, np.ndarray, np.ndarray] | None = None
    for part in data.parts:
        there = np.isfinite(data.measured[part, j]) & np.isfinite(data.before[part, j] + data.after[part, j])
        index = np.flatnonzero(there)
        if not len(index):
            continue
        for own in np.split(index, np.flatnonzero(np.diff(data.time[part][index]) > SHORT_GAP) + 1):
            if len(own) >= LEAST and (best is None or len(own) > best[0]):
                best = len(own), own + part.start, data.time[part][own]
    if best is None:
        return None
    _, rows, time = best
    step = float(np.median(np.diff(time)))
    even = time[0] + step * np.arange(int((time[-1] - time[0]) / step * (1 + 1e-9)) + 1)
    columns = (data.measured[rows, j], data.before[rows, j], data.after[rows, j])
    measured, before, after = (np.interp(even, time, own) for own in columns)
    return measured, before, after, float(even[-1] - even[0])


def _described(own: Fidelity) -> dict[str, Any]:
    drawn = spread(own, DRAWS).summary()
    return {short: own.domains[name] for name, short in DOMAINS.items()} | {
        "R_RVM_standard_uncertainty": drawn["residual_vehicle_model"]["standard_uncertainty"],
        "R_XiL": own.total,
        "standard_uncertainty": drawn["total"]["standard_uncertainty"],
        "signals": [
            {"name": one.name, "R_NRMSE": one.nrmse, "R_tau": one.delay_fidelity, "delay": one.delay.value,
             "delay_standard_uncertainty": one.delay.standard_uncertainty,
             "delay_undetermined": one.delay.reason or None}
            for one in own.signals["residual_vehicle_model"]
        ],
    }  # fmt: skip
