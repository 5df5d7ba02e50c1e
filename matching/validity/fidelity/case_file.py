"""Fidelity cases (TOML): partial fidelities as stated values, or calculated from recordings of road and test bed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from matching.validity.budget.budget_file import read_budget
from matching.validity.budget.inputs import read_coverage_factor
from matching.validity.fidelity.recordings import RecordingPair, read_recordings
from matching.validity.uncertainty.evaluate import evaluate
from modelling.common.errors import InputError
from modelling.common.escape import single_line
from modelling.common.tables import check_keys, no_pipe, number, one_of, read_toml, text, title
from modelling.fidelity.assess import assemble, assess_signal
from modelling.fidelity.delay import Delay
from modelling.fidelity.fidelity import (
    DYNAMIC_DOMAINS,
    MEASUREMENT_DOMAIN,
    Fidelity,
    FidelityMethod,
    SensorUncertainty,
    SignalFidelity,
    SignalPair,
)
from modelling.fidelity.measures import ARITHMETICS, NRMSE_FORMS, delay_fidelity
from modelling.measurement.channels import Channel
from modelling.units import Unit, signal_quantity, to_si

KEYS = (
    "title", "f_max", "arithmetic", "nrmse", "longest_delay", "recordings", "weights", *DYNAMIC_DOMAINS,
    MEASUREMENT_DOMAIN,
)  # fmt: skip
LONGEST_DELAY = 1000.0  # s, of a stated one
STATED_KEYS = ("nrmse_fidelity", "nrmse_uncertainty", "delay", "delay_uncertainty")
MEASURED_KEYS = ("reference", "test", "reference_noise", "test_noise")
SENSOR_KEYS = (
    "fidelity", "expanded_uncertainty", "range", "signal", "budget", "measurand", "coverage_factor",
    "degrees_of_freedom",
)  # fmt: skip
LARGEST_F_MAX = 1e6  # Hz
F_MAX = 30.0  # Hz: the largest relevant frequency of drivability, as in the paper


@dataclass(frozen=True)
class _StatedUncertainty:
    """U in SI with its dimension (None: a number without unit), k and degrees of freedom."""

    expanded: float
    dimension: Any
    coverage_factor: float
    degrees_of_freedom: float


@dataclass(frozen=True)
class _Context:
    """What the tables of signals need besides themselves."""

    method: FidelityMethod
    recordings: RecordingPair | None
    uncertainties: Mapping[str, _StatedUncertainty]  # by signal


def read_case(
    path: Path | str,
    arithmetic: str | None = None,
    nrmse: str | None = None,
    channels: Mapping[str, Channel] | None = None,
) -> tuple[str, Fidelity]:
    """Title and fidelity of a case file.

    Parameters
    ----------
    arithmetic, nrmse : str, optional
        Instead of what the file says; see :mod:`modelling.fidelity.measures`.
    channels : mapping of str to Channel, optional
        What the recordings call the signals (:func:`modelling.measurement.channels.read_channels`).

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
    """As :func:`read_case` for tables as ``tomllib`` reads them; other files are looked for beside ``path``.

    Raises
    ------
    InputError
        One line that names file and key.
    """
    where = str(path)
    check_keys(tables, KEYS, where)
    method = _method(tables, where, arithmetic, nrmse)
    recordings = None
    if "recordings" in tables:
        recordings = read_recordings(tables["recordings"], path, _compared_columns(tables), channels)
    elif channels:
        raise InputError(where, "has no recordings whose channels could be named", "leave out --channels")
    sensor_tables = _subtables(tables, MEASUREMENT_DOMAIN, where)
    uncertainties = {
        table["signal"]: _uncertainty(table, f"{where}: {MEASUREMENT_DOMAIN}.{name}", path)
        for name, table in sensor_tables.items()
        if isinstance(table, dict) and isinstance(table.get("signal"), str)
    }
    context = _Context(method, recordings, uncertainties)
    signals = {}
    for domain in DYNAMIC_DOMAINS:
        members = tuple(
            _signal(name, table, f"{where}: {domain}.{name}", context)
            for name, table in _subtables(tables, domain, where).items()
        )
        if members:
            signals[domain] = members
    sensors = tuple(
        _sensor(name, table, f"{where}: {MEASUREMENT_DOMAIN}.{name}", path, signals)
        for name, table in sensor_tables.items()
    )
    weights = None
    if "weights" in tables:
        weights_table = check_keys(tables["weights"], (*DYNAMIC_DOMAINS, MEASUREMENT_DOMAIN), f"{where}: weights")
        weights = {name: number(weights_table, name, f"{where}: weights") for name in weights_table}
    fidelity = assemble(signals, sensors, weights, method, recordings.step if recordings else None, where)
    if recordings:
        fidelity = replace(fidelity, notes=recordings.notes)
    return title(tables, where, single_line(path.stem)), fidelity


