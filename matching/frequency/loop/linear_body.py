"""A linear system with what its states mean in inertias and shafts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from modelling.common.errors import InputError
from modelling.equations.compiled import compiled
from modelling.linear.elements import elements
from modelling.linear.linearise import deflated, linearise
from modelling.linear.state_space import StateSpace
from modelling.modal.symmetry import images
from modelling.model.system import System


@dataclass(frozen=True)
class Body:
    """A system made linear about its operating point, or at rest; rigid-body angles left out.

    Attributes
    ----------
    system : System
    space : StateSpace
        ẋ = A·x + B·u, y = C·x + D·u.
    turns, twists : ndarray (k, x), (s, x)
        Speed of every inertia (rad/s) and deflection of every spring (rad) by state.
    J, stiffness : ndarray (k,), (s,)
        kg·m², N·m/rad.
    masses, springs : tuple of str
        ``inertias.NAME``, ``shafts.NAME``.
    image : ndarray (k,) or None
        Index of every inertia's mirror image.
    """

    system: System
    space: StateSpace
    turns: np.ndarray
    twists: np.ndarray
    J: np.ndarray
    stiffness: np.ndarray
    masses: tuple[str, ...]
    springs: tuple[str, ...]
    image: np.ndarray | None

    def response(self, s: np.ndarray) -> np.ndarray:
        """C·(sI − A)⁻¹·B + D, (f, y, u), at complex s (f,)."""
        return transfer(self.space.A, self.space.B, self.space.C, self.space.D, s)


def body(system: System) -> Body:
    """Linearise a system about its operating point, without one at rest with lash just closed.

    Raises
    ------
    InputError
        If rigid gears lock the system, or an input or sensor is delayed inside the model.
    """
    linear = linearise(compiled(system))
    if linear.input_delays.any() or linear.sensor_delays.any():
        raise InputError(
            "effects", "a dead time inside the model is not expected here", "state it in the loop of the case"
        )
    parts = elements(linear.model, linear.p[None], linear.x0)
    rest = deflated(linear, parts)
    lift = rest.lift
    model, n = linear.model, linear.model.n
    space = StateSpace(rest.A, lift.T @ linear.B, linear.C @ lift, linear.D, tuple(model.inputs), tuple(model.sensors))
    return Body(
        system,
        space,
        parts.mass_transformation @ lift[n : 2 * n],
        parts.deflection_jacobian @ lift,
        parts.J[0],
        parts.stiffness[0],
        parts.masses,
        parts.springs,
        images(system, parts.masses),
    )


def transfer(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, s: np.ndarray) -> np.ndarray:
    """C·(sI − A)⁻¹·B + D at complex s (f,): (f, y, u)."""
    s = np.asarray(s)
    states = np.linalg.solve(
        s[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (len(s), *B.shape)).astype(complex)
    )
    return C @ states + D
