"""Undamped modes and what each component holds of them (paper Eqs. 1–7), one model or a batch of parameter sets."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import scipy

from modelling.equations.casadi_code import Model, compiled
from modelling.errors import InputError
from modelling.linear.elements import (
    Elements,
    SparseElements,
    check_size,
    elements,
    null_space,
    sparse_elements,
    unit_rows,
)
from modelling.linear.linearise import Linear, deflated, linearise
from modelling.linear.steady_motion import is_linear, reference_motion, reference_states
from modelling.modal.result import Modes
from modelling.system import System, mirror_images

# --- Left/right symmetry: what mirrors what, how symmetric a shape is, and how repeated modes are split by it.

SYMMETRY_THRESHOLD = 0.9  # correlation of a shape with its mirror image from which it is called (anti)symmetric


def images(system: System, components: Sequence[str]) -> np.ndarray | None:
    """Index (k,) of the mirror image of every component; itself where it has none. None without mirror pairs."""
    if not system.mirror:
        return None
    index = {name: i for i, name in enumerate(components)}
    images = mirror_images(components, system)
    return np.array([index.get(image, i) for i, image in enumerate(images)])


def correlation(turns: np.ndarray, J: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Correlation of shapes with their mirror images, weighted by inertia: 1 symmetric, −1 antisymmetric.

    Parameters
    ----------
    turns : ndarray (..., k, m)
        Amplitude of every mass.
    J : ndarray (..., k)
    image : ndarray (k,)
    """
    weight = (J + J[..., image])[..., None] / 2
    norm = np.sum(weight * np.abs(turns) ** 2, axis=-2)
    return np.sum(weight * (np.conj(turns) * turns[..., image, :]).real, axis=-2) / np.maximum(norm, 1e-300)


def labels(turns: np.ndarray, J: np.ndarray, image: np.ndarray | None) -> np.ndarray:
    """``symmetric``, ``antisymmetric`` or ``none`` for every shape, (..., m); arguments as in :func:`correlation`."""
    if image is None:
        return np.full(turns.shape[:-2] + turns.shape[-1:], "none", dtype="<U13")
    symmetry = correlation(turns, J, image)
    return np.where(
        symmetry > SYMMETRY_THRESHOLD, "symmetric", np.where(symmetry < -SYMMETRY_THRESHOLD, "antisymmetric", "none")
    )


