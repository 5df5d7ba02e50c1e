"""How many steps a second the clutches of a gearbox need: it depends on how they slip and on what they carry."""

from __future__ import annotations

import casadi as ca
import numpy as np

from modelling.effects.torques import ENGAGED, SETTLING
from modelling.equations.casadi_code import Model
from modelling.linear.elements import elements
from modelling.simulation.stepping import ACCURATE_STEP, STABLE_STEP


def steps_of_clutches(model: Model, x: ca.SX, rates: ca.SX, seconds: ca.SX) -> list[ca.SX]:
    """Steps a second that each clutch needs over the next seconds; see :data:`STABLE_STEP`.

    The deflection of a clutch that slips follows within slip over deflection; one that sticks is a spring and a damper
    between its ends. Both depend on the motion and on what the clutch carries now.

    Parameters
    ----------
    x, rates : SX (x,)
        States of the model and their rates.
    seconds : SX
        s.
    """
    found: list[ca.SX] = []
    if not model.system.gearboxes:
        return found
    parts, n = elements(model, model.p0[None]), model.n
    rows = dict(zip(parts.masses, parts.mass_transformation.reshape(-1, n), strict=True))
    value = dict(zip(model.parameters, model.p0.tolist(), strict=True))
    for box in model.system.gearboxes:
        place, (first, second) = f"gearboxes.{box.name}", (rows[f"inertias.{name}"] for name in box.between)
        deflection, settling = value[f"{place}.deflection"], value.get(f"{place}.settling", SETTLING)
        for gear, capacity in enumerate(box.capacities, 1):
            at, row = model.states.index(f"{place}.{capacity}"), first - value[f"{place}.ratio_{gear}"] * second
            change = ca.mtimes(ca.DM(row).T, rates[n : 2 * n])
            follows = ca.fabs(ca.jacobian(rates[at], x[at])) + ca.fabs(change) * seconds / deflection
            stiffness = ca.fabs(ca.jacobian(change, x[at]))
            if box.engages_below is not None:  # teeth that may find their gaps within the next seconds
                stiffness = ca.substitute(stiffness, x[model.states.index(f"{place}.{capacity}{ENGAGED}")], 1.0)
            fastest = ca.fmax(follows, settling * stiffness) / STABLE_STEP
            found.append(ca.fmax(fastest, ca.sqrt(stiffness) / ACCURATE_STEP))
    return found


def most_steps(model: Model, states: np.ndarray, inputs: np.ndarray, seconds: float) -> float:
    """Steps a second that the clutches need at most along a motion; 0 without one.

    Parameters
    ----------
    states, inputs : ndarray (t, x), (t, u)
    seconds : float
        Between two of its samples.
    """
    x, u = ca.SX.sym("x", states.shape[1]), ca.SX.sym("u", inputs.shape[1])
    needed = steps_of_clutches(model, x, model.rates(x, u, ca.DM(model.p0)), ca.SX(seconds))
    if not needed:
        return 0.0
    along = ca.Function("along", [x, u], [ca.cse(ca.mmax(ca.vertcat(*needed)))]).map(len(states))
    return float(np.max(along(states.T, inputs.T).full()))
