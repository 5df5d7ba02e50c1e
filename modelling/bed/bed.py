"""The controlled test bed: its loop, its structures, the sampled control law, and the model it predicts with."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, expm

from modelling.bed.specimen import KNOWN, KnownPart, known_part
from modelling.bed.vehicle import FeedForward, Interface, ResidualVehicle
from modelling.linear.state_space import StateSpace, by_tustin, state_space
from modelling.system import Input, Sensor, Shaft, System

# --- The sampled control law in one form for every structure.


@dataclass(frozen=True)
class ControlLaw:
    """What a controller computes at every sample, in deviations from where it was switched on.

    The form of every controller on the bed: of feedback and feed-forward (:mod:`modelling.controller.law`), and of an
    observer (:func:`modelling.bed.observer.design`).

    xc = x + L·(y − E·x), u = K·xc + Dy·y + Dw·w, x⁺ = A·xc + By·y + Bw·w + Bs·sent, where ``sent`` is u after the
    limits: a command that was cut is known to the law, so nothing winds up.

    Attributes
    ----------
    A, By, Bw, Bs : ndarray (x, x), (x, y), (x, w), (x, k)
    K, Dy, Dw : ndarray (k, x), (k, y), (k, w)
    L, E : ndarray (x, y), (y, x)
        Correction by, and expectation of, the readings.
    sensors, known, dynamometers : tuple of str
        Names of y (sensors of the rig), w (torques that are measured or demanded) and u (dynamometers).
    sample_time : float
        s. A command is issued at the sample whose readings it uses.
    delayed_commands : slice or None
        Of an observer: the states that hold commands which were sent and do not act yet, newest first. The states are
        counted among those that a reading changes.
    """

    A: np.ndarray
    By: np.ndarray
    Bw: np.ndarray
    Bs: np.ndarray
    K: np.ndarray
    Dy: np.ndarray
    Dw: np.ndarray
    L: np.ndarray
    E: np.ndarray
    sensors: tuple[str, ...]
    known: tuple[str, ...]
    dynamometers: tuple[str, ...]
    sample_time: float
    delayed_commands: slice | None = None

    @property
    def states(self) -> int:
        """Number x of states."""
        return len(self.A)

    @property
    def vehicle_states(self) -> int:
        """Number v of states of a residual vehicle that is stepped beside it: none."""
        return 0

    @property
    def linear(self) -> ControlLaw:
        """The law as a linear one: itself."""
        return self

    def step(
        self, state: np.ndarray, readings: np.ndarray, known: np.ndarray,
        limits: np.ndarray | tuple[np.ndarray, np.ndarray], added: np.ndarray | float = 0.0,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Commands (k, …), N·m, and the state (x, …) of the next sample, of one bed or of a batch.

        Commands stay within ±``limits`` (k, …), or between the first and the second of a pair. ``added`` torques
        (k, …) are part of them, and the law knows of them.
        """
        low, high = limits if isinstance(limits, tuple) else (-limits, limits)
        corrected = state + self.L @ (readings - self.E @ state)
        sent = np.clip(self.K @ corrected + self.Dy @ readings + self.Dw @ known + added, low, high)
        return sent, self.A @ corrected + self.By @ readings + self.Bw @ known + self.Bs @ sent


# --- The control loop as data, and what a control structure has to answer.
#
# Per dynamometer: measured flange torque → torque-sensor lag → residual vehicle → reference speed → controller →
# dead time → inverter lag → air-gap torque on the rotor. What the controller does with these signals is its structure,
# an object from one file of :mod:`modelling.bed.controllers`.


@dataclass(frozen=True)
class LoopQuantity:
    """A quantity of the loop: SI unit, start value, physical bounds, what it is."""

    unit: str
    start: float
    lower: float
    upper: float
    meaning: str


