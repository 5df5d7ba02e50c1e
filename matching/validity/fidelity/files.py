"""Fidelity cases (TOML): partial fidelities given as values, or worked out from recordings of road and rig."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from matching.validity.fidelity.recordings import Recordings, read_recordings
from matching.validity.uncertainty.evaluate import evaluate
from matching.validity.uncertainty.files import read_budget
from modelling.common.errors import InputError
from modelling.common.tables import check_keys, number, one_of, read_toml, text
from modelling.fidelity.assess import (
    DYNAMIC,
    MEASUREMENT,
    Fidelity,
    Sensor,
    SignalFidelity,
    SignalPair,
    assemble,
    assess_signal,
)
from modelling.fidelity.delay import Delay
from modelling.fidelity.measures import ARITHMETICS, NRMSE, delay_fidelity
from modelling.measurement.channels import Channel
from modelling.units import Unit, signal_quantity, to_si

TOP = ("title", "f_max", "arithmetic", "nrmse", "longest_delay", "recordings", "weights", *DYNAMIC, MEASUREMENT)
GIVEN = ("nrmse_fidelity", "nrmse_uncertainty", "delay", "delay_uncertainty")
MEASURED = ("reference", "test", "reference_noise", "test_noise")
SENSOR = (
    "fidelity",
    "expanded_uncertainty",
    "range",
    "signal",
    "budget",
    "measurand",
    "coverage_factor",
    "degrees_of_freedom",
)


def read_case(
    path: Path | str,
    arithmetic: str | None = None,
    nrmse: str | None = None,
    channels: Mapping[str, Channel] | None = None,
) -> tuple[str, Fidelity]:
    """Title and fidelity of a case file; ``arithmetic`` and ``nrmse`` override what the file says.

    ``channels`` tells what the recordings call the signals (:func:`modelling.measurement.channels.read_channels`).

    Raises
    ------
    InputError
        On any fault of the file or its recordings.
    """
    path = Path(path)
    return fidelity_from_tables(read_toml(path), path, arithmetic, nrmse, channels)


def fidelity_from_tables(
    tables: dict[str, Any],
    path: Path,
    arithmetic: str | None = None,
    nrmse: str | None = None,
    channels: Mapping[str, Channel] | None = None,
) -> tuple[str, Fidelity]:
    """As ``read_case`` for tables as ``tomllib`` reads them; other files are looked for beside ``path``."""
    where = str(path)
    check_keys(tables, TOP, where)
    f_max = to_si(tables.get("f_max", 30.0), "Hz", f"{where}: f_max")
    if f_max <= 0:
        raise InputError(f"{where}: f_max", f"{f_max:g} is not positive", "give the largest relevant frequency in Hz")
    form = one_of(nrmse or text(tables, "nrmse", where, "definition"), NRMSE, f"{where}: nrmse")
    way = one_of(arithmetic or text(tables, "arithmetic", where, "definition"), ARITHMETICS, f"{where}: arithmetic")
    longest = to_si(tables["longest_delay"], "s", f"{where}: longest_delay") if "longest_delay" in tables else None
    recordings = None
    if "recordings" in tables:
        recordings = read_recordings(tables["recordings"], path, _compared(tables), channels)
    elif channels:
        raise InputError(where, "has no recordings whose channels could be named", "leave out --channels")
    sensors_given = check_keys(tables.get(MEASUREMENT, {}), tables.get(MEASUREMENT, {}), f"{where}: {MEASUREMENT}")
    by_signal = {
        table["signal"]: _uncertainty(table, f"{where}: {MEASUREMENT}.{name}", path)
        for name, table in sensors_given.items()
        if isinstance(table, dict) and "signal" in table
    }
    signals = {}
    for domain in DYNAMIC:
        given = check_keys(tables.get(domain, {}), tables.get(domain, {}), f"{where}: {domain}")
        members = tuple(
            _signal(name, table, f"{where}: {domain}.{name}", f_max, form, recordings, longest, by_signal)
            for name, table in given.items()
        )
        if members:
            signals[domain] = members
    sensors = tuple(
        _sensor(name, table, f"{where}: {MEASUREMENT}.{name}", path, signals) for name, table in sensors_given.items()
    )
    weights = None
    if "weights" in tables:
        weights_table = check_keys(tables["weights"], (*DYNAMIC, MEASUREMENT), f"{where}: weights")
        weights = {name: number(weights_table, name, f"{where}: weights") for name in weights_table}
    fidelity = assemble(signals, sensors, weights, f_max, way, form, recordings.step if recordings else None, where)
    if recordings:
        fidelity = replace(fidelity, notes=recordings.reference.notes + recordings.test.notes)
    return text(tables, "title", where, path.stem), fidelity


def _compared(tables: dict[str, Any]) -> set[str]:
    """Columns of the recordings that a case compares; what is wrong with its tables is told later."""
    return {
        str(own.get(kind, name))
        for domain in DYNAMIC
        if isinstance(tables.get(domain), dict)
        for name, own in tables[domain].items()
        if isinstance(own, dict)
        for kind in ("reference", "test")
    }


def _signal(
    name: str,
    table: Any,
    where: str,
    f_max: float,
    form: str,
    recordings: Recordings | None,
    longest: float | None,
    by_signal: dict[str, Any],
) -> SignalFidelity:
    check_keys(table, (*GIVEN, *MEASURED), where)
    if any(key in table for key in GIVEN):
        if any(key in table for key in MEASURED):
            raise InputError(
                where, "gives values and signals at once", f"keep {', '.join(GIVEN)} or {', '.join(MEASURED)}"
            )
        nrmse = _fraction(table, "nrmse_fidelity", where)
        lag = to_si(table.get("delay", 0.0), "s", f"{where}.delay")
        doubt = to_si(table.get("delay_uncertainty", 0.0), "s", f"{where}.delay_uncertainty")
        spread = _fraction(table, "nrmse_uncertainty", where) if "nrmse_uncertainty" in table else 0.0
        return SignalFidelity(name, nrmse, Delay(lag, abs(doubt), "", lag), float(delay_fidelity(lag, f_max)), spread)
    if recordings is None:
        raise InputError(
            where,
            "has neither values nor recordings",
            "give nrmse_fidelity and delay, or [recordings] with reference and test",
        )
    reference, test, unit = recordings.pair(
        text(table, "reference", where, name), text(table, "test", where, name), where
    )
    noise = None
    if "reference_noise" in table or "test_noise" in table:
        noise = (_like(table, "reference_noise", unit, where), _like(table, "test_noise", unit, where))
    expanded, factor, freedom = by_signal.get(name, ((None, None), 2.0, math.inf))
    if None not in (expanded[1], unit.dimension) and expanded[1] != unit.dimension:
        raise InputError(where, f"its sensor's uncertainty has another dimension than {unit.text}", "correct a unit")
    pair = SignalPair(reference, test, expanded[0], factor, freedom, noise, unit.text)
    return assess_signal(name, pair, recordings.step, f_max, form, longest, None, where.rpartition(".")[0])


def _like(table: Any, key: str, unit: Unit, where: str) -> float:
    value, dimension = signal_quantity(table.get(key, 0.0), f"{where}.{key}")
    if None not in (dimension, unit.dimension) and dimension != unit.dimension:
        raise InputError(f"{where}.{key}", "has another dimension than the signal", f"give it in {unit.text}")
    if value < 0:
        raise InputError(f"{where}.{key}", f"{value:g} is negative", "give a standard deviation")
    return value


def _fraction(table: Any, key: str, where: str) -> float:
    if key not in table:
        raise InputError(where, f"'{key}' is missing", f'give {key} = 0.95 or "95 %"')
    value = to_si(table[key], "1", f"{where}.{key}")
    if not 0 <= value <= 1:
        raise InputError(f"{where}.{key}", f"{value:g} is not in 0 ... 1", 'give a fraction such as 0.95 or "95 %"')
    return value


def _uncertainty(table: Any, where: str, path: Path) -> tuple[tuple[float, Any], float, float]:
    """U with its dimension, k and degrees of freedom, from the case or from a budget file."""
    freedom = number(table, "degrees_of_freedom", where, positive=True) if "degrees_of_freedom" in table else math.inf
    factor = number(table, "coverage_factor", where, positive=True) if "coverage_factor" in table else 2.0
    if "budget" not in table:
        if "expanded_uncertainty" not in table:
            raise InputError(where, "has no uncertainty", "give expanded_uncertainty, budget or fidelity")
        value = signal_quantity(table["expanded_uncertainty"], f"{where}.expanded_uncertainty")
        if value[0] < 0:
            raise InputError(
                f"{where}.expanded_uncertainty", f"{value[0]:g} is negative", "give a number of at least 0"
            )
        return value, factor, freedom
    results, _ = evaluate(read_budget(path.parent / text(table, "budget", where)), with_monte_carlo=False)
    wanted = text(table, "measurand", where, results[0].measurand.name)
    for result in results:
        if result.measurand.name == wanted:
            unit = result.measurand.unit
            scale = signal_quantity(f"1 {unit.text}", where)[0] / unit.scale  # 1/min counts turns in a signal
            found = result.propagation.degrees_of_freedom
            return (result.expanded * scale, unit.dimension), result.coverage_factor, found or math.inf
    raise InputError(
        f"{where}.measurand",
        f"the budget has no '{wanted}'",
        f"choose {', '.join(one.measurand.name for one in results)}",
    )


def _sensor(name: str, table: Any, where: str, path: Path, signals: dict[str, tuple[SignalFidelity, ...]]) -> Sensor:
    check_keys(table, SENSOR, where)
    freedom = number(table, "degrees_of_freedom", where, positive=True) if "degrees_of_freedom" in table else math.inf
    if "fidelity" in table:
        return Sensor(name, 1 - _fraction(table, "fidelity", where), freedom)
    (value, dimension), _, freedom = _uncertainty(table, where, path)
    if "signal" in table:
        wanted = text(table, "signal", where)
        for members in signals.values():
            for one in members:
                if one.name == wanted and one.pair is not None:
                    return Sensor(name, value / one.width, freedom)
        raise InputError(
            f"{where}.signal", f"there is no measured signal '{wanted}'", "name one taken from the recordings"
        )
    if "range" not in table:
        raise InputError(where, "has no range", "give range, or signal = the name of a measured signal")
    width, other = signal_quantity(table["range"], f"{where}.range")
    if width <= 0:
        raise InputError(f"{where}.range", f"{width:g} is not positive", "give the range of the signal")
    if other != dimension:
        raise InputError(f"{where}.range", "and the uncertainty have unlike dimensions", "give both in the same unit")
    return Sensor(name, value / width, freedom)
