"""Uncertainty budgets: measurands with formulas, inputs with distributions, and their TOML files."""

from __future__ import annotations

import ast
import keyword
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import sympy

from modelling.errors import InputError
from modelling.escape import single_line
from modelling.toml import check_file, check_keys, number, numbers, one_of, read_toml, text, title
from modelling.units import Unit, counts_angle, is_torque, registry, unit_of

# --- The distributions an input can have: standard uncertainty from half-width (Eq. 12), fast draws, exact quantiles.
#
# Every shape is written for a standard uncertainty of one, centred at zero. Draws follow JCGM 101, 6.4.

NAMES = ("normal", "rectangular", "triangular", "arcsine", "trapezoidal", "t")


@dataclass(frozen=True)
class Distribution:
    """A shape by name; ``beta`` is the trapezoid's top over its base, ``degrees_of_freedom`` those of Student's t."""

    name: str
    beta: float = 0.0
    degrees_of_freedom: float = math.inf
    width_tolerance: float = 0.0  # of the half-width, relative: a rectangle with inexact limits (JCGM 101, 6.4.3)

    def weight(self) -> float:
        """G of Eq. 12: squared standard uncertainty over squared half-width."""
        return {
            "rectangular": 1 / 3 + self.width_tolerance**2 / 9,
            "triangular": 1 / 6,
            "arcsine": 1 / 2,
            "trapezoidal": (1 + self.beta**2) / 6,
        }[self.name]

    def law(self) -> Any:
        """The same as frozen SciPy distribution (of unit *scale* for Student's t, whose variance is larger)."""
        if self.name == "normal":
            return scipy.stats.norm()
        if self.name == "t":
            return scipy.stats.t(self.degrees_of_freedom)
        half = 1 / math.sqrt(self.weight())
        if self.name == "rectangular":
            return scipy.stats.uniform(-half, 2 * half)
        if self.name == "arcsine":
            return scipy.stats.arcsine(-half, 2 * half)
        return scipy.stats.trapezoid((1 - self.beta) / 2, (1 + self.beta) / 2, loc=-half, scale=2 * half)

    def kurtosis(self) -> float:
        """Fourth central moment over squared variance; that of the normal for Student's t, as GUM 5.1.2 takes it."""
        if self.name in ("normal", "t"):
            return 3.0
        if self.name == "triangular":
            return 2.4
        if self.width_tolerance:  # half-width W uniform in 1 ± τ: E x⁴ = E W⁴/5, E x² = E W²/3
            tau = self.width_tolerance**2
            return (1 + 2 * tau + tau**2 / 5) / 5 / ((1 + tau / 3) / 3) ** 2
        return 3.0 + float(self.law().stats("k"))

    def draw(self, generator: np.random.Generator, count: int) -> np.ndarray:
        """Draws, shape ``(count,)``."""
        if self.name == "normal":
            return generator.standard_normal(count)
        if self.name == "t":
            return generator.standard_t(self.degrees_of_freedom, count)
        half = 1 / math.sqrt(self.weight())
        draws = generator.random(count)
        if self.name == "arcsine":
            return half * np.cos(np.pi * draws)
        draws = 2 * draws - 1
        if self.name == "rectangular":
            if self.width_tolerance:
                draws *= 1 + self.width_tolerance * (2 * generator.random(count) - 1)
            return half * draws
        second = 2 * generator.random(count) - 1
        return half * ((1 + self.beta) / 2 * draws + (1 - self.beta) / 2 * second)


# --- A budget: what is measured (a formula), what it depends on, and how well each of that is known. All in SI.


@dataclass(frozen=True)
class InputQuantity:
    """One input quantity: best estimate and standard uncertainty in SI, and the distribution behind it.

    ``group`` names the simultaneous readings (or fitted line) it comes from; inputs of one group are correlated and
    share their degrees of freedom.
    """

    name: str
    value: float
    standard_uncertainty: float
    unit: Unit
    distribution: Distribution = field(default_factory=lambda: Distribution("normal"))
    degrees_of_freedom: float = math.inf
    group: str | None = None
    cause: str = "Other"
    description: str = ""


