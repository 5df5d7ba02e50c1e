"""What a kind of effect states about itself, the motion it guesses from, and the torque table that no law describes."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
import scipy
import sympy as sm
from sympy import Abs, Expr, Symbol

from modelling.errors import ExcludedEffects
from modelling.units import QUANTITY_UNITS

# --- What an effect guesses its first values from: the motion of a fitted model without it, and the misfit's gradient.


@dataclass(frozen=True)
class FittedMotion:
    """The motion of a fitted model over the recorded inputs; segments of recordings one after another.

    Attributes
    ----------
    time : ndarray (t,)
        s, from the start of each recording.
    segments : tuple of slice
        The uninterrupted segments.
    angle, speed, acceleration : dict of str to ndarray (t,)
        By inertia.
    twist, twist_rate, torque : dict of str to ndarray (t,)
        By shaft; twist and its rate as the shaft's law takes them, torque on the second end's side.
    input : dict of str to ndarray (t,)
        As recorded, by input.
    reading : dict of str to ndarray (t,)
        As simulated, by sensor.
    noise : dict of str to float
        Standard uncertainty by sensor.
    value : dict of str to float
        Every quantity by its full name.
    ends : dict of str to (str, str)
        The inertias that a shaft joins.
    torque_gradient : dict of str to ndarray (t,)
        By inertia: −∂χ²/∂torque, how much a torque at that time would lower the misfit.
    torque_lacking : dict of str to ndarray (t,)
        By inertia: the torque that the measurement asks for beside those of the model.
    gear_torque : dict of str to ndarray (t,)
        By rigid gear, on the second end's side, as far as it follows from both sides.
    gear_ends : dict of str to (str, str)
        The inertias that a rigid gear joins.
    recording : ndarray (t,)
        Number of the recording that a sample is of, from 1.
    load : dict of str to ndarray (t,)
        By inertia that inputs drive: the sum of their torques.
    model_angle : dict of str to ndarray (t,)
        By inertia: the angle without what the measurement adds; that drifts where no sensor tells of angles.
    reads, sensor_of : dict of str to str
        By sensor: the quantity that it measures, and the inertia or shaft of which.
    reading_gradient : dict of str to ndarray (t,)
        By sensor: −½∂χ²/∂reading, how much a further reading at that time would lower the misfit.
    """

    time: np.ndarray
    segments: tuple[slice, ...]
    angle: Mapping[str, np.ndarray]
    speed: Mapping[str, np.ndarray]
    acceleration: Mapping[str, np.ndarray]
    twist: Mapping[str, np.ndarray]
    twist_rate: Mapping[str, np.ndarray]
    torque: Mapping[str, np.ndarray]
    input: Mapping[str, np.ndarray]
    reading: Mapping[str, np.ndarray]
    noise: Mapping[str, float]
    value: Mapping[str, float]
    ends: Mapping[str, tuple[str, str]]
    torque_gradient: Mapping[str, np.ndarray] = field(default_factory=dict)
    torque_lacking: Mapping[str, np.ndarray] = field(default_factory=dict)
    gear_torque: Mapping[str, np.ndarray] = field(default_factory=dict)
    gear_ends: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    recording: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    load: Mapping[str, np.ndarray] = field(default_factory=dict)
    model_angle: Mapping[str, np.ndarray] = field(default_factory=dict)
    reads: Mapping[str, str] = field(default_factory=dict)
    sensor_of: Mapping[str, str] = field(default_factory=dict)
    reading_gradient: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def step(self) -> float:
        """Sampling interval, s."""
        return float(np.median(np.diff(self.time[self.segments[0]])))

    def signal(self, place: str) -> np.ndarray:
        """What the input or sensor at a place carries, (t,): as recorded, or as simulated."""
        table, name = place.split(".")
        return (self.input if table == "inputs" else self.reading)[name]

    def per_segment(self, work: Callable[[np.ndarray, np.ndarray], np.ndarray], signal: np.ndarray) -> np.ndarray:
        """``work(time, signal)`` on every segment by itself."""
        return np.concatenate([work(self.time[part], signal[part]) for part in self.segments])

    def delayed(self, signal: np.ndarray, delay: float) -> np.ndarray:
        """A signal (t,) that comes ``delay`` s later."""
        return self.per_segment(lambda t, s: np.interp(t - delay, t, s), signal)

    def lagged(self, signal: np.ndarray, time_constant: float) -> np.ndarray:
        """A signal (t,) through a first-order lag."""
        a = float(np.exp(-self.step / time_constant))
        last = time_constant / self.step * (1 - a) - a
        return self.filtered([1 - a - last, last], [1, -a], signal)

    def filtered(self, b: list[float], a: list[float], signal: np.ndarray) -> np.ndarray:
        """A signal (t,) through a discrete filter that has settled at the first sample."""
        return self.per_segment(lambda _, s: scipy.signal.lfilter(b, a, s - s[0]) + s[0] * sum(b) / sum(a), signal)


@dataclass(frozen=True)
class Guess:
    """A first guess of an effect: what it would add to the model's equations along the motion without it.

    Attributes
    ----------
    additions : tuple of dict
        Each by place: ``inertias.…`` torque on it (t,), ``shafts.…`` further torque of it (t,), ``inputs.…`` further
        input (t,), ``sensors.…`` further reading (t,), or a quantity's full name with the change of its value.
        Their amplitudes a follow from least squares.
    parameters : callable
        Amplitudes a, one for each addition → parameters of the effect, or None if no such effect exists.
    chosen_from : float
        From how many independent guesses it was chosen by looking at the residual: the best of many lowers the misfit
        by more, also where there is only noise.
    """

    additions: tuple[Mapping[str, np.ndarray | float], ...]
    parameters: Callable[[np.ndarray], dict[str, float] | None]
    chosen_from: float = 1.0


def if_positive(name: str, factor: float = 1.0, **others: float) -> Callable[[np.ndarray], dict[str, float] | None]:
    """Parameters where ``name`` is ``factor`` times the amplitude, which must be positive."""
    return lambda a: {name: factor * float(a[0]), **others} if a[0] > 0 else None


def smooth_sign(speed: np.ndarray) -> np.ndarray:
    """Sign of a speed (t,), smoothed over a thousandth of its largest value."""
    return np.tanh(speed / (1e-3 * float(np.abs(speed).max()) + 1e-9))


# --- Places of effects: one ``table.name``, or several inputs or sensors that share one effect.

SHARED = "+"  # between the places of a shared effect; no name may hold it


def shared_place(places: Iterable[str]) -> str:
    """The place of an effect that several inputs or sensors share: ``sensors.a+sensors.b``."""
    return SHARED.join(places)


def members(at: str) -> tuple[str, ...]:
    """The inputs or sensors that share an effect; of any other place, itself."""
    return tuple(at.split(SHARED))


def place_in_file(at: str) -> str | list[str]:
    """A place as files write it: a text, of a shared effect a list of texts."""
    places = members(at)
    return list(places) if len(places) > 1 else at


def place_in_words(at: str) -> str:
    """A place for a sentence: ``sensors.a and sensors.b``."""
    *first, last = members(at)
    return f"{', '.join(first)} and {last}" if first else last


# --- What a recording has shown: the range in which an effect found in it must lie.

LONGEST_MEMORY_SHARE = 0.25  # of the recording: a longer delay or lag cannot be told from a start state
FEWEST_PERIODS = 1.0  # within the range of an angle: a torque over it has been recorded once as a whole
FEWEST_PASSES = 2.0  # periods over the whole path: it has been recorded to repeat


@dataclass(frozen=True)
class RecordedRange:
    """Ranges of a recording.

    Attributes
    ----------
    duration : float
        Longest time without a gap, s.
    torque : dict of str to float
        By inertia, N·m: no effect on it can be larger.
    largest_reading, width : dict of str to float
        By sensor, SI: largest magnitude, and largest minus smallest reading.
    turns : dict of str to float
        By inertia: over how many turns it moves, the path of all segments together.
    range_of_turns : dict of str to float
        By inertia: largest minus smallest angle of the segment that covers most, in turns.
    input_torque : float
        Largest torque of all inputs together, N·m.
    sensor_of : dict of str to str
        By sensor: the inertia or shaft that it measures.
    """

    duration: float
    torque: Mapping[str, float]
    largest_reading: Mapping[str, float]
    width: Mapping[str, float]
    turns: Mapping[str, float]
    range_of_turns: Mapping[str, float]
    input_torque: float
    sensor_of: Mapping[str, str] = field(default_factory=dict)

    def lowest_order(self, inertia: str) -> float:
        """Lowest order per turn of a torque that the recording shows to repeat over the angle of an inertia."""
        once = FEWEST_PERIODS / max(self.range_of_turns[inertia], 1e-9)
        return max(once, FEWEST_PASSES / max(self.turns[inertia], 1e-9))

    @property
    def longest_memory(self) -> float:
        """Longest delay or time constant that shows in the recording, s."""
        return LONGEST_MEMORY_SHARE * self.duration


# --- First guesses of a time by which a signal is late: short ones, from which a fit finds its way, and long ones.
#
# A signal that comes longer than a quarter of a period late differs from one in time by no more than one that comes
# later still. A fit then ends in the next local minimum, so the screening looks at long delays one by one.

SHORT_DELAYS = (1e-3, 4e-3, 1.6e-2, 6.4e-2)  # s
LONG_DELAYS = (0.25, 0.7, 2.0)  # s, as far as the recording can show them
SHORTEST_REFINED = 0.1  # s, of delays near which further ones are looked at
REFINED = np.geomspace(0.4, 2.5, 61)  # times the best delay, each 3 % longer than the one before

Change = Callable[[float], dict[str, np.ndarray | float]]  # delay in s → what it adds, by place


def late(motion: FittedMotion, at: str) -> Change:
    """What a delay adds to the signals of the inputs and sensors at a place."""
    signals = {place: motion.signal(place) for place in members(at)}
    return lambda delay: {place: motion.delayed(signal, delay) - signal for place, signal in signals.items()}


def first_delays(motion: FittedMotion, change: Change, key: str) -> Iterator[Guess]:
    """Delays of all magnitudes that the recording can show."""
    for delay in SHORT_DELAYS:
        yield Guess((change(delay),), if_positive(key, delay))
    yield from fixed_delays(motion, change, key, LONG_DELAYS)


def fixed_delays(
    motion: FittedMotion, change: Change, key: str, delays: Sequence[float], sign: float = 1.0
) -> Iterator[Guess]:
    """Long delays whose amplitude says nothing about their time: ``key`` is ``sign`` times the delay itself."""
    longest = LONGEST_MEMORY_SHARE * max(float(np.ptp(motion.time[part])) for part in motion.segments)
    for delay in delays:
        if delay < longest:
            yield Guess((change(delay),), _fixed(key, sign * delay))


def delays_near(motion: FittedMotion, change: Change, key: str, best: float, sign: float = 1.0) -> Iterator[Guess]:
    """Delays near the best one, if it is so long that a fit would not move from one to the next."""
    if abs(best) > SHORTEST_REFINED:
        yield from fixed_delays(motion, change, key, [float(d) for d in abs(best) * REFINED], sign)


def _fixed(key: str, value: float) -> Callable[[np.ndarray], dict[str, float] | None]:
    return lambda a: {key: value} if a[0] > 0 else None


# --- What an effect may read of a drivetrain and change in its equations; laws import nothing else of the program.
#
# The equations under construction (:class:`modelling.equations.lagrange.Assembly`) and the model
# (:class:`modelling.system.System`) fit the two protocols here.

Symbols = Mapping[str, sm.Symbol]


class Drivetrain(Protocol):
    """The model that an effect belongs to."""

    @property
    def parameters(self) -> Mapping[str, Any]:
        """Every quantity by its full name."""

    @property
    def shafts(self) -> Iterable[Any]:
        """Shafts, see :class:`modelling.system.Shaft`."""

    @property
    def inputs(self) -> Iterable[Any]:
        """Inputs, see :class:`modelling.system.Input`."""

    @property
    def sensors(self) -> Iterable[Any]:
        """Sensors, see :class:`modelling.system.Sensor`."""

    def places(self) -> Iterable[str]:
        """Every ``table.name``."""


class EquationBuilder(Protocol):
    """The equations while components and effects write into them."""

    q: list[sm.Symbol]
    qd: list[sm.Symbol]
    qdd: list[sm.Symbol]
    time: sm.Symbol
    parameters: dict[str, sm.Symbol]
    potential: dict[str, sm.Expr]
    springs: dict[str, Spring]
    motions: dict[str, Motion]

    @property
    def recording(self) -> sm.Symbol:
        """Number of the recording that is simulated, from 1 in the order of a fit; 0 of any other motion."""

    @property
    def creep(self) -> sm.Symbol:
        """Speed (rad/s) at which a held brake gives way under its full torque; 0 but in a controller."""

    def add_coordinate(self, name: str) -> Motion:
        """Add a degree of freedom."""

    def add_inertia(self, component: str, inertia: sm.Expr, motion: Motion) -> None:
        """Give a component its kinetic energy."""

    def add_state(self, name: str, derivative: Callable[[sm.Symbol], sm.Expr]) -> sm.Symbol:
        """Add a first-order state with its time derivative, as a function of its symbol."""

    def add_torque(self, component: str, torque: sm.Expr, motion: Motion) -> None:
        """Let a torque (N·m) act on a motion: it does virtual work on it, named after a component."""

    def load(self, place: str) -> sm.Expr:
        """The torque (N·m) that all inputs together put on the inertia at a place."""

    def impose(self, place: str, motion: Motion, acceleration: sm.Expr) -> None:
        """Let a motion have an acceleration (rad/s²) whatever torques act on it; a later one replaces an earlier."""

    def abbreviate(self, expression: sm.Expr) -> sm.Symbol:
        """A symbol for a constant expression of parameters and earlier abbreviations."""

    def symbol(self, name: str) -> sm.Expr:
        """The symbol of a parameter of the model; what effects make of it, where they replace or change it."""

    def sign(self, speed: sm.Expr) -> sm.Expr:
        """Sign of a speed (rad/s), smoothed over a stick speed that the simulation keeps small."""

    @property
    def follow_time(self) -> sm.Symbol:
        """Time (s) in which a limited rate follows where it may, which the simulation keeps small."""


@dataclass(frozen=True)
class Motion:
    """A rotation as a linear combination of coordinates: ``coefficients[i]`` is the coefficient of coordinate i."""

    coefficients: dict[int, sm.Expr]
    assembly: EquationBuilder = field(repr=False)

    def _sum(self, symbols: list[sm.Symbol]) -> sm.Expr:
        return sm.Add(*(coefficient * symbols[i] for i, coefficient in self.coefficients.items()))

    @property
    def angle(self) -> sm.Expr:
        """Angle, rad."""
        return self._sum(self.assembly.q)

    @property
    def speed(self) -> sm.Expr:
        """Speed, rad/s."""
        return self._sum(self.assembly.qd)

    @property
    def acceleration(self) -> sm.Expr:
        """Acceleration, rad/s²."""
        return self._sum(self.assembly.qdd)

    def __sub__(self, other: Motion) -> Motion:
        difference = dict(self.coefficients)
        for i, coefficient in other.coefficients.items():
            difference[i] = difference.get(i, sm.Integer(0)) - coefficient
        return Motion({i: c for i, c in difference.items() if c != 0}, self.assembly)

    def divided_by(self, ratio: sm.Expr) -> Motion:
        """The motion divided by a ratio."""
        return Motion({i: c / ratio for i, c in self.coefficients.items()}, self.assembly)


@dataclass(frozen=True)
class Spring:
    """A spring in small oscillations: tangent ``stiffness`` (N·m/rad), the ``twist`` it resists, its ``deflection``.

    Deflection and twist differ where a damper is in series with the spring.
    """

    stiffness: sm.Expr
    twist: Motion
    deflection: sm.Expr


@dataclass
class ShaftLaw:
    """The torque law of a shaft while effects shape it; closed by :func:`modelling.equations.shaft_law.close`.

    Attributes
    ----------
    place : str
        ``shafts.NAME``.
    first, second : Motion
        Of both ends, the first divided by the ratio.
    stiffness, damping : Expr
        N·m/rad, N·m·s/rad.
    rate : Symbol
        Placeholder of the twist rate (rad/s) until the law is closed.
    potentials : list of callable
        Twist → elastic energy.
    gap : Expr or None
        Free play, rad.
    series : Expr or None
        Coefficient of a damper in series, N·m·s/rad.
    series_state : str
        Name of the state that the damper in series adds, the deflection of the spring.
    quadratic : Expr
        Coefficient of damping in parallel that grows with the square of the rate, N·m·s²/rad².
    contact : pair of callable or None
        What passes on of the torque that spring, damper and parallel elements together would have: torque → torque,
        and the derivative of it. Goes with a damper in series.
    parallel, parallel_stiffness : list of Expr
        Torques of parallel elements, and their tangent stiffness for small oscillations about rest.
    losses : list of callable
        Torque of the closed law → torque (N·m) that is lost of it at the second end.
    torque : Expr
        All that the shaft transmits (N·m), once the law is closed.
    """

    place: str
    first: Motion
    second: Motion
    stiffness: sm.Expr
    damping: sm.Expr
    rate: sm.Symbol
    potentials: list[Callable[[sm.Expr], sm.Expr]]
    gap: sm.Expr | None = None
    series: sm.Expr | None = None
    series_state: str = ""
    contact: tuple[Callable[[sm.Expr], sm.Expr], Callable[[sm.Expr], sm.Expr]] | None = None
    quadratic: sm.Expr = sm.S.Zero
    parallel: list[sm.Expr] = field(default_factory=list)
    parallel_stiffness: list[sm.Expr] = field(default_factory=list)
    losses: list[Callable[[sm.Expr], sm.Expr]] = field(default_factory=list)
    torque: sm.Expr = sm.S.Zero

    def put_in_series(self, coefficient: sm.Expr, state: str) -> None:
        """Put a damper of a coefficient in series, whose spring's deflection is a state.

        Raises
        ------
        InputError
            If one is there.
        """
        if self.series is not None:
            raise ExcludedEffects(
                self.place, "slips twice", "leave out slip or tyre_slip, or put it on a shaft of its own"
            )
        self.series, self.series_state = coefficient, state


@dataclass(frozen=True)
class GearLaw:
    """What a rigid gear joins, reflected to its second end.

    Attributes
    ----------
    place : str
        ``gears.NAME``.
    second : Motion
        Of the second end.
    first_torque, second_torque : Expr
        All torques on the train on that side, N·m.
    first_inertia, second_inertia : Expr
        kg·m².
    """

    place: str
    second: Motion
    first_torque: sm.Expr
    first_inertia: sm.Expr
    second_torque: sm.Expr
    second_inertia: sm.Expr

    @property
    def torque(self) -> sm.Expr:
        """What the gear passes on where it loses nothing, N·m at the second end, positive when the first end leads."""
        taken = self.second_inertia * self.first_torque - self.first_inertia * self.second_torque
        return taken / (self.first_inertia + self.second_inertia)


@dataclass
class InputPath:
    """What happens to a recorded input before it acts on an inertia: ``value`` (N·m) acts ``delay`` (s) later."""

    place: str
    on: str
    value: sm.Expr
    delay: sm.Expr


@dataclass
class SensorPath:
    """What happens to the measured quantity before it is recorded: ``value`` (SI) is read ``delay`` (s) later.

    ``measures`` is the quantity, ``motion`` that of the inertia it is measured of, None of a shaft.
    """

    place: str
    value: sm.Expr
    delay: sm.Expr
    measures: str = ""
    motion: Motion | None = None


# --- What every effect states about itself: its places, parameters, law, and what it asks of a simulation or a fit.


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect: SI unit, physical bounds.

    The units ``"sensor"``, ``"sensor/s"`` and ``"quantity"`` stand for that of the place.
    """

    unit: str
    lower: float = -math.inf
    upper: float = math.inf
    optional: bool = False