HARDWARE = {
    "dead_time": LoopQuantity(
        "s", 0.003, 0.0, 0.2, "total dead time from sensor to air-gap torque: computing, bus, half a sample of hold"
    ),
    "inverter_lag": LoopQuantity("s", 0.002, 1e-5, 0.2, "first-order lag of the air-gap torque"),
    "torque_sensor_lag": LoopQuantity("s", 0.0005, 1e-6, 0.2, "first-order lag of the torque flange and its filter"),
    "sample_time": LoopQuantity("s", 0.001, 1e-5, 0.05, "sample time of the residual vehicle model and the controller"),
}


OWN_TIMES = ("dead_time", "inverter_lag", "torque_sensor_lag")  # of a dynamometer, where not as the loop states them


@dataclass(frozen=True)
class Dynamometer:
    """One dynamometer: the rig input it drives, its torque and speed sensors, the cut shaft whose outer end it is.

    ``torque_sensor`` is None without a torque flange: an observer then estimates the torque from the speeds.
    ``torque_gain`` is its air-gap torque over its command as calibrated: commands are divided by it. ``dead_time``,
    ``inverter_lag`` and ``torque_sensor_lag`` (s) are its own where it has others than the loop states for all.
    """

    name: str
    torque_input: str
    torque_sensor: str | None
    speed_sensor: str
    follows: str
    torque_gain: float = 1.0
    dead_time: float | None = None
    inverter_lag: float | None = None
    torque_sensor_lag: float | None = None


class ControlStructure(ABC):
    """What a controller does with the measured signals; k dynamometers, x states, r inputs of the residual vehicle.

    Structures have no state of their own: every method takes the values it works with.

    Attributes
    ----------
    name : str
        As case files write it under ``loop.structure``.
    quantities : dict of str to LoopQuantity
        What may be tuned of it.
    has_feed_forward : bool
        Whether :meth:`feed_forward` gives one.
    is_observer : bool
        Whether :meth:`observer` gives the whole controller.
    """

    name: str
    quantities: Mapping[str, LoopQuantity]
    has_feed_forward: bool = False
    is_observer: bool = False

    @abstractmethod
    def gives_torque(self, values: Mapping[str, float]) -> bool:
        """Whether the dynamometers ever give torque at these values."""

    @abstractmethod
    def measured_inputs(self, measured: Sequence[str], simulated: Sequence[str]) -> tuple[str, ...]:
        """Torque inputs that the feed-forward takes as measured.

        Parameters
        ----------
        measured : sequence of str
            Inputs of the rig whose torque is measured.
        simulated : sequence of str
            Inputs of the residual vehicle, whose torque the controller itself computes.
        """

    def starts(self, rig: System, loop: Loop) -> tuple[Mapping[str, float], ...]:
        """Values of all quantities where a search may begin, in addition to values that a case states."""
        return ()

    def controller(self, loop: Loop, residual: StateSpace, rig: System) -> StateSpace:
        """The feedback law in continuous time, residual vehicle included.

        Parameters
        ----------
        residual : StateSpace
            All of the residual vehicle: inputs [interface torques (k), its own inputs (r)], outputs reference speeds
            (k), in the order of the dynamometers.
        rig : System
            As the controller believes it to be.

        Returns
        -------
        StateSpace
            Inputs [flange torques (k), rotor speeds (k), inputs of the residual vehicle (r)], outputs commands (k).
        """
        raise NotImplementedError(f"{self.name} runs from sample to sample only")

    def sampled(self, loop: Loop, residual: StateSpace, rig: System) -> StateSpace:
        """The feedback law as it runs, from sample to sample: :meth:`controller` by Tustin's rule unless overridden."""
        return by_tustin(self.controller(loop, residual, rig), loop["sample_time"])

    def feed_forward(self, rig: System, residual: ResidualVehicle, loop: Loop) -> FeedForward | None:
        """The model-based feed-forward of measured torques, which has poles of its own; None where there is none.

        Parameters
        ----------
        residual : ResidualVehicle
            As cut out of the vehicle: the reference, not what was tuned for the feedback.

        Raises
        ------
        NoDesign
            If there is no stabilising solution.
        """
        return None

    def observer(self, rig: System, residual: ResidualVehicle, loop: Loop) -> ControlLaw | None:
        """The whole controller where it is an observer with state feedback; None for feedback laws.

        Parameters
        ----------
        residual : ResidualVehicle
            As cut out of the vehicle.

        Raises
        ------
        InputError
            If a model cannot be made linear.
        NoDesign
            If a Riccati equation has no stabilising solution.
        """
        return None