@dataclass(frozen=True)
class Measurand:
    """What is measured: ``expression`` is SymPy over the names of the inputs."""

    name: str
    expression: Any
    unit: Unit
    description: str


@dataclass(frozen=True)
class Budget:
    """Measurands, inputs (p) and the correlation matrix ``(p, p)`` of the inputs.

    ``coverage_factor`` where given is k itself; otherwise k follows from ``coverage`` and the degrees of freedom.
    """

    title: str
    measurands: tuple[Measurand, ...]
    inputs: tuple[InputQuantity, ...]
    correlation: np.ndarray
    coverage: float
    coverage_factor: float | None
    where: str

    def __post_init__(self) -> None:
        check_correlation(self.correlation, [quantity.name for quantity in self.inputs], self.where)
        self._check_groups()

    def _check_groups(self) -> None:
        for i, first in enumerate(self.inputs):
            for j, second in enumerate(self.inputs[:i]):
                if self.correlation[i, j] == 0 or (first.group and first.group == second.group):
                    continue
                if first.group or second.group:
                    raise InputError(
                        f"{self.where}: correlations",
                        f"{second.name} and {first.name} come from readings",
                        "let both belong to the same simultaneous readings instead",
                    )

    @property
    def values(self) -> np.ndarray:
        """Best estimates in SI, shape ``(p,)``."""
        return np.array([quantity.value for quantity in self.inputs])

    @property
    def standard_uncertainties(self) -> np.ndarray:
        """Standard uncertainties in SI, shape ``(p,)``."""
        return np.array([quantity.standard_uncertainty for quantity in self.inputs])

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the inputs in SI, shape ``(p, p)``."""
        u = self.standard_uncertainties
        return self.correlation * np.outer(u, u)

    def scaled(self, factors: dict[str, float]) -> Budget:
        """The same budget with the named inputs' standard uncertainties times a factor."""
        inputs = tuple(
            replace(quantity, standard_uncertainty=quantity.standard_uncertainty * factors.get(quantity.name, 1.0))
            for quantity in self.inputs
        )
        return replace(self, inputs=inputs)


def check_correlation(matrix: np.ndarray, names: list[str], where: str) -> None:
    """Raises ``InputError`` unless the matrix can be a correlation matrix (symmetric, ones, no negative eigenvalue)."""
    where = f"{where}: correlations"
    if matrix.shape != (len(names), len(names)) or not np.all(np.isfinite(matrix)):
        raise InputError(where, "the correlation matrix has a wrong shape or gaps", "give one number a pair of inputs")
    if not np.allclose(matrix, matrix.T) or not np.allclose(np.diag(matrix), 1):
        raise InputError(where, "the correlation matrix is not symmetric with ones on its diagonal", "correct it")
    if np.max(np.abs(matrix)) > 1 + 1e-12:
        raise InputError(where, "a correlation coefficient is beyond -1 ... 1", "correct it")
    if matrix.size and (least := float(np.linalg.eigvalsh(matrix).min())) < -1e-9:
        culprits = [name for name, row in zip(names, matrix, strict=True) if np.count_nonzero(row) > 1]
        raise InputError(
            where,
            f"no quantities can be correlated like this (smallest eigenvalue {least:.3g} among {', '.join(culprits)})",
            "lower the coefficients or give the raw simultaneous readings",
        )


# --- Does the formula make sense in units? Its dimension is worked out from those of the inputs.


def dimension_of(expression: Any, dimensions: dict[str, Any], where: str) -> Any:
    """The dimension (pint's) of a SymPy expression whose symbols have the given dimensions."""
    return _Dimensions(dimensions, where).of(expression)