def split(shapes: np.ndarray, turns: np.ndarray, J: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Shapes (n, c) of one repeated mode, rotated so that symmetric ones come first and antisymmetric ones last.

    Any combination of the shapes of a repeated mode is a shape; this picks the one that symmetry knows.
    ``turns`` (k, n), ``J`` and ``image`` (k,).
    """
    moved = turns @ shapes
    swapped = moved.T @ (((J + J[image]) / 2)[:, None] * moved[image])
    _, rotation = np.linalg.eigh((swapped + swapped.T) / 2)
    return shapes @ rotation[:, ::-1]


# --- Damped modes: eigenvalues of the linear model, rigid motions taken out before they can blur.

ZERO_EIGENVALUE = 1e-9  # of the largest eigenvalue: what is smaller is rounding
ZERO_IF_WIDE = 1e-14  # the same in modal coordinates


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
    wide = bool(_wide(parts, *_eigen(parts)).any())
    eigenvalues, vectors = _damped_eigen(linear, parts, wide)
    speed = vectors[n : 2 * n]
    rigid = _rigid(eigenvalues, speed, parts)
    size = np.abs(eigenvalues)
    zero = (ZERO_IF_WIDE if wide else ZERO_EIGENVALUE) * size.max(initial=0.0)
    keep = np.flatnonzero(rigid | (size > zero))
    keep = keep[np.lexsort((size[keep], ~rigid[keep]))]
    eigenvalues, vectors, speed, rigid = eigenvalues[keep], vectors[:, keep], speed[:, keep], rigid[keep]
    eigenvalues[np.abs(eigenvalues) <= zero] = 0.0

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
    ).without_held(model.system.held)  # fmt: skip


def _damped_eigen(linear: Linear, parts: Elements, wide: bool) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues with Im ≥ 0 and vectors (x, m), after angles that nothing depends on are taken out."""
    if wide:
        A, lift = _in_modal_coordinates(linear.A, parts)
    else:
        rest = deflated(linear, parts)
        A, lift = rest.A, rest.lift
    eigenvalues, vectors = np.linalg.eig(A)
    upper = eigenvalues.imag >= 0
    return eigenvalues[upper].astype(complex), (lift @ vectors[:, upper]).astype(complex)


def _in_modal_coordinates(A: np.ndarray, parts: Elements) -> tuple[np.ndarray, np.ndarray]:
    """A (l, l) of undamped modal coordinates, angles times ω, and what takes those to all states (x, l).

    In them, the stiffnesses are the undamped ω, which are known to all digits where frequencies are decades apart; what
    else depends on angles stays, if rounding cannot have made it.
    """
    squares, shapes = _by_singular_values(parts, 0)
    r, n = int(parts.rigid()[0]), len(squares)
    omega = np.where(np.arange(n) < r, 1.0, np.sqrt(squares))
    across = shapes.T @ parts.mass_matrix()[0]
    forward, back = (np.eye(len(A)) for _ in range(2))
    forward[:n, :n], forward[n : 2 * n, n : 2 * n] = shapes / omega, shapes
    back[:n, :n], back[n : 2 * n, n : 2 * n] = omega[:, None] * across, across
    modal, largest = back @ A @ forward, np.abs(back) @ np.abs(A) @ np.abs(forward)
    known = np.zeros_like(modal)
    known[range(n), range(n, 2 * n)], known[range(n, 2 * n), range(n)] = omega, -omega
    known[range(n, n + r), range(r)] = 0.0
    modal[:, :n] = np.where(np.abs(modal - known)[:, :n] <= 1e-12 * largest[:, :n], known[:, :n], modal[:, :n])
    modal[:n] = known[:n]
    left = np.arange(len(A)) >= (0 if modal[:, :r].any() else r)
    return modal[np.ix_(left, left)], forward[:, left]


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


# --- The lowest modes of a model of many degrees of freedom, by a sparse eigensolver, and a count that none is missing.

SHIFT = 1e-9  # of the largest ω²: below every elastic mode of a chain of some thousand inertias
LARGEST_REPEATED = 1500  # degrees of freedom for which dense matrices are tried
SPARE = 10  # modes more than asked for, so that the last ones asked for have converged


def lowest(parts: SparseElements, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The lowest ω² (1, m) and mass-normalised shapes (1, n, m) of K·v = ω²·M·v.

    Lanczos iterations with (K + shift·M)⁻¹, whose factors are as sparse as the drivetrain (ARPACK). The signs of the
    pivots of K − s·M count the modes below s (Sylvester's law of inertia), so a mode that was missed is noticed.

    Raises
    ------
    InputError
        If an inertia is not positive, the stiffness is negative, or modes are repeated too often.
    """
    if np.any(parts.J <= 0):
        raise InputError("", f"the inertia of {parts.masses[int(np.argmin(parts.J[0]))]} is not positive", "J > 0")
    mass, stiffness = parts.mass_matrix(), parts.stiffness_matrix()
    n = mass.shape[0]
    largest = float(np.max(abs(stiffness).sum(axis=1) / mass.diagonal(), initial=0.0))
    shift = SHIFT * largest if largest else 1.0
    if np.any(parts.stiffness < 0) and _below(stiffness, mass, -1e-11 * largest):
        raise InputError("", "the stiffness at this state is negative: no mode oscillates", "choose another state")
    inverse = _factors(stiffness + shift * mass)
    solve = scipy.sparse.linalg.LinearOperator((n, n), inverse.solve, dtype=float)
    start = np.random.default_rng(0).standard_normal(n)
    for spare in (SPARE, 4 * SPARE):
        size = min(count + spare, n - 2)
        squares, shapes = scipy.sparse.linalg.eigsh(
            stiffness, size, mass, sigma=-shift, OPinv=solve, v0=start, ncv=min(n, 3 * size)
        )
        order = np.argsort(squares)
        squares, shapes = squares[order], shapes[:, order]
        if _complete(stiffness, mass, squares, count):
            return squares[None, :count], shapes[None, :, :count]
    return _dense(stiffness, mass, count)


def _dense(
    stiffness: scipy.sparse.csc_array, mass: scipy.sparse.csc_array, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """The same by dense matrices, for modes repeated so often that Lanczos iterations miss some: slow, but all."""
    if stiffness.shape[0] > LARGEST_REPEATED:
        raise InputError("inertias", "many equal branches give the same mode too often", "join equal branches to one")
    squares, shapes = scipy.linalg.eigh(stiffness.toarray(), mass.toarray(), subset_by_index=(0, count - 1))
    return squares[None], shapes[None]


def _complete(stiffness: scipy.sparse.csc_array, mass: scipy.sparse.csc_array, squares: np.ndarray, count: int) -> bool:
    """Whether all modes up to the widest gap after the ones asked for are among ω² (m,), in order."""
    gaps = np.diff(squares[count - 1 :])
    if not gaps.max(initial=0.0) > 1e-8 * squares[-1]:
        return False  # the last of them is repeated, or none is left to compare with
    last = count - 1 + int(np.argmax(gaps))
    return _below(stiffness, mass, (squares[last] + squares[last + 1]) / 2) == last + 1


def _below(stiffness: scipy.sparse.csc_array, mass: scipy.sparse.csc_array, square: float) -> int:
    """Number of modes with ω² below ``square``."""
    return int(np.sum(_factors(stiffness - square * mass).U.diagonal() < 0))


def _factors(matrix: scipy.sparse.csc_array) -> scipy.sparse.linalg.SuperLU:
    """LU factors with pivots from the diagonal, in an order that keeps them sparse."""
    return scipy.sparse.linalg.splu(
        scipy.sparse.csc_matrix(matrix),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )


# --- Modes

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
        return modes_of(model, p[None], state).case(0).without_held(system.held)
    if not np.isfinite(p).all():
        raise InputError("values", "a parameter is not finite", "give finite numbers")
    if state is None and system.operating_point is not None and not is_linear(system):
        check_size(model)
        state = reference_motion(model, p).state
    parts = sparse_elements(model, p, state)
    squares, shapes = lowest(parts, LOWEST_MODES)
    if _wide(parts, squares, shapes).any():
        if model.n > LARGEST_REPEATED:
            wrong = "frequencies over so many decades are not found in so large a model"
            raise InputError("", wrong, "join inertias at very stiff shafts to one")
        squares, shapes = (found[None, ..., :LOWEST_MODES] for found in _by_singular_values(parts, 0))
    return _completed(model, parts, squares, shapes).case(0).without_held(system.held)


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
    for case in np.flatnonzero(_wide(parts, squares, shapes)):
        squares[case], shapes[case] = _by_singular_values(parts, int(case))
    if np.any(squares < -1e-11 * np.abs(squares).max(axis=1, keepdims=True)):
        raise InputError("", "the stiffness at this state is negative: no mode oscillates", "choose another state")
    return _completed(model, parts, squares, shapes)


WIDE = 1e-8  # of the largest ω²: below, rounding in the stiffest shaft shows in the eighth digit
RAYLEIGH = 1e-8  # largest relative distance of ω² from the Rayleigh quotient of its shape


def _wide(parts: Elements | SparseElements, squares: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """Which cases (b,) have modes that rounding in the stiffest shaft may have changed."""
    twists = _amplitudes(parts.spring_transformation, shapes)
    quotients = (parts.stiffness[:, :, None] * twists**2).sum(axis=1)
    elastic = np.arange(squares.shape[1]) >= parts.rigid()[:, None]
    doubtful = np.abs(quotients - squares) > RAYLEIGH * np.abs(squares)
    if isinstance(parts, Elements):
        doubtful |= squares < WIDE * squares[:, -1:]
    return (doubtful & elastic).any(axis=1) & (parts.stiffness >= 0).all(axis=1)


def _by_singular_values(parts: Elements | SparseElements, case: int) -> tuple[np.ndarray, np.ndarray]:
    """ω² (m,) and mass-normalised shapes (n, m) of one case, also over ten and more decades.

    With M = R'R and rows √k·twist, ω are the singular values of (rows)·R⁻¹. One-sided Jacobi rotations find them to
    nearly all digits however far the stiffnesses are apart [1]; their sum K has lost the digits of the soft ones.

    References
    ----------
    .. [1] Demmel, Gu, Eisenstat, Slapničar, Veselić, Drmač, "Computing the singular value decomposition with high
       relative accuracy", Linear Algebra Appl. 299 (1999).
    """
    turns, twists = (
        (rows if isinstance(rows, np.ndarray) else rows.toarray()) if rows.ndim == 2 else rows[case]
        for rows in (parts.mass_transformation, parts.spring_transformation)
    )
    root = np.linalg.qr(np.sqrt(parts.J[case])[:, None] * turns, mode="r")
    rows = np.sqrt(parts.stiffness[case])[:, None] * twists
    own = scipy.linalg.solve_triangular(root, rows.T, trans="T").T
    square = np.vstack([own, np.zeros((max(0, own.shape[1] - len(own)), own.shape[1]))])
    sizes, _, right, scale, _, failed = scipy.linalg.lapack.dgejsv(
        square, joba=2, jobu=3, jobv=0, jobr=0, jobt=0, jobp=0
    )
    if failed:
        raise InputError("", "the modes cannot be computed", "check inertias, stiffnesses and gear ratios")
    return (sizes[::-1] * scale[0] / scale[1]) ** 2, scipy.linalg.solve_triangular(root, right[:, ::-1])


def _completed(model: Model, parts: Elements | SparseElements, squares: np.ndarray, shapes: np.ndarray) -> Modes:
    """Modes from ω² (b, m) and mass-normalised shapes (b, n, m)."""
    rigid = np.arange(squares.shape[1]) < parts.rigid()[:, None]
    squares = np.where(rigid, 0.0, np.maximum(squares, 0.0))
    _part_from_held(model, shapes, parts)
    image = images(model.system, parts.masses)
    if image is not None:
        _split_repeated(squares, shapes, parts, image)
    return _shares(squares, shapes, parts, image, tuple(model.coordinates))


def _part_from_held(model: Model, shapes: np.ndarray, parts: Elements | SparseElements) -> None:
    """Rotate the shapes of rigid motions, in place: inertias with an imposed motion turn in as few as can be."""
    rows = [number for number, place in enumerate(parts.masses) if place in model.system.held]
    for case in range(len(shapes)) if rows else ():
        turns = parts.mass_transformation
        own = (turns if turns.ndim == 2 else turns[case])[rows]
        rigid = shapes[case][:, : int(parts.rigid()[case])]
        across = np.linalg.svd(np.asarray(own @ rigid))[2]
        shapes[case][:, : rigid.shape[1]] = rigid @ across.T


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
    scale = 1 / np.sqrt(diagonal)
    try:
        inverse = np.linalg.inv(np.linalg.cholesky(mass * scale[:, :, None] * scale[:, None, :])) * scale[:, None, :]
    except np.linalg.LinAlgError:  # inertias at one shaft that differ by all digits
        cases = [_by_singular_values(parts, case) for case in range(len(mass))]
        squares, shapes = zip(*cases, strict=True)
        return np.stack(squares), np.stack(shapes)
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
        damped=False,
    )


# --- Values reduced to the shaft of a reference inertia, as the paper reports them (2.3): J/i², c/i².


def speed_ratios(system: System, values: Mapping[str, float] | None = None) -> dict[str, float]:
    """speed(reference)/speed(component) of every inertia and of the second end of every shaft, no shaft twisting.

    Where shafts leave several ways to turn (an open differential), that with the least kinetic energy counts: both
    sides alike.

    Raises
    ------
    InputError
        If the system names no reference, or the reference cannot turn without twisting a shaft.
    """
    model = compiled(system)
    parts = elements(model, model.vector(values)[None])
    if not system.reference:
        raise InputError("reference", "the model names none", 'write reference = "NAME" of an inertia at the top')
    reference = parts.masses.index(f"inertias.{system.reference}")
    motion = _rigid_motion(parts, parts.mass_transformation[reference])
    speeds = dict(zip(parts.masses, parts.mass_transformation @ motion, strict=True))
    ratios = {name: 1 / speed for name, speed in speeds.items() if abs(speed) > 1e-12}
    for shaft in system.shafts:
        end = ratios.get(f"inertias.{shaft.between[1]}")
        if end is not None:
            ratios[f"shafts.{shaft.name}"] = end
    return ratios


def _rigid_motion(parts: Elements, reference: np.ndarray) -> np.ndarray:
    """Coordinates' speeds (n,) at reference speed 1, no twist, least kinetic energy."""
    mass = parts.mass_matrix()[0]
    basis = (
        null_space(unit_rows(parts.spring_transformation)) if len(parts.spring_transformation) else np.eye(len(mass))
    )
    direction = basis.T @ reference
    energy = basis.T @ mass @ basis
    if not np.linalg.norm(direction) > 1e-9 * np.linalg.norm(reference):
        raise InputError("reference", "it cannot turn without twisting a shaft", "name another inertia")
    motion = np.linalg.solve(energy, direction)
    return basis @ (motion / (direction @ motion))


def reduced_values(system: System, values: Mapping[str, float] | None = None) -> dict[str, float]:
    """J, drag, stiffness and damping of every component at the reference shaft, by parameter name, SI.

    Raises
    ------
    InputError
        As :func:`speed_ratios`.
    """
    ratios = speed_ratios(system, values)
    model = compiled(system)
    p = dict(zip(model.parameters, model.vector(values), strict=True))
    at_reference = {}
    for name, value in p.items():
        place, _, key = name.rpartition(".")
        if key in ("J", "drag", "stiffness", "damping") and place in ratios and place.count(".") == 1:
            at_reference[name] = float(value / ratios[place] ** 2)
    return at_reference


def reduced(modes: Modes, ratios: Mapping[str, float]) -> Modes:
    """The same modes with amplitudes, modal mass and modal stiffness at the reference shaft; largest amplitude 1.

    ``ratios`` are those of :func:`speed_ratios`; frequencies and energy shares stay as they are.
    """
    at_reference = modes.mass_amplitudes * np.array([ratios.get(name, 1.0) for name in modes.masses])[:, None]
    peak = at_reference[np.argmax(np.abs(at_reference), axis=0), range(len(modes))]
    peak = np.where(np.abs(peak) > 0, peak, 1.0)  # a mode that moves no inertia
    size = np.abs(peak) ** 2
    return dataclasses.replace(
        modes,
        shapes=modes.shapes / peak,
        mass_amplitudes=at_reference / peak,
        modal_mass=modes.modal_mass / size,
        modal_stiffness=modes.modal_stiffness / size,
    )