@dataclass(frozen=True)
class Loop:
    """Structure, dynamometers, measured rig inputs, and values of :data:`HARDWARE` and the structure's quantities (SI).

    ``measured`` are the inputs of the rig whose torque is measured, or known as a demand, and reaches the controller;
    ``further_sensors`` those of the rig that reach it in addition to the dynamometers' own. ``fixed``: the controller
    is given, and no search moves its quantities. ``specimen`` is one of :data:`modelling.bed.specimen.SPECIMENS`;
    ``beyond`` are inputs and sensors that only a controller of the known specimen can use.
    """

    structure: ControlStructure
    dynamometers: tuple[Dynamometer, ...]
    measured: tuple[str, ...]
    values: Mapping[str, float]
    further_sensors: tuple[str, ...] = ()
    fixed: bool = False
    specimen: str = KNOWN
    beyond: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    @property
    def controller_sensors(self) -> tuple[str, ...]:
        """Sensors that reach the controller: the torques of the flanges, the rotors' speeds, then further ones."""
        speeds = [dynamometer.speed_sensor for dynamometer in self.dynamometers]
        return (*self.flanges, *speeds, *self.further_sensors)

    @property
    def flanges(self) -> tuple[str, ...]:
        """The torque sensors of the dynamometers that have a flange (f)."""
        return tuple(one.torque_sensor for one in self.dynamometers if one.torque_sensor is not None)

    @property
    def with_flange(self) -> list[int]:
        """Which dynamometers have a flange (f), by number."""
        return [j for j, one in enumerate(self.dynamometers) if one.torque_sensor is not None]

    @property
    def lag_states(self) -> int:
        """States of the lags: of the inverters (k), then of the flanges (f)."""
        return len(self.dynamometers) + len(self.flanges)

    @property
    def quantities(self) -> dict[str, LoopQuantity]:
        """Every quantity of the loop by name: hardware, then the structure's."""
        return {**HARDWARE, **self.structure.quantities}

    @property
    def tunes_observer(self) -> bool:
        """Whether a search moves the weights of an observer."""
        return self.structure.is_observer and not self.fixed

    @property
    def states_weights(self) -> bool:
        """Whether quantities of the structure have other values than a search begins at."""
        return any(self[name] != known.start for name, known in self.structure.quantities.items())

    @property
    def torqueless(self) -> bool:
        """Whether the dynamometers never give torque."""
        return not self.structure.gives_torque(self.values)

    def command_delay(self, dead_time: float | None = None) -> float:
        """From a sample to the moment its command begins to act, s, not below 0.

        A command that is held for a sample lags half of it, which the dead time (s, the loop's unless given) counts.
        """
        return max((self["dead_time"] if dead_time is None else dead_time) - self["sample_time"] / 2, 0.0)

    def command_delays(self, dead_time: float | None = None) -> np.ndarray:
        """The same of every dynamometer (k,); where the loop's dead time is another one, all differ by as much."""
        more = 0.0 if dead_time is None else dead_time - self["dead_time"]
        own = [self["dead_time"] if one.dead_time is None else one.dead_time for one in self.dynamometers]
        return np.array([self.command_delay(value + more) for value in own])

    def lags(self, name: str, value: float | None = None) -> np.ndarray:
        """``inverter_lag`` or ``torque_sensor_lag`` of every dynamometer (k,), s; another value scales all alike."""
        factor = 1.0 if value is None else value / self[name]
        own = [getattr(one, name) for one in self.dynamometers]
        return np.array([factor * (self[name] if lag is None else lag) for lag in own])

    def with_values(self, values: Mapping[str, float]) -> Loop:
        """The same loop with some values changed by name."""
        return replace(self, values={**self.values, **values})


# --- Rig, lags and residual vehicle as one continuous model: what a controller predicts with.


