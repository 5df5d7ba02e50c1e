"""The functions that the integrators step, with what depends on parameters alone taken out once."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import casadi as ca
import numpy as np

from modelling.equations.compiled import Model
from modelling.equations.shaft_law import CONTACT_TIME

SHARPER = 0.2  # of the step: how long a closing lash takes to a sensor, for which no jump is integrated


@dataclass(frozen=True)
class Functions:
    """``field`` (x, u, c) → ẋ and ``reading`` (x, u, c, t) → y; with derivatives also A, B, P and C, D, Q by x, u, p.

    ``constants`` maps p to c: all that the two need of the parameters, so that no step repeats it.
    """

    constants: ca.Function
    field: ca.Function
    reading: ca.Function
    derivatives: bool

    def constants_of(self, p: np.ndarray) -> np.ndarray:
        """(b, p) → (b, c)."""
        return np.ascontiguousarray(np.array(self.constants(p.T)).T)


def functions(model: Model, derivatives: bool = False) -> Functions:
    """The functions of a model, kept for models of one structure."""
    contact = model.parameters.index(CONTACT_TIME) if CONTACT_TIME in model.parameters else None
    return _functions(model.rates, model.readings, contact, derivatives)


@functools.lru_cache(maxsize=512)
def _functions(rates: ca.Function, readings: ca.Function, contact: int | None, derivatives: bool) -> Functions:
    x, u, p, t = (ca.SX.sym(name, readings.size1_in(i)) for i, name in enumerate("xupt"))
    outputs = []
    sharp = ca.SX(p)
    if contact is not None:
        sharp[contact] = SHARPER * p[contact]
    for expression in (rates(x, u, p), readings(x, u, sharp, t)):
        outputs.append(expression)
        if derivatives:
            outputs += [ca.jacobian(expression, by) for by in (x, u, p)]
    outputs, symbols, parametric = ca.extract_parametric(ca.cse(outputs), p, {"extract_trivial": True})
    c = ca.vertcat(*symbols) if symbols else ca.SX(0, 1)
    constants = ca.Function("constants", [p], [ca.vertcat(*parametric) if parametric else ca.SX(0, 1)])
    half = len(outputs) // 2
    field = ca.Function("field", [x, u, c], ca.cse(outputs[:half]))
    reading = ca.Function("reading", [x, u, c, t], ca.cse(outputs[half:]))
    return Functions(constants, field, reading, derivatives)
