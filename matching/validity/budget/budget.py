"""A budget: what is measured (a formula), what it depends on, and how well each of that is known. All in SI."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from matching.validity.budget.distributions import Distribution
from modelling.common.errors import InputError
from modelling.units import Unit


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
