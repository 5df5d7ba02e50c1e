"""Budget files (TOML) to ``Budget``; the format is described in ``examples/sensors/README.md``."""

from __future__ import annotations

import keyword
from pathlib import Path
from typing import Any

import numpy as np

from matching.validity.budget.budget import Budget, InputQuantity, Measurand
from matching.validity.budget.dimensions import check_turns, dimension_of, result_unit
from matching.validity.budget.formula import functions, parse_formula
from matching.validity.budget.inputs import read_coverage_factor, read_input, read_line
from modelling.common.errors import InputError
from modelling.common.escape import single_line
from modelling.common.tables import check_keys, number, read_toml, text, title
from modelling.units import unit_of

MOST_INPUTS = 500  # matrices of second derivatives and correlations are full
TOP = ("title", "coverage", "coverage_factor", "measurand", "measurands", "inputs", "correlations", "lines")
LONGEST_NAME = 100  # characters of a measurand's name: it stands in sentences and figures


def read_budget(path: Path | str) -> Budget:
    """The budget in a TOML file; raises ``InputError`` on any fault of the file."""
    return budget_from_tables(read_toml(path), str(path))


def budget_from_tables(tables: dict[str, Any], where: str = "budget") -> Budget:
    """The budget in tables as ``tomllib`` reads them.

    Raises
    ------
    InputError
        One line that names file and key.
    """
    check_keys(tables, TOP, where)
    coverage = number(tables, "coverage", where) if "coverage" in tables else 0.95
    if not 0 < coverage < 1:
        raise InputError(f"{where}: coverage", f"{coverage:g} is no probability", "give a number such as 0.95")
    factor = read_coverage_factor(tables, where) if "coverage_factor" in tables else None
    inputs, correlated = _inputs(tables, where)
    names = [quantity.name for quantity in inputs]
    return Budget(
        title(tables, where, single_line(Path(where).stem)),
        _measurands(tables, inputs, where),
        tuple(inputs),
        _correlation(tables.get("correlations", []), correlated, names, where),
        coverage,
        factor,
        where,
    )


def _inputs(tables: dict[str, Any], where: str) -> tuple[list[InputQuantity], dict[tuple[str, str], float]]:
    of_inputs = tables.get("inputs", {})
    lines = tables.get("lines", {})
    for key, group in (("inputs", of_inputs), ("lines", lines)):
        if not isinstance(group, dict):
            raise InputError(f"{where}: {key}", "is no table", f"write [{key}.name]")
    if not of_inputs and not lines:
        raise InputError(where, "there are no inputs", "write at least one [inputs.name]")
    if len(of_inputs) + 2 * len(lines) > MOST_INPUTS:
        raise InputError(f"{where}: inputs", f"there are more than {MOST_INPUTS}", "join those that hardly contribute")
    inputs: list[InputQuantity] = []
    readings: dict[str, list[tuple[str, np.ndarray]]] = {}
    for name, table in of_inputs.items():
        _check_name(name, where)
        quantity, values = read_input(name, table, f"{where}: inputs.{name}")
        inputs.append(quantity)
        if quantity.group is not None:
            readings.setdefault(quantity.group, []).append((name, values))
    correlated = _simultaneous(readings, where)
    for name, table in lines.items():
        _check_name(name, where)
        intercept, slope, r = read_line(name, table, f"{where}: lines.{name}")
        inputs += [intercept, slope]
        correlated[intercept.name, slope.name] = r
    doubled = {quantity.name for quantity in inputs if [two.name for two in inputs].count(quantity.name) > 1}
    if doubled:
        raise InputError(f"{where}: inputs", f"{doubled.pop()} is given twice", "rename one")
    return inputs, correlated


def _check_name(name: str, where: str) -> None:
    if not name.isidentifier() or keyword.iskeyword(name) or name in functions() or name == "pi":
        raise InputError(
            f"{where}: inputs.{name}",
            "this name cannot stand in a formula",
            "use letters, digits and _ and no name of a function",
        )


