"""The loop as it runs: rig with lags, delay line and sampled controller, of one bed or of many."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from matching.match.box import of_system
from matching.match.case import Case
from matching.match.damping import asked_damping
from matching.match.requirements import Requirements
from modelling.bed.bed import ControlLaw, DelayedBed, Dynamometer, Loop, bed_model, delayed_beds
from modelling.bed.vehicle import FeedForward, Interface, cut
from modelling.controller.law import law_of_feed_forward, law_of_feedback
from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.linear.elements import elements
from modelling.linear.linearise import deflated, linearise
from modelling.linear.resolvent import Resolvent, resolvent, resolvents, transfer
from modelling.linear.state_space import StateSpace, state_spaces
from modelling.modal.modes import images
from modelling.resources import threads
from modelling.system import Sensor, System
from modelling.topology import joints, side

# --- A linear system with what its states mean in inertias and shafts.


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
    """Linearise a system about its operating point, without one at rest with lash just closed."""
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


# --- A case as linear models: rig, residual vehicle, and who measures and drives what.


@dataclass(frozen=True)
class LinearBed:
    """Rig and residual vehicle of a case as bodies, with who measures and drives what.

    Attributes
    ----------
    case : Case
    rig : Body
        With further sensors: every shaft's torque and the interfaces' speeds, see :func:`shaft_torque` and
        :func:`interface_speed`.
    residual : tuple of Body
        The tuned residual vehicle, part by part.
    cuts : tuple of Interface
        The cut each dynamometer follows.
    torque_signs : ndarray (k,)
        Torque that drives the rotor for a flange reading of 1 N·m; without a flange, for 1 N·m in the cut shaft.
    simulated : tuple of str
        Inputs that act inside the residual vehicle.
    free : Body
        The rig before anything was tuned, sensors as ``rig``: what the matched one is compared with.
    variant : mapping of str to float
        Values, SI, in which lags, dead time and gains of the bed are not the case's.
    """

    case: Case
    rig: Body
    residual: tuple[Body, ...]
    cuts: tuple[Interface, ...]
    torque_signs: np.ndarray
    simulated: tuple[str, ...]
    free: Body
    variant: Mapping[str, float] = field(default_factory=dict)

    @property
    def dynamometers(self) -> tuple[Dynamometer, ...]:
        """The dynamometers of the case, k of them."""
        return self.case.loop.dynamometers

    @property
    def drives(self) -> tuple[str, ...]:
        """Inputs of the rig that are no dynamometer's."""
        driven = {dyno.torque_input for dyno in self.dynamometers}
        return tuple(name for name in self.rig.space.inputs if name not in driven)

    @property
    def measured(self) -> tuple[str, ...]:
        """Inputs whose torque the feed-forward takes as measured: none in the structure ``pi``."""
        loop = self.case.loop
        on_rig = [name for name in self.drives if name in loop.measured]
        return loop.structure.measured_inputs(on_rig, self.simulated)

    @cached_property
    def bed(self) -> Bed:
        """Rig with inverter and torque-sensor lags."""
        return assembled_bed(self.case, self.rig.space, self.variant)

    @cached_property
    def residual_space(self) -> StateSpace:
        """All of the residual vehicle: inputs [interface torques (k), :attr:`simulated`], outputs reference speeds."""
        A = block_diag(*(part.space.A for part in self.residual))
        sources = [*(cut.torque for cut in self.cuts), *self.simulated]
        B, C = np.zeros((len(A), len(sources))), np.zeros((len(self.cuts), len(A)))
        starts = np.cumsum([0, *(len(part.space.A) for part in self.residual)])
        for part, a, b in zip(self.residual, starts[:-1], starts[1:], strict=True):
            for i, name in enumerate(sources):
                if name in part.space.inputs:
                    B[a:b, i] = part.space.input(name)
            for j, cut in enumerate(self.cuts):
                if cut.speed in part.space.outputs:
                    C[j, a:b] = part.space.output(cut.speed)
        speeds = tuple(cut.speed for cut in self.cuts)
        return StateSpace(A, B, C, np.zeros((len(C), len(sources))), tuple(sources), speeds)

    @cached_property
    def sampled_feedback(self) -> StateSpace:
        """The feedback law as it runs, from sample to sample, see :meth:`ControlStructure.sampled`."""
        return self.case.loop.structure.sampled(self.case.loop, self.residual_space, self.case.rig)


