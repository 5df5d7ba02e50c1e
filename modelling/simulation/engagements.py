"""Dog clutches whose teeth found their gaps in a simulation: when, at what slip, and with what impulse."""

from __future__ import annotations

import numpy as np

from modelling.effects.torques import ENGAGED
from modelling.equations.casadi_code import Model
from modelling.linear.elements import elements
from modelling.simulation.stepping import Simulation

IN, OUT = 0.5, 0.02  # of the engagement of a dog clutch: it holds from the one on; up to the other nothing has met yet
TOLD_FROM = 0.01  # of the slip below which it engages: less makes no impulse that anybody feels


def engagements(model: Model, simulation: Simulation) -> list[str]:
    """A sentence for each time that a dog clutch came in with slip.

    The impulse is that with which the inertias at both ends come to one speed, without what shafts do meanwhile.
    """
    said = []
    parts, n = elements(model, model.p0[None]), model.n
    rows = dict(zip(parts.masses, parts.mass_transformation.reshape(-1, n), strict=True))
    mass = np.asarray(parts.mass_matrix()).reshape(n, n)
    values = dict(zip(model.parameters, model.p0.tolist(), strict=True))
    for box in model.system.gearboxes:
        if box.engages_below is None:
            continue
        first, second = (rows[f"inertias.{name}"] for name in box.between)
        for gear, capacity in enumerate(box.capacities, 1):
            row = first - values[f"gearboxes.{box.name}.ratio_{gear}"] * second
            slip = simulation.states[:, n : 2 * n] @ row
            teeth = simulation[f"gearboxes.{box.name}.{capacity}{ENGAGED}"]
            for at in np.flatnonzero((teeth[1:] >= IN) & (teeth[:-1] < IN)) + 1:
                apart = np.flatnonzero(teeth[:at] < OUT)
                before = float(slip[apart[-1]]) if len(apart) else 0.0
                if abs(before) < TOLD_FROM * box.engages_below.value:
                    continue
                impulse = before / float(row @ np.linalg.solve(mass, row))
                said.append(
                    f"{capacity} of gearboxes.{box.name} engages at {simulation.time[at]:.4g} s with {before:.2g} "
                    f"rad/s of slip, an impulse of {impulse:.2g} N*m*s at {box.between[0]}"
                )
    return said
