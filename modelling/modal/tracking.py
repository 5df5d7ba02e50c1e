"""Which mode became which when parameters change: the modal assurance criterion and following by it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from modelling.equations.compiled import Model, compiled
from modelling.linear.elements import elements
from modelling.modal.modes import modes_of
from modelling.modal.result import Modes
from modelling.model.system import System


def mac(first: np.ndarray, second: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
    """Modal assurance criterion |v'Ww|²/(v'Wv · w'Ww), normalised: 0 … 1 whatever the scale of the shapes.

    Parameters
    ----------
    first, second : ndarray (n, m), (n, l)
        Shapes, real or complex.
    weight : ndarray (n, n), optional
        Positive definite; the mass matrix makes distinct modes of one system score 0. Default: the unit matrix
        (Allemang and Brown 1982).

    Returns
    -------
    ndarray (m, l)
    """
    weighted = second if weight is None else weight @ second
    other = first if weight is None else weight @ first
    norms = np.sum(np.conj(first) * other, axis=0).real[:, None] * np.sum(np.conj(second) * weighted, axis=0).real
    return np.abs(np.conj(first).T @ weighted) ** 2 / np.maximum(norms, 1e-300)


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
        rows, columns = scipy.optimize.linear_sum_assignment(-score)
        order[i], mac_values[i] = columns, score[rows, columns]
    return Tracked(np.take_along_axis(batch.frequencies, order, axis=1), order, mac_values, batch)