class _Dimensions:
    """Dimensions of the parts of an expression, each worked out once, however deeply sums are nested."""

    def __init__(self, of_symbols: dict[str, Any], where: str):
        self._of_symbols, self._where = of_symbols, where
        self._plain = registry().dimensionless.dimensionality
        self._known: dict[Any, Any] = {}

    def of(self, node: Any) -> Any:
        if node not in self._known:
            self._known[node] = self._worked_out(node)
        return self._known[node]

    def _worked_out(self, node: Any) -> Any:
        if node.is_Symbol:
            return self._of_symbols[node.name]
        if node.is_number:
            return self._plain
        if node.is_Add:
            return self._alike(node.args)
        if node.is_Mul:
            return math.prod((self.of(factor) for factor in node.args), start=self._plain)
        if node.is_Pow and node.exp.is_number:
            return self.of(node.base) ** _exact(node.exp)
        if isinstance(node, sympy.Abs):
            return self.of(node.args[0])
        if isinstance(node, sympy.atan2):
            self._alike(node.args)
            return self._plain
        for argument in node.args[::-1] if node.is_Pow else node.args:  # of a power the exponent first
            self._need_plain(argument)
        return self._plain

    def _need_plain(self, node: Any) -> None:
        if self.of(node) != self._plain:
            raise InputError(
                self._where,
                f"'{node}' must be a plain number, but has dimension {self.of(node)}",
                "divide it by a quantity of that dimension",
            )

    def _alike(self, nodes: Any) -> Any:
        first, *others = nodes
        for node in others:
            if self.of(node) != self.of(first):
                raise InputError(
                    self._where,
                    f"'{first}' ({self.of(first)}) and '{node}' ({self.of(node)}) cannot be added",
                    "give both the same dimension",
                )
        return self.of(first)


def _exact(exponent: Any) -> float:
    value = float(exponent)
    return int(value) if value == int(value) else value


def check_turns(expression: Any, units: Mapping[str, Unit], result: Unit, where: str) -> None:
    """Check that a formula converts between turns, cycles and radians exactly once.

    A speed in 1/min is taken in rad/s, so a factor 2·pi beside it would count it twice; a frequency in Hz is a number
    of cycles, so a torque times it is a power only with that factor.
    """
    for product in expression.atoms(sympy.Mul):
        factors = {factor.base if factor.is_Pow else factor for factor in product.args}
        counted = {units[symbol.name].counts: symbol for symbol in factors if symbol.is_Symbol}
        if "turns" in counted and sympy.pi in factors:
            name = counted["turns"].name
            raise InputError(
                where,
                f"multiplies {name} by pi, but {name} in {units[name].text} is taken in rad/s already",
                f"leave out the factor 2*pi, or give {name} in Hz",
            )
        torques = [symbol for symbol in factors if symbol.is_Symbol and is_torque(units[symbol.name].text)]
        power = unit_of("W", where).dimension
        if "cycles" in counted and torques and result.dimension == power and not expression.has(sympy.pi):
            raise InputError(
                where,
                f"multiplies the torque {torques[0]} by the frequency {counted['cycles']}, which counts cycles",
                "write the factor 2*pi, or give a speed in 1/min or rad/s",
            )
    if _is_rate(result) and not expression.has(sympy.pi):
        _check_rate(expression, units, result, where)


def _check_rate(expression: Any, units: Mapping[str, Unit], result: Unit, where: str) -> None:
    """Check that no frequency in cycles becomes a speed in radians or turns, or the other way, without a factor."""
    cycles = result.counts == "cycles"
    for term in sympy.Add.make_args(sympy.expand(expression)):
        powers = {name: exponent for name, exponent in term.as_powers_dict().items() if name.is_Symbol}
        other = [
            name for name in powers if _is_rate(units[name.name]) and (units[name.name].counts == "cycles") != cycles
        ]
        if sum(powers[name] for name in other) == 1:
            name = str(next(name for name in other if powers[name] > 0))
            counted = ("radians", "cycles") if cycles else ("cycles", "radians")
            raise InputError(
                where,
                f"{name} in {units[name].text} counts {counted[0]}, the result in {result.text} counts {counted[1]}",
                f"{'divide by' if cycles else 'write the factor'} 2*pi, or give both in the same unit",
            )


def _is_rate(unit: Unit) -> bool:
    """Whether it is a frequency or a speed of rotation."""
    return unit.dimension == unit_of("Hz", "").dimension