def linear_bed(case: Case, rig: System | None = None, untuned: System | None = None) -> LinearBed:
    """Take a case apart.

    ``rig`` stands in for the case's where the true rig is another; ``untuned`` is the rig before it was tuned, ``rig``
    unless given.
    """
    residual = case.residual_vehicle
    cuts = tuple(
        next(cut for cut in residual.interfaces if cut.shaft == dyno.follows) for dyno in case.loop.dynamometers
    )
    rig = case.rig if rig is None else rig
    bodies = tuple(body(part) for part in residual.parts)
    taken = {cut.torque for cut in residual.interfaces}
    simulated = tuple(name for part in bodies for name in part.space.inputs if name not in taken)
    torque_signs = np.array([
        cut.factor if dyno.torque_sensor is None else torque_sign(rig, dyno)
        for dyno, cut in zip(case.loop.dynamometers, cuts, strict=True)
    ])  # fmt: skip
    rig_body = body(watched(rig, cuts, rig_side=True))
    free = rig_body if untuned is None else body(watched(untuned, cuts, rig_side=True))
    return LinearBed(case, rig_body, bodies, cuts, torque_signs, simulated, free)


def variant_of(case: Case, values: Mapping[str, float]) -> LinearBed:
    """The bed with some values (:class:`matching.match.box.Uncertain`) other than the case's, SI, taken apart."""
    known = {name.removeprefix("rig."): value for name, value in values.items() if name.startswith("rig.")}
    return replace(linear_bed(case, rig=case.rig.with_values(known)), variant=values)


def watched(system: System, cuts: tuple[Interface, ...], *, rig_side: bool) -> System:
    """The system with sensors of every shaft's torque and of the speeds at the cuts, on the rig's side or beyond."""
    more = [Sensor(shaft_torque(shaft.name), "torque", shaft.name) for shaft in system.shafts]
    more += [Sensor(interface_speed(cut.shaft), "speed", cut.rig_end if rig_side else cut.vehicle_end) for cut in cuts]
    return replace(system, sensors=(*system.sensors, *more))


def shaft_torque(shaft: str) -> str:
    """Name of the added sensor of a shaft's torque."""
    return f"verified_torque_{shaft}"


def interface_speed(shaft: str) -> str:
    """Name of the added sensor of the speed at a cut."""
    return f"verified_speed_{shaft}"


def torque_sign(rig: System, dyno: Dynamometer) -> float:
    """+1 where the rotor hangs on the second end of the measured flange, −1/ratio where on the first."""
    flange = next(
        shaft
        for shaft in rig.shafts
        for sensor in rig.sensors
        if sensor.name == dyno.torque_sensor and sensor.of == shaft.name
    )
    rotor = next(torque.on for torque in rig.inputs if torque.name == dyno.torque_input)
    beyond = side(flange.between[1], joints(rig, without=(f"shafts.{flange.name}",)))
    if rotor in beyond:
        return 1.0
    return -1.0 if flange.ratio is None else -1 / flange.ratio.value


# --- One variant of the bed with its lags and its dead time: what a sampled controller acts on.


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
    delay : ndarray (k,)
        s, from a sample to the moment its command begins to act.
    sampled : DelayedBed
    own_modes : ndarray (m,)
        Modes of the rig without control, 1/s, upper half plane.
    open_loop_damping : float
        Least damping ratio of these, where the loop has to have rolled off.
    """

    A: np.ndarray
    commands: np.ndarray
    torques: np.ndarray
    readings: np.ndarray
    compared: np.ndarray
    compared_torques: np.ndarray
    delay: np.ndarray
    sampled: DelayedBed
    own_modes: np.ndarray
    open_loop_damping: float


def disturbing(case: Case) -> list[str]:
    """Inputs of the rig that are no dynamometer's."""
    driven = {dynamometer.torque_input for dynamometer in case.loop.dynamometers}
    return [part.name for part in case.rig.inputs if part.name not in driven]


def compared_sensors(case: Case) -> list[str]:
    """Sensors of the compared functions, each once."""
    return list(dict.fromkeys(pair.sensor for pair in case.compared))


def bed_of(case: Case, values: Mapping[str, float]) -> Bed:
    """The bed with some values (:class:`matching.match.box.Uncertain`) other than the case's, SI."""
    return beds_of(case, [values])[0]


def beds_of(case: Case, values: Sequence[Mapping[str, float]]) -> list[Bed]:
    """:func:`bed_of` for many sets of values, worked out together."""
    of_rig = [
        {name.removeprefix("rig."): value for name, value in one.items() if name.startswith("rig.")} for one in values
    ]
    return assembled_beds(case, state_spaces(case.rig, of_rig), values) if of_rig else []


