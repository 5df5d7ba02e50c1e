"""A controller that estimates unmeasured torques: its model, filter, state feedback, and how it steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, solve_discrete_are

from modelling.bed.bed import (
    BedModel,
    ControlLaw,
    ControlStructure,
    DelayedBed,
    Loop,
    LoopQuantity,
    bed_model,
    delayed_bed,
    predicted_part,
)
from modelling.bed.specimen import KnownPart, part_of, torques_of_rest
from modelling.bed.vehicle import ResidualVehicle
from modelling.errors import InputError, NoDesign
from modelling.linear.steady_motion import speeds_of, torques_of
from modelling.modal.modes import damped_modes
from modelling.system import Sensor, System

# --- What the design of the observer needs of rig, residual vehicle and loop, whatever its weights are.

NOISE = {"torque": 0.3, "speed": 0.08}  # N·m, rad/s of a sensor without uncertainty, as flanges and encoders have


def sensor_noise(sensor: Sensor, sample_time: float) -> float:
    """Standard deviation of a reading, SI.

    A speed that is counted is the difference of two angles, each rounded to a count, over the sample: a quantum is
    2π/counts/T, and the standard deviation is the quantum over √6, as both roundings are even over a count.
    """
    if sensor.counts is None:
        return sensor.uncertainty or NOISE[sensor.measures]
    quantum = 2 * np.pi / sensor.counts / sample_time
    return float(np.hypot(sensor.uncertainty or 0.0, quantum / np.sqrt(6.0)))


ALIKE = 0.01  # relative: rotors that differ by less are one kind of dynamometer
FORGETTING_PER_SAMPLE = 1e-5  # of an estimated or known torque: a random walk without it has no bounded variance
MODES = 2  # that a swinging torque is estimated for; each adds two states a dynamometer
SWING_DAMPING = 0.02  # ratio, of such a torque, at least: how far from the mode's frequency it may swing
OF_MODES_DAMPING = 0.4  # the same over the modes' damping: a third of it is what a loop is asked for, and this is in it
FASTEST_SWING_RAD = 0.5  # of such a torque, from sample to sample
SMALLEST_SHARE = 1e-3  # of a mode's energy in the cut shafts
# s over which the zero of a flange's torque moves by its uncertainty. Half shafts behind an open differential, and
# wheel motors, hold no difference of their rotors: an observer that takes a zero for a torque turns them against each
# other for ever. With the zero among what is estimated, the speeds hold that difference.
ZERO_TIME_S = 60.0


@dataclass(frozen=True)
class Readings:
    """What the controller measures: y torque sensors of the flanges, speeds of the dynamometers, then further sensors.

    Attributes
    ----------
    rows : ndarray (y, x)
        By state of rig and lags.
    noise : ndarray (y,)
        Standard deviation, SI.
    kinds : tuple of str
        ``torque``, ``speed`` (of the dynamometers) or ``further``.
    sensors : tuple of str
    """

    rows: np.ndarray
    noise: np.ndarray
    kinds: tuple[str, ...]
    sensors: tuple[str, ...]


@dataclass(frozen=True)
class ObserverModel:
    """The model from sample to sample; x states, of which the first ``states`` are of rig and lags.

    Attributes
    ----------
    bed : DelayedBed
        Its torques are [by state of the estimated ones (e); known ones (w)].
    states : int
    wandering : ndarray (e, e)
        The estimated torques' states from sample to sample: a torque that wanders at every input of the rig and at
        every rotor, and one that swings with an emulated mode at every rotor, two states each.
    drifts : tuple of str (e)
        The weight that states how fast each of these states wanders; empty of a flange's zero.
    zero_rates : ndarray (e,)
        How fast the zero of a flange's torque wanders, N·m/s^0.5; 0 of torques.
    of_zeros : ndarray (y, e)
        Readings by these states: the zeros of the flanges alone.
    noises : dict of str to ndarray (x, k)
        What torques without memory do, by the weight that states their size: at the rotors, in the cut shafts.
    sizes : ndarray (k,)
        Torques of each dynamometer over those of the mean one, see :func:`dynamometer_sizes`: the weights hold for the
        mean one, and count in proportion for the others. The columns of ``noises`` have this factor.
    drift_sizes : ndarray (e,)
        The same factor of every estimated torque's state; 1 of torques at the inputs of the rig.
    speed_error : ndarray (k, x)
        Speed of the rig less that of the residual vehicle at each cut, rad/s.
    readings : Readings
    known : tuple of str (w)
        The last ``remainders`` of them are no torques: what the residual vehicle's states (v) do beyond its linear
        model, which the controller computes itself.
    dynamometers : tuple of str (k)
    sample_time : float
        s.
    """

    bed: DelayedBed
    states: int
    wandering: np.ndarray
    drifts: tuple[str, ...]
    zero_rates: np.ndarray
    of_zeros: np.ndarray
    noises: dict[str, np.ndarray]
    speed_error: np.ndarray
    readings: Readings
    known: tuple[str, ...]
    dynamometers: tuple[str, ...]
    sample_time: float
    sizes: np.ndarray
    drift_sizes: np.ndarray
    remainders: int = 0

    @property
    def command_prices(self) -> np.ndarray:
        """Price (k, k) of a squared command of each dynamometer over that of the mean one."""
        return np.diag(self.sizes**-2)

    @property
    def torques_known(self) -> int:
        """How many of the known ones are torques: w − v."""
        return len(self.known) - self.remainders

    @property
    def estimated(self) -> int:
        """Number e of the estimated torques' states."""
        return len(self.wandering)

    @property
    def delayed_commands(self) -> slice:
        """Where the commands on their way stand among the states of the controller, newest first."""
        x = len(self.bed.whole)
        return slice(x, x + len(self.dynamometers) * (self.bed.delay + 1))


