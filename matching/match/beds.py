"""Beds whose cut shafts have opened: what a lash between its flanks lets a bed appear to be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, matrix_balance, schur

from matching.match.case import Case, of_system, target_modes
from modelling.bed.bed import DelayedBed, ObserverController, delayed_bed
from modelling.bed.observer import TRUST, Feedback, Filter, ObserverModel, last_command, predicted, summed
from modelling.linear.state_space import state_space
from modelling.resources import threads

# --- What every bed and the loop have to keep, for a controller to count as robust.

DAMPING_SHARE = 1 / 3  # of the least damping of the target modes, for every mode on every bed
MARGIN_FROM_HIGHEST_TARGET = 2.0  # the margin counts from this many times the highest target mode on
ROLLED_OFF_FROM_HZ = 100.0  # where a model of a drivetrain ends, unless the case says otherwise
LARGEST_ROLLED_OFF = 0.5  # of |T| from there on
OF_ITS_OWN = 0.95  # of its damping that a mode of the bed's own keeps, above the roll-off, where that is all it has
NOISE_SHARE = 0.02  # of the dynamometers' torque limit that sensor noise may become, rms


@dataclass(frozen=True)
class Requirements:
    """Least damping ratio of any mode, modulus margin and from where (Hz), roll-off (Hz), command noise (N·m rms)."""

    damping_ratio: float
    modulus_margin: float
    margin_from: float
    rolled_off_from: float
    command_noise: float | None


def rolled_off_from(case: Case) -> float:
    """From where the loop has to have rolled off, Hz."""
    return case.limits.get("rolled_off_from", ROLLED_OFF_FROM_HZ)


def requirements(case: Case) -> Requirements:
    """What a case asks for."""
    damped = [mode for _, mode in target_modes(case)]
    limits = case.limits
    noise = limits.get("command_noise")
    if noise is None and "dynamometer_torque" in limits:
        noise = NOISE_SHARE * limits["dynamometer_torque"]
    return Requirements(
        DAMPING_SHARE * min(mode.damping_ratio for mode in damped),
        limits["modulus_margin"],
        limits.get("margin_from", MARGIN_FROM_HIGHEST_TARGET * max(mode.frequency for mode in damped)),
        rolled_off_from(case),
        noise,
    )


# --- A bed as it may stand there, with its dead time: what a sampled controller acts on.


@dataclass(frozen=True)
class Bed:
    """Rig with lags; x states, k commands, y readings of the controller, d torques at the rig, c compared sensors.

    Attributes
    ----------
    A, commands, torques : ndarray (x, x), (x, k), (x, d)
        Continuous, commands as they arrive.
    readings, compared : ndarray (y, x), (c, x)
    compared_torques : ndarray (c, d)
        What a torque does to a compared sensor at once.
    delay : float
        s, from a sample to the moment its command begins to act.
    sampled : DelayedBed
        Without torques.
    own_damping : float
        Least damping ratio of its own modes, without control, where the loop has to have rolled off.
    """

    A: np.ndarray
    commands: np.ndarray
    torques: np.ndarray
    readings: np.ndarray
    compared: np.ndarray
    compared_torques: np.ndarray
    delay: float
    sampled: DelayedBed
    own_damping: float


def disturbing(case: Case) -> list[str]:
    """Inputs of the rig that are no dynamometer's."""
    driven = {dynamometer.torque_input for dynamometer in case.loop.dynamometers}
    return [part.name for part in case.rig.inputs if part.name not in driven]


def compared_sensors(case: Case) -> list[str]:
    """Sensors of the compared functions, each once."""
    return list(dict.fromkeys(pair.sensor for pair in case.compared))


def bed_of(case: Case, values: Mapping[str, float]) -> Bed:
    """The bed with some values (:class:`matching.match.case.Uncertain`) other than the case's, SI."""
    loop, k = case.loop, len(case.loop.dynamometers)
    of_rig = {name.removeprefix("rig."): value for name, value in values.items() if name.startswith("rig.")}
    rig = state_space(case.rig.with_values(of_rig) if of_rig else case.rig)
    lag, sensor_lag = (values.get(f"loop.{name}", loop[name]) for name in ("inverter_lag", "torque_sensor_lag"))
    delay = loop.command_delay(values.get("loop.dead_time"))
    n = len(rig.A)
    A = block_diag(rig.A, -np.eye(k) / lag, -np.eye(k) / sensor_lag)
    commands, readings = np.zeros((n + 2 * k, k)), np.zeros((len(loop.controller_sensors), n + 2 * k))
    for j, dynamometer in enumerate(loop.dynamometers):
        A[:n, n + j] = values.get(f"dynamometers.{dynamometer.name}.torque_gain", 1.0) * rig.input(
            dynamometer.torque_input
        )
        A[n + k + j, :n] = rig.output(dynamometer.torque_sensor) / sensor_lag
        commands[n + j, j] = 1 / lag
    for i, name in enumerate(loop.controller_sensors):
        readings[i, :n] = rig.output(name)
    readings[:k] = np.eye(k, n + 2 * k, n + k)
    readings *= np.array([[values.get(f"sensors.{name}.gain", 1.0)] for name in loop.controller_sensors])
    torques = np.zeros((n + 2 * k, len(disturbing(case))))
    rows = [rig.outputs.index(name) for name in compared_sensors(case)]
    columns = [rig.inputs.index(name) for name in disturbing(case)]
    torques[:n] = rig.B[:, columns]
    compared = np.hstack([rig.C[rows], np.zeros((len(rows), 2 * k))])
    of_its_own = least_damping(rig.A, 2 * np.pi * rolled_off_from(case))
    sampled = delayed_bed(A, commands, np.zeros((n + 2 * k, 0)), delay, loop["sample_time"])
    return Bed(A, commands, torques, readings, compared, rig.D[np.ix_(rows, columns)], delay, sampled, of_its_own)