def _method(tables: dict[str, Any], where: str, arithmetic: str | None, nrmse: str | None) -> FidelityMethod:
    f_max = to_si(tables.get("f_max", F_MAX), "Hz", f"{where}: f_max")
    if not 0 < f_max <= LARGEST_F_MAX:
        wrong = f"{f_max:g} is not positive" if f_max <= 0 else f"{f_max:g} Hz is no frequency of a drivetrain"
        raise InputError(f"{where}: f_max", wrong, "give the largest relevant frequency in Hz")
    form = one_of(nrmse or text(tables, "nrmse", where, "definition"), NRMSE_FORMS, f"{where}: nrmse")
    arithmetic = arithmetic or text(tables, "arithmetic", where, "definition")
    longest = to_si(tables["longest_delay"], "s", f"{where}: longest_delay") if "longest_delay" in tables else None
    return FidelityMethod(f_max, one_of(arithmetic, ARITHMETICS, f"{where}: arithmetic"), form, longest)


def _subtables(tables: dict[str, Any], key: str, where: str) -> dict[str, Any]:
    """The table under a key, which may have any keys."""
    table = tables.get(key, {})
    return check_keys(table, table if isinstance(table, dict) else (), f"{where}: {key}")


def _compared_columns(tables: dict[str, Any]) -> set[str]:
    """Columns of the recordings that a case compares; what is wrong with its tables is reported later."""
    return {
        str(table.get(role, name))
        for domain in DYNAMIC_DOMAINS
        if isinstance(tables.get(domain), dict)
        for name, table in tables[domain].items()
        if isinstance(table, dict)
        for role in ("reference", "test")
    }


def _signal(name: str, table: Any, where: str, context: _Context) -> SignalFidelity:
    """One signal of a dynamic domain, from stated values or from the recordings."""
    check_keys(table, (*STATED_KEYS, *MEASURED_KEYS), where)
    if any(key in table for key in STATED_KEYS):
        if any(key in table for key in MEASURED_KEYS):
            raise InputError(
                where,
                "states values and names signals at once",
                f"keep {', '.join(STATED_KEYS)} or {', '.join(MEASURED_KEYS)}",
            )
        return _stated_signal(name, table, where, context.method.f_max)
    if context.recordings is None:
        raise InputError(
            where,
            "has neither values nor recordings",
            "give nrmse_fidelity and delay, or [recordings] with reference and test",
        )
    columns = text(table, "reference", where, name), text(table, "test", where, name)
    measured = context.recordings.signal(*columns, where)
    noise = None
    if "reference_noise" in table or "test_noise" in table:
        noise = tuple(_standard_deviation(table, key, measured.unit, where) for key in MEASURED_KEYS[2:])
    pair = SignalPair(measured.reference, measured.test, noise=noise)  # type: ignore[arg-type]
    stated = context.uncertainties.get(name)
    if stated is not None:
        if None not in (stated.dimension, measured.unit.dimension) and stated.dimension != measured.unit.dimension:
            raise InputError(
                where, f"its sensor's uncertainty has another dimension than {measured.unit.text}", "correct a unit"
            )
        pair = replace(
            pair,
            expanded_uncertainty=stated.expanded,
            coverage_factor=stated.coverage_factor,
            degrees_of_freedom=stated.degrees_of_freedom,
        )
    return assess_signal(name, pair, context.recordings.step, context.method, where.rpartition(".")[0])


def _stated_signal(name: str, table: dict[str, Any], where: str, f_max: float) -> SignalFidelity:
    nrmse = _fraction(table, "nrmse_fidelity", where)
    delay = to_si(table.get("delay", 0.0), "s", f"{where}.delay")
    delay_u = to_si(table.get("delay_uncertainty", 0.0), "s", f"{where}.delay_uncertainty")
    for key, seconds in (("delay", delay), ("delay_uncertainty", delay_u)):
        if abs(seconds) > LONGEST_DELAY:
            wrong = f"{seconds:g} s is no delay of a test bed"
            raise InputError(f"{where}.{key}", wrong, f"at most {LONGEST_DELAY:g} s are possible")
    nrmse_u = _fraction(table, "nrmse_uncertainty", where) if "nrmse_uncertainty" in table else 0.0
    estimate = Delay(delay, abs(delay_u), "", delay)
    return SignalFidelity(name, nrmse, estimate, float(delay_fidelity(delay, f_max)), nrmse_u)


