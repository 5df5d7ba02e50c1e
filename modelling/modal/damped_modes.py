"""Damped modes: eigenvalues of the linear model, rigid motions taken out before they can blur."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from modelling.linear.elements import Elements, elements, null_space, unit_rows
from modelling.linear.linearise import Linear, deflated, linearise
from modelling.modal.result import Modes
from modelling.modal.symmetry import images, labels
from modelling.model.system import System

ZERO_EIGENVALUE = 1e-9  # of the largest eigenvalue: what is smaller is rounding


def damped_modes(
    system: System,
    values: Mapping[str, float] | None = None,
    state: np.ndarray | None = None,
    inputs: np.ndarray | None = None,
) -> Modes:
    """Damped modes about a state (default the operating point, or rest with lash just closed), delays left out.

    A pair of complex eigenvalues λ is one mode of frequency |λ|/2π and damping ratio −Re λ/|λ|. A real eigenvalue
    other than a rigid one is a mode of its own, with damping ratio 1 (−1 if it grows) and the corner frequency |λ|/2π.
    Every rigid-body mode stands once, at exactly 0.0 Hz with damping ratio 0; its eigenvalue is the rate at which drag
    slows it. Eigenvalues that only integrate an angle or keep a stored friction are no modes.

    Raises
    ------
    InputError
        As :func:`modelling.linear.linearise`.
    """
    return damped_modes_of(linearise(system, values, state, inputs))


def damped_modes_of(linear: Linear) -> Modes:
    """Damped modes of a linear model, see :func:`damped_modes`."""
    model, n = linear.model, linear.model.n
    parts = elements(model, linear.p[None], linear.x0)
    eigenvalues, vectors = _eigen(linear, parts)
    speed = vectors[n : 2 * n]
    rigid = _rigid(eigenvalues, speed, parts)
    size = np.abs(eigenvalues)
    keep = np.flatnonzero(rigid | (size > ZERO_EIGENVALUE * size.max(initial=0.0)))
    keep = keep[np.lexsort((size[keep], ~rigid[keep]))]
    eigenvalues, vectors, speed, rigid = eigenvalues[keep], vectors[:, keep], speed[:, keep], rigid[keep]
    eigenvalues[np.abs(eigenvalues) <= ZERO_EIGENVALUE * size.max(initial=0.0)] = 0.0

    peak = speed[np.argmax(np.abs(speed), axis=0), range(len(keep))]
    peak = np.where(np.abs(peak) > 1e-12 * np.abs(vectors).max(axis=0), peak, 1.0)  # a lag moves nothing
    vectors, speed = vectors / peak, speed / peak
    turns = parts.mass_transformation @ speed
    kinetic, mass = _normalised(parts.J[0][:, None] * np.abs(turns) ** 2)
    deflections = parts.deflection_jacobian @ vectors
    potential, stiffness = _normalised(parts.stiffness[0][:, None] * np.abs(deflections) ** 2 * ~rigid)
    frequencies = np.where(rigid, 0.0, np.abs(eigenvalues) / (2 * np.pi))
    ratios = np.where(rigid, 0.0, -eigenvalues.real / np.where(rigid, 1.0, np.abs(eigenvalues)))
    # deflections belong to unit speeds; |λ|² takes them to unit angles
    stiffness = stiffness * np.abs(eigenvalues) ** 2
    symmetries = labels(turns, parts.J[0], images(model.system, parts.masses))
    return Modes(
        frequencies, ratios, symmetries, speed, mass, stiffness, kinetic.T, potential.T, turns,
        parts.masses, parts.springs, tuple(model.coordinates), eigenvalues,
    )  # fmt: skip


def _eigen(linear: Linear, parts: Elements) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues with Im ≥ 0 and vectors (x, m), after angles that nothing depends on are taken out."""
    rest = deflated(linear, parts)
    eigenvalues, vectors = np.linalg.eig(rest.A)
    upper = eigenvalues.imag >= 0
    return eigenvalues[upper].astype(complex), (rest.lift @ vectors[:, upper]).astype(complex)


def _rigid(eigenvalues: np.ndarray, speed: np.ndarray, parts: Elements) -> np.ndarray:
    """Which eigenvalues (m,) are those of rigid-body modes: as many real ones as there are, the most rigid first."""
    count = int(parts.rigid()[0])
    stiff = parts.spring_transformation[parts.stiffness[0] != 0]
    basis = null_space(unit_rows(stiff)) if len(stiff) else np.eye(speed.shape[0])
    mass = parts.mass_matrix()[0]
    momentum = basis.T @ mass @ speed
    part = np.sum(np.conj(momentum) * np.linalg.solve(basis.T @ mass @ basis, momentum), axis=0).real
    whole = np.sum(np.conj(speed) * (mass @ speed), axis=0).real
    share = np.where(eigenvalues.imag == 0, part / np.maximum(whole, 1e-300), 0.0)
    share[whole <= 1e-24 * whole.max(initial=0.0)] = 0.0
    chosen = np.zeros(len(share), bool)
    ranked = np.argsort(-share)[:count]
    chosen[ranked[share[ranked] > 0.5]] = True
    return chosen


def _normalised(energy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    total = energy.sum(axis=0)
    return energy / np.where(total > 0, total, 1.0), total