def assembled_bed(case: Case, rig: StateSpace, values: Mapping[str, float]) -> Bed:
    """The bed of a linear rig, lags, dead time and gains from ``values`` or the case."""
    return assembled_beds(case, [rig], [values])[0]


def assembled_beds(case: Case, rigs: Sequence[StateSpace], values: Sequence[Mapping[str, float]]) -> list[Bed]:
    """:func:`assembled_bed` of linear rigs (b) that differ in their values alone."""
    loop, space = case.loop, rigs[0]
    A, B, C, D = (np.stack([getattr(rig, name) for rig in rigs]) for name in "ABCD")
    n = A.shape[1]
    own_modes = np.linalg.eigvals(A).astype(complex)
    A, commands, readings = with_hardware(
        loop, A, lambda name: B[:, :, space.inputs.index(name)], lambda name: C[:, space.outputs.index(name)], values
    )  # fmt: skip
    delays = np.stack([loop.command_delays(one.get("loop.dead_time")) for one in values])
    torques = np.zeros((*A.shape[:2], len(disturbing(case))))
    rows = [space.outputs.index(name) for name in compared_sensors(case)]
    columns = [space.inputs.index(name) for name in disturbing(case)]
    torques[:, :n] = B[:, :, columns]
    compared = np.concatenate([C[:, rows], np.zeros((len(rigs), len(rows), loop.lag_states))], axis=2)
    at_once = D[:, rows][:, :, columns]
    beds = []
    sampled = delayed_beds(A, commands, torques, delays, loop["sample_time"])
    for i, modes in enumerate(own_modes):
        own = modes[modes.imag > 0]
        fast = least_damping(own, 2 * np.pi * case.limits["rolled_off_from"])
        beds.append(
            Bed(A[i], commands[i], torques[i], readings[i], compared[i], at_once[i], delays[i], sampled[i], own, fast)
        )
    return beds