def least_damping(A: np.ndarray, from_rad_s: float) -> float:
    """Least damping ratio of the modes of A (x, x) from so many rad/s on; 1 without any."""
    s = np.linalg.eigvals(A)
    fast = s[(np.abs(s) >= from_rad_s) & (s.imag > 0)]
    return float(np.min(-fast.real / np.abs(fast), initial=1.0))


def vehicle_response(case: Case, values: Mapping[str, float], frequencies: np.ndarray) -> np.ndarray:
    """Compared functions (f, h) of the vehicle whose shared components have the bed's values."""
    drawn = of_system(values, case.vehicle)
    space = state_space(case.vehicle.with_values(drawn) if drawn else case.vehicle)
    s = 2j * np.pi * frequencies
    states = np.linalg.solve(
        s[:, None, None] * np.eye(len(space.A)) - space.A, np.broadcast_to(space.B, (len(s), *space.B.shape))
    )
    H = space.C @ states + space.D
    rows = [space.outputs.index(pair.sensor) for pair in case.compared]
    return H[:, rows, [space.inputs.index(pair.input) for pair in case.compared]]


# --- Eigenvalues of many matrices, on all cores.

WORTH_THREADS = 2e6  # sum of the cubes of the orders (speed only; 3 ms on one core)


def eigenvalues(matrices: np.ndarray) -> np.ndarray:
    """Eigenvalues (b, n) of matrices (b, n, n).

    LAPACK leaves Python's lock while it works, so threads share the matrices. None is left over: what has threads
    cannot be forked.
    """
    parts = min(threads(), len(matrices)) if matrices.size * matrices.shape[-1] > WORTH_THREADS else 1
    if parts < 2:
        values: np.ndarray = np.linalg.eigvals(matrices)
        return values
    with ThreadPoolExecutor(parts) as pool:
        return np.concatenate(list(pool.map(np.linalg.eigvals, np.array_split(matrices, parts))))


# --- (z·I − A)⁻¹ at many z from one Schur form of A: a back substitution a frequency in place of a factorisation.


@dataclass(frozen=True)
class Resolvent:
    """A = V·T·V⁻¹ with T upper triangular, all (x, x) and complex; see :func:`resolvent`."""

    T: np.ndarray
    V: np.ndarray
    inverse: np.ndarray

    def columns(self, z: np.ndarray, B: np.ndarray) -> np.ndarray:
        """(z·I − A)⁻¹·B, (f, x, u), for z (f,) and B (x, u) or (f, x, u)."""
        x, u = B.shape[-2:]
        turned = np.moveaxis(np.broadcast_to(self.inverse @ B, (len(z), x, u)), 0, 1)
        columns = np.empty((x, len(z) * u), complex)
        for i in reversed(range(x)):
            above = turned[i] + (self.T[i, i + 1 :] @ columns[i + 1 :]).reshape(len(z), u)
            columns[i] = (above / (z - self.T[i, i])[:, None]).ravel()
        return np.moveaxis((self.V @ columns).reshape(x, len(z), u), 1, 0)

    def rows(self, z: np.ndarray, C: np.ndarray) -> np.ndarray:
        """C·(z·I − A)⁻¹, (f, k, x), for z (f,) and C (k, x)."""
        k, x = C.shape
        turned = C @ self.V
        rows = np.empty((x, len(z) * k), complex)
        for i in range(x):
            before = turned[:, i] + (self.T[:i, i] @ rows[:i]).reshape(len(z), k)
            rows[i] = (before / (z - self.T[i, i])[:, None]).ravel()
        return np.moveaxis((self.inverse.T @ rows).reshape(x, len(z), k), 0, 2)


def resolvent(A: np.ndarray) -> Resolvent:
    """The Schur form of a matrix (x, x), balanced: states in N·m and rad/s are of very different size."""
    balanced, (scale, _) = matrix_balance(A, permute=False, separate=True)
    T, Q = schur(balanced, output="complex")
    return Resolvent(T, scale[:, None] * Q, Q.conj().T / scale)


# --- A sampled controller on beds: poles, damping, responses, all beds of a set at once; b beds, f frequencies.

FORGOTTEN = 1e-3  # of z: poles that decay faster have no frequency worth a number
LEAST_OF_ITS_OWN = 1e-6  # damping ratio, of a mode of the bed's own
SLOWEST_SWING_RAD_S = 1.0  # below, a pair of poles is a drift, not a mode


