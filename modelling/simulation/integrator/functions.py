"""The functions that the integrators step, with what depends on parameters alone computed once."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import casadi as ca
import numpy as np

from modelling.equations.compiled import Model
from modelling.equations.shaft_law import CONTACT_TIME

READING_CONTACT_SHARE = 0.2  # of a step: over which the damping of a closing lash sets in for a sensor


@dataclass(frozen=True)
class Functions:
    """CasADi functions of one model, c standing for all that they need of the parameters.

    Attributes
    ----------
    constants : Function
        p → c.
    field : Function
        (x, u, c) → ẋ; with ``parametric`` also its derivatives A, B, P by x, u, p.
    reading : Function
        (x, u, c, t) → y; with ``parametric`` also C, D, Q by x, u, p.
    jacobian : Function or None
        (x, u, c) → A, B, for implicit steps.
    parametric : bool
        Whether forward sensitivities can be integrated along.
    """

    constants: ca.Function
    field: ca.Function
    reading: ca.Function
    jacobian: ca.Function | None
    parametric: bool

    def constants_of(self, p: np.ndarray) -> np.ndarray:
        """(b, p) → (b, c)."""
        return np.ascontiguousarray(np.array(self.constants(p.T)).T)

    @property
    def all(self) -> tuple[ca.Function, ...]:
        """Those that a step calls."""
        return (self.field, self.reading) if self.jacobian is None else (self.field, self.reading, self.jacobian)


def functions(model: Model, parametric: bool = False, implicit: bool = False) -> Functions:
    """The functions of a model, kept for models of one structure.

    Parameters
    ----------
    parametric, implicit : bool
        For sensitivities by the parameters; for implicit steps.
    """
    contact = model.parameters.index(CONTACT_TIME) if CONTACT_TIME in model.parameters else None
    return _functions(model.rates, model.readings, contact, parametric, implicit)


@functools.lru_cache(maxsize=512)
def _functions(
    rates: ca.Function, readings: ca.Function, contact: int | None, parametric: bool, implicit: bool
) -> Functions:
    x, u, p, t = (ca.SX.sym(name, readings.size1_in(i)) for i, name in enumerate("xupt"))
    for_readings = ca.SX(p)
    if contact is not None:
        for_readings[contact] = READING_CONTACT_SHARE * p[contact]
    xdot, y = rates(x, u, p), readings(x, u, for_readings, t)
    groups = [
        [xdot, *(ca.jacobian(xdot, by) for by in (x, u, p) if parametric)],
        [y, *(ca.jacobian(y, by) for by in (x, u, p) if parametric)],
        [ca.jacobian(xdot, by) for by in (x, u) if implicit],
    ]
    outputs = ca.cse([output for group in groups for output in group])
    outputs, symbols, parts = ca.extract_parametric(outputs, p, {"extract_trivial": True})
    c = ca.vertcat(*symbols) if symbols else ca.SX(0, 1)
    constants = ca.Function("constants", [p], [ca.vertcat(*parts) if parts else ca.SX(0, 1)])
    first, second = len(groups[0]), len(groups[0]) + len(groups[1])
    field = ca.Function("field", [x, u, c], ca.cse(outputs[:first]))
    reading = ca.Function("reading", [x, u, c, t], ca.cse(outputs[first:second]))
    jacobian = ca.Function("jacobian", [x, u, c], ca.cse(outputs[second:])) if implicit else None
    return Functions(constants, field, reading, jacobian, parametric)