@dataclass(frozen=True)
class BedModel:
    """Rig with inverter and torque-sensor lags, driving the residual vehicle through the torque of the cut shafts.

    Attributes
    ----------
    space : StateSpace
        Inputs [commands as they act (k), measured torques (w)], outputs [sensors of the rig, the speed of each
        dynamometer ``NAME speed``, the lagged torque of each that has a flange ``NAME torque``].
    speed_error : ndarray (k, x)
        Speed of the rig less that of the residual vehicle at each cut, rad/s by state.
    measured : tuple of str (w)
        Every torque that is no dynamometer's: of the rig, then of the residual vehicle.
    rig_states : int
        The first states, of the rig; the air-gap torques (k), the lagged flange torques (f) and the residual vehicle
        follow.
    shaft_torques : ndarray (x, k)
        What a torque in addition to that of each cut shaft's spring and damper does, like columns of B.
    """

    space: StateSpace
    speed_error: np.ndarray
    measured: tuple[str, ...]
    rig_states: int
    shaft_torques: np.ndarray

    @property
    def rotor_torques(self) -> np.ndarray:
        """What a torque right at each dynamometer's rotor does (x, k), like columns of B."""
        k, n = len(self.speed_error), self.rig_states
        return np.vstack([self.space.A[:n, n : n + k], np.zeros((len(self.space.A) - n, k))])


def predicted_part(rig: System, residual: ResidualVehicle, loop: Loop) -> KnownPart:
    """The part of a rig that the controller predicts with: all of it, where the specimen is known."""
    if loop.specimen == KNOWN:
        return KnownPart(rig, {}, (), {})
    on = {part.name: part.on for part in rig.inputs}
    follows = [one.follows for one in loop.dynamometers]
    outer = [next(cut.rig_end for cut in residual.interfaces if cut.shaft == name) for name in follows]
    return known_part(rig, [on[one.torque_input] for one in loop.dynamometers], follows, outer)


def bed_model(rig: System, residual: ResidualVehicle, loop: Loop) -> BedModel:
    """Put rig, lags and residual vehicle together, without dead time; of an unknown specimen what stands before it.

    Raises
    ------
    InputError
        If a model cannot be made linear.
    """
    rig = predicted_part(rig, residual, loop).system
    rig_space = state_space(_with_interfaces(rig, residual))
    parts = [state_space(part) for part in residual.parts]
    interface_torques = {cut.torque for cut in residual.interfaces}
    dynamometer_inputs = [dynamometer.torque_input for dynamometer in loop.dynamometers]
    on_rig = tuple(part.name for part in rig.inputs if part.name not in dynamometer_inputs)
    in_vehicle = [(i, name) for i, part in enumerate(parts) for name in part.inputs if name not in interface_torques]
    k, n = len(loop.dynamometers), len(rig_space.A)
    A = block_diag(
        rig_space.A,
        -np.diag(1 / loop.lags("inverter_lag")),
        -np.diag(1 / loop.lags("torque_sensor_lag")[loop.with_flange]),
        *(part.A for part in parts),
    )
    starts = np.cumsum([n + loop.lag_states, *(len(part.A) for part in parts)])
    B = np.zeros((len(A), k + len(on_rig) + len(in_vehicle)))
    error, shaft_torques = np.zeros((k, len(A))), np.zeros((len(A), k))
    for j, dynamometer in enumerate(loop.dynamometers):
        cut = next(cut for cut in residual.interfaces if cut.shaft == dynamometer.follows)
        A[:n, n + j] = rig_space.input(dynamometer.torque_input)
        B[n + j, j] = 1 / loop.lags("inverter_lag")[j]
        at = next(i for i, part in enumerate(parts) if cut.torque in part.inputs)
        rows = slice(starts[at], starts[at + 1])
        A[rows, :n] += np.outer(parts[at].input(cut.torque), cut.factor * rig_space.output(_torque(cut)))
        first, second = (rig_space.input(name) for name in _ends(cut))
        shaft_torques[:n, j] = second - first / _ratio(rig, cut)
        shaft_torques[rows, j] = cut.factor * parts[at].input(cut.torque)
        error[j, :n] = rig_space.output(_speed(cut))
        error[j, rows] = -parts[at].output(cut.speed)
    for i, (j, name) in enumerate(zip(loop.with_flange, loop.flanges, strict=True), n + k):
        A[i, :n] = rig_space.output(name) / loop.lags("torque_sensor_lag")[j]
    for j, name in enumerate(on_rig, k):
        B[:n, j] = rig_space.input(name)
    for j, (at, name) in enumerate(in_vehicle, k + len(on_rig)):
        B[starts[at] : starts[at + 1], j] = parts[at].input(name)
    C, D, outputs = _readings(rig_space, loop, len(A), B.shape[1], on_rig)
    measured = (*on_rig, *(name for _, name in in_vehicle))
    space = StateSpace(A, B, C, D, (*dynamometer_inputs, *measured), outputs)
    return BedModel(space, error, measured, n, shaft_torques)