def result_unit(expression: Any, unit: Unit, units: Mapping[str, Unit]) -> Unit:
    """The unit of a measurand: 1/min of a formula that divides by pi, as angle/(2·pi·time) does, counts cycles; so does
    1/min of a number over a time, without an angle or a speed in it."""
    divides = any(
        factor.is_Pow and factor.base == sympy.pi and factor.exp == -1 for factor in expression.atoms(sympy.Pow)
    )
    used = [units[symbol.name] for symbol in expression.free_symbols]
    number_over_time = not expression.has(sympy.pi) and not any(part.counts or counts_angle(part.text) for part in used)
    if unit.counts != "turns" or not (divides or number_over_time):
        return unit
    return replace(unit, scale=unit.scale / (2 * math.pi), counts="cycles")


# --- From the text of a formula to a SymPy expression, without evaluating any of the text.
#
# The text goes through Python's own grammar (``ast``); only numbers, named inputs, + − · / powers and the mathematical
# functions listed here become SymPy nodes. Everything else is an ``InputError``.

LONGEST = 10_000
LARGEST_POWER = 100
DEEPEST = 60  # functions and powers within one another: no formula of a measurement has so many


@cache
def functions() -> dict[str, Any]:
    """The functions a formula may call, by name."""
    names = [
        "sin",
        "cos",
        "tan",
        "asin",
        "acos",
        "atan",
        "atan2",
        "sinh",
        "cosh",
        "tanh",
        "asinh",
        "acosh",
        "atanh",
        "exp",
        "log",
        "sqrt",
    ]
    table = {name: getattr(sympy, name) for name in names}
    return table | {"abs": sympy.Abs, "log10": lambda x: sympy.log(x) / sympy.log(10)}


def parse_formula(text: str, names: Iterable[str], where: str) -> Any:
    """The formula as SymPy expression over real symbols of the given names."""
    symbols = {name: sympy.Symbol(name, real=True) for name in names}
    if len(text) > LONGEST:
        raise InputError(where, f"the formula has {len(text)} characters", f"at most {LONGEST} are read")
    try:
        tree = ast.parse(text.replace("^", "**").strip(), mode="eval")
        return _Walker(symbols, where).visit(tree.body)
    except (RecursionError, MemoryError) as error:
        wrong = f"'{text[:60]}' has too many operations one after the other, or in one another"
        raise InputError(where, wrong, "write a shorter formula, or several measurands") from error
    except (SyntaxError, ValueError) as error:
        raise InputError(where, f"'{text[:60]}' is no formula", "write it like a*x + sqrt(b)") from error


class _Walker(ast.NodeVisitor):
    """Builds the SymPy expression node by node; a node without a visitor here is refused."""

    def __init__(self, symbols: dict[str, Any], where: str):
        self.symbols, self.where = symbols, where
        self.depth = 0  # of functions and powers around what is visited

    def refuse(
        self, what: str, right: str = "use numbers, inputs, + - * / ** and mathematical functions only"
    ) -> InputError:
        return InputError(self.where, what, right)

    def generic_visit(self, node: Any) -> Any:
        raise self.refuse(f"'{ast.unparse(node)[:60]}' is not mathematics")

    def visit(self, node: Any) -> Any:
        nested = isinstance(node, ast.Call) or (isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow))
        self.depth += nested
        if self.depth > DEEPEST:
            raise self.refuse(f"functions are nested more than {DEEPEST} deep", "write a simpler formula")
        value = super().visit(node)
        self.depth -= nested
        return value

    def visit_Constant(self, node: Any) -> Any:
        if type(node.value) not in (int, float):
            raise self.refuse(f"{node.value!r} is no number")
        if not abs(node.value) < 1e300:
            raise self.refuse("a number is too large", "stay below 1e300")
        exact = isinstance(node.value, int) and abs(node.value) < 10**15
        return sympy.Integer(node.value) if exact else sympy.Float(float(node.value))

    def visit_Name(self, node: Any) -> Any:
        if node.id in self.symbols:
            return self.symbols[node.id]
        if node.id == "pi":
            return sympy.pi
        raise self.refuse(f"'{node.id}' is not among the inputs", f"known are {', '.join(self.symbols)} and pi")

    def visit_UnaryOp(self, node: Any) -> Any:
        value = self.visit(node.operand)
        if isinstance(node.op, ast.USub):
            return -value
        if isinstance(node.op, ast.UAdd):
            return value
        return self.generic_visit(node)

    def visit_BinOp(self, node: Any) -> Any:
        left, right = self.visit(node.left), self.visit(node.right)
        match node.op:
            case ast.Add():
                return left + right
            case ast.Sub():
                return left - right
            case ast.Mult():
                return left * right
            case ast.Div():
                if right.is_zero:
                    raise self.refuse("the formula divides by zero", "correct the formula")
                return left / right
            case ast.Pow():
                return self.power(left, right)
        return self.generic_visit(node)

    def power(self, base: Any, exponent: Any) -> Any:
        # Exact integer towers such as 9**9**9 would run for ever, so the size is looked at first.
        if exponent.is_number and not abs(float(exponent)) <= LARGEST_POWER:
            raise self.refuse("a power is too large", f"exponents reach to {LARGEST_POWER}")
        if base.is_number and base.is_zero and exponent.is_number and float(exponent) <= 0:
            raise self.refuse("the formula divides by zero", "correct the formula")
        result = base**exponent
        if result.is_number and not abs(complex(result)) < 1e300:
            raise self.refuse("a number is too large", "stay below 1e300")
        return result

    def visit_Call(self, node: Any) -> Any:
        name = node.func.id if isinstance(node.func, ast.Name) else None
        if name not in functions():
            called = ast.unparse(node.func)[:40]
            raise self.refuse(f"'{called}' is no function of mathematics", f"known are {', '.join(functions())}")
        wanted = 2 if name == "atan2" else 1
        if node.keywords or len(node.args) != wanted:
            raise self.refuse(
                f"{name} takes {wanted} argument{'s' * (wanted > 1)}", f"write {name}(x{', y' * (wanted > 1)})"
            )
        value = functions()[name](*(self.visit(argument) for argument in node.args))
        if value.has(sympy.zoo, sympy.nan, sympy.oo, sympy.I) or (value.is_number and complex(value).imag != 0):
            raise self.refuse(f"'{ast.unparse(node)[:60]}' has no finite real value", "correct the formula")
        return value


