"""State-space models of systems without the angle that nothing depends on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from modelling.compiled import compiled
from modelling.system import System, unknown


@dataclass(frozen=True)
class StateSpace:
    """ẋ = A·x + B·u, y = C·x + D·u with named inputs and outputs; A (x, x), B (x, u), C (y, x), D (y, u), SI."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def input(self, name: str) -> np.ndarray:
        """Column of B, (x,)."""
        return self.B[:, _index(name, self.inputs)]

    def output(self, name: str) -> np.ndarray:
        """Row of C, (x,)."""
        return self.C[_index(name, self.outputs)]

    def response(self, s: np.ndarray) -> np.ndarray:
        """Transfer functions (f, y, u) at complex frequencies s (f,), rad/s."""
        n = len(self.A)
        states = np.linalg.solve(s[:, None, None] * np.eye(n) - self.A, np.broadcast_to(self.B, (len(s), *self.B.shape)))
        return self.C @ states + self.D


def linear(system: System, x0: np.ndarray | None = None, u0: np.ndarray | None = None) -> StateSpace:
    """Linearise a system about a state, and leave out the rigid-body angle, on which no torque depends.

    Parameters
    ----------
    system : System
    x0 : ndarray (x,), optional
        State to linearise about; rest unless given.
    u0 : ndarray (u,), optional

    Raises
    ------
    InputError
        If rigid gears lock the system.
    """
    model = compiled(system)
    size = len(model.states)
    x0 = np.zeros(size) if x0 is None else x0
    u0 = np.zeros(len(model.inputs)) if u0 is None else u0
    A, B, C, D = (np.array(part) for part in model.jacobians(x0, u0, model.p0, 0.0))
    n = model.n
    felt = np.vstack([A[:, :n], C[:, :n]])
    scale = np.linalg.norm(felt, axis=1, keepdims=True)
    rows = felt / np.where(scale > 0, scale, 1)
    _, singular, basis = np.linalg.svd(rows)
    rank = int(np.sum(singular > 1e-9 * max(singular[0], 1e-300))) if len(singular) else 0
    keep = np.zeros((rank + size - n, size))
    keep[:rank, :n] = basis[:rank]
    keep[rank:, n:] = np.eye(size - n)
    return StateSpace(keep @ A @ keep.T, keep @ B, C @ keep.T, D, tuple(model.inputs), tuple(model.sensors))


def _index(name: str, names: tuple[str, ...]) -> int:
    if name not in names:
        raise unknown(name, list(names), "")
    return names.index(name)