class SimplerEffect(NamedTuple):
    """An effect that behaves like one with more parameters: kind, place, and parameters in SI."""

    kind: str
    at: str
    parameters: dict[str, float]


SECOND_STATE = ".2"  # after ``place.kind``: name of the second state of an effect that has two


@dataclass(frozen=True)
class State:
    """The first-order state that an effect adds to the model, named ``place.kind``.

    Attributes
    ----------
    unit : str
        SI unit; ``"signal"`` stands for that of the input or sensor it sits at.
    meaning : str
        For the description of an FMU, with ``{place}`` in it.
    settles : bool
        Whether it has one fixed value while inputs and motion stay constant, so that a simulation may start there.
    from_zero : bool
        It is 0 when a recording begins, and follows from time alone, see :meth:`Kind.state_after`: no fit changes it.
    """

    unit: str
    meaning: str
    settles: bool = False
    from_zero: bool = False


class Kind:
    """One kind of effect. A subclass sets the class attributes and overrides the law of the tables it can sit at.

    Attributes
    ----------
    kind : str
        Its name in model files.
    words : str
        Predicate of the place in reports, parameters in braces: ``"has {gap} of free play"``.
    in_recording : str
        How it looks in a recording, in one sentence for a test engineer.
    tables : tuple of str
        Tables of the model file that it can sit at.
    parameters : dict of str to Parameter
        By key of the model file.
    state : State or None
        The state it adds to the model.
    second_state : str
        What a second one, named ``place.kind.2`` and in the unit of the first, means; empty where there is none.
    linear : bool
        A linear model holds it completely.
    state_dependent : bool
        The eigenvalues of the linearised model depend on the state: steps are chosen along the motion.
    abrupt : bool
        The torque or its derivative jumps: a fit needs finer steps.
    sticks : bool
        Dry friction between an inertia and ground, whose sign changes over the stick speed.
    shareable : bool
        Several inputs or sensors may share it: one filter on two channels, one clock for a logger.
    follows : bool
        ``at`` lists two inertias: it acts on the first as the second turns.
    changes_quantity : bool
        What acts at its place is what :meth:`quantity` makes of the quantity there.
    replaces_quantity : bool
        Its parameter ``value`` replaces the quantity at its place; it adds nothing else to the equations.
    free_play : str
        The parameter that is the total free play of a shaft in rad, if it has one.
    speed_exponent : int or None
        Its only parameter times speed to this power is the torque that resists; None where it is another law.
    only_delays : bool
        Its only parameter is a time in s by which an input acts or a sensor reads later; nothing else changes.
    zero_of_recording : bool
        A zero that may differ between recordings: a recording that is not fitted gets its own, with its start state.
    by_recording : str
        The list that has an element for every fitted recording; a recording that is not fitted gets its own.
    is_clock : bool
        Its only parameter is by how many s the clock of a logger, whose channels share it, is late.
    rate_bound : str
        The parameter that bounds the rate of its state; what does not change does not meet it.
    looks_ahead : bool
        The law takes the delay of a filter of its own off the recording.
    imposes_motion : bool
        The inertia moves as recorded: an input on it is a motion, see :meth:`imposed_input`.
    sought : bool
        A diagnosis looks for it.
    slips : bool
        The two sides of its shaft may turn apart for ever: an inertia behind it need not follow.
    brakes : bool
        Its input is the torque of a brake: 0 or more, and against the motion.
    pedal : bool
        Its input is a pedal, 0 to 1. It comes before all other effects at the input.
    arrays : tuple of str
        Keys that files write as lists; their values are the parameters ``key_1``, ``key_2``, ….
    matrices : tuple of str
        Keys that files write as lists of rows; their values are the parameters ``key_1_1``, ``key_1_2``, ….
    zero_mean : tuple of str
        Parameters that scale a torque whose mean over a turn is zero; a steady state leaves them out.
    """

    kind: ClassVar[str] = ""
    words: ClassVar[str] = ""
    in_recording: ClassVar[str] = ""
    tables: ClassVar[tuple[str, ...]] = ()
    parameters: ClassVar[dict[str, Parameter]] = {}
    state: ClassVar[State | None] = None
    second_state: ClassVar[str] = ""
    linear: ClassVar[bool] = False
    state_dependent: ClassVar[bool] = False
    abrupt: ClassVar[bool] = False
    sticks: ClassVar[bool] = False
    shareable: ClassVar[bool] = False
    follows: ClassVar[bool] = False
    changes_quantity: ClassVar[bool] = False
    replaces_quantity: ClassVar[bool] = False
    free_play: ClassVar[str] = ""
    speed_exponent: ClassVar[int | None] = None
    only_delays: ClassVar[bool] = False
    zero_of_recording: ClassVar[bool] = False
    by_recording: ClassVar[str] = ""
    is_clock: ClassVar[bool] = False
    rate_bound: ClassVar[str] = ""
    looks_ahead: ClassVar[bool] = False
    imposes_motion: ClassVar[bool] = False
    slips: ClassVar[bool] = False
    sought: ClassVar[bool] = True
    brakes: ClassVar[bool] = False
    pedal: ClassVar[bool] = False
    arrays: ClassVar[tuple[str, ...]] = ()
    matrices: ClassVar[tuple[str, ...]] = ()
    zero_mean: ClassVar[tuple[str, ...]] = ()

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        """Change the torque law of a shaft."""
        raise NotImplementedError

    def gear(self, law: GearLaw, p: Symbols, assembly: EquationBuilder) -> None:
        """Add a torque at the second end of a rigid gear."""
        raise NotImplementedError

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        """Add a torque on an inertia; ``name`` is the place, of a kind that ``follows`` both of its places."""
        raise NotImplementedError

    def input(self, path: InputPath, p: Symbols, assembly: EquationBuilder) -> None:
        """Change what reaches the inertia of a recorded input."""
        raise NotImplementedError

    def imposed_input(self, path: InputPath, measures: str, motion: Motion, assembly: EquationBuilder) -> None:
        """Impose the ``speed`` or ``angle`` that an input holds on the motion of the inertia it sits on."""
        raise NotImplementedError

    def imposed_response(self, measures: str, s: np.ndarray) -> np.ndarray:
        """What the imposed motion is of what the input holds, at complex frequencies s, 1/s; 1 where it is exact."""
        raise NotImplementedError

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        """Change what a sensor reads."""
        raise NotImplementedError

    def quantity(self, value: Expr, p: Symbols, assembly: EquationBuilder, name: str) -> Expr:
        """What a quantity of this value becomes; ``name`` is that of the state."""
        raise NotImplementedError

    def state_after(self, seconds: float, parameters: Mapping[str, float]) -> float:
        """The state of a kind that begins ``from_zero``, so long after the start of a recording."""
        raise NotImplementedError

    def guesses(self, motion: FittedMotion, at: str) -> Iterable[Guess]:
        """First guesses of this effect at a place, from a motion without it; for screening and as starts of a fit."""
        if self.sought:
            raise NotImplementedError
        return ()

    def shared_guesses(self, motion: FittedMotion, at: str) -> Iterable[Guess]:
        """First guesses at one place or at several that share the effect: the same amplitude at each of them."""
        for guesses in zip(*(self.guesses(motion, place) for place in members(at)), strict=True):
            additions = tuple(
                {place: signal for addition in parts for place, signal in addition.items()}
                for parts in zip(*(guess.additions for guess in guesses), strict=True)
            )
            yield Guess(additions, guesses[0].parameters, max(guess.chosen_from for guess in guesses))

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterable[Guess]:
        """Further guesses near the best one, where a fit would not move from one to the other; by default none."""
        return ()

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterable[SimplerEffect]:
        """Effects of fewer parameters that behave alike at these values; by default none.

        A fit started there may reach such an effect where it does not from a first guess. ``value`` holds the
        quantities of the system by name.
        """
        return ()

    def akin(
        self, at: str, parameters: Mapping[str, float], motion: FittedMotion
    ) -> Iterable[tuple[str, str, dict[str, float]]]:
        """Kind, place and first values of effects that a search may have taken this one for; by default none.

        Far from the truth no first guess may reach such an effect; from the values of this one, a fit does. ``motion``
        is that of the fit that has it.
        """
        return ()

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        """Bounds of a parameter in a fit that starts from a guess, for data sampled every ``step`` s.

        By default the physical bounds.
        """
        parameter = self.parameters[key]
        if parameter.lower > 0:  # a scale: it may differ much from the guess, but not be 0
            guess = min(max(guess, parameter.lower), parameter.upper)
            return max(parameter.lower, guess / 20), min(parameter.upper, guess * 20)
        return parameter.lower, parameter.upper

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        """Bounds of a parameter from what a recording has shown; by default none."""
        return -math.inf, math.inf

    def bounds_in_recording(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        """:meth:`recorded_bounds` of an effect; of a shared one, those of its first place."""
        return self.recorded_bounds(key, at if self.follows else members(at)[0], recorded)

    def possible(self, parameters: Mapping[str, float]) -> bool:
        """Whether parameters within their bounds make sense together."""
        return True

    @property
    def file_keys(self) -> list[str]:
        """Keys of its parameters in model files."""
        lists = {*self.arrays, *self.matrices}
        return [*self.arrays, *self.matrices, *(key for key in self.parameters if not _elements_of(lists, key))]

    def parameter(self, key: str) -> Parameter:
        """What is known of the parameter at a key of a model file; of a list, of its first element."""
        end = "_1" if key in self.arrays else "_1_1" if key in self.matrices else ""
        return self.parameters[f"{key}{end}"]

    def fault(self, at: str, values: Mapping[str, float]) -> str:
        """What is wrong with parameters (SI) of a model file that are each within their bounds; empty if nothing."""
        return ""

    def canonical(self, parameters: dict[str, float]) -> dict[str, float]:
        """The same effect with its parameters in their usual range, e.g. a phase within ±π."""
        return parameters

    def unit(self, key: str, at: str, system: Drivetrain) -> str:
        """SI unit of the parameter ``key`` of this effect at the place ``at``."""
        unit = self.parameters[key].unit
        if unit == "quantity":
            return QUANTITY_UNITS[at.rsplit(".", 1)[1]]
        if unit.startswith("sensor"):
            reading = next(sensor.unit for sensor in system.sensors if f"sensors.{sensor.name}" in members(at))
            return reading + unit.removeprefix("sensor")
        return unit

    def state_unit(self, at: str, system: Drivetrain) -> str:
        """SI unit of the state of this effect at the place ``at``.

        Raises
        ------
        AttributeError
            If this kind has no state.
        """
        assert self.state is not None
        if self.state.unit != "signal":
            return self.state.unit
        return next((sensor.unit for sensor in system.sensors if f"sensors.{sensor.name}" in members(at)), "N*m")

    def places(self, system: Drivetrain) -> list[str]:
        """Every place of a system where this kind can sit by itself."""
        return [place for place in system.places() if place.split(".")[0] in self.tables]

    def candidate_places(self, system: Drivetrain) -> list[str]:
        """Those of :meth:`places` where a diagnosis looks for it."""
        return self.places(system) if self.sought else []

    def same_as(self, at: str, system: Drivetrain) -> Iterable[tuple[str, str]]:
        """Kinds and places that no recording can tell from this effect at a place; they are named with it."""
        return ()

    def shared_places(self, system: Drivetrain) -> list[str]:
        """Groups of sensors that may share it, as far as a diagnosis tries them: all that measure the same quantity.

        A group of all sensors is left out: whatever all of them have is the same at the inputs.
        """
        if not self.shareable or "sensors" not in self.tables:
            return []
        groups: dict[str, list[str]] = {}
        for sensor in system.sensors:
            groups.setdefault(sensor.measures, []).append(f"sensors.{sensor.name}")
        return [shared_place(group) for group in groups.values() if len(group) > 1] if len(groups) > 1 else []


def _elements_of(lists: Collection[str], key: str) -> bool:
    """Whether a parameter is an element of one of the lists, or lists of rows."""
    ahead, _, _ = key.rpartition("_")
    return ahead in lists or ahead.rpartition("_")[0] in lists


# --- Table

MOST_POINTS = 33
AXES = {"speed": "rad/s", "angle": "rad", "twist": "rad"}


class TorqueTable(Kind):
    """``torque`` over one of ``speed``, ``angle`` (inertia) or ``twist`` (shaft), linear between the points.

    It is constant beyond them. On an inertia it acts in positive direction; a shaft transmits it besides its spring.
    """

    kind = "table"
    words = "bears a torque that follows a table"
    in_recording = "the torque that is missing repeats over the same speed, angle or twist."
    tables = ("inertias", "shafts")
    arrays = (*AXES, "torque")
    parameters = {
        f"{key}_{i}": Parameter(unit, optional=True)
        for key, unit in {**AXES, "torque": "N*m"}.items()
        for i in range(1, MOST_POINTS + 1)
    }
    state_dependent = True
    sought = False  # it is what is kept where no cause explains

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        axis, points, torques = _points(p)
        assembly.add_torque(name, between(motion.speed if axis == "speed" else motion.angle, points, torques), motion)

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        _, points, torques = _points(p)
        law.potentials.append(lambda twist: _integral(twist, points, torques))

    def fault(self, at: str, values: Mapping[str, float]) -> str:
        axes = {key.rsplit("_", 1)[0] for key in values} - {"torque"}
        wanted = {"twist"} if at.startswith("shafts.") else {"speed", "angle"}
        if len(axes) != 1 or not axes <= wanted:
            return f"needs one list of {' or '.join(sorted(wanted))} beside torque"
        axis = axes.pop()
        points = [values[f"{axis}_{i}"] for i in range(1, MOST_POINTS + 1) if f"{axis}_{i}" in values]
        if len(points) < 2 or len(points) != sum(key.startswith("torque_") for key in values):
            return f"{axis} and torque need the same number of points, two at least"
        if not all(low < high for low, high in pairwise(points)):
            return f"the values of {axis} do not increase"
        return ""


def table_parameters(axis: str, points: Sequence[float], torques: Sequence[float]) -> dict[str, float]:
    """Parameters of a table over ``speed``, ``angle`` or ``twist``, SI by key.

    Points that are as good as equal are left out, and further ones beyond ``MOST_POINTS``.
    """
    kept: list[tuple[float, float]] = []
    for point, torque in zip(points, torques, strict=True):
        if not kept or point > kept[-1][0]:
            kept.append((point, torque))
    kept = kept[:MOST_POINTS]
    values = {f"{axis}_{i}": point for i, (point, _) in enumerate(kept, 1)}
    return values | {f"torque_{i}": torque for i, (_, torque) in enumerate(kept, 1)}


def _points(p: Symbols) -> tuple[str, list[Symbol], list[Symbol]]:
    """Name of the axis, its points and the torques there."""
    axis = next(key for key in AXES if f"{key}_1" in p)
    count = sum(key.startswith("torque_") for key in p)
    points, torques = ([p[f"{key}_{i}"] for i in range(1, count + 1)] for key in (axis, "torque"))
    return axis, points, torques


def between(x: Expr, points: Sequence[Expr], torques: Sequence[Expr]) -> Expr:
    """The torque at x: linear between points, constant beyond them."""
    total: Expr = torques[0]
    for (low, high), (first, last) in zip(pairwise(points), pairwise(torques), strict=True):
        total += (last - first) / (high - low) * (Abs(x - low) - Abs(x - high) + high - low) / 2
    return total


def _integral(x: Expr, points: list[Symbol], torques: list[Symbol]) -> Expr:
    """The integral of :func:`_between` over x, but for a constant."""
    total: Expr = torques[0] * x
    for (low, high), (first, last) in zip(pairwise(points), pairwise(torques), strict=True):
        bent = ((x - low) * Abs(x - low) - (x - high) * Abs(x - high)) / 2
        total += (last - first) / (high - low) * (bent + (high - low) * x) / 2
    return total