@dataclass(frozen=True)
class SampledBeds:
    """Beds from sample to sample, their matrices side by side; the states end with the commands on their way.

    Attributes
    ----------
    A, B, C : ndarray (b, x, x), (b, x, k), (b, y, x)
        Commands on their way stand newest first.
    states : int
        Of a bed itself, which the commands on their way follow.
    own_damping : ndarray (b,)
        Least damping ratio of each bed's own modes, without control, where the loop has to have rolled off.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    states: int
    own_damping: np.ndarray

    def some(self, which: np.ndarray) -> SampledBeds:
        """The beds of these numbers (n,)."""
        return SampledBeds(self.A[which], self.B[which], self.C[which], self.states, self.own_damping[which])


@dataclass(frozen=True)
class BedSet:
    """Beds of one case and what they do at frequencies.

    Attributes
    ----------
    sampled : SampledBeds
    frequencies : ndarray (f,)
        Hz.
    held : ndarray (b, f, y, k)
        Readings for commands, sampled.
    read, answered, commanded : ndarray (b, f, y, d), (b, f, c, d), (b, f, c, k)
        Readings and compared sensors for continuous torques, and compared sensors for held commands.
    vehicle : ndarray (b, f, h)
    """

    case: Case
    sampled: SampledBeds
    frequencies: np.ndarray
    held: np.ndarray
    read: np.ndarray
    answered: np.ndarray
    commanded: np.ndarray
    vehicle: np.ndarray


def sampled_beds(case: Case, values: Sequence[dict[str, float]]) -> SampledBeds:
    """Beds with these values (SI, by name; :func:`bed_of`)."""
    return side_by_side([bed_of(case, of_bed) for of_bed in values])


def side_by_side(beds: Sequence[Bed]) -> SampledBeds:
    """Sampled beds as one batch, each with as many delayed commands as the bed with the longest dead time has."""
    longest = max(bed.sampled.delay for bed in beds) + 1
    matrices = [_shifting(bed, longest) for bed in beds]
    A, B, C = (np.stack(parts) for parts in zip(*matrices, strict=True))
    return SampledBeds(A, B, C, len(beds[0].A), np.array([bed.own_damping for bed in beds]))


def bed_set(case: Case, values: Sequence[dict[str, float]], frequencies: np.ndarray) -> BedSet:
    """Beds with these values (SI, by name; :func:`bed_of`) and their responses at frequencies (f,) in Hz."""
    beds = [bed_of(case, of_bed) for of_bed in values]
    sampled, step = side_by_side(beds), case.loop["sample_time"]
    s = 2j * np.pi * frequencies
    hold = (1 - np.exp(-s * step)) / (s * step)
    z = np.exp(s * step)
    held = np.stack(
        [c @ resolvent(a).columns(z, b) for a, b, c in zip(sampled.A, sampled.B, sampled.C, strict=True)]
    )  # fmt: skip
    read, answered, commanded = [], [], []
    for bed in beds:
        d = bed.torques.shape[1]
        states = resolvent(bed.A).columns(s, np.hstack([bed.torques, bed.commands]))
        read.append(bed.readings @ states[:, :, :d])
        answered.append(bed.compared @ states[:, :, :d] + bed.compared_torques)
        late = hold * np.exp(-s * bed.delay)
        commanded.append(bed.compared @ states[:, :, d:] * late[:, None, None])
    vehicle = np.stack([vehicle_response(case, of_bed, frequencies) for of_bed in values])
    return BedSet(case, sampled, frequencies, held, np.stack(read), np.stack(answered), np.stack(commanded), vehicle)


def _shifting(bed: Bed, longest: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C with ``longest`` commands on their way as further states."""
    x, k, delay = len(bed.A), bed.commands.shape[1], bed.sampled.delay
    A, B = np.zeros((x + k * longest,) * 2), np.zeros((x + k * longest, k))
    A[:x, :x] = bed.sampled.whole
    if delay:
        A[:x, x + k * (delay - 1) : x + k * delay] = bed.sampled.new
    else:
        B[:x] = bed.sampled.new
    A[:x, x + k * delay : x + k * (delay + 1)] = bed.sampled.old
    A[x + k :, x:-k] = np.eye(k * (longest - 1))
    B[x : x + k] = np.eye(k)
    return A, B, np.hstack([bed.readings, np.zeros((len(bed.readings), k * longest))])


@dataclass(frozen=True)
class Action:
    """A controller at frequencies: commands for readings (f, k, y) and for known torques (f, k, w)."""

    of_readings: np.ndarray
    of_known: np.ndarray
    known: tuple[str, ...]

    def at(self, part: slice) -> Action:
        """The same at some of the frequencies."""
        return Action(self.of_readings[part], self.of_known[part], self.known)


def action(controller: ObserverController, frequencies: np.ndarray, ahead: np.ndarray | None = None) -> Action:
    """What a controller does at frequencies (f,), Hz.

    ``ahead`` is what :func:`ahead_states` gives, if it is there already: it does not depend on the weights.
    """
    space, o, y = controller.space, controller.observed, len(controller.sensors)
    feedback = controller.feedback
    # C·(zI − A)⁻¹ of the observer, from the left: as many right-hand sides as dynamometers
    z = np.exp(2j * np.pi * frequencies * controller.sample_time)
    left = resolvent(feedback.A).rows(z, feedback.C)
    ahead = ahead_states(controller, frequencies) if ahead is None else ahead
    reaches = space.A[:o, o:] @ ahead + space.B[:o, y:]
    of_known = left @ reaches + space.C[:, o:] @ ahead + space.D[:, y:]
    return Action(left @ feedback.B + feedback.D, of_known, controller.known)


