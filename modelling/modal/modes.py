"""Undamped modes and what each component holds of them (paper Eqs. 1–7), one model or a batch of parameter sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy

from modelling.common.errors import InputError
from modelling.equations.compiled import Model, compiled
from modelling.linear.elements import Elements, check_size, elements
from modelling.linear.reference_motion import is_linear, reference_motion, reference_states
from modelling.linear.sparse_elements import SparseElements, sparse_elements
from modelling.modal.large import lowest
from modelling.modal.result import Modes
from modelling.modal.symmetry import images, labels, split
from modelling.model.system import System

LARGEST_WITH_ALL_MODES = 300  # degrees of freedom; the work for all modes grows with their cube
LOWEST_MODES = 100  # found of larger models
REPEATED_MODE_TOLERANCE = 1e-9  # relative distance of ω² of modes that count as repeated: above rounding (1e-13·n)


def modes(system: System, values: Mapping[str, float] | None = None, state: np.ndarray | None = None) -> Modes:
    """Undamped modes of a system: all of them, or the lowest 100 where it has more than 300 degrees of freedom.

    Dampers in parallel are left out, a damper in series (tyre slip) is rigid, lash is closed, and dry friction and
    torque ripple do not hold the shaft, as in a drive that turns under load.

    Parameters
    ----------
    values : mapping, optional
        Parameters that differ from the system's, by name, SI.
    state : ndarray (x,), optional
        About which nonlinear springs are tangent; default the operating point, or at rest with lash just closed.

    Raises
    ------
    InputError
        If a name is unknown, a value is not finite, an inertia is not positive, or the stiffness at the state is
        negative (a softening shaft past its peak): there is nothing to oscillate about.
    """
    model = compiled(system)
    p = model.vector(values)
    if model.n <= LARGEST_WITH_ALL_MODES:
        return modes_of(model, p[None], state).case(0)
    if not np.isfinite(p).all():
        raise InputError("values", "a parameter is not finite", "give finite numbers")
    if state is None and system.operating_point is not None and not is_linear(system):
        check_size(model)
        state = reference_motion(model, p).state
    parts = sparse_elements(model, p, state)
    return _completed(model, parts, *lowest(parts, LOWEST_MODES)).case(0)


def modes_batch(
    system: System, values: np.ndarray, names: Sequence[str] | None = None, state: np.ndarray | None = None
) -> Modes:
    """Undamped modes at many parameter sets at once.

    Parameters
    ----------
    values : ndarray (b, p)
        Parameter sets, SI; its columns are ``names``, or all parameters of the compiled model in order.
    names : sequence of str, optional
    state : ndarray (x,) or (b, x), optional

    Raises
    ------
    InputError
        As :func:`modes`, or if the shape does not fit.
    """
    model = compiled(system)
    values = np.asarray(values, float)
    columns = model.parameters if names is None else list(names)
    if values.ndim != 2 or values.shape[1] != len(columns):
        raise InputError("values", f"shape {values.shape} does not fit {len(columns)} parameters", "give (b, p)")
    p = np.repeat(model.vector(dict.fromkeys(columns, 0.0))[None], len(values), axis=0)
    p[:, [model.parameters.index(name) for name in columns]] = values
    return modes_of(model, p, state)


def modes_of(model: Model, p: np.ndarray, state: np.ndarray | None = None) -> Modes:
    """Undamped modes of a compiled model at parameter sets (b, p); see :func:`modes_batch`.

    Raises
    ------
    InputError
        If a parameter is not finite or the stiffness is negative.
    """
    if not np.isfinite(p).all():
        raise InputError("values", "a parameter is not finite", "give finite numbers")
    parts = elements(model, p, reference_states(model, p) if state is None else state)
    squares, shapes = _eigen(parts)
    if np.any(squares < -1e-11 * np.abs(squares).max(axis=1, keepdims=True)):
        raise InputError("", "the stiffness at this state is negative: no mode oscillates", "choose another state")
    return _completed(model, parts, squares, shapes)


def _completed(model: Model, parts: Elements | SparseElements, squares: np.ndarray, shapes: np.ndarray) -> Modes:
    """Modes from ω² (b, m) and mass-normalised shapes (b, n, m)."""
    rigid = np.arange(squares.shape[1]) < parts.rigid()[:, None]
    squares = np.where(rigid, 0.0, np.maximum(squares, 0.0))
    image = images(model.system, parts.masses)
    if image is not None:
        _split_repeated(squares, shapes, parts, image)
    return _shares(squares, shapes, parts, image, tuple(model.coordinates))


def _eigen(parts: Elements) -> tuple[np.ndarray, np.ndarray]:
    """ω² (b, m) ascending and mass-normalised shapes (b, n, m) of K·v = ω²·M·v, whitened by M."""
    mass, stiffness = parts.mass_matrix(), parts.stiffness_matrix()
    n = mass.shape[-1]
    diagonal = mass[:, range(n), range(n)]
    if np.any(parts.J <= 0):
        raise InputError(
            "", f"the inertia of {parts.masses[int(np.argmin(parts.J.min(axis=0)))]} is not positive", "J > 0"
        )
    if np.count_nonzero(mass) == diagonal.size:
        scale = 1 / np.sqrt(diagonal)
        squares, shapes = np.linalg.eigh(stiffness * scale[:, :, None] * scale[:, None, :])
        return squares, shapes * scale[:, :, None]
    inverse = np.linalg.inv(np.linalg.cholesky(mass))
    across = np.swapaxes(inverse, -1, -2)
    white = inverse @ stiffness @ across
    squares, shapes = np.linalg.eigh((white + np.swapaxes(white, -1, -2)) / 2)
    return squares, across @ shapes


def _split_repeated(
    squares: np.ndarray, shapes: np.ndarray, parts: Elements | SparseElements, image: np.ndarray
) -> None:
    """Rotate the shapes of repeated modes into symmetric and antisymmetric ones, in place."""
    near = np.diff(squares, axis=1) <= REPEATED_MODE_TOLERANCE * squares[:, 1:] + 1e-13 * squares[:, -1:]
    for case in np.flatnonzero(near.any(axis=1)):
        transformation = parts.mass_transformation
        if transformation.ndim > 2:
            transformation = transformation[case]
        first = 0
        for last in range(1, squares.shape[1] + 1):
            if last == squares.shape[1] or not near[case, last - 1]:
                if last - first > 1:
                    group = slice(first, last)
                    shapes[case][:, group] = split(shapes[case][:, group], transformation, parts.J[case], image)
                first = last


def _amplitudes(rows: np.ndarray | scipy.sparse.csr_array, shapes: np.ndarray) -> np.ndarray:
    """Amplitudes (b, r, m) of masses or springs; sparse rows (r, n) go with one case only."""
    return rows @ shapes if isinstance(rows, np.ndarray) else (rows @ shapes[0])[None]


def _shares(
    squares: np.ndarray,
    shapes: np.ndarray,
    parts: Elements | SparseElements,
    image: np.ndarray | None,
    coordinates: tuple[str, ...],
) -> Modes:
    """Modes with their largest amplitude 1 and the energy shares of masses and springs."""
    largest = np.take_along_axis(shapes, np.argmax(np.abs(shapes), axis=1)[:, None], axis=1)
    shapes = shapes / largest
    modal_mass = 1 / largest[:, 0] ** 2
    mass_amplitudes = _amplitudes(parts.mass_transformation, shapes)
    spring_amplitudes = _amplitudes(parts.spring_transformation, shapes)
    kinetic = parts.J[:, :, None] * mass_amplitudes**2
    potential = parts.stiffness[:, :, None] * spring_amplitudes**2 * (squares > 0)[:, None]
    kinetic = kinetic / kinetic.sum(axis=1, keepdims=True)
    total = potential.sum(axis=1, keepdims=True)
    potential = potential / np.where(total > 0, total, 1.0)
    omega = np.sqrt(squares)
    return Modes(
        frequencies=omega / (2 * np.pi),
        damping_ratios=np.zeros_like(squares),
        symmetries=labels(mass_amplitudes, parts.J, image),
        shapes=shapes,
        modal_mass=modal_mass,
        modal_stiffness=squares * modal_mass,
        kinetic=np.swapaxes(kinetic, 1, 2),
        potential=np.swapaxes(potential, 1, 2),
        mass_amplitudes=mass_amplitudes,
        masses=parts.masses,
        springs=parts.springs,
        coordinates=coordinates,
        eigenvalues=1j * omega,
    )
