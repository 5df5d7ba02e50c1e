"""How frequencies change with parameters: first-order prediction (paper Eq. 8) beside the exact solution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from modelling.equations.casadi_code import Model, compiled
from modelling.linear.elements import elements
from modelling.linear.steady_motion import reference_motion
from modelling.modal.modes import modes_of
from modelling.modal.pairing import mac, pairs
from modelling.modal.result import Modes
from modelling.system import System

# --- Modes followed by their shapes when parameters change.


@dataclass(frozen=True)
class Tracked:
    """Modes followed through t parameter sets.

    Attributes
    ----------
    frequencies : ndarray (t, m)
        Hz; column i is mode i of the first set, followed by its shape.
    order : ndarray (t, m) of int
        Index of that mode among the modes of each set.
    mac_values : ndarray (t, m)
        MAC against the set before, 1 in the first row.
    modes : Modes
        Of all sets, batched (t, …), in order of frequency.
    """

    frequencies: np.ndarray
    order: np.ndarray
    mac_values: np.ndarray
    modes: Modes


def track(system: System, sets: Sequence[Mapping[str, float]]) -> Tracked:
    """Follow every mode through a series of parameter sets by its shape.

    Sets should be near each other: where two modes nearly cross, coarse steps keep the shape and jump the gap, fine
    steps follow the branch.

    Raises
    ------
    InputError
        As :func:`modelling.modal.modes.modes`.
    """
    model = compiled(system)
    return track_vectors(model, np.array([model.vector(values) for values in sets]))


def track_vectors(model: Model, p: np.ndarray) -> Tracked:
    """:func:`track` for parameter vectors (t, p) of a compiled model."""
    batch = modes_of(model, p)
    mass = elements(model, p).mass_matrix()
    order = np.tile(np.arange(len(batch)), (len(p), 1))
    mac_values = np.ones(order.shape)
    for i in range(1, len(p)):
        score = mac(batch.shapes[i - 1][:, order[i - 1]], batch.shapes[i], (mass[i - 1] + mass[i]) / 2)
        columns = [column for _, column in pairs(score, -1.0)]
        order[i], mac_values[i] = columns, score[range(len(columns)), columns]
    return Tracked(np.take_along_axis(batch.frequencies, order, axis=1), order, mac_values, batch)


# --- Sensitivity

TRACKING_STEPS = 32  # parameter sets from the old to the new values: near enough to follow each shape


@dataclass(frozen=True)
class Sensitivities:
    """Derivatives of the undamped frequencies by every parameter.

    Attributes
    ----------
    names : tuple of str (p,)
    gradients : ndarray (m, p)
        ∂f/∂p, Hz per SI unit; 0 for rigid-body modes.
    relative : ndarray (m, p)
        (p/f)·∂f/∂p: half the potential share for a stiffness, minus half the kinetic share for an inertia (Eqs. 6–8).
    modes : Modes
    """

    names: tuple[str, ...]
    gradients: np.ndarray
    relative: np.ndarray
    modes: Modes


def sensitivities(system: System, values: Mapping[str, float] | None = None) -> Sensitivities:
    """∂f/∂p for every mode and parameter, from ∂λ/∂p = vᵀ(∂K/∂p − λ·∂M/∂p)v/μ.

    For a repeated mode they hold for the shapes given, i.e. for changes that keep the symmetry.

    Raises
    ------
    InputError
        As :func:`modelling.modal.modes.modes`.
    """
    model = compiled(system)
    p = model.vector(values)
    undamped = modes_of(model, p[None]).case(0)
    squares = (2 * np.pi * undamped.frequencies) ** 2
    x = reference_motion(model, p).state
    energy = _gradient(model).map(len(undamped))
    columns = np.tile(np.concatenate([x, p])[:, None], len(undamped))
    gradient = energy(columns[: len(x)], columns[len(x) :], undamped.shapes, squares[None]).full().T
    elastic = undamped.frequencies > 0
    per_frequency = 8 * np.pi**2 * np.where(elastic, undamped.frequencies, 1.0) * undamped.modal_mass
    gradients = np.where(elastic[:, None], gradient / per_frequency[:, None], 0.0)
    relative = gradients * p / np.where(elastic, undamped.frequencies, 1.0)[:, None]
    return Sensitivities(tuple(model.parameters), gradients, relative, undamped)


def _gradient(model: Model) -> ca.Function:
    """(x, p, v, λ) → ∂(vᵀKv − λ·vᵀMv)/∂p with v and λ held, (p,)."""
    functions = model._functions
    if "energy_gradient" not in functions:
        x, p = ca.SX.sym("x", len(model.states)), ca.SX.sym("p", len(model.parameters))
        v, square = ca.SX.sym("v", model.n), ca.SX.sym("square")
        J, turns, stiffness, twists, *_ = model.elements(x, p)
        energy = ca.dot(stiffness, (twists @ v) ** 2) - square * ca.dot(J, (turns @ v) ** 2)
        functions["energy_gradient"] = ca.Function("energy_gradient", [x, p, v, square], [ca.gradient(energy, p)])
    return functions["energy_gradient"]


@dataclass(frozen=True)
class Change:
    """What a change of parameters does to one mode; frequencies in Hz.

    ``predicted`` is Eq. 8, first order; ``exact`` is solved anew and found again by shape, ``mac`` the smallest
    MAC met on the way.
    """

    number: int
    frequency: float
    predicted: float
    exact: float
    number_after: int
    mac: float

    @property
    def predicted_change(self) -> float:
        """Eq. 8: Δf/f."""
        return self.predicted / self.frequency - 1 if self.frequency else 0.0

    @property
    def exact_change(self) -> float:
        """Δf/f of the exact solution."""
        return self.exact / self.frequency - 1 if self.frequency else 0.0

    def to_dict(self) -> dict[str, Any]:
        """Fields and both relative changes, for JSON."""
        fields = {
            key: getattr(self, key) for key in ("number", "frequency", "predicted", "exact", "number_after", "mac")
        }
        return fields | {"predicted_change": self.predicted_change, "exact_change": self.exact_change}


def what_if(system: System, changes: Mapping[str, float], values: Mapping[str, float] | None = None) -> list[Change]:
    """What every mode does when parameters change to new values: Eq. 8's prediction and the exact re-solve.

    Parameters
    ----------
    changes : mapping
        New values by name, SI.
    values : mapping, optional
        The values to start from where they differ from the system's.

    Raises
    ------
    InputError
        As :func:`modelling.modal.modes.modes`.
    """
    model = compiled(system)
    start = model.vector(values)
    end = model.vector({**(values or {}), **changes})
    gradient = sensitivities(system, values)
    tracked = track_vectors(model, _path(start, end))
    before = gradient.modes.frequencies
    predicted = before + gradient.gradients @ (end - start)
    return [
        Change(
            number=i + 1,
            frequency=float(before[i]),
            predicted=float(predicted[i]),
            exact=float(tracked.frequencies[-1, i]),
            number_after=int(tracked.order[-1, i]) + 1,
            mac=float(tracked.mac_values[:, i].min()),
        )
        for i in range(len(before))
    ]


def _path(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Parameter vectors (t, p) from start to end, by equal factors where the sign stays and equal steps elsewhere."""
    part = np.linspace(0.0, 1.0, TRACKING_STEPS + 1)[:, None]
    factor = start * end > 0
    ratio = np.where(factor, end / np.where(factor, start, 1.0), 1.0)
    path = np.where(factor, start * ratio**part, start + (end - start) * part)
    path[0], path[-1] = start, end
    return path