# --- One input of a budget file: from data sheet entries, certificates, raw readings or a fitted line.

LARGEST_FACTOR = 1e6  # k; 99.99 % with one degree of freedom has 6366
KNOWN = (
    "value",
    "unit",
    "distribution",
    "half_width",
    "half_width_tolerance",
    "uncertainty",
    "expanded_uncertainty",
    "coverage_factor",
    "degrees_of_freedom",
    "beta",
    "readings",
    "simultaneous",
    "cause",
    "description",
)
LINE = ("abscissa", "ordinate", "abscissa_unit", "ordinate_unit", "origin", "cause", "description")


def read_input(name: str, table: Any, where: str) -> tuple[InputQuantity, np.ndarray]:
    """The input and its readings (n,) in SI (empty where it has none)."""
    check_keys(table, KNOWN, where)
    unit = unit_of(table.get("unit", "1"), f"{where}.unit")
    labels: dict[str, Any] = {
        "cause": text(table, "cause", where, "Other"),
        "description": text(table, "description", where, ""),
    }
    if "readings" in table:
        return _from_readings(name, table, unit, labels, where)
    if "simultaneous" in table:
        raise InputError(f"{where}.simultaneous", "is for readings", "give readings = [...]")
    value = unit.value_to_si(number(table, "value", where))
    if not any(key in table for key in ("half_width", "uncertainty", "expanded_uncertainty")):
        for key in ("distribution", "degrees_of_freedom", "beta", "coverage_factor", "half_width_tolerance"):
            if key in table:
                raise InputError(where, f"{key} without an uncertainty", "give half_width, uncertainty or drop it")
        return InputQuantity(name, value, 0.0, unit, **labels), np.empty(0)
    tolerance = _width_tolerance(table, where)
    freedom = 0.5 / tolerance**2 if tolerance else math.inf  # GUM G.4.2
    freedom = number(table, "degrees_of_freedom", where, positive=True) if "degrees_of_freedom" in table else freedom
    distribution = replace(_distribution(table, freedom, where), width_tolerance=tolerance)
    u = unit.difference_to_si(_standard_uncertainty(table, distribution, where))
    return InputQuantity(name, value, abs(u), unit, distribution, freedom, **labels), np.empty(0)