def _readings(
    rig: StateSpace, loop: Loop, states: int, inputs: int, on_rig: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """C (y, x), D (y, u) and names (y) of the outputs."""
    k, n, sensors = len(loop.dynamometers), len(rig.A), len(rig.C)
    rows = sensors + loop.lag_states
    C, D = np.zeros((rows, states)), np.zeros((rows, inputs))
    C[:sensors, :n] = rig.C
    names = list(rig.outputs)
    for j, dynamometer in enumerate(loop.dynamometers):
        C[sensors + j, :n] = rig.output(dynamometer.speed_sensor)
        names.append(f"{dynamometer.name} speed")
    for i, j in enumerate(loop.with_flange):
        C[sensors + k + i, n + k + i] = 1
        names.append(f"{loop.dynamometers[j].name} torque")
    for j, name in enumerate(on_rig, k):
        D[:sensors, j] = rig.D[:, rig.inputs.index(name)]
    return C, D, tuple(names)


def _torque(cut: Interface) -> str:
    return f"interface_torque_{cut.shaft}"


def _speed(cut: Interface) -> str:
    return f"interface_speed_{cut.shaft}"


def _ends(cut: Interface) -> tuple[str, str]:
    """Names of torques on the first and the second end of a cut shaft."""
    return f"first_end_torque_{cut.shaft}", f"second_end_torque_{cut.shaft}"


def _shaft(rig: System, cut: Interface) -> Shaft:
    return next(shaft for shaft in rig.shafts if shaft.name == cut.shaft)


def _ratio(rig: System, cut: Interface) -> float:
    ratio = _shaft(rig, cut).ratio
    return 1.0 if ratio is None else ratio.value


def _with_interfaces(rig: System, residual: ResidualVehicle) -> System:
    """The rig with sensors of torque and speed at its interfaces, and with torques on both ends of the cut shafts."""
    sensors = tuple(
        sensor
        for cut in residual.interfaces
        for sensor in (Sensor(_torque(cut), "torque", cut.shaft), Sensor(_speed(cut), "speed", cut.rig_end))
    )
    torques = tuple(
        Input(name, end, "torque")
        for cut in residual.interfaces
        for name, end in zip(_ends(cut), _shaft(rig, cut).between, strict=True)
    )
    return replace(rig, sensors=rig.sensors + sensors, inputs=rig.inputs + torques)


# --- The bed's model from sample to sample, with a dead time that need not be a multiple of the sample time.

WHOLE_SAMPLE = 1e-9  # of a sample: dead times this little short of a whole number of samples count as whole


@dataclass(frozen=True)
class DelayedBed:
    """x(j + 1) = whole·x(j) + new·u(j − delay) + old·u(j − delay − 1) + torques·w(j), all held over a sample.

    Where dead times differ, ``delay`` is the shortest, and the commands that have to wait longer pass through further
    states, which follow those of the bed.

    Attributes
    ----------
    whole : ndarray (x, x)
        What a whole sample makes of the state without inputs.
    new, old : ndarray (x, k)
        Commands for the rest of a sample, and those before for its first part, while the newer ones are still delayed.
    torques : ndarray (x, w)
        Measured torques.
    delay : int
        Whole samples of dead time; the rest of it is shared between ``new`` and ``old``.
    """

    whole: np.ndarray
    new: np.ndarray
    old: np.ndarray
    torques: np.ndarray
    delay: int


def delayed_bed(
    A: np.ndarray, commands: np.ndarray, torques: np.ndarray, dead_time: float | np.ndarray, step: float
) -> DelayedBed:
    """Exact discretisation of ẋ = A·x + commands·u(t − dead_time) + torques·w over a step, both in s.

    A (x, x), commands (x, k), torques (x, w); ``dead_time`` of all commands, or of each (k,).
    """
    times = np.broadcast_to(np.asarray(dead_time, float), (commands.shape[1],))
    return delayed_beds(A[None], commands[None], torques[None], times[None], step)[0]


def delayed_beds(
    A: np.ndarray, commands: np.ndarray, torques: np.ndarray, dead_times: np.ndarray, step: float
) -> list[DelayedBed]:
    """:func:`delayed_bed` of many beds: A (b, x, x), commands (b, x, k), torques (b, x, w), dead times (b, k) in s."""
    whole, of_torques = held(A, torques, step)
    delays = np.floor(dead_times / step + WHOLE_SAMPLE).astype(int)
    # s at the begin of each sample, in which the command before still acts
    late = np.maximum(dead_times - delays * step, 0.0)
    new, old = np.zeros(commands.shape), np.zeros(commands.shape)
    different, group = np.unique(late, axis=1, return_inverse=True)
    for i, rest in enumerate(different.T):
        which = group == i
        _, early = held(A, commands[:, :, which], rest)
        after, new[:, :, which] = held(A, commands[:, :, which], step - rest)
        old[:, :, which] = after @ early
    return [_waiting(*parts) for parts in zip(whole, new, old, of_torques, delays, strict=True)]


def _waiting(
    whole: np.ndarray, new: np.ndarray, old: np.ndarray, of_torques: np.ndarray, delays: np.ndarray
) -> DelayedBed:  # fmt: skip
    """A bed whose commands are ``delays`` (k,) samples late: those that wait longer than others get registers."""
    x, delay = len(whole), int(delays.min()) if len(delays) else 0
    waiting = [j for j in range(len(delays)) if delays[j] > delay]
    if not waiting:
        return DelayedBed(whole, new, old, of_torques, delay)
    # a command that has to wait m samples longer: m + 1 registers, of which the last two act
    size = x + sum(int(delays[j]) - delay + 1 for j in waiting)
    made = DelayedBed(
        np.pad(whole, (0, size - x)), np.pad(new, ((0, size - x), (0, 0))), np.pad(old, ((0, size - x), (0, 0))),
        np.pad(of_torques, ((0, size - x), (0, 0))), delay,
    )  # fmt: skip
    first = x
    for j in waiting:
        more = int(delays[j]) - delay
        made.whole[:x, first + more - 1], made.whole[:x, first + more] = new[:, j], old[:, j]
        made.new[:x, j] = made.old[:x, j] = 0.0
        made.new[first, j] = 1.0
        for register in range(first + 1, first + more + 1):
            made.whole[register, register - 1] = 1.0
        first += more + 1
    return made


def held(A: np.ndarray, B: np.ndarray, step: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Exact discretisation (b, x, x), (b, x, u) of A (b, x, x), B (b, x, u) over steps (s), one or (b,), inputs held.

    Or of one bed, without b.
    """
    n = A.shape[-1]
    block = np.zeros((*A.shape[:-2], *(n + B.shape[-1],) * 2))
    block[..., :n, :n], block[..., :n, n:] = A, B
    block = expm(block * np.asarray(step)[..., None, None])
    return block[..., :n, :n], block[..., :n, n:]


def of_model(model: BedModel, dead_time: float | np.ndarray, step: float) -> DelayedBed:
    """The model of rig, lags and residual vehicle, sampled (s); inputs: the commands, then the measured torques."""
    k = len(model.speed_error)
    plant = model.space
    return delayed_bed(plant.A, plant.B[:, :k], plant.B[:, k:], dead_time, step)