def with_hardware(
    loop: Loop, A: np.ndarray, column: Callable[[str], np.ndarray], row: Callable[[str], np.ndarray],
    values: Sequence[Mapping[str, float]],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Mechanical systems A (b, n, n) with inverters and flanges: A, commands, readings of :class:`Bed`, each with b.

    ``column`` and ``row`` give what an input does and what a sensor reads, (b, n) by name. The states of inverters (k)
    and of flanges (f) follow the system's.
    """
    lag, sensor_lag = (
        np.stack([loop.lags(name, one.get(f"loop.{name}")) for one in values])
        for name in ("inverter_lag", "torque_sensor_lag")
    )  # (b, k)
    count, n, k = len(A), A.shape[1], len(loop.dynamometers)
    size = n + k + len(loop.with_flange)
    whole, commands = np.zeros((count, size, size)), np.zeros((count, size, k))
    readings = np.zeros((count, len(loop.controller_sensors), size))
    whole[:, :n, :n] = A
    for i, name in enumerate(loop.controller_sensors):
        readings[:, i, :n] = row(name)
    for i, j in enumerate(loop.with_flange):
        whole[:, n + k + i, :n] = readings[:, i, :n] / sensor_lag[:, j, None]
        whole[:, n + k + i, n + k + i] = -1 / sensor_lag[:, j]
        readings[:, i] = np.eye(1, size, n + k + i)
    for j, dynamometer in enumerate(loop.dynamometers):
        gain = np.array([one.get(f"dynamometers.{dynamometer.name}.torque_gain", 1.0) for one in values])
        whole[:, :n, n + j] = gain[:, None] * column(dynamometer.torque_input)
        whole[:, n + j, n + j] = -1 / lag[:, j]
        commands[:, n + j, j] = 1 / lag[:, j]
    gains = [[one.get(f"sensors.{name}.gain", 1.0) for name in loop.controller_sensors] for one in values]
    return whole, commands, readings * np.array(gains)[:, :, None]


def least_damping(modes: np.ndarray, from_rad_s: float) -> float:
    """Least damping ratio of modes (m,), 1/s, from so many rad/s on; 1 without any."""
    fast = modes[np.abs(modes) >= from_rad_s]
    return float(np.min(-fast.real / np.abs(fast), initial=1.0))


def vehicle_response(case: Case, values: Mapping[str, float], frequencies: np.ndarray) -> np.ndarray:
    """Compared functions (f, h) of the vehicle whose shared components have the bed's values."""
    return vehicle_responses(case, [values], frequencies)[0]


def vehicle_responses(case: Case, values: Sequence[Mapping[str, float]], frequencies: np.ndarray) -> np.ndarray:
    """Compared functions (b, f, h) of the vehicle whose shared components have the values of beds (b)."""
    spaces = state_spaces(case.vehicle, [of_system(one, case.vehicle) for one in values])
    A, B, C, D = (np.stack([getattr(space, name) for space in spaces]) for name in "ABCD")
    rows = [spaces[0].outputs.index(pair.sensor) for pair in case.compared]
    columns = [spaces[0].inputs.index(pair.input) for pair in case.compared]
    read, driven = sorted(set(rows)), sorted(set(columns))
    states = resolvents(A).columns(2j * np.pi * frequencies, B[:, :, driven])
    H = C[:, None, read] @ states + D[:, None, read][..., driven]
    return H[:, :, [read.index(row) for row in rows], [driven.index(column) for column in columns]]


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


# --- Sampled controllers on beds: poles, damping, responses, all beds of a set at once; b beds, f frequencies.


NO_MODE = complex(-1e9, 0.0)  # in the place of a mode that swings


@dataclass(frozen=True)
class SampledBeds:
    """Beds from sample to sample, their matrices side by side; the states end with the commands on their way.

    Attributes
    ----------
    A, B, C : ndarray (b, x, x), (b, x, k), (b, y, x)
        Commands on their way stand newest first.
    torques : ndarray (b, x, d)
        What torques at the rig, held over a sample, do.
    states : int
        Of a bed itself, and of commands that have to wait longer than others, which the commands on their way follow.
    own_modes : ndarray (b, m)
        Each bed's own modes, without control, 1/s; :data:`NO_MODE` where it has fewer than others.
    open_loop_damping : ndarray (b,)
        Least damping ratio of each bed's own modes, without control, where the loop has to have rolled off.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    torques: np.ndarray
    states: int
    own_modes: np.ndarray
    open_loop_damping: np.ndarray

    def some(self, which: np.ndarray) -> SampledBeds:
        """The beds of these numbers (n,)."""
        A, B, C, torques = (part[which] for part in (self.A, self.B, self.C, self.torques))
        return SampledBeds(
            A, B, C, torques, self.states, self.own_modes[which], self.open_loop_damping[which]
        )  # fmt: skip

    def asked_damping(self, z: np.ndarray, step: float, required: Requirements, reserve: float = 1.0) -> np.ndarray:
        """Damping ratios (b, x) that modes of poles (b, x) are asked for, see :func:`matching.match.damping`."""
        return asked_damping(z, step, required, self.own_modes, self.open_loop_damping, reserve)


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

    def at(self, part: slice) -> BedSet:
        """The same at some of the frequencies."""
        names = ("held", "read", "answered", "commanded", "vehicle")
        parts = {name: getattr(self, name)[:, part] for name in names}
        return replace(self, frequencies=self.frequencies[part], **parts)


def sampled_beds(case: Case, values: Sequence[Mapping[str, float]]) -> SampledBeds:
    """Beds with these values (SI, by name; :func:`bed_of`)."""
    return side_by_side(beds_of(case, values))


def side_by_side(beds: Sequence[Bed]) -> SampledBeds:
    """Sampled beds as one batch, each with as many delayed commands as the bed with the longest dead time has."""
    longest = max(bed.sampled.delay for bed in beds) + 1
    states = max(len(bed.sampled.whole) for bed in beds)
    matrices = [_shifting(bed, longest, states) for bed in beds]
    A, B, C, torques = (np.stack(parts) for parts in zip(*matrices, strict=True))
    most = max(len(bed.own_modes) for bed in beds)
    own = np.stack(
        [np.pad(bed.own_modes, (0, most - len(bed.own_modes)), constant_values=NO_MODE) for bed in beds]
    )  # fmt: skip
    fast = np.array([bed.open_loop_damping for bed in beds])
    return SampledBeds(A, B, C, torques, states, own, fast)


def bed_set(case: Case, values: Sequence[Mapping[str, float]], frequencies: np.ndarray) -> BedSet:
    """Beds with these values (SI, by name; :func:`bed_of`) and their responses at frequencies (f,) in Hz."""
    return responses_of(case, beds_of(case, values), values, frequencies)


def responses_of(
    case: Case, beds: Sequence[Bed], values: Sequence[Mapping[str, float]], frequencies: np.ndarray,
    vehicle: np.ndarray | None = None,
) -> BedSet:  # fmt: skip
    """The same of beds that are there already, maybe with the ``vehicle`` (b, f, h) that each is compared with."""
    sampled, step = side_by_side(beds), case.loop["sample_time"]
    s = 2j * np.pi * frequencies
    hold = (1 - np.exp(-s * step)) / (s * step)
    z = np.exp(s * step)
    own, x, k = [bed.sampled for bed in beds], sampled.states, sampled.B.shape[2]
    # commands on their way are powers of 1/z: no states are needed for them
    pushed = np.stack([np.pad(np.hstack([one.new, one.old]), ((0, x - len(one.new)), (0, 0))) for one in own])
    states = resolvents(sampled.A[:, :x, :x]).columns(z, pushed)
    waited = z[:, None, None] ** -np.array([one.delay for one in own], float)[:, None, None, None]
    held = sampled.C[:, None, :, :x] @ (waited * (states[..., :k] + states[..., k:] / z[:, None, None]))
    A, commands, torques, readings, compared, at_once, delay = (
        np.stack([getattr(bed, name) for bed in beds])
        for name in ("A", "commands", "torques", "readings", "compared", "compared_torques", "delay")
    )
    d = torques.shape[2]
    states = resolvents(A).columns(s, np.concatenate([torques, commands], axis=2))
    late = hold[:, None] * np.exp(-s[:, None] * delay[:, None])  # (b, f, k)
    read = readings[:, None] @ states[..., :d]
    answered = compared[:, None] @ states[..., :d] + at_once[:, None]
    commanded = compared[:, None] @ states[..., d:] * late[:, :, None]
    if vehicle is None:
        vehicle = vehicle_responses(case, values, frequencies)
    return BedSet(case, sampled, frequencies, held, read, answered, commanded, vehicle)


def _shifting(bed: Bed, longest: int, states: int) -> tuple[np.ndarray, ...]:
    """A, B, C and torques of a bed whose ``longest`` delayed commands are further states after so many ``states``."""
    x, k, delay, sampled = states, bed.commands.shape[1], bed.sampled.delay, bed.sampled
    own = len(sampled.whole)
    A, B = np.zeros((x + k * longest,) * 2), np.zeros((x + k * longest, k))
    A[:own, :own] = sampled.whole
    if delay:
        A[:own, x + k * (delay - 1) : x + k * delay] = sampled.new
    else:
        B[:own] = sampled.new
    A[:own, x + k * delay : x + k * (delay + 1)] += sampled.old
    A[x + k :, x:-k] = np.eye(k * (longest - 1))
    B[x : x + k] = np.eye(k)
    C = np.pad(bed.readings, ((0, 0), (0, len(A) - bed.readings.shape[1])))
    return A, B, C, np.pad(sampled.torques, ((0, len(A) - own), (0, 0)))


@dataclass(frozen=True)
class FrequencyResponse:
    """A controller at frequencies: commands for readings (f, k, y) and for known torques (f, k, w)."""

    of_readings: np.ndarray
    of_known: np.ndarray
    known: tuple[str, ...]

    def at(self, part: slice) -> FrequencyResponse:
        """The same at some of the frequencies."""
        return FrequencyResponse(self.of_readings[part], self.of_known[part], self.known)


@dataclass(frozen=True)
class SampledController:
    """A controller of any structure within its limits: x⁺ = A·x + B·[y, w], u = C·x + D·[y, w].

    The states that readings reach come first; the others run on known torques alone, whatever the bed does.

    Attributes
    ----------
    A, B, C, D : ndarray (x, x), (x, y + w), (k, x), (k, y + w)
    reached : int
        How many states the readings reach.
    sensors, known, dynamometers : tuple of str
        Names of y (sensors of the rig), w and u.
    sample_time : float
        s.
    delayed_commands : slice or None
        Of an observer: see :class:`modelling.bed.bed.ControlLaw`.
    emulated : (ndarray (r, x), ndarray (r, y)) or None
        States of the residual vehicle by state and reading.
    expected : ndarray (y, x) or None
        Readings that the states expect; None where nothing corrects them.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    reached: int
    sensors: tuple[str, ...]
    known: tuple[str, ...]
    dynamometers: tuple[str, ...]
    sample_time: float
    delayed_commands: slice | None = None
    emulated: tuple[np.ndarray, np.ndarray] | None = None
    expected: np.ndarray | None = None

    @property
    def feedback(self) -> StateSpace:
        """From readings to commands alone: what decides on stability."""
        o, y = self.reached, len(self.sensors)
        return StateSpace(
            self.A[:o, :o], self.B[:o, :y], self.C[:, :o], self.D[:, :y], self.sensors, self.dynamometers
        )  # fmt: skip

    @property
    def own_matrix(self) -> np.ndarray:
        """State matrix of what runs on known torques alone."""
        return self.A[self.reached :, self.reached :]

    @cached_property
    def forms(self) -> tuple[Resolvent, Resolvent]:
        """Of the state matrices of the feedback and of what runs on known torques alone."""
        return resolvent(self.feedback.A), resolvent(self.own_matrix)


def without_limits(law: ControlLaw) -> SampledController:
    """The controller that a law is as long as no command is cut off."""
    y, x = len(law.sensors), len(law.A)
    sending, keep = law.A + law.Bs @ law.K, np.eye(x) - law.L @ law.E
    A, C = sending @ keep, law.K @ keep
    B = np.hstack([sending @ law.L + law.By + law.Bs @ law.Dy, law.Bw + law.Bs @ law.Dw])
    D = np.hstack([law.K @ law.L + law.Dy, law.Dw])
    reached = _reached(A, B[:, :y])
    order, delayed = np.argsort(~reached, kind="stable"), law.delayed_commands
    if delayed is not None:  # what nothing reaches before them, as a brake that is not pulled, stands behind now
        ahead = int((~reached[: delayed.start]).sum())
        delayed = slice(delayed.start - ahead, delayed.stop - ahead)
    return SampledController(
        A[np.ix_(order, order)], B[order], C[:, order], D, int(reached.sum()), law.sensors, law.known,
        law.dynamometers, law.sample_time, delayed,
        expected=law.E[:, order] if law.L.any() else None,
    )  # fmt: skip


def _reached(A: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Which states (x,) of x⁺ = A·x + inputs·u the inputs reach."""
    reached: np.ndarray = np.asarray((inputs != 0).any(axis=1))
    while True:
        further = reached | (A[:, reached] != 0).any(axis=1)
        if (further == reached).all():
            return reached
        reached = further


def controller_of(case: Case) -> SampledController:
    """The controller of a case as it runs, of any structure."""
    return controller_on(linear_bed(case))


def controller_on(bed: LinearBed, feed_forward: FeedForward | None = None) -> SampledController:
    """The same where the case's linear models, and maybe its feed-forward, are there already."""
    case, loop = bed.case, bed.case.loop
    k = len(loop.dynamometers)
    if loop.torqueless:
        count = len(loop.controller_sensors) + len(bed.simulated)
        return SampledController(
            np.zeros((0, 0)), np.zeros((0, count)), np.zeros((k, 0)), np.zeros((k, count)),
            0, loop.controller_sensors, bed.simulated, tuple(one.name for one in loop.dynamometers),
            loop["sample_time"],
        )  # fmt: skip
    if not (loop.structure.is_observer or loop.structure.has_feed_forward):
        return feedback_on(bed)
    feed_forward = feed_forward or feed_forward_of(case)
    made, r = without_limits(control_law(bed, feed_forward)), len(bed.residual_space.A)
    if made.delayed_commands is not None:
        emulated, of_readings = np.zeros((r, len(made.A))), np.zeros((r, len(made.sensors)))
        begin = len(bed_model(case.rig, case.residual_vehicle, loop).speed_error[0]) - r  # after rig and lags
    else:
        assert feed_forward is not None, "the structure has one"
        emulated, of_readings = _emulated(bed, len(made.A), made.reached)
        begin = made.reached + len(bed.bed.A)
    emulated[:, begin : begin + r] = np.eye(r)
    return _reading_all(replace(made, emulated=(emulated, of_readings)), loop.controller_sensors)


def feed_forward_of(case: Case) -> FeedForward | None:
    """The model-based feed-forward of a case; None where its structure has none."""
    return case.loop.structure.feed_forward(case.rig, cut(case.emulated_vehicle, case.rig), case.loop)


def feedback_on(bed: LinearBed) -> SampledController:
    """The feedback law of a case alone, without a feed-forward; what acts inside the residual vehicle is known."""
    feedback, k, loop = bed.sampled_feedback, len(bed.dynamometers), bed.case.loop
    B, D, signs = feedback.B.copy(), feedback.D.copy(), np.concatenate([bed.torque_signs, np.ones(k)])
    B[:, : 2 * k], D[:, : 2 * k] = B[:, : 2 * k] * signs, D[:, : 2 * k] * signs
    x = len(feedback.A)
    made = SampledController(
        feedback.A, B, feedback.C, D, x, loop.controller_sensors[: 2 * k], bed.simulated,
        tuple(dynamometer.name for dynamometer in loop.dynamometers), loop["sample_time"],
        emulated=_emulated(bed, x, x),
    )  # fmt: skip
    return _reading_all(made, loop.controller_sensors)


def _reading_all(controller: SampledController, sensors: tuple[str, ...]) -> SampledController:
    """The same controller with further sensors, which come last, that it makes nothing of."""
    y, more = len(controller.sensors), len(sensors) - len(controller.sensors)
    if not more:
        return controller
    assert controller.emulated is not None, "a feedback law runs a residual vehicle"
    B, D = (np.insert(part, [y] * more, 0.0, axis=1) for part in (controller.B, controller.D))
    emulated = controller.emulated[0], np.insert(controller.emulated[1], [y] * more, 0.0, axis=1)
    return replace(controller, B=B, D=D, sensors=sensors, emulated=emulated)


def _emulated(bed: LinearBed, states: int, reached: int) -> tuple[np.ndarray, np.ndarray]:
    """States (r, …) of the residual vehicle by state and reading of a feedback law sampled by Tustin's rule."""
    r, k = len(bed.residual_space.A), len(bed.dynamometers)
    of_states, of_readings = np.zeros((r, states)), np.zeros((r, 2 * k))
    if reached >= r:  # x = (I − A·T/2)⁻¹·(x of the rule + B·u·T/2)
        half = bed.case.loop["sample_time"] / 2
        of_states[:, :r] = np.linalg.inv(np.eye(r) - half * bed.residual_space.A)
        of_readings[:, :k] = of_states[:, :r] @ (half * bed.residual_space.B[:, :k] * bed.torque_signs)
    return of_states, of_readings


def frequency_response(controller: SampledController, frequencies: np.ndarray) -> FrequencyResponse:
    """What a controller does at frequencies (f,), Hz."""
    o, y, feedback, own = controller.reached, len(controller.sensors), controller.feedback, controller.own_matrix
    z = np.exp(2j * np.pi * frequencies * controller.sample_time)
    # C·(zI − A)⁻¹ from the left: as many right-hand sides as dynamometers
    left = controller.forms[0].rows(z, feedback.C) if o else np.zeros((len(z), len(controller.C), 0), complex)
    # states that known torques alone reach, for these torques
    states = np.zeros((len(z), 0, len(controller.known)), complex)
    if len(own):
        states = controller.forms[1].columns(z, controller.B[o:, y:])
    of_known = left @ (controller.A[:o, o:] @ states + controller.B[:o, y:])
    of_known = of_known + controller.C[:, o:] @ states + controller.D[:, y:]
    return FrequencyResponse(left @ feedback.B + feedback.D, of_known, controller.known)


def law_response(law: ControlLaw, frequencies: np.ndarray, readings: tuple[str, ...]) -> FrequencyResponse:
    """What a control law does at frequencies (f,), Hz, for ``readings``, among which are its own."""
    made = frequency_response(without_limits(law), frequencies)
    of_readings = np.zeros((*made.of_readings.shape[:2], len(readings)), complex)
    of_readings[:, :, [readings.index(name) for name in law.sensors]] = made.of_readings
    return replace(made, of_readings=of_readings)


def closed_matrices(beds: SampledBeds, controller: SampledController) -> np.ndarray:
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


def closed_poles(beds: SampledBeds, controller: SampledController) -> np.ndarray:
    """Poles (b, p) of the closed loops of beds and feedback.

    A bed and an observer hold the same delayed commands, and their difference is gone once they have passed: its poles
    are 0. So the closed loop is worked out with the bed's alone, which takes a fraction of the time where the dead time
    is many samples.
    """
    closed, x, delayed = closed_matrices(beds, controller), beds.A.shape[1], controller.delayed_commands
    if delayed is None:
        return eigenvalues(closed)
    both = np.arange(min(x - beds.states, delayed.stop - delayed.start))
    twice = x + delayed.start + both
    closed[:, :, beds.states + both] += closed[:, :, twice]
    once = np.delete(np.arange(closed.shape[1]), twice)
    return eigenvalues(closed[:, once[:, None], once])


def return_difference(beds: BedSet, acting: FrequencyResponse) -> np.ndarray:
    """I + L at the commands (b, f, k, k)."""
    return np.eye(acting.of_readings.shape[1]) - acting.of_readings @ beds.held


@dataclass(frozen=True)
class Driven:
    """What i inputs do before any command reaches the bed.

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


def drive(beds: BedSet, acting: FrequencyResponse, inputs: Sequence[str], measured: Sequence[str]) -> Driven:
    """What inputs (i) do; ``measured`` and what acts inside the residual vehicle are known."""
    rig_inputs = disturbing(beds.case)
    shape = beds.read.shape[:2]
    read = np.zeros((*shape, beds.read.shape[2], len(inputs)), complex)
    answered = np.zeros((*shape, beds.answered.shape[2], len(inputs)), complex)
    known = {}
    for i, name in enumerate(inputs):
        if name in rig_inputs:
            read[..., i] = beds.read[..., rig_inputs.index(name)]
            answered[..., i] = beds.answered[..., rig_inputs.index(name)]
        if name not in rig_inputs or (name in measured and name in acting.known):
            known[i] = acting.known.index(name)
    commands = acting.of_readings @ read
    for i, column in known.items():
        commands[..., i] += acting.of_known[:, :, column]
    return Driven(commands, read, answered, known)


def responses(beds: BedSet, acting: FrequencyResponse, measured: Sequence[str]) -> np.ndarray:
    """Compared functions (b, f, h) of the beds under control for continuous torques, of which ``measured`` are known.

    What acts inside the residual vehicle is always known.
    """
    driven = drive(beds, acting, compared_inputs(beds.case), measured)
    answer = beds.commanded @ np.linalg.solve(return_difference(beds, acting), driven.commands) + driven.answered
    sensors, inputs = compared_columns(beds.case)
    return answer[:, :, sensors, inputs]


def can_be_unmeasured(case: Case) -> np.ndarray:
    """Which of the compared functions (h,) begin at a torque that may act without the controller knowing it, as bool.

    What acts inside the residual vehicle the controller itself computes. Where nothing else is compared all count.
    """
    on_rig = np.isin([pair.input for pair in case.compared], disturbing(case))
    return on_rig if on_rig.any() else np.ones(len(on_rig), bool)


def errors(beds: BedSet, acting: FrequencyResponse, measured: Sequence[str]) -> np.ndarray:
    """Mean squares (b, h) over the frequencies of |log(H_rig/H_vehicle)|, complex logarithm."""
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = np.abs(np.log(responses(beds, acting, measured) / beds.vehicle)) ** 2
    return np.nan_to_num(squares, nan=1e6, posinf=1e6).mean(axis=1)


# --- Bed and controller as state spaces of one sample time, to be closed by their names.


def command_names(case: Case) -> tuple[str, ...]:
    """Names of the commands (k), without a point, which python-control refuses."""
    return tuple(f"{dynamometer.name}_command" for dynamometer in case.loop.dynamometers)


def bed_space(case: Case) -> StateSpace:
    """The bed from sample to sample, held inputs, its dead time in states.

    Inputs are the commands and the torques at the rig that no dynamometer gives; outputs the controller's readings,
    then the compared sensors that are no reading.
    """
    bed = bed_of(case, {})
    sampled = side_by_side([bed])
    readings, names = case.loop.controller_sensors, compared_sensors(case)
    further = [row for row, name in enumerate(names) if name not in readings]
    x, (y, k, d) = len(bed.A), (len(readings), sampled.B.shape[2], sampled.torques.shape[2])
    C, D = np.zeros((y + len(further), sampled.A.shape[1])), np.zeros((y + len(further), k + d))
    C[:y], C[y:, :x], D[y:, k:] = sampled.C[0], bed.compared[further], bed.compared_torques[further]
    return StateSpace(
        sampled.A[0], np.hstack([sampled.B[0], sampled.torques[0]]), C, D, (*command_names(case), *disturbing(case)),
        (*readings, *(names[row] for row in further)), case.loop["sample_time"],
    )  # fmt: skip


def controller_space(case: Case) -> StateSpace:
    """The controller from readings and known torques to commands, as long as no command is cut by a limit."""
    one = controller_of(case)
    return StateSpace(one.A, one.B, one.C, one.D, (*one.sensors, *one.known), command_names(case), one.sample_time)


# --- The sampled control law of a tuned case, of any structure, as it leaves the computer.


def control_law(bed: LinearBed, feed_forward: FeedForward | None = None) -> ControlLaw:
    """The law of a tuned case; its readings are those of the rig's sensors, signs as the rig has them.

    ``feed_forward`` is the case's where it is there already.
    """
    case, loop = bed.case, bed.case.loop
    observer = loop.structure.observer(case.rig, case.residual_vehicle, loop)
    if observer is not None:
        return observer
    k, feed_forward = len(loop.dynamometers), feed_forward or feed_forward_of(case)
    sensors, signs = loop.controller_sensors[: 2 * k], np.concatenate([bed.torque_signs, np.ones(k)])
    if feed_forward is not None:
        return law_of_feed_forward(feed_forward, bed.sampled_feedback, signs, sensors)
    return law_of_feedback(bed.sampled_feedback, signs, sensors, bed.simulated, loop["sample_time"])