def _standard_deviation(table: dict[str, Any], key: str, unit: Unit, where: str) -> float:
    """A standard deviation in the unit of a signal, SI; 0 where there is none."""
    value, dimension = signal_quantity(table.get(key, 0.0), f"{where}.{key}")
    if None not in (dimension, unit.dimension) and dimension != unit.dimension:
        raise InputError(f"{where}.{key}", "has another dimension than the signal", f"give it in {unit.text}")
    if value < 0:
        raise InputError(f"{where}.{key}", f"{value:g} is negative", "give a standard deviation")
    return value


def _fraction(table: dict[str, Any], key: str, where: str) -> float:
    if key not in table:
        raise InputError(where, f"'{key}' is missing", f'give {key} = 0.95 or "95 %"')
    value = to_si(table[key], "1", f"{where}.{key}")
    if not 0 <= value <= 1:
        raise InputError(f"{where}.{key}", f"{value:g} is not in 0 ... 1", 'give a fraction such as 0.95 or "95 %"')
    return value


def _degrees_of_freedom(table: dict[str, Any], where: str) -> float:
    return number(table, "degrees_of_freedom", where, positive=True) if "degrees_of_freedom" in table else math.inf


def _uncertainty(table: dict[str, Any], where: str, path: Path) -> _StatedUncertainty:
    """The uncertainty of a sensor, from the case itself or from a budget file."""
    if "budget" in table:
        return _uncertainty_of_budget(table, where, path)
    factor = read_coverage_factor(table, where) if "coverage_factor" in table else 2.0
    if "expanded_uncertainty" not in table:
        raise InputError(where, "has no uncertainty", "give expanded_uncertainty, budget or fidelity")
    value, dimension = signal_quantity(table["expanded_uncertainty"], f"{where}.expanded_uncertainty")
    if value < 0:
        raise InputError(f"{where}.expanded_uncertainty", f"{value:g} is negative", "give a number of at least 0")
    return _StatedUncertainty(value, dimension, factor, _degrees_of_freedom(table, where))


def _uncertainty_of_budget(table: dict[str, Any], where: str, path: Path) -> _StatedUncertainty:
    budget = read_budget(no_pipe(path.parent / text(table, "budget", where), where))
    results = evaluate(budget, with_monte_carlo=False).measurands
    wanted = text(table, "measurand", where, results[0].measurand.name)
    for result in results:
        if result.measurand.name == wanted:
            unit = result.measurand.unit
            freedom = result.propagation.degrees_of_freedom or math.inf
            return _StatedUncertainty(result.expanded, unit.dimension, result.coverage_factor, freedom)
    raise InputError(
        f"{where}.measurand",
        f"the budget has no '{wanted}'",
        f"choose {', '.join(result.measurand.name for result in results)}",
    )


def _sensor(
    name: str, table: Any, where: str, path: Path, signals: dict[str, tuple[SignalFidelity, ...]]
) -> SensorUncertainty:
    check_keys(table, SENSOR_KEYS, where)
    if "fidelity" in table:
        return SensorUncertainty(name, 1 - _fraction(table, "fidelity", where), _degrees_of_freedom(table, where))
    stated = _uncertainty(table, where, path)
    if "signal" in table:
        wanted = text(table, "signal", where)
        for members in signals.values():
            for signal in members:
                if signal.name == wanted and signal.pair is not None:
                    return SensorUncertainty(name, stated.expanded / signal.width, stated.degrees_of_freedom)
        raise InputError(
            f"{where}.signal", f"there is no measured signal '{wanted}'", "name one taken from the recordings"
        )
    if "range" not in table:
        raise InputError(where, "has no range", "give range, or signal = the name of a measured signal")
    width, dimension = signal_quantity(table["range"], f"{where}.range")
    if width <= 0:
        raise InputError(f"{where}.range", f"{width:g} is not positive", "give the range of the signal")
    if dimension != stated.dimension:
        raise InputError(f"{where}.range", "and the uncertainty have unlike dimensions", "give both in the same unit")
    return SensorUncertainty(name, stated.expanded / width, stated.degrees_of_freedom)