def observer_model(
    rig: System, residual: ResidualVehicle, loop: Loop, modes: Sequence[complex] | None = None,
    remainders: bool = False, model: BedModel | None = None,
) -> ObserverModel:  # fmt: skip
    """Put model, dead time and sensors together.

    Parameters
    ----------
    modes : sequence of complex, optional
        Eigenvalues, 1/s, that a torque at each rotor swings with; :func:`emulated_modes` unless given.
    remainders : bool
        Have the rates of the residual vehicle's states among what is known, see :mod:`modelling.bed.stepped`.
    model : BedModel, optional
        Of rig, lags and residual vehicle; :func:`modelling.bed.bed.bed_model` unless given.

    Raises
    ------
    InputError
        If a model cannot be made linear or a further sensor reads an angle or an acceleration.
    """
    model = bed_model(rig, residual, loop) if model is None else model
    part = predicted_part(rig, residual, loop)
    rig = part.system
    k, step = len(loop.dynamometers), loop["sample_time"]
    driven = {dynamometer.torque_input for dynamometer in loop.dynamometers}
    on_rig = [part.name for part in rig.inputs if part.name not in driven]
    known = tuple(name for name in model.measured if name in loop.measured or name not in on_rig)
    torques = pedal_torques(rig)
    columns = [part.ratios.get(name, 1.0) / torques.get(name, 1.0) * model.space.input(name) for name in on_rig]
    columns += [*model.rotor_torques.T, *model.shaft_torques.T]
    columns += [model.space.input(name) for name in known]
    size, first = len(model.space.A), model.rig_states + loop.lag_states
    further = np.eye(size)[:, first:] if remainders else np.zeros((size, 0))
    known = (*known, *(f"remainder {number}" for number in range(further.shape[1])))
    columns += [*further.T]
    bed = delayed_bed(model.space.A, model.space.B[:, :k], np.stack(columns, axis=1), loop.command_delays(), step)
    at_inputs, at_rotors, in_shafts, of_known = np.split(bed.torques, np.cumsum([len(on_rig), k, k]), axis=1)
    modes = emulated_modes(residual, step, part) if modes is None else tuple(modes)
    damping = max([SWING_DAMPING, *(-OF_MODES_DAMPING * mode.real / abs(mode) for mode in modes)])
    turns = [_turn(mode, step, damping) for mode in modes for _ in range(k)]
    swinging = np.zeros((len(at_rotors), 2 * len(turns)))
    swinging[:, ::2] = np.tile(at_rotors, len(turns) // k)
    stay = (1 - FORGETTING_PER_SAMPLE) * np.eye(len(on_rig) + k)
    drifts = ("torque_drift",) * len(on_rig) + ("dynamometer_drift",) * k + ("dynamometer_swing",) * 2 * len(turns)
    readings = _readings(model, rig, loop)
    flanges, others = readings.kinds.count("torque"), len(drifts)
    of_zeros = np.zeros((len(readings.kinds), others + flanges))
    of_zeros[:flanges, others:] = np.eye(flanges)
    rates = np.r_[np.zeros(others), readings.noise[:flanges] * np.sqrt(2 / ZERO_TIME_S)]
    zeros = np.zeros((len(at_rotors), flanges))
    sizes = dynamometer_sizes(rig, loop)
    of_drifts = np.r_[np.ones(len(on_rig)), sizes, np.repeat(np.tile(sizes, len(modes)), 2), np.ones(flanges)]
    return ObserverModel(
        replace(bed, torques=np.hstack([at_inputs, at_rotors, swinging, zeros, of_known])),
        model.rig_states + loop.lag_states,
        block_diag(stay, *turns, np.exp(-step / ZERO_TIME_S) * np.eye(flanges)), (*drifts, *("",) * flanges), rates,
        of_zeros, {"dynamometer_noise": at_rotors * sizes, "shaft_noise": in_shafts * sizes},
        np.pad(model.speed_error, ((0, 0), (0, len(bed.whole) - len(model.space.A)))),
        readings, known,
        tuple(dynamometer.name for dynamometer in loop.dynamometers), step, sizes, of_drifts,
        further.shape[1],
    )  # fmt: skip


def pedal_torques(rig: System) -> dict[str, float]:
    """By input of the rig that is a pedal: its torque, N·m, over the pedal about the operating point.

    Raises
    ------
    InputError
        If its map is level there: no pedal makes a torque.
    """
    if not rig.pedals:
        return {}
    speeds, held, on = speeds_of(rig), torques_of(rig), {part.name: part.on for part in rig.inputs}
    found = {name: own.slope(speeds[on[name]], held[name]) for name, own in rig.pedals.items()}
    for name, slope in found.items():
        if not slope:
            wrong = f"is level at a pedal of {held[name]:.3g} and {speeds[on[name]]:.4g} rad/s, the operating point"
            raise InputError(f"inputs.{name}: torque_map", wrong, "give the map another value there")
    return found


def dynamometer_sizes(rig: System, loop: Loop) -> np.ndarray:
    """Torque (k,) that noise of its speed sensor asks of each dynamometer, over the geometric mean of all.

    It grows with the inertia of the rotor. A machine in the engine's place is ten times lighter than one at a wheel:
    what wanders at it, and the price of its commands, are in proportion. All are 1 where the dynamometers are alike.
    """
    on, sensors = {part.name: part.on for part in rig.inputs}, {part.name: part for part in rig.sensors}
    inertia, step = {part.name: part.J.value for part in rig.inertias}, loop["sample_time"]
    torques = np.array([
        inertia[on[one.torque_input]] * sensor_noise(sensors[one.speed_sensor], step) for one in loop.dynamometers
    ])  # fmt: skip
    if np.ptp(torques) <= ALIKE * torques.max():
        return np.ones(len(torques))
    sizes: np.ndarray = torques / np.exp(np.mean(np.log(torques)))
    return sizes


def emulated_modes(residual: ResidualVehicle, step: float, part: KnownPart | None = None) -> tuple[complex, ...]:
    """Eigenvalues (1/s) of the vehicle's modes that a wrong torque of a dynamometer damps or excites most.

    A relative error of the torque at a cut changes a mode's damping ratio by up to the share of the mode's energy in
    the cut shaft, so what counts is this share over the damping ratio. At most :data:`MODES`, slow enough for the
    ``step`` (s) of the controller. Where only a ``part`` of the rig is known, of the vehicle without the rest.
    """
    vehicle = residual.vehicle
    if part is not None and part.torques:
        known = part.names | {one.name for system in residual.parts for one in system.inertias}
        vehicle = part_of(vehicle, known, torques_of_rest(vehicle, known))
    modes, cuts = damped_modes(vehicle), {f"shafts.{interface.shaft}" for interface in residual.interfaces}
    at = [i for i, name in enumerate(modes.springs) if name in cuts]
    share, value = modes.potential[:, at].sum(axis=1), modes.eigenvalues
    swings = (value.imag > 0) & (value.real < 0) & (value.imag * step < FASTEST_SWING_RAD) & (share > SMALLEST_SHARE)
    weight = np.where(swings, share / np.maximum(modes.damping_ratios, SMALLEST_SHARE), 0.0)
    ranked = np.argsort(-weight, kind="stable")[:MODES]
    return tuple(complex(value[i]) for i in sorted(ranked) if weight[i] > 0)


def _turn(mode: complex, step: float, damping: float) -> np.ndarray:
    """A torque that swings with a mode, from sample to sample: (2, 2), the first state is the torque."""
    angle = mode.imag * step
    c, s = np.cos(angle), np.sin(angle)
    return np.exp(-damping * angle) * np.array([[c, s], [-s, c]])


def _readings(model: BedModel, rig: System, loop: Loop) -> Readings:
    states = model.rig_states + loop.lag_states
    sensors = {part.name: part for part in rig.sensors}
    names = [f"{loop.dynamometers[j].name} torque" for j in loop.with_flange]
    names += [f"{dynamometer.name} speed" for dynamometer in loop.dynamometers] + list(loop.further_sensors)
    kinds = ["torque"] * len(loop.flanges) + ["speed"] * len(loop.dynamometers)
    kinds += ["further"] * len(loop.further_sensors)
    noise = []
    for name in loop.controller_sensors:
        if sensors[name].measures not in NOISE:
            raise InputError(
                "loop.measures", f"{name!r} measures an {sensors[name].measures}", "a speed or torque is needed"
            )
        noise.append(sensor_noise(sensors[name], loop["sample_time"]))
    rows = np.stack([model.space.output(name) for name in names])[:, :states]
    return Readings(rows, np.array(noise), tuple(kinds), loop.controller_sensors)


# --- Stabilising solutions of discrete Riccati equations, for feedback, feed-forward and filter alike.


def riccati(
    A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, S: np.ndarray | None = None, *, what: str
) -> np.ndarray:
    """The stabilising solution (x, x) of the equation for A, Q (x, x), B, S (x, u) and R (u, u).

    Parameters
    ----------
    what : str
        What it is for, as the error names it.

    Raises
    ------
    NoDesign
        If there is none.
    """
    try:
        X = solve_discrete_are(A, B, Q, R, s=S)
        across = np.zeros_like(B) if S is None else S
        # one step of Newton's method (Hewer, IEEE Trans. Autom. Control 16 (1971) 382) makes twelve digits of the six
        # that LAPACK gives: differences of designs need them
        F = np.linalg.solve(B.T @ X @ B + R, B.T @ X @ A + across.T)
        closed = A - B @ F
        return summed(closed.T, closed, Q - across @ F - F.T @ across.T + F.T @ R @ F)
    except (np.linalg.LinAlgError, ValueError) as fault:
        raise NoDesign(
            f"there is no stable {what} ({fault}); check that each dynamometer reaches its cut and what the sensors see"
        ) from None


# --- The Kalman filter of an observer: rig, lags, unmeasured torques, and what they say of the residual vehicle.

STATE_NOISE = 1e-12  # variance on every state of the rig, so that none counts as known exactly
DOUBLINGS = 40  # of the time over which a sum runs: 2⁴⁰ samples are for ever
# The weight that states how far the sensors of each kind are trusted.
TRUST = {"torque": "torque_sensor_noise", "speed": "rotor_speed_noise", "further": "further_sensor_noise"}


@dataclass(frozen=True)
class Filter:
    """What the filter's Riccati equation gives; o = n + e states of rig, lags and estimated torques.

    Attributes
    ----------
    L, of_vehicle : ndarray (o, y), (v, y)
        Correction of these states and of the residual vehicle for a reading off by one.
    A, C, P, innovation : ndarray (o, o), (y, o), (o, o), (y, y)
        The model, the covariance before a reading, and that of what a reading is off.
    from_rig, shared : ndarray (v, o), (v, o)
        What the states do to the residual vehicle, and its covariance with them.
    """

    L: np.ndarray
    of_vehicle: np.ndarray
    A: np.ndarray
    C: np.ndarray
    P: np.ndarray
    innovation: np.ndarray
    from_rig: np.ndarray
    shared: np.ndarray

    @property
    def correction(self) -> np.ndarray:
        """Of rig and lags, estimated torques and residual vehicle (o + v, y) for a reading off by one."""
        return np.vstack([self.L, self.of_vehicle])

    @property
    def left(self) -> np.ndarray:
        """What a reading leaves (o, o) of the states' error."""
        return np.eye(len(self.L)) - self.L @ self.C


def filter_of(model: ObserverModel, weights: Mapping[str, float]) -> Filter:
    """The stationary Kalman filter of a model.

    Parameters
    ----------
    model : ObserverModel
    weights : mapping of str to float
        By the names that the model's ``drifts``, ``noises`` and :data:`TRUST` have, in the units of
        :data:`modelling.bed.observer.QUANTITIES`.

    Raises
    ------
    NoDesign
        If the filter's Riccati equation has no stabilising solution.
    """
    bed, n, e, root = model.bed, model.states, model.estimated, np.sqrt(model.sample_time)
    push = bed.torques[:n, :e]
    A = np.block([[bed.whole[:n, :n], push], [np.zeros((e, n)), model.wandering]])
    C = np.hstack([model.readings.rows, model.of_zeros])
    drift = np.array([weights[name] if name else rate for name, rate in
                      zip(model.drifts, model.zero_rates, strict=True)]) * root  # fmt: skip
    drift = drift * model.drift_sizes
    white = np.hstack([columns * (weights[name] / root) for name, columns in model.noises.items()])
    Q = np.zeros((n + e, n + e))
    Q[:n, :n] = white[:n] @ white[:n].T + STATE_NOISE * np.eye(n)
    Q[n:, n:] = np.diag(drift**2)
    R = np.diag((model.readings.noise * [weights[TRUST[kind]] for kind in model.readings.kinds]) ** 2)
    P = riccati(A.T, C.T, Q, R, what="estimate of the rig's state")
    innovation = C @ P @ C.T + R
    L = np.linalg.solve(innovation, C @ P).T
    left = np.eye(n + e) - L @ C
    # covariance of the residual vehicle with rig and torques: M = V·M·(A·left)ᵀ + drive
    from_rig = np.hstack([bed.whole[n:, :n], bed.torques[n:, :e]])
    M = from_rig @ left @ P @ A.T
    M[:, :n] += white[n:] @ white[:n].T
    M = summed(bed.whole[n:, n:], (A @ left).T, M)
    return Filter(L, np.linalg.solve(innovation, C @ M.T).T, A, C, P, innovation, from_rig, M)


def summed(left: np.ndarray, right: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """The solution of M = left·M·right + drive (…, a, b), summed by doubling; left (a, a) or right has to decay."""
    M = drive
    for _ in range(DOUBLINGS):
        M, left, right = M + left @ M @ right, left @ left, right @ right
        if min(np.abs(left).max(), np.abs(right).max()) < 1e-20:
            break
    return M


# --- Design of the observer-based controller: Kalman filter, prediction across the dead time, optimal state feedback.
#
# The model is that of :mod:`modelling.bed.bed`, with a torque that wanders (a random walk) at every input of the
# rig and at every dynamometer's rotor: unmeasured torques are estimated from their effect. What a dynamometer gives
# wrong (gain, lag, dead time) swings with the emulated modes, so at every rotor a torque that swings with them is
# estimated as well, and predicted in phase across the dead time (internal model principle: Francis and Wonham,
# Automatica 12 (1976) 457). Noise in the cut shafts says that their torque is not the model's. The filter corrects rig,
# lags and these torques; the residual vehicle, whose rigid motion is not observable from the rig, is corrected by its
# covariance with their errors. Commands on their way are known, so the prediction across the dead time is exact
# (Kwakernaak and Sivan, Linear Optimal Control Systems, 1972). Such a loop has no margin of its own accord (Doyle, IEEE
# Trans. Autom. Control 23 (1978) 756): its weights are what a search over drawn beds has to set.

FREE_COMMAND_WEIGHT = 1e-12  # (rad/s per N·m)², of commands that known torques ask for: practically free
# A known torque is a sample of a continuous one. Over the sample that begins it counts with its value half a sample on,
# by the line through it and the last one, 1.5·w − 0.5·w(last): held as it is, it would come half a sample late.
NOW = 1.5
STATE_WEIGHT = 1e-14  # on every state, so that the Riccati equation sees also what the speed error does not show


def design(model: ObserverModel, weights: Mapping[str, float], ahead: Ahead | None = None) -> ControlLaw:
    """The controller for a model and weights, see :data:`modelling.bed.observer.QUANTITIES`.

    A model runs ahead on the known torques alone, with commands that are nearly free; the observer estimates what bed
    and vehicle really do, and its feedback, whose commands have the weights given, acts on the difference. So known
    torques do not depend on how hard the feedback may work. States [observer; model that runs ahead].

    Parameters
    ----------
    ahead : Ahead, optional
        The model that runs ahead, if it is there already: it does not depend on the weights.

    Raises
    ------
    NoDesign
        If a Riccati equation has no stabilising solution.
    """
    ahead = runs_ahead(model) if ahead is None else ahead
    F = state_feedback(model, weights["command_weight"], weights["command_change_weight"])
    return assembled(model, ahead, F, filter_of(model, weights).correction)


def assembled(model: ObserverModel, ahead: Ahead, F: np.ndarray, corrected: np.ndarray) -> ControlLaw:
    """The controller of a model that runs ahead, a state feedback F (k, …) and a correction (n + e + v, y).

    Known are the torques, then the remainders of the observer's residual vehicle, then those of the one that runs
    ahead.
    """
    A, B, W = _shifting(model)
    size, y, more, known = len(A), len(model.readings.rows), len(ahead.A), model.torques_known
    m = size - model.estimated
    L, C = np.vstack([laid_out(model, corrected), np.zeros((more, y))]), np.zeros((y, size + more))
    C[:, : model.states], C[:, m:size] = model.readings.rows, model.of_zeros
    whole = block_diag(A, ahead.A)
    whole[:size, size + m :] = (1 - NOW) * W[:, :known]
    difference = ahead.F.copy()
    difference[:, :m] -= F[:, :m]
    k, of_remainders = B.shape[1], F[:, size + known :]
    taken = np.block([
        [NOW * W[:, :known], W[:, known:], np.zeros((size, model.remainders))],
        [ahead.W[:, :known], np.zeros((more, model.remainders)), ahead.W[:, known:]],
    ])  # fmt: skip
    return ControlLaw(
        whole, np.zeros((size + more, y)), taken, np.vstack([B, np.zeros((more, k))]),
        -np.hstack([F[:, :size], difference]), np.zeros((k, y)),
        -np.hstack([ahead.G[:, :known], of_remainders, ahead.G[:, known:] - of_remainders]), L, C,
        model.readings.sensors, model.known[:known], model.dynamometers, model.sample_time, model.delayed_commands,
    )  # fmt: skip


def laid_out(model: ObserverModel, corrected: np.ndarray) -> np.ndarray:
    """A correction (n + e + v, y) by state of the observer (o, y): [rig, lags, vehicle; commands; torques]."""
    n, e = model.states, model.estimated
    commands = np.zeros((len(model.dynamometers) * (model.bed.delay + 1), corrected.shape[1]))
    return np.vstack([corrected[:n], corrected[n + e :], commands, corrected[n : n + e]])


@dataclass(frozen=True)
class Ahead:
    """The model that runs ahead on known torques: ξ⁺ = A·ξ + W·w, u = −F·ξ − G·w.

    Attributes
    ----------
    A, W, F, G : ndarray (m, m), (m, w), (k, m), (k, w)
        States [x; commands on their way, newest first; known torques of the last sample].
    """

    A: np.ndarray
    W: np.ndarray
    F: np.ndarray
    G: np.ndarray


def runs_ahead(model: ObserverModel, change: float = 0.0) -> Ahead:
    """The model that runs ahead; ``change`` ((rad/s per N·m)²) is the price of changes of its commands."""
    m, w = len(model.bed.whole) + len(model.dynamometers) * (model.bed.delay + 1), model.torques_known
    gains = state_feedback(model, FREE_COMMAND_WEIGHT, change)
    A, B, W = (part[:m] for part in _shifting(model))
    F, G = gains[:, :m], gains[:, m + model.estimated :]
    W = W - B @ G
    now = np.where(np.arange(len(model.known)) < w, NOW, 1.0)  # a remainder is computed when its sample begins
    return Ahead(
        np.block([[A[:, :m] - B @ F, (1 - NOW) * W[:, :w]], [np.zeros((w, m + w))]]),
        np.vstack([now * W, np.eye(w, len(model.known))]),
        np.hstack([F, (1 - NOW) * G[:, :w]]),
        now * G,
    )


def _arriving(model: ObserverModel) -> tuple[np.ndarray, np.ndarray]:
    """A, B of [x; commands of the last step] for commands as they arrive."""
    bed, k = model.bed, len(model.dynamometers)
    A = np.vstack([np.hstack([bed.whole, bed.old]), np.zeros((k, len(bed.whole) + k))])
    return A, np.vstack([bed.new, np.eye(k)])


def _shifting(model: ObserverModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, W of [x; commands on their way, newest first; estimated torques] for commands as they are issued."""
    bed, k, e = model.bed, len(model.dynamometers), model.estimated
    x, fifo = len(bed.whole), k * (bed.delay + 1)
    A, B = np.zeros((x + fifo + e,) * 2), np.zeros((x + fifo + e, k))
    A[:x, :x] = bed.whole
    if bed.delay:
        A[:x, x + fifo - 2 * k : x + fifo - k] = bed.new
    else:
        B[:x] = bed.new
    A[:x, x + fifo - k : x + fifo] = bed.old
    A[:x, x + fifo :] = bed.torques[:, :e]
    A[x + k : x + fifo, x : x + fifo - k] = np.eye(fifo - k)
    B[x : x + k] = np.eye(k)
    A[x + fifo :, x + fifo :] = model.wandering
    W = np.vstack([bed.torques[:, e:], np.zeros((fifo + e, len(model.known)))])
    return A, B, W


@dataclass(frozen=True)
class Feedback:
    """What the state feedback's Riccati equation gives, on [x; commands of the last step].

    Attributes
    ----------
    F, of_torques : ndarray (k, x + k), (k, e + w)
        Gains, the latter on torques that go on as they do by themselves.
    B, X, weight, closed : ndarray (x + k, k), (x + k, x + k), (k, k), (x + k, x + k)
        Of the commands, the equation's solution, BᵀXB + R, and A − B·F.
    push, gradient, on : ndarray (x + k, e + w), (x + k, e + w), (e + w, e + w)
        What torques do, what they add to the cost's gradient, and how they go on.
    """

    F: np.ndarray
    of_torques: np.ndarray
    B: np.ndarray
    X: np.ndarray
    weight: np.ndarray
    closed: np.ndarray
    push: np.ndarray
    gradient: np.ndarray
    on: np.ndarray


def feedback_on_all(model: ObserverModel, command_weight: float, change: float) -> Feedback:
    """Gains on all that is known when the commands arrive.

    Minimises the squared speed errors at the cuts, the squared commands and their squared changes. Torques stay out
    of the Riccati equation: what they add to the cost's gradient solves a linear equation.

    Raises
    ------
    NoDesign
        If the design's Riccati equation has no stabilising solution.
    """
    A, B = _arriving(model)
    k, x = len(model.dynamometers), len(model.bed.whole)
    E = np.hstack([model.speed_error, np.zeros((k, k))])
    last = last_command(model)
    price = model.command_prices
    Q = E.T @ E + STATE_WEIGHT * np.eye(x + k) + change * last.T @ price @ last
    R, S = (command_weight + change) * price, -change * last.T @ price
    X = riccati(A, B, Q, R, S, what="command that makes the rig follow the vehicle")
    weight = B.T @ X @ B + R
    F = np.linalg.solve(weight, B.T @ X @ A + S.T)
    on, closed = _torques_on(model), A - B @ F
    push = np.vstack([model.bed.torques, np.zeros((k, model.bed.torques.shape[1]))])
    gradient = summed(closed.T, on, closed.T @ X @ push)
    of_torques = np.linalg.solve(weight, B.T @ (X @ push + gradient @ on))
    return Feedback(F, of_torques, B, X, weight, closed, push, gradient, on)


def last_command(model: ObserverModel) -> np.ndarray:
    """The commands of the last step (k, x + k) by state [x; commands of the last step]."""
    k, x = len(model.dynamometers), len(model.bed.whole)
    return np.hstack([np.zeros((k, x)), np.eye(k)])


def _torques_on(model: ObserverModel) -> np.ndarray:
    """Estimated and known torques from sample to sample (e + w, e + w)."""
    return block_diag(model.wandering, (1 - FORGETTING_PER_SAMPLE) * np.eye(len(model.known)))


def state_feedback(model: ObserverModel, command_weight: float, change: float) -> np.ndarray:
    """Gains (k, x + fifo + e + w) on what is known now, the state predicted across the dead time.

    Raises
    ------
    NoDesign
        If the design's Riccati equation has no stabilising solution.
    """
    made = feedback_on_all(model, command_weight, change)
    return predicted(model, made.F, made.of_torques)


def predicted(model: ObserverModel, feedback: np.ndarray, of_torques: np.ndarray) -> np.ndarray:
    """Gains (…, k, x + fifo + e + w) on what is known now, of those on what is known when the commands arrive.

    ``feedback`` (…, k, x + k) is on [x; commands of the last step], ``of_torques`` (…, k, e + w), N·m per N·m, on the
    torques.
    """
    bed, k, x = model.bed, len(model.dynamometers), len(model.bed.whole)
    fifo, step, on = k * (bed.delay + 1), _torques_on(model), np.eye(bed.torques.shape[1])
    now = np.zeros((x, x + fifo + bed.torques.shape[1]))
    now[:, :x] = np.eye(x)
    for j in range(bed.delay):  # commands of delay − j and delay − j + 1 samples ago arrive
        ahead = bed.whole @ now
        newest = x + k * (bed.delay - j - 1)
        ahead[:, newest : newest + k] += bed.new
        ahead[:, newest + k : newest + 2 * k] += bed.old
        ahead[:, x + fifo :] += bed.torques @ on
        now, on = ahead, step @ on
    last = np.zeros((k, now.shape[1]))
    last[:, x : x + k] = np.eye(k)
    gains: np.ndarray = feedback @ np.vstack([now, last])
    gains[..., x + fifo :] += of_torques @ on
    return gains


# --- How the gains change with the weights. A Riccati equation differentiated at its solution is a Lyapunov equation
# with the matrix of its closed loop (implicit function theorem: Kao and Hennequin, arXiv:2011.11430).

BY_DECADE = float(np.log(10))  # of a weight, over the weight


def feedback_slopes(model: ObserverModel, made: Feedback, command_weight: float, change: float) -> np.ndarray:
    """Of the state feedback's gains (2, k, x + fifo + e + w) by a decade of each of its weights."""
    last = last_command(model)
    by_command, by_change = BY_DECADE * command_weight, BY_DECADE * change
    F, B, X, closed, on = made.F, made.B, made.X, made.closed, made.on
    # Q, S and R together, seen along u = −F·x: a command costs FᵀPF, its change (last + F)ᵀP(last + F)
    P = model.command_prices
    price = np.stack([by_command * F.T @ P @ F, by_change * (last + F).T @ P @ (last + F)])
    dX = summed(closed.T, closed, price)
    dR = np.array([by_command, by_change])[:, None, None] * P
    dS = np.stack([np.zeros_like(last), -by_change * P @ last])
    dF = np.linalg.solve(made.weight, B.T @ dX @ closed + dS - dR @ F)
    bent = -np.swapaxes(B @ dF, 1, 2)  # of closedᵀ
    gradient = summed(closed.T, on, bent @ (made.gradient @ on + X @ made.push) + closed.T @ dX @ made.push)
    of_torques = B.T @ (dX @ made.push + gradient @ on) - (B.T @ dX @ B + dR) @ made.of_torques
    return predicted(model, dF, np.linalg.solve(made.weight, of_torques))


def filter_slopes(
    model: ObserverModel, made: Filter, weights: Mapping[str, float], names: Sequence[str]
) -> np.ndarray:  # fmt: skip
    """Of the correction (w, n + e + v, y) by a decade of each of some weights (w) of the filter, given by name."""
    n, v, root = model.states, len(made.shared), model.sample_time
    count, o, y = len(names), len(made.L), len(made.C)
    dQ, dR, across = np.zeros((count, o, o)), np.zeros((count, y, y)), np.zeros((count, v, n))
    for i, name in enumerate(names):
        square = 2 * BY_DECADE * weights[name] ** 2
        wanders = np.array([square * root if drift == name else 0.0 for drift in model.drifts])
        dQ[i, n:, n:] = np.diag(wanders * model.drift_sizes**2)
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


# --- Observer, prediction across the dead time and state feedback in one controller, for measured and unmeasured
# torques.
#
# What it measures: the dynamometers' torques and speeds, further sensors (``loop.measures``) and torques that are
# measured or demanded (``loop.knows``). Unmeasured torques it estimates. Its weights, :data:`QUANTITIES`, are no
# physical values: a search over drawn beds sets them.

# Starts: tuned over drawn beds for the reference drive at 3 ms of dead time, opened cut shafts among them.
QUANTITIES = {
    "torque_drift": LoopQuantity("N*m/s^0.5", 155.0, 1e-4, 1e6, "how fast an unmeasured torque at an input may wander"),
    "dynamometer_drift": LoopQuantity("N*m/s^0.5", 17.0, 1e-4, 1e6, "how fast a torque at a rotor may wander"),
    "dynamometer_swing": LoopQuantity(
        "N*m/s^0.5", 3.8, 1e-4, 1e6, "how fast a torque at a rotor may wander that swings with an emulated mode"
    ),
    "dynamometer_noise": LoopQuantity("N*m*s^0.5", 0.004, 1e-6, 1e4, "noise of the torque at a rotor"),
    "shaft_noise": LoopQuantity("N*m*s^0.5", 0.078, 1e-6, 1e4, "noise of the torque in a shaft at a cut"),
    "command_weight": LoopQuantity("(rad/s/(N*m))^2", 3.6e-12, 1e-18, 1.0, "weight on a squared command"),
    "command_change_weight": LoopQuantity(
        "(rad/s/(N*m))^2", 1.6e-6, 1e-14, 1.0, "weight on the squared change of a command from sample to sample"
    ),
    "torque_sensor_noise": LoopQuantity("1", 0.14, 1e-3, 1e3, "noise of a flange torque over the sensor's uncertainty"),
    "rotor_speed_noise": LoopQuantity("1", 0.32, 1e-3, 1e3, "noise of a rotor speed over the sensor's uncertainty"),
    "further_sensor_noise": LoopQuantity("1", 0.76, 1e-3, 1e3, "noise of any other sensor over its uncertainty"),
}

# Where else a search may begin: tuned for the same drive at 5 ms; and, at 3 and 8 ms, with no torque that swings and no
# noise in the cut shafts, which other drives may be nearer to.
WITHOUT_SWING = {"dynamometer_swing": 1e-4, "shaft_noise": 1e-6}
FURTHER_STARTS = (
    {
        "torque_drift": 85.0, "dynamometer_drift": 5.0, "dynamometer_swing": 0.26, "dynamometer_noise": 0.0015,
        "shaft_noise": 0.011, "command_weight": 3.6e-12, "command_change_weight": 4.2e-7,
        "torque_sensor_noise": 0.04, "rotor_speed_noise": 0.09, "further_sensor_noise": 0.17,
    },
    {
        "torque_drift": 19.0, "dynamometer_drift": 11.0, "dynamometer_noise": 0.096, "command_weight": 3.6e-12,
        "command_change_weight": 1.2e-7, "torque_sensor_noise": 1.6, "rotor_speed_noise": 0.24,
        "further_sensor_noise": 0.072, **WITHOUT_SWING,
    },
    {
        "torque_drift": 10.0, "dynamometer_drift": 2.8, "dynamometer_noise": 0.27, "command_weight": 7.6e-12,
        "command_change_weight": 6.2e-8, "torque_sensor_noise": 0.95, "rotor_speed_noise": 0.27,
        "further_sensor_noise": 0.035, **WITHOUT_SWING,
    },
)  # fmt: skip

# The drive they were tuned for: kg·m² of a rotor, rad/s of its speed sensor's uncertainty, s of the sample time.
TUNED_FOR = {"inertia": 0.895, "speed_noise": 0.0836, "sample_time": 0.001}


def scaled_starts(rig: System, loop: Loop) -> tuple[dict[str, float], ...]:
    """Weights where a search may begin, scaled by the bed.

    A torque that noise of a speed sensor asks for grows with the rotor's inertia and with that noise; a speed error for
    which a command is worth its price falls with the inertia, and with the sample over which the command is held.
    """
    sensors, inputs = {part.name: part for part in rig.sensors}, {part.name: part for part in rig.inputs}
    inertia = np.exp(np.mean([
        np.log(rig.parameters[f"inertias.{inputs[one.torque_input].on}.J"].value) for one in loop.dynamometers
    ]))  # fmt: skip
    noise = np.exp(np.mean([
        np.log(sensor_noise(sensors[one.speed_sensor], loop["sample_time"])) for one in loop.dynamometers
    ]))  # fmt: skip
    torque = float(inertia * noise / (TUNED_FOR["inertia"] * TUNED_FOR["speed_noise"]))
    light = float((TUNED_FOR["inertia"] / inertia) ** 2)
    sample = (TUNED_FOR["sample_time"] / loop["sample_time"]) ** 2
    factors = {"command_weight": light, "command_change_weight": light * sample}
    factors |= {name: torque for name, known in QUANTITIES.items() if known.unit.startswith("N*m")}
    own = {name: known.start for name, known in QUANTITIES.items()}
    return tuple(
        {
            name: float(np.clip(factors.get(name, 1.0) * value, QUANTITIES[name].lower, QUANTITIES[name].upper))
            for name, value in start.items()
        }
        for start in (own, *FURTHER_STARTS)
    )


@dataclass(frozen=True)
class Observer(ControlStructure):
    """Kalman filter, prediction and state feedback."""

    name = "observer"
    quantities = QUANTITIES
    is_observer = True

    def starts(self, rig: System, loop: Loop) -> tuple[dict[str, float], ...]:
        """See :func:`scaled_starts`."""
        return scaled_starts(rig, loop)

    def gives_torque(self, values: Mapping[str, float]) -> bool:
        """Always."""
        return True

    def measured_inputs(self, measured: Sequence[str], simulated: Sequence[str]) -> tuple[str, ...]:
        """All that are measured, and what acts inside the residual vehicle."""
        return (*measured, *simulated)

    def observer(self, rig: System, residual: ResidualVehicle, loop: Loop) -> ControlLaw | None:
        """See :meth:`ControlStructure.observer`."""
        return design(observer_model(rig, residual, loop), loop.values)