def _width_tolerance(table: Any, where: str) -> float:
    """Half-width of the half-width, relative: limits that are not exactly known (JCGM 101, 6.4.3); 0 if exact."""
    if "half_width_tolerance" not in table:
        return 0.0
    if "half_width" not in table or text(table, "distribution", where, "rectangular") != "rectangular":
        wrong = "belongs to the half_width of a rectangular distribution"
        raise InputError(f"{where}.half_width_tolerance", wrong, "drop it")
    half_width = number(table, "half_width", where, positive=True)
    tolerance = number(table, "half_width_tolerance", where, least=0.0)
    if tolerance > half_width:
        raise InputError(f"{where}.half_width_tolerance", f"{tolerance:g} is beyond half_width", "give less")
    return tolerance / half_width


def _distribution(table: Any, freedom: float, where: str) -> Distribution:
    default = "rectangular" if "half_width" in table and "coverage_factor" not in table else "normal"
    name = one_of(text(table, "distribution", where, default), NAMES, f"{where}.distribution")
    if ("beta" in table) != (name == "trapezoidal"):
        raise InputError(
            f"{where}.beta",
            "beta belongs to the trapezoidal distribution and to no other",
            'give distribution = "trapezoidal" and beta = top width over base width',
        )
    beta = number(table, "beta", where) if "beta" in table else 0.0
    if not 0 <= beta <= 1:
        raise InputError(f"{where}.beta", f"{beta:g} is out of range", "give a number in 0 ... 1")
    if name == "t" and math.isinf(freedom):
        raise InputError(where, "Student's t needs degrees_of_freedom", "give them")
    if name == "normal" and math.isfinite(freedom):  # JCGM 101, 6.4.9: an estimated spread makes the normal a t
        name = "t"
    return Distribution(name, beta, freedom if name == "t" else math.inf)


def read_coverage_factor(table: Any, where: str) -> float:
    """The coverage factor k in a table; one far from any level of confidence would only overflow."""
    return number(table, "coverage_factor", where, positive=True, least=1 / LARGEST_FACTOR, most=LARGEST_FACTOR)


def _standard_uncertainty(table: Any, distribution: Distribution, where: str) -> float:
    statements = [key for key in ("half_width", "uncertainty", "expanded_uncertainty") if key in table]
    if len(statements) != 1:
        raise InputError(where, f"{' and '.join(statements)} are given together", "give one of them")
    amount = number(table, statements[0], where, least=0.0)
    if statements[0] == "uncertainty":
        if "coverage_factor" in table:
            raise InputError(
                where,
                "uncertainty is the standard uncertainty and has no coverage_factor",
                "write expanded_uncertainty",
            )
        return amount
    if distribution.name in ("normal", "t") or statements[0] == "expanded_uncertainty":
        if "coverage_factor" not in table:
            raise InputError(
                where,
                f"{statements[0]} of a {distribution.name} distribution needs coverage_factor",
                "give coverage_factor = 2 or whatever the certificate says",
            )
        return amount / read_coverage_factor(table, where)
    if "coverage_factor" in table:
        raise InputError(f"{where}.coverage_factor", f"a {distribution.name} half-width has none", "drop it")
    return amount * math.sqrt(distribution.weight())


def _from_readings(
    name: str, table: Any, unit: Unit, labels: dict[str, Any], where: str
) -> tuple[InputQuantity, np.ndarray]:
    for key in (
        "value",
        "half_width",
        "half_width_tolerance",
        "uncertainty",
        "expanded_uncertainty",
        "distribution",
        "degrees_of_freedom",
        "coverage_factor",
        "beta",
    ):
        if key in table:
            raise InputError(where, f"{key} beside readings", "the readings say it already; drop it")
    values = unit.value_to_si(np.array(numbers(table["readings"], f"{where}.readings")))
    freedom = len(values) - 1
    group = text(table, "simultaneous", where, "") or None
    mean = InputQuantity(
        name,
        float(values.mean()),
        float(values.std(ddof=1) / math.sqrt(len(values))),
        unit,
        Distribution("t", degrees_of_freedom=freedom),
        freedom,
        group,
        **labels,
    )
    return mean, values