def ahead_states(controller: ObserverController, frequencies: np.ndarray) -> np.ndarray:
    """States (f, m, w) of the model that runs ahead, for known torques, at frequencies (f,) in Hz."""
    space, o, y = controller.space, controller.observed, len(controller.sensors)
    z = np.exp(2j * np.pi * frequencies * controller.sample_time)
    return resolvent(space.A[o:, o:]).columns(z, space.B[o:, y:])


def closed_matrices(beds: SampledBeds, controller: ObserverController) -> np.ndarray:
    """State matrices (b, x + c, x + c) of the closed loops."""
    space = controller.feedback
    By, Dy = space.B, space.D
    count, x, c = len(beds.A), beds.A.shape[1], len(space.A)
    closed = np.empty((count, x + c, x + c))
    closed[:, :x, :x] = beds.A + beds.B @ Dy @ beds.C
    closed[:, :x, x:] = beds.B @ space.C
    closed[:, x:, :x] = By @ beds.C
    closed[:, x:, x:] = space.A
    return closed


def shared_poles(beds: SampledBeds, controller: ObserverController, on_their_way: slice) -> np.ndarray:
    """Poles (b, p) of the closed loops without those at 0 that stand for commands known twice.

    A bed and the controller, among whose states ``on_their_way`` are these commands, hold the same ones, and what tells
    theirs apart is gone once they have passed. So the closed loop is worked out with the bed's alone, which takes a
    fraction of the time where the dead time is many samples.
    """
    closed, x = closed_matrices(beds, controller), beds.A.shape[1]
    both = np.arange(min(x - beds.states, on_their_way.stop - on_their_way.start))
    twice = x + on_their_way.start + both
    closed[:, :, beds.states + both] += closed[:, :, twice]
    once = np.delete(np.arange(closed.shape[1]), twice)
    return eigenvalues(closed[:, once[:, None], once])