def _simultaneous(groups: dict[str, list[tuple[str, np.ndarray]]], where: str) -> dict[tuple[str, str], float]:
    correlated = {}
    for group, members in groups.items():
        if len({len(values) for _, values in members}) > 1:
            raise InputError(
                f"{where}: inputs.{members[0][0]}",
                f"the simultaneous readings '{group}' differ in number",
                "give as many readings to each",
            )
        for i, (first, a) in enumerate(members):
            for second, b in members[:i]:
                if np.ptp(a) > 0 and np.ptp(b) > 0:
                    correlated[second, first] = float(np.corrcoef(a, b)[0, 1])
    return correlated


def _correlation(
    pairs_in_file: Any, correlated: dict[tuple[str, str], float], names: list[str], where: str
) -> np.ndarray:
    matrix = np.eye(len(names))
    here = f"{where}: correlations"
    if not isinstance(pairs_in_file, list):
        raise InputError(here, "is no list", "write [[correlations]] with between and r")
    for table in pairs_in_file:
        check_keys(table, ("between", "r"), here)
        pair = table.get("between")
        if (
            not isinstance(pair, list)
            or len(pair) != 2
            or any(name not in names for name in pair)
            or len(set(pair)) < 2
        ):
            raise InputError(here, f"between = {pair!r} is no pair of inputs", f"choose two of {', '.join(names)}")
        if tuple(pair) in correlated or tuple(pair[::-1]) in correlated:
            raise InputError(here, f"{pair[0]} and {pair[1]} are correlated twice", "give their correlation once")
        r = number(table, "r", here)
        if abs(r) > 1:
            raise InputError(here, f"r = {r:g} between {pair[0]} and {pair[1]}", "give a number in -1 ... 1")
        correlated[tuple(pair)] = r
    for (first, second), r in correlated.items():
        i, j = names.index(first), names.index(second)
        matrix[i, j] = matrix[j, i] = r
    return matrix


def _measurands(tables: dict[str, Any], inputs: list[InputQuantity], where: str) -> tuple[Measurand, ...]:
    if ("measurand" in tables) == ("measurands" in tables):
        raise InputError(where, "there must be either [measurand] or [measurands.name]", "write one of them")
    known = ("name", "formula", "unit", "description")
    if "measurand" in tables:
        single = check_keys(tables["measurand"], known, f"{where}: measurand")
        tables_by_name = {text(single, "name", f"{where}: measurand", "y"): single}
    else:
        tables_by_name = check_keys(tables["measurands"], tables["measurands"], f"{where}: measurands")
    dimensions = {quantity.name: quantity.unit.dimension for quantity in inputs}
    units = {quantity.name: quantity.unit for quantity in inputs}
    measurands = []
    for name, table in tables_by_name.items():
        here = f"{where}: measurand" if "measurand" in tables else f"{where}: measurands.{name}"
        if not name.isprintable() or not 0 < len(name) <= LONGEST_NAME:
            right = f"give it 1 to {LONGEST_NAME} characters that can be printed"
            raise InputError(f"{where}: measurand", "a name that nobody can read", right)
        check_keys(table, known, here)
        unit = unit_of(table.get("unit", "1"), f"{here}.unit")
        expression = parse_formula(text(table, "formula", here), dimensions, f"{here}.formula")
        dimension = dimension_of(expression, dimensions, f"{here}.formula")
        check_turns(expression, units, unit, f"{here}.formula")
        unit = result_unit(expression, unit)
        if dimension != unit.dimension:
            raise InputError(
                f"{here}.formula",
                f"gives {dimension or 'a plain number'}, but the unit {unit.text} is "
                f"{unit.dimension or 'a plain number'}",
                "correct the formula or a unit",
            )
        measurands.append(Measurand(name, expression, unit, text(table, "description", here, "")))
    if not measurands:
        raise InputError(f"{where}: measurands", "is empty", "write at least one [measurands.name]")
    return tuple(measurands)
