"""The feedback loop in the frequency domain as one CasADi function of (s, p): exact, dead time included.

Rig and residual vehicle are solved as dynamic stiffnesses, (s²·M + s·C + K)·q = torques, the loop is closed round
them, and the functions give the compared transfer functions, to sensors of the rig or of the residual vehicle, and the
return difference I + L at the dynamometers' commands. Derivatives are CasADi's, exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.programme.feedback_loop import FeedbackLoop, LoopShape
from matching.frequency.programme.linear_response import LinearResponse
from modelling.common.errors import unknown
from modelling.equations.compiled import compiled
from modelling.equations.complex_sx import Complex


@dataclass(frozen=True, eq=False)
class General:
    """Compared responses and return difference of (s_re, s_im, p, fixed): one object for all cases of one structure."""

    response: ca.Function
    difference: ca.Function


@dataclass(frozen=True)
class ClosedLoopFunctions:
    """The loop of a case as CasADi functions.

    Attributes
    ----------
    parameters : tuple of str
        Names of p: ``residual_vehicle.…``, ``rig.…``, ``loop.…``.
    values : ndarray (p,)
        Values as the case has them.
    fixed : ndarray (c,)
        What does not move, as far as it is neither 0 nor 1, which are part of the structure.
    general : General
        :attr:`response` and :attr:`difference` for every case of the structure.
    """

    parameters: tuple[str, ...]
    values: np.ndarray
    fixed: np.ndarray
    general: General

    @cached_property
    def response(self) -> ca.Function:
        """(s_re, s_im, p) → H re (h,), H im (h,) of the compared functions."""
        return self._here(self.general.response)

    @cached_property
    def difference(self) -> ca.Function:
        """(s_re, s_im, p) → return difference I + L, re (u·u,) and im, row by row."""
        return self._here(self.general.difference)

    def _here(self, general: ca.Function) -> ca.Function:
        inputs = [ca.SX.sym("s_re"), ca.SX.sym("s_im"), ca.SX.sym("p", len(self.values))]
        outputs: Any = general(*inputs, ca.SX(self.fixed))  # in CasADi's stubs a call gives one output
        return ca.Function(general.name(), inputs, ca.cse(list(outputs)), ["s_re", "s_im", "p"], ["re", "im"])


def closed_loop(case: Case, moving: Sequence[tuple[str, ...]] | None = None) -> ClosedLoopFunctions:
    """Build the feedback loop of a case; the model-based feed-forward is left out.

    Parameters
    ----------
    case : Case
    moving : sequence of tuple of str, optional
        Groups of names that share one entry of p (a quantity and its mirror image); every name by itself unless given.
        The rest do not move, which makes derivatives cheaper.

    Raises
    ------
    InputError
        If a name is unknown.
    """
    systems = {"rig": [case.rig], "residual_vehicle": case.residual_vehicle.parts}
    values: list[tuple[str, float]] = []
    for prefix, parts in systems.items():
        models = [compiled(system) for system in parts]
        values += [
            (f"{prefix}.{name}", value)
            for model in models
            for name, value in zip(model.parameters, model.p0, strict=True)
        ]
    values += [(f"loop.{name}", value) for name, value in case.loop.values.items()]
    names = tuple(name for name, _ in values)
    groups = [(name,) for name in names] if moving is None else list(moving)
    for name in (name for group in groups for name in group):
        if name not in names:
            raise unknown(name, list(names), "")
    structure = LoopShape(
        case.rig,
        tuple(case.residual_vehicle.parts),
        tuple(case.residual_vehicle.interfaces),
        tuple(case.loop.dynamometers),
        tuple(case.compared),
        names,
        tuple(float(value) if value in (0.0, 1.0) else None for _, value in values),
        case.loop.structure,
        tuple(groups),
    )
    kept = np.array([values[names.index(group[0])][1] for group in groups])
    fixed_values = np.array([values[i][1] for i in structure.still])
    return ClosedLoopFunctions(tuple(group[0] for group in groups), kept, fixed_values, _expressions(structure))


@lru_cache(maxsize=16)
def _expressions(shape: LoopShape) -> General:
    rig, parts, still = compiled(shape.rig), [compiled(part) for part in shape.parts], shape.still
    symbols, fixed = ca.SX.sym("p", len(shape.moving)), ca.SX.sym("fixed", len(still))
    p = ca.SX([0.0 if value is None else value for value in shape.known])
    for i, entry in enumerate(still):
        p[entry] = fixed[i]
    for i, group in enumerate(shape.moving):
        for name in group:
            p[shape.names.index(name)] = symbols[i]
    s = Complex(ca.SX.sym("s_re"), ca.SX.sym("s_im"))
    loop = {name.removeprefix("loop."): p[i] for i, name in enumerate(shape.names) if name.startswith("loop.")}
    starts = np.cumsum([0, len(rig.parameters), *(len(part.parameters) for part in parts)])
    systems = [
        LinearResponse(model, p[int(a) : int(b)], s)
        for model, a, b in zip([rig, *parts], starts[:-1], starts[1:], strict=True)
    ]
    closed = FeedbackLoop(shape, systems[0], systems[1:], loop, s)
    inputs, names_in = [s.re, s.im, symbols, fixed], ["s_re", "s_im", "p", "fixed"]

    def function(name: str, values: list[Complex]) -> ca.Function:
        parts = [ca.vertcat(*(value.re for value in values)), ca.vertcat(*(value.im for value in values))]
        return ca.Function(name, inputs, parts, names_in, ["re", "im"])

    return General(
        function("response", closed.responses()),
        function("difference", [entry for row in closed.difference() for entry in row]),
    )