def damping(z: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Largest magnitude (b,) of poles (b, x) of a loop with this sampling interval (s), and least damping ratio (b,).

    Poles that do not swing have no damping ratio.
    """
    return np.abs(z).max(axis=1), damping_ratios(z, step).min(axis=1)


def damping_ratios(z: np.ndarray, step: float) -> np.ndarray:
    """Damping ratios (b, x) of poles (b, x) of a loop with this sampling interval (s); 1 of what does not swing."""
    size, s = np.abs(z), rates(z, step)
    swinging = (size > FORGOTTEN) & (np.abs(s.imag) > SLOWEST_SWING_RAD_S)
    return np.where(swinging, -s.real / np.maximum(np.abs(s), 1e-300), 1.0)


def rates(z: np.ndarray, step: float) -> np.ndarray:
    """Poles (b, x) of a loop with this sampling interval (s) in continuous time, 1/s."""
    s: np.ndarray = np.log(np.where(np.abs(z) > FORGOTTEN, z, 0.5).astype(complex)) / step
    return s


def eased(beds: SampledBeds, z: np.ndarray, step: float, least: float, rolled_off_from: float) -> np.ndarray:
    """Factors (b, x) on the damping ratios of poles (b, x), sampling interval ``step`` (s), that ``least`` judges.

    From ``rolled_off_from`` (Hz) on no control helps a bed's own modes: there they count as if they had all of it.
    """
    of_own = least / (OF_ITS_OWN * np.maximum(beds.own_damping, LEAST_OF_ITS_OWN))
    fast = np.abs(rates(z, step)) >= 2 * np.pi * rolled_off_from
    factors: np.ndarray = np.where(fast, np.maximum(of_own, 1.0)[:, None], 1.0)
    return factors


def return_difference(beds: BedSet, acting: Action) -> np.ndarray:
    """I + L at the commands (b, f, k, k)."""
    return np.eye(acting.of_readings.shape[1]) - acting.of_readings @ beds.held


@dataclass(frozen=True)
class Driven:
    """What the i inputs of the compared functions do before any command reaches the bed.

    Attributes
    ----------
    commands : ndarray (b, f, k, i)
        What the controller makes of them.
    read, answered : ndarray (b, f, y, i), (b, f, c, i)
        Readings and compared sensors.
    known : dict
        Of the inputs, by number, those whose torque the controller knows: number among its known torques.
    """

    commands: np.ndarray
    read: np.ndarray
    answered: np.ndarray
    known: dict[int, int]


def compared_columns(case: Case) -> tuple[list[int], list[int]]:
    """Of every compared function: number of its sensor, number of its input."""
    sensors, inputs = compared_sensors(case), compared_inputs(case)
    return [sensors.index(pair.sensor) for pair in case.compared], [inputs.index(pair.input) for pair in case.compared]


def compared_inputs(case: Case) -> list[str]:
    """Inputs of the compared functions, each once."""
    return list(dict.fromkeys(pair.input for pair in case.compared))


def drive(beds: BedSet, acting: Action, measured: Sequence[str]) -> Driven:
    """What the compared functions' inputs do; ``measured`` and what acts inside the residual vehicle are known."""
    rig_inputs, inputs = disturbing(beds.case), compared_inputs(beds.case)
    shape = beds.read.shape[:2]
    read = np.zeros((*shape, beds.read.shape[2], len(inputs)), complex)
    answered = np.zeros((*shape, beds.answered.shape[2], len(inputs)), complex)
    known = {}
    for i, name in enumerate(inputs):
        if name in rig_inputs:
            read[..., i] = beds.read[..., rig_inputs.index(name)]
            answered[..., i] = beds.answered[..., rig_inputs.index(name)]
        if name in measured or name not in rig_inputs:
            known[i] = acting.known.index(name)
    commands = acting.of_readings @ read
    for i, column in known.items():
        commands[..., i] += acting.of_known[:, :, column]
    return Driven(commands, read, answered, known)


def responses(beds: BedSet, acting: Action, measured: Sequence[str]) -> np.ndarray:
    """Compared functions (b, f, h) of the beds under control for continuous torques, of which ``measured`` are known.

    What acts inside the residual vehicle is always known.
    """
    driven = drive(beds, acting, measured)
    answer = beds.commanded @ np.linalg.solve(return_difference(beds, acting), driven.commands) + driven.answered
    sensors, inputs = compared_columns(beds.case)
    return answer[:, :, sensors, inputs]


def errors(beds: BedSet, acting: Action, measured: Sequence[str]) -> np.ndarray:
    """Mean squares (b, h) over the frequencies of |log(H_rig/H_vehicle)|, complex logarithm."""
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = np.abs(np.log(responses(beds, acting, measured) / beds.vehicle)) ** 2
    return np.nan_to_num(squares, nan=1e6, posinf=1e6).mean(axis=1)


# --- What a controller does on a set of beds and what it asks of them: the figures that the search works with.

PLAN_POINTS = 240  # log-spaced frequencies from the band's lower edge to half the sampling frequency
BED_POINTS = 60  # over the band, for drawn beds: fewer miss the transmission zeros, where the error is largest


@dataclass(frozen=True)
class LoopFigures:
    """Of the bed as planned.

    Attributes
    ----------
    modulus_margin, margin_at : float
        Least singular value of I + L from where it counts on, and where, Hz.
    largest_rolled_off : float
        Largest singular value of T = L/(1 + L) where the loop has to have rolled off.
    command_noise : tuple of float (k)
        N·m rms of each dynamometer's command, of the sensors' uncertainties alone.
    """

    modulus_margin: float
    margin_at: float
    largest_rolled_off: float
    command_noise: tuple[float, ...]


@dataclass(frozen=True)
class Planned:
    """The bed as planned: over the band, and at all frequencies that margin, roll-off and noise need.

    ``uncertainty`` (y,) are the standard deviations of the sensors.
    """

    band: BedSet
    every: BedSet
    uncertainty: np.ndarray


def planned(case: Case, uncertainty: np.ndarray) -> Planned:
    """Prepare the bed as planned; ``uncertainty`` (y,): standard uncertainties of the controller's sensors, SI."""
    top = 0.499 / case.loop["sample_time"]
    every = np.geomspace(min(case.band[0], top / 2), top, PLAN_POINTS)
    return Planned(
        bed_set(case, [{}], np.geomspace(*case.band, 2 * BED_POINTS)), bed_set(case, [{}], every), uncertainty
    )  # fmt: skip


@dataclass(frozen=True)
class LoopCurves:
    """Of the bed as planned, at all its frequencies (f,).

    Attributes
    ----------
    difference : ndarray (f, k, k)
        I + L.
    margin, closed : ndarray (f,)
        Least singular value of I + L, largest of T.
    noise : ndarray (f, k, y)
        Commands for the sensors' standard deviations.
    """

    difference: np.ndarray
    margin: np.ndarray
    closed: np.ndarray
    noise: np.ndarray


def loop_curves(bed: Planned, acting: Action) -> LoopCurves:
    """Return difference, complementary sensitivity and noise of the bed as planned, which the requirements limit."""
    difference = return_difference(bed.every, acting)[0]
    identity = np.eye(difference.shape[-1])
    inverse = np.linalg.inv(difference)
    return LoopCurves(
        difference,
        np.linalg.svd(difference, compute_uv=False)[:, -1],
        np.linalg.svd(inverse - identity, compute_uv=False)[:, 0],
        inverse @ (acting.of_readings * bed.uncertainty),
    )


def command_noise(curves: LoopCurves, frequencies: np.ndarray) -> np.ndarray:
    """N·m rms (k,): a sample's noise is spread evenly up to half the sampling frequency."""
    power = (np.abs(curves.noise) ** 2).sum(axis=2)
    return np.sqrt(noise_weights(frequencies) @ power)


def noise_weights(f: np.ndarray) -> np.ndarray:
    """Weights (f,) of a mean over all frequencies up to the last; below the first it counts as there."""
    edges = np.r_[0.0, (f[1:] + f[:-1]) / 2, f[-1]]
    return np.diff(edges) / f[-1]


def counted(bed: Planned, required: Requirements) -> tuple[np.ndarray, np.ndarray]:
    """At which frequencies (f,) the margin counts, and at which the roll-off."""
    f = bed.every.frequencies
    return f >= min(required.margin_from, f[-1]), f >= required.rolled_off_from


def loop_figures(bed: Planned, controller: ObserverController, required: Requirements) -> LoopFigures:
    """Margin, roll-off and noise of a controller."""
    f = bed.every.frequencies
    curves = loop_curves(bed, action(controller, f))
    margin, rolled_off = counted(bed, required)
    at = int(np.argmin(np.where(margin, curves.margin, np.inf)))
    largest = curves.closed[rolled_off].max(initial=0.0)
    return LoopFigures(
        float(curves.margin[at]), float(f[at]), float(largest), tuple(command_noise(curves, f).tolist())
    )  # fmt: skip


@dataclass(frozen=True)
class BedFigures:
    """Of b beds, each (b,): largest pole, least damping ratio, response errors to measured, unmeasured torques."""

    largest_pole: np.ndarray
    damping_ratio: np.ndarray
    measured: np.ndarray
    unmeasured: np.ndarray

    def stable(self, neutral: float = 1e-9) -> np.ndarray:
        """Which beds (b,) are stable; a rigid motion that nothing slows stands at 1."""
        return self.largest_pole < 1 + neutral


def bed_figures(beds: BedSet, controller: ObserverController, known: Sequence[str]) -> BedFigures:
    """Figures of every bed of a set."""
    acting = action(controller, beds.frequencies)
    size, ratio = damping(np.linalg.eigvals(closed_matrices(beds.sampled, controller)), controller.sample_time)
    measured, unmeasured = (np.sqrt(errors(beds, acting, those).mean(axis=1)) for those in (known, ()))
    return BedFigures(size, ratio, measured, unmeasured)


# --- A point of the search over an observer's weights: what was worked out there, and how it is judged.

MERIT = 10.0  # cost of a requirement missed by all of it, where ends are compared


@dataclass(frozen=True)
class Judged:
    """Cost of a point of the search, and how much of its requirements is left, relative; negative if missed.

    Attributes
    ----------
    cost : float
    room : ndarray (r,)
        Of every bed's damping, every dynamometer's noise, roll-off and margin at every frequency.
    least : ndarray (b + 3,)
        The same, of noise, roll-off and margin the worst alone.
    """

    cost: float
    room: np.ndarray
    least: np.ndarray

    @property
    def merit(self) -> float:
        """By which points are compared: the cost, and much for what is missed."""
        return self.cost + MERIT * float(np.maximum(-self.least, 0.0).sum())


@dataclass(frozen=True)
class DesignPoint:
    """What was worked out at a point: poles (b, x), errors (b + 1,) over the tolerance, of the bed as planned last."""

    controller: ObserverController
    acting: Action
    curves: LoopCurves
    poles: np.ndarray
    errors: np.ndarray


# --- Derivatives of an observer's gains with respect to the logarithms of its weights, exact; w weights.
#
# A Riccati equation differentiated at its solution is a Lyapunov equation with the matrix of its closed loop (implicit
# function theorem; Kao and Hennequin, arXiv:2011.11430): no further Riccati equation is solved.


def feedback_slopes(model: ObserverModel, made: Feedback, by_command: float, by_change: float) -> np.ndarray:
    """Of the state feedback's gains (2, k, x + fifo + e + w) by the weights on commands and on their changes.

    ``by_command``, ``by_change``: what a unit of each logarithm changes of the weight.
    """
    last, k = last_command(model), len(model.dynamometers)
    F, B, X, closed, on = made.F, made.B, made.X, made.closed, made.on
    # of Q, S and R together, seen along u = −F·x: a command costs FᵀF, its change (last + F)ᵀ(last + F)
    price = np.stack([by_command * F.T @ F, by_change * (last + F).T @ (last + F)])
    dX = summed(closed.T, closed, price)
    dR = np.array([by_command, by_change])[:, None, None] * np.eye(k)
    dS = np.stack([np.zeros_like(last), -by_change * last])
    dF = np.linalg.solve(made.weight, B.T @ dX @ closed + dS - dR @ F)
    bent = -np.swapaxes(B @ dF, 1, 2)  # of closedᵀ
    drive = bent @ (made.gradient @ on + X @ made.push) + closed.T @ dX @ made.push
    gradient = summed(closed.T, on, drive)
    of_torques = B.T @ (dX @ made.push + gradient @ on) - (B.T @ dX @ B + dR) @ made.of_torques
    return predicted(model, dF, np.linalg.solve(made.weight, of_torques))


def filter_slopes(
    model: ObserverModel, made: Filter, weights: Mapping[str, float], names: Sequence[str]
) -> np.ndarray:  # fmt: skip
    """Of the correction (w, n + e + v, y) by the logarithms of some of the filter's weights."""
    n, v, root = model.states, len(made.shared), model.sample_time
    decade = 2 * np.log(10)  # of a square by its root's decimal logarithm, over the square
    count, o, y = len(names), len(made.L), len(made.C)
    dQ, dR, across = np.zeros((count, o, o)), np.zeros((count, y, y)), np.zeros((count, v, n))
    for i, name in enumerate(names):
        square = decade * weights[name] ** 2
        dQ[i, n:, n:] = np.diag([square * root if drift == name else 0.0 for drift in model.drifts])
        if name in model.noises:
            columns = model.noises[name]
            dQ[i, :n, :n] = square / root * columns[:n] @ columns[:n].T
            across[i] = square / root * columns[n:] @ columns[:n].T
        trusts = np.array([TRUST[kind] == name for kind in model.readings.kinds])
        dR[i] = np.diag(np.where(trusts, square * model.readings.noise**2, 0.0))
    A, C, P, L, left = made.A, made.C, made.P, made.L, made.left
    on, gain = A @ left, A @ L
    dP = summed(on, on.T, dQ + gain @ dR @ gain.T)
    off = C @ dP @ C.T + dR
    dL = np.swapaxes(np.linalg.solve(made.innovation, C @ dP - off @ L.T), 1, 2)
    bent = -np.swapaxes(A @ dL @ C, 1, 2)  # of (A·left)ᵀ
    V = model.bed.whole[n:, n:]
    drive = made.from_rig @ (left @ dP - dL @ C @ P) @ A.T + V @ made.shared @ bent
    drive[:, :, :n] += across
    shared = summed(V, on.T, drive)
    of_vehicle = np.linalg.solve(made.innovation, C @ np.swapaxes(shared, 1, 2) - off @ made.of_vehicle.T)
    return np.concatenate([dL, np.swapaxes(of_vehicle, 1, 2)], axis=1)


# --- First derivatives of what a controller does on beds with respect to its gains, exact; w weights to be tuned.
#
# A change of the correction by dL adds dL·e to the corrected state, e being what a reading is off; a change of the
# feedback by dF adds −dF·ξ̂ to the command. What either makes of the commands follows from the controller as it is.

OFF_THE_POLE = 1e-9  # of |z|: an inverse iteration beside the eigenvalue finds its vectors in one step


@dataclass(frozen=True)
class GainSlopes:
    """What a unit of each weight changes of a controller's gains: feedback (w, k, o) and correction (w, o, y)."""

    feedback: np.ndarray
    correction: np.ndarray


@dataclass(frozen=True)
class ActionSlopes:
    """What a unit of each weight changes of an :class:`Action`: (w, f, k, y) and (w, f, k, known)."""

    of_readings: np.ndarray
    of_known: np.ndarray

    def at(self, part: slice) -> ActionSlopes:
        """The same at some of the frequencies."""
        return ActionSlopes(self.of_readings[:, part], self.of_known[:, part])


def action_slopes(
    controller: ObserverController, gains: GainSlopes, frequencies: np.ndarray, ahead: np.ndarray
) -> ActionSlopes:
    """Derivatives of :func:`~matching.match.beds.action` at (f,) Hz; ``ahead`` (f, m, w)."""
    o, y = controller.observed, len(controller.sensors)
    A, B, C, L = controller.A[:o, :o], controller.B[:o], controller.C[:, :o], controller.L[:o]
    F, feedback, space = controller.F[:, :o], controller.feedback, controller.space
    z = np.exp(2j * np.pi * frequencies * controller.sample_time)
    form = resolvent(feedback.A)
    left = form.rows(z, feedback.C)
    reaches = space.A[:o, o:] @ ahead + space.B[:o, y:]
    inputs = np.concatenate([np.broadcast_to(feedback.B, (len(z), *feedback.B.shape)), reaches], axis=2)
    predicted = form.columns(z, inputs)
    missed = -C @ predicted
    missed[:, :, :y] += np.eye(y)
    corrected = predicted + L @ missed
    m = ahead.shape[1] - ahead.shape[2]
    corrected[:, :m, y:] -= ahead[:, :m]  # the feedback acts on the difference to the model that runs ahead
    of_command = np.eye(len(F)) + left @ B
    of_state = left @ (A - B @ F) - F
    change = np.stack(
        [
            of_state @ correction @ missed - of_command @ feedback_change @ corrected
            for correction, feedback_change in zip(gains.correction, gains.feedback, strict=True)
        ]
    )
    return ActionSlopes(change[..., :y], change[..., y:])


def error_slopes(beds: BedSet, acting: Action, slopes: ActionSlopes, share: np.ndarray) -> np.ndarray:
    """Derivatives (w,) of Σ share·(response error to unmeasured torques)² over the beds, ``share`` (b,).

    With H the compared function, d|log(H/V)|² = 2·Re(conj(log(H/V))·dH/H).
    """
    driven = drive(beds, acting, ())
    difference = return_difference(beds, acting)
    commands = np.linalg.solve(difference, driven.commands)
    back = np.swapaxes(beds.commanded @ np.linalg.inv(difference), 2, 3)  # (b, f, k, c)
    sensors, inputs = compared_columns(beds.case)
    answers = (beds.commanded @ commands + driven.answered)[:, :, sensors, inputs]
    ratio = answers / beds.vehicle
    pull = np.zeros((*commands.shape[:2], back.shape[3], commands.shape[3]), complex)
    weight = 2 * share[:, None, None] / (ratio.shape[1] * ratio.shape[2])
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.nan_to_num(weight * np.log(ratio).conj() / answers)
    for h, (sensor, column) in enumerate(zip(sensors, inputs, strict=True)):
        pull[:, :, sensor, column] += part[:, :, h]
    at_command = back @ pull  # (b, f, k, i)
    readings = beds.held @ commands + driven.read  # (b, f, y, i)
    of_readings = (at_command @ np.swapaxes(readings, 2, 3)).sum(axis=0)
    slope = np.einsum("wfky,fky->w", slopes.of_readings, of_readings)
    at_known = at_command.sum(axis=0)
    for column, known in driven.known.items():
        slope = slope + np.einsum("wfk,fk->w", slopes.of_known[..., known], at_known[..., column])
    return slope.real


def pole_slopes(beds: SampledBeds, controller: ObserverController, gains: GainSlopes, poles: np.ndarray) -> np.ndarray:
    """Derivatives (weights, b) of one pole z (b,) of every bed's closed loop: dz = wᴴ·dA·v / wᴴ·v.

    v and w are its right and left eigenvector (Lancaster, Numerische Mathematik 6 (1964) 377).
    """
    closed = closed_matrices(beds, controller).astype(complex)
    size, x, o = closed.shape[1], beds.A.shape[1], controller.observed
    shifted = closed - (poles * (1 + OFF_THE_POLE))[:, None, None] * np.eye(size)
    start = np.broadcast_to(np.cos(np.arange(size))[:, None], (len(poles), size, 1))
    v = np.linalg.solve(shifted, start)
    w = np.linalg.solve(np.swapaxes(shifted, 1, 2), start)
    v, w = (part / np.linalg.norm(part, axis=1, keepdims=True) for part in (v, w))
    B, C, L, F = controller.B[:o], controller.C[:, :o], controller.L[:o], controller.F[:, :o]
    missed = beds.C @ v[:, :x] - C @ v[:, x:]
    corrected = v[:, x:] + L @ missed
    at_command = np.swapaxes(w[:, :x], 1, 2) @ beds.B + np.swapaxes(w[:, x:], 1, 2) @ B
    at_state = np.swapaxes(w[:, x:], 1, 2) @ controller.A[:o, :o] - at_command @ F
    both = np.swapaxes(w, 1, 2) @ v
    return np.stack(
        [
            ((at_state @ correction @ missed - at_command @ feedback @ corrected) / both)[:, 0, 0]
            for correction, feedback in zip(gains.correction, gains.feedback, strict=True)
        ]
    )


def loop_slopes(
    bed: Planned, curves: LoopCurves, slopes: ActionSlopes
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Derivatives of :class:`LoopCurves`: margin (w, f), closed (w, f), and of the command noise (w, k).

    A singular value changes by uᴴ·dM·v.
    """
    inverse = np.linalg.inv(curves.difference)
    change = -slopes.of_readings @ bed.every.held[0]
    left, _, right = np.linalg.svd(curves.difference)
    margin = np.einsum("fk,wfkl,fl->wf", left[:, :, -1].conj(), change, right[:, -1].conj()).real
    left, _, right = np.linalg.svd(inverse - np.eye(inverse.shape[-1]))
    closed = -np.einsum(
        "fk,wfkl,fl->wf", np.einsum("fk,fkl->fl", left[:, :, 0].conj(), inverse), change,
        np.einsum("fkl,fl->fk", inverse, right[:, 0].conj()),
    ).real  # fmt: skip
    noisy = inverse @ (slopes.of_readings * bed.uncertainty - change @ curves.noise)
    f = bed.every.frequencies
    power = 2 * (curves.noise.conj() * noisy).sum(axis=3).real  # (w, f, k)
    noise = np.einsum("f,wfk->wk", noise_weights(f), power) / (2 * command_noise(curves, f))
    return margin, closed, noise


# --- Softened

# Of stiffness and damping that is left, from a shaft that carries next to nothing to one that opens for moments. A
# lash that is crossed within a swing acts on the swing like a softer spring and damper, by the share of it that the
# flanks touch (describing function: Gelb and Vander Velde, Multiple-Input Describing Functions, 1968).
SHARES = (0.001, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7)


def softened(case: Case, values: Mapping[str, float], share: float) -> dict[str, float]:
    """Values (SI) of a bed by name, the shafts that its dynamometers follow with ``share`` of stiffness and damping."""
    known, made = case.rig.parameters, dict(values)
    for dynamometer in case.loop.dynamometers:
        for quantity in ("stiffness", "damping"):
            name = f"shafts.{dynamometer.follows}.{quantity}"
            if name in known:
                made[f"rig.{name}"] = share * values.get(f"rig.{name}", known[name].value)
    return made


def damping_left(share: float) -> float:
    """Part of a shaft's damping ratio that is left with ``share`` of its stiffness and damping: the root of it."""
    return float(np.sqrt(share))


def beds_at(case: Case, positions: np.ndarray, left: float = 1.0) -> SampledBeds:
    """Beds at positions (b, p) of the case's box, with ``left`` of the stiffness and damping of their cut shafts."""
    return sampled_beds(case, [softened(case, case.uncertainty.at(position), left) for position in positions])