def read_line(name: str, table: Any, where: str) -> tuple[InputQuantity, InputQuantity, float]:
    """Intercept and slope of a straight line fitted to readings by least squares (GUM H.3), and their correlation.

    The line is ``ordinate = NAME_intercept + NAME_slope * (abscissa - origin)``. In the budget's formula an abscissa in
    °C counts from absolute zero, so a unit with an offset needs the origin.
    """
    check_keys(table, LINE, where)
    units = [unit_of(table.get(f"{axis}_unit", "1"), f"{where}.{axis}_unit") for axis in ("abscissa", "ordinate")]
    if units[0].offset and "origin" not in table:
        raise InputError(
            f"{where}.abscissa_unit", f"{units[0].text} has its zero elsewhere than SI, and no origin is stated",
            f"write for example origin = 20, and in the formula {name}_slope * (t - t0), t0 an input of 20 degC",
        )  # fmt: skip
    x, y = (np.array(numbers(table.get(axis), f"{where}.{axis}", least=3)) for axis in ("abscissa", "ordinate"))
    if len(x) != len(y):
        raise InputError(where, f"{len(x)} abscissas but {len(y)} ordinates", "give as many of both")
    x = units[0].difference_to_si(x - (number(table, "origin", where) if "origin" in table else 0.0))
    y = units[1].value_to_si(y)
    if np.ptp(x) == 0:  # also where the origin is so far away that no digit of them is left
        raise InputError(f"{where}.abscissa", "all readings are equal", "a line needs different abscissas")
    with np.errstate(over="ignore", invalid="ignore"):
        fit = scipy.stats.linregress(x, y)
    if not np.isfinite([fit.slope, fit.stderr, fit.intercept, fit.intercept_stderr]).all():
        raise InputError(where, "no line can be fitted: the readings are too large", "give readings in another unit")
    freedom = len(x) - 2
    labels = {"cause": text(table, "cause", where, "Calibration"), "description": text(table, "description", where, "")}
    spread = Distribution("t", degrees_of_freedom=freedom)
    slope_unit = Unit(
        "/".join(
            f"({axis_unit.text.replace('degC', 'delta_degC') if axis_unit.offset else axis_unit.text})"
            for axis_unit in units[::-1]
        ),
        units[1].scale / units[0].scale,
        0.0,
        units[1].dimension / units[0].dimension,
    )
    intercept = InputQuantity(
        f"{name}_intercept",
        float(fit.intercept),
        float(fit.intercept_stderr),
        units[1],
        spread,
        freedom,
        name,
        **labels,
    )
    slope = InputQuantity(
        f"{name}_slope", float(fit.slope), float(fit.stderr), slope_unit, spread, freedom, name, **labels
    )
    r = -float(x.mean() * fit.stderr / fit.intercept_stderr) if fit.intercept_stderr > 0 else 0.0
    return intercept, slope, max(-1.0, min(1.0, r))


# --- Budget files (TOML) to ``Budget``; the format is described in ``examples/sensors/README.md``.

MOST_INPUTS = 500  # matrices of second derivatives and correlations are full
LARGEST_COVERAGE = 0.9999  # a hundred draws of a million lie outside: they tell where the interval ends
TOP = ("title", "coverage", "coverage_factor", "measurand", "measurands", "inputs", "correlations", "lines")
LONGEST_NAME = 100  # characters of a measurand's name: it stands in sentences and figures


def read_budget(path: Path | str) -> Budget:
    """The budget in a TOML file; raises ``InputError`` on any fault of the file."""
    return budget_from_tables(read_toml(path), str(path))


def budget_from_tables(tables: dict[str, Any], where: str = "budget") -> Budget:
    """The budget in tables as ``tomllib`` reads them."""
    check_file(tables, TOP, where, "budget")
    coverage = number(tables, "coverage", where) if "coverage" in tables else 0.95
    if not 0 < coverage < 1:
        raise InputError(f"{where}: coverage", f"{coverage:g} is no probability", "give a number such as 0.95")
    if coverage > LARGEST_COVERAGE:
        wrong = f"{coverage:.10g} is more than draws can show"
        raise InputError(f"{where}: coverage", wrong, f"give at most {LARGEST_COVERAGE}")
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
        unit = result_unit(expression, unit, units)
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
