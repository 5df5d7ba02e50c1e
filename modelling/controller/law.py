"""Control laws of feedback and feed-forward in the form of every structure, and what it watches on the bed."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy
from scipy.linalg import solve_discrete_are

from modelling.bed.bed import ControlLaw
from modelling.bed.foreign_vehicle import Followed, ForeignVehicleLaw
from modelling.bed.stepped import Emulation, Law, SteppedLaw, own_vehicle, shown_of
from modelling.bed.vehicle import FeedForward
from modelling.controller.tracking import Rotors, RotorTracker, Tracked, Tracking
from modelling.errors import NoDesign
from modelling.linear.state_space import StateSpace

# --- The sampled laws of feedback and of a feed-forward next to it.


def law_of_feedback(
    feedback: StateSpace, signs: np.ndarray, sensors: tuple[str, ...], known: tuple[str, ...], sample_time: float
) -> ControlLaw:
    """The law of a sampled feedback that knows no limits, made to follow what was sent.

    The difference between what was sent and what was asked for corrects the states as an observer would (Åström and
    Wittenmark, Computer-Controlled Systems, 1997, section 3.5); without a cut nothing changes.

    Parameters
    ----------
    feedback : StateSpace
        Inputs [flange torques (k), rotor speeds (k), known torques (w)], outputs commands (k).
    signs : ndarray (2k,)
        What a reading is multiplied by before it enters.
    sensors : tuple of str (2k)
    known : tuple of str (w)
    sample_time : float
        s.
    """
    count = len(signs)
    follow = _following(feedback.A, feedback.C)
    of_readings, of_known = feedback.B[:, :count] * signs, feedback.B[:, count:]
    direct, direct_known = feedback.D[:, :count] * signs, feedback.D[:, count:]
    x = len(feedback.A)
    return ControlLaw(
        feedback.A - follow @ feedback.C, of_readings - follow @ direct, of_known - follow @ direct_known, follow,
        feedback.C, direct, direct_known, np.zeros((x, count)), np.zeros((count, x)), sensors, known,
        feedback.outputs, sample_time,
    )  # fmt: skip


def _following(A: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Gain (x, k) with which the states follow the commands that were sent; 0 where the commands do not show them."""
    try:
        P = solve_discrete_are(A.T, C.T, np.eye(len(A)), np.eye(len(C)))
    except (np.linalg.LinAlgError, ValueError):
        return np.zeros((len(A), len(C)))
    return A @ P @ C.T @ np.linalg.inv(C @ P @ C.T + np.eye(len(C)))


def law_of_feed_forward(
    feed_forward: FeedForward, feedback: StateSpace, signs: np.ndarray, sensors: tuple[str, ...]
) -> ControlLaw:
    """The law of a model-based feed-forward whose model's readings the feedback acts on the deviations from.

    States [model and last command, commands on their way (oldest first), feedback]. What the limits cut off reaches
    the model, which then expects what the bed does.

    Parameters
    ----------
    feed_forward, feedback : FeedForward, StateSpace
        As in :func:`law_of_feedback`; known torques are those of the feed-forward.
    signs : ndarray (y,)
        As in :func:`law_of_feedback`.
    sensors : tuple of str
        As in :func:`law_of_feedback`.
    """
    names, delay = feedback.outputs, feed_forward.delay
    k, n, w, y = len(names), len(feed_forward.A), len(feed_forward.measured), len(sensors)
    rows = [feed_forward.outputs.index(f"{name} {what}") for what in ("torque", "speed") for name in names]
    expected, through = feed_forward.C[rows], feed_forward.D[rows]
    fifo, size = k * delay, n + k * delay + len(feedback.A)
    model, of_feedback = slice(0, n), slice(n + fifo, size)
    B, D = feedback.B[:, :y] * signs, feedback.D[:, :y] * signs
    of_state, of_known = feed_forward.gains()
    K, Kw = np.zeros((k, size)), of_known - D @ through
    K[:, : n + fifo] = of_state
    K[:, model] -= D @ expected
    K[:, of_feedback] = feedback.C
    A, Bw, By, Bs = np.zeros((size, size)), np.zeros((size, w)), np.zeros((size, y)), np.zeros((size, k))
    A[model, model], Bw[model] = feed_forward.A, feed_forward.W
    A[of_feedback, of_feedback], A[of_feedback, model], By[of_feedback], Bw[of_feedback] = (
        feedback.A,
        -B @ expected,
        B,
        -B @ through,
    )
    # the command as the model takes it: the command sent, less the part of the feedback
    part_x, part_w = np.zeros((k, size)), D @ through
    part_x[:, of_feedback], part_x[:, model] = -feedback.C, D @ expected
    if delay:
        A[model, n : n + k] = feed_forward.B
        A[n : n + fifo - k, n + k : n + fifo] = np.eye(fifo - k)
        newest = slice(n + fifo - k, n + fifo)
        A[newest], By[newest], Bw[newest], Bs[newest] = part_x, -D, part_w, np.eye(k)
    else:
        A[model] += feed_forward.B @ part_x
        By[model], Bs[model] = -feed_forward.B @ D, feed_forward.B
        Bw[model] = Bw[model] + feed_forward.B @ part_w
    E = np.zeros((y, size))
    E[:, model] = expected
    return ControlLaw(
        A, By, Bw, Bs, K, D, Kw, np.zeros((size, y)), E, sensors, feed_forward.measured, names,
        feed_forward.sample_time,
    )  # fmt: skip


# --- When a shaft counts as opened: readings leave what is expected as they do where its torque is gone.
#
# What an opened shaft, or a clutch in it, does to the readings over the first samples is as large as the torque that it
# carried. Weights on what the readings of the last samples are off from what the controller's model expects estimate
# the torque that was lost; the flange torques before these samples state what the shaft carried. An opened shaft has
# lost all of it; noise and driving torques that are not as measured seem to take a small share of it, or none. A lash
# that is crossed is an opened shaft for that time, but of a shaft whose torque has just changed its sign: so only
# shafts that have carried a torque for a while are judged.

WATCHED_SAMPLES = 5  # within which an opened shaft is to be noticed
IN_A_ROW = 2  # of these samples, so that a single wrong reading does not count
LARGEST_SHARE = 2.0  # of the carried torque that an opened shaft can seem to lose: more is something else


@dataclass(frozen=True)
class WatchedShafts:
    """How opened shafts are noticed; s shafts, y readings, k dynamometers.

    Attributes
    ----------
    shafts : tuple of str (s)
    lost : ndarray (s, WATCHED_SAMPLES · y)
        Torque that was lost, N·m, by what the readings are off from what is expected: those of the newest sample first.
    carried : ndarray (s, k)
        Torque of the shaft, N·m, by flange torques in steady motion.
    carried_samples : int
        For which a shaft has to have carried its torque before it is judged.
    """

    shafts: tuple[str, ...]
    lost: np.ndarray
    carried: np.ndarray
    carried_samples: int


@dataclass(frozen=True)
class OpenedShaft:
    """How the opening of a shaft is noticed.

    Attributes
    ----------
    shaft : str
    noticed_by : str
        ``lost_torque``, ``opened_torque`` (settings of the controller), or nothing: not within five samples.
    from_torque : float or None
        N·m in the shaft that have to be carried.
    why_not : str
        In words, where it is not noticed.
    """

    shaft: str
    noticed_by: str
    from_torque: float | None
    why_not: str = ""

    @property
    def words(self) -> str:
        """For people."""
        if self.noticed_by:
            return f"{self.shaft}: noticed by {self.noticed_by} from {self.from_torque:.3g} N·m in it on"
        return f"{self.shaft}: not noticed within five samples; {self.why_not}"


def nothing_watched(readings: int, dynamometers: int) -> WatchedShafts:
    """Of a controller that cannot tell an opened shaft from anything else."""
    return WatchedShafts((), np.zeros((0, WATCHED_SAMPLES * readings)), np.zeros((0, dynamometers)), 1)


class ShaftWatch:
    """Judges the watched shafts, sample by sample."""

    def __init__(self, watched: WatchedShafts):
        self.watched = watched
        self.reset()

    def reset(self) -> None:
        """Forget what the shafts carried."""
        count = len(self.watched.shafts)
        self._carried_for = np.zeros(count, int)  # samples, negative where the torque is
        self._seems_open = np.zeros(count, int)  # samples in a row

    def opened(self, deviations: np.ndarray, before: np.ndarray, least: np.ndarray, share: float) -> np.ndarray:
        """Which shafts (s,) have opened, as bool.

        Parameters
        ----------
        deviations : ndarray (WATCHED_SAMPLES · y,)
            Readings less what is expected, the newest sample first.
        before : ndarray (k,)
            Flange torques a sample before the oldest of these, N·m.
        least : ndarray (s,)
            N·m: shafts that carried no more are not judged.
        share : float
            Of the carried torque that an opened shaft seems to lose at least.
        """
        carried, enough = self.watched.carried @ before, self.watched.carried_samples
        longer = np.where(carried > 0, np.maximum(self._carried_for, 0) + 1, np.minimum(self._carried_for, 0) - 1)
        self._carried_for = np.where(np.abs(carried) > least, np.clip(longer, -enough, enough), 0)
        size, lost = np.abs(carried), self.watched.lost @ deviations * np.sign(carried)
        seems = (np.abs(self._carried_for) >= enough) & (lost > share * size) & (lost < LARGEST_SHARE * size)
        self._seems_open = np.where(seems, self._seems_open + 1, 0)
        opened: np.ndarray = self._seems_open >= IN_A_ROW
        return opened


# --- What the supervision of a controller needs to know: limits, speed hold, when to give up.

ZERO_TORQUE, SPEED_HOLD, EMULATION, CHANNEL_CHECK = 0, 1, 2, 3  # modes
FAULTS = ("none", "not finite", "missing", "frozen", "overspeed", "torque gone", "unexpected", "not delivered")
OVERSPEED, TORQUE_GONE, UNEXPECTED, NOT_DELIVERED = 4, 5, 6, 7
# Faults after which the speeds are still known: speed hold; after others zero torque.
HOLDABLE = (OVERSPEED, TORQUE_GONE, UNEXPECTED, NOT_DELIVERED)
# s that the exponential means hold from which an emulation begins. Twice the mean less the mean of the mean follows a
# hold that still comes to its speed without a lag (double exponential smoothing), and leaves a sixth of one sample's
# noise at 1 kHz; what is left of it the observer estimates. Chosen by trial.
MEAN_S = 0.05
SAMPLES_IN_A_ROW = 2  # in which two readings at once have to be unexpected: then the model does not hold
MEAN_OF_OFF = 10  # samples that the mean of what a reading is off from what is expected holds
MEAN_SHARE = 0.25  # of the allowed: how far that mean may be off. Healthy beds reached 0.09 in drives of every kind
RIDE_THROUGH_S = 0.02  # for which emulation goes on without a reading that is refused. Chosen by trial
DELIVERY_S = 0.2  # time constant over which commanded and delivered torque are compared: noise of speeds is 2 N·m then
UNDELIVERED_S = 0.05  # for which they have to differ. Both chosen by trial
UNDELIVERED_SHARE = 0.15  # of the commanded torque: five times the 3 % by which a torque gain may be off unless stated
FADE_S = 0.5  # time constant with which the torque of a rotor ends whose speed is not trusted. Chosen by trial
EVEN_LIFE = 100  # samples in which the sign of life rose by one: then a larger rise is samples that did not run
LIFE_S = 0.05  # without a change of the sign of life, after which it counts as missing
HELD_BELOW_LIMIT = 0.95  # of the largest speed: what is held after an overspeed
NO_LIMIT = 1e12  # N·m, rad/s: larger than anything on a bed, and finite, as FMI wants it
SLOWEST = 1e-6  # rad/s: power limits no torque below it
CHECK_TORQUE_SHARE = 0.08  # of the torque limit: friction of 3 % of the rated torque is overcome
CHECK_SPEED_SHARE = 0.1  # of the speed limit, which no speed passes before the channels are known
OPENED_SHARE = 0.5  # of the torque that it carried that an opened shaft seems to lose at least
TURNING = 1.0  # rad/s: a rotor that turns faster cannot have readings that do not change


@dataclass(frozen=True)
class Settings:
    """Limits and thresholds; k dynamometers, y readings, s shafts that are watched.

    Attributes
    ----------
    torque_limit, speed_limit, power_limit : ndarray (k,)
        N·m, rad/s, W: air-gap torques stay within torque and power.
    hold_proportional, hold_integral : ndarray (k,)
        N·m·s/rad, N·m/rad of the speed hold.
    lost_torque : ndarray (k,)
        N·m: a flange torque above it that is gone at once is a broken shaft, see :func:`has_gone`.
    torque_gain : ndarray (k,)
        Air-gap torque over command as calibrated: commands are divided by it.
    curve_speeds, curve_torques : ndarray (p,)
        rad/s, N·m: largest torque over speed of every dynamometer, straight between the points.
    check_torque, check_speed : ndarray (k,)
        N·m, rad/s: while the channels are checked, commands stay within that torque, and a faster rotor is overspeed.
    opened_torque : ndarray (s,)
        N·m: a watched shaft that carries more and loses it counts as opened, see :class:`ShaftWatch`.
    unexpected : ndarray (y,)
        How far a reading may be from what the controller's model expects, in its unit; :data:`MEAN_SHARE` of it as a
        mean over :data:`MEAN_OF_OFF` samples. A reading that is further off is refused.
    ride_samples : int
        So many samples emulation goes on without a reading that is refused; 0 switches refusing off.
    undelivered_share : float
        Part of the commanded air-gap torque, where that is above ``lost_torque``, that may be missing or too much by
        what flange and rotor say, see :class:`modelling.controller.tracking.Rotors`; 0 switches it off.
    frozen_samples : int
        So many samples with the same readings on a turning bed stop the emulation; 0 switches it off.
    opened_share : float
        Of the torque that it carried that an opened shaft loses at least.
    life_samples : int
        So many samples without a change of the sign of life stop the emulation; 0 switches it off.
    """

    torque_limit: np.ndarray
    speed_limit: np.ndarray
    hold_proportional: np.ndarray
    hold_integral: np.ndarray
    lost_torque: np.ndarray
    torque_gain: np.ndarray
    unexpected: np.ndarray
    power_limit: np.ndarray
    curve_speeds: np.ndarray
    curve_torques: np.ndarray
    check_torque: np.ndarray
    check_speed: np.ndarray
    opened_torque: np.ndarray = field(default_factory=lambda: np.zeros(0))
    opened_share: float = OPENED_SHARE
    undelivered_share: float = UNDELIVERED_SHARE
    frozen_samples: int = 4
    life_samples: int = 0
    ride_samples: int = 0


# --- When a flange torque counts as gone: a shaft broke, or a clutch at the flange opened.

REMEMBERED_SAMPLES = 3  # a torque gone within so many samples has gone at once
AVERAGED_SAMPLES = 3  # what a break leaves at the flange swings on about zero: the mean of so many samples shows it
KEPT_SAMPLES = 4  # torques kept: those of the mean but for the newest, and two before them
GONE = 0.2  # of the torque before: what is left of it counts as none


def has_gone(recent: np.ndarray, least: np.ndarray, left: float = GONE) -> np.ndarray:
    """Which flange torques are gone.

    Parameters
    ----------
    recent : ndarray (KEPT_SAMPLES + 1, …, k)
        Torques in N·m, the newest first.
    least : ndarray (k,)
        N·m: torques that were not larger are not judged.
    left : float
        Share of the torque before that counts as none.

    Returns
    -------
    ndarray of bool (…, k)
    """
    size = np.abs(recent)
    before = size[1 : 1 + REMEMBERED_SAMPLES].max(axis=0)
    at_once = (before > least) & (size[0] < left * before)
    earlier = size[AVERAGED_SAMPLES:].max(axis=0)
    about_zero = (earlier > least) & (np.abs(recent[:AVERAGED_SAMPLES].mean(axis=0)) < left * earlier)
    return at_once | about_zero


# --- The controller with its supervision, sample by sample, in Python: what the C sources have to equal.
#
# Four modes: zero torque, speed hold, emulation, and the check of the channels, in which no reading is fed back: small
# torques are commanded as they are asked for, whatever sign or unit the channels have. Emulation begins from the mean
# of the readings, known torques and commands before it, so it begins without a bump at any
# steady speed. What goes wrong ends it: readings that do not come or do not change, a rotor too fast, a torque that is
# gone at once, a shaft that opens, or readings that are not what the controller's model expects. A single reading that
# is not finite or far from what is expected is refused in its first sample, and emulation goes on with what the model
# says in its place; after a short time it ends, too. Then the speeds are held by the sensors that are right, or, where
# they are not known any more, the torque is zero, until zero torque is asked for.


@dataclass(frozen=True)
class Answer:
    """Commands (k,), N·m; the mode that is active and the fault that ended the emulation, numbers of
    :mod:`modelling.controller.law`."""

    commands: np.ndarray
    mode: int
    fault: int


def mean_samples(sample_time: float) -> int:
    """Samples that the means hold from which an emulation begins; ``sample_time`` in s."""
    return max(round(MEAN_S / sample_time), 1)


def undelivered_samples(sample_time: float) -> int:
    """Samples in a row in which the delivered torque has to differ; ``sample_time`` in s."""
    return max(round(UNDELIVERED_S / sample_time), 1)


class SupervisedController:
    """A control law with its supervision.

    Parameters
    ----------
    law : ControlLaw or SteppedLaw
    settings : Settings
    torque_readings, speed_readings : sequence of int (k)
        Which readings are the dynamometers' flange torques, −1 without a flange, and speeds.
    watched : WatchedShafts
        Shafts whose opening is noticed.
    by_others : ndarray (k, y), optional
        See :class:`ExportedController`.
    learned : ndarray (n, k), optional
        See :class:`ExportedController`.
    rotors : Rotors, optional
    tracking : Tracking, optional
        How drifts are tracked; without it none is a warning.
    """

    def __init__(
        self, law: Law, settings: Settings, torque_readings: list[int],
        speed_readings: list[int], watched: WatchedShafts, by_others: np.ndarray | None = None,
        learned: np.ndarray | None = None, rotors: Rotors | None = None, tracking: Tracking | None = None,
    ):  # fmt: skip
        self._rotors = Rotors.unknown(len(speed_readings)) if rotors is None else rotors
        self._tracking = Tracking.unknown(len(speed_readings)) if tracking is None else tracking
        self._by_others = np.zeros((len(speed_readings), len(law.sensors))) if by_others is None else by_others
        self._learned = np.zeros((0, 0)) if learned is None else learned
        self.law, self.settings, self._watch = law, settings, ShaftWatch(watched)
        self._torques, self._speeds = torque_readings, speed_readings
        own = own_vehicle(law)
        self.road = np.zeros(0) if own is None else own.as_planned  # may change at any time
        self.reset()

    def reset(self) -> None:
        """Back to zero torque, everything forgotten."""
        k, y = len(self.law.dynamometers), len(self.law.sensors)
        self._mode, self._fault, self._fallback = ZERO_TORQUE, 0, ZERO_TORQUE
        self._sent, self._integral, self._held = np.zeros(k), np.zeros(k), np.zeros(k)
        self._state = np.zeros(self.law.states)
        self._start = np.zeros(y), np.zeros(len(self.law.known)), np.zeros(k)
        # now, when it began, and the torques at the cuts then
        self._emulation: tuple[Emulation, Emulation, np.ndarray] | None = None
        if isinstance(self.law, SteppedLaw) and not isinstance(self.law, ForeignVehicleLaw):
            begun, cut = self.law.begin(np.zeros(y), np.zeros(k))
            self._emulation = begun, begun, cut
        # of a vehicle that is stepped outside: what is kept, where it began, torques into it and those that hold it
        self._followed: Followed | None = None
        self._follow_start = np.zeros(k), np.zeros(k), 0.0
        self.cut_torque, self._held_cut, self._cut_integral = np.zeros(k), np.zeros(k), np.zeros(k)
        self._last, self._averaged = np.zeros(y), 0
        # of readings, known torques and commands, and the means of these means
        self._means, self._slow = ((np.zeros(y), np.zeros(len(self.law.known)), np.zeros(k)) for _ in range(2))
        self._mean_samples = mean_samples(self.law.sample_time)
        self._past_torques = np.zeros((max(KEPT_SAMPLES, WATCHED_SAMPLES), k))
        self._deviations = np.zeros((WATCHED_SAMPLES, y))
        self._watch.reset()
        self._gone = np.zeros(k, bool)
        self._unchanged = self._lifeless = self._surprised = 0
        self._off_mean, self._lost = np.zeros(y), np.zeros(y, int)  # of what readings are off; samples refused in a row
        self._refused, self._distrusted = np.zeros(y, bool), np.zeros(y, bool)  # now; since a fault
        self._seen, self._holdable = np.zeros(y), False  # readings as they are used; the speeds were known at a fault
        self.sensor = -1  # the reading that led to the last fault, −1 without one
        self._life: int | None = None
        self._even_life = self.missed_samples = 0  # the latter of this emulation, see `_catch_up`
        self._triggered, self._played = False, 0  # samples since the trigger, 0 before it
        self._past_sent = np.zeros((self._rotors.kept, k))
        self._delivery: np.ndarray | None = None  # (3, k): command as it acts, flange torque, speed, alike filtered
        self._undelivered_for = np.zeros(k, int)
        self._missed = False  # samples were caught up with in this one
        self._trackers = [RotorTracker(self._rotors, self._tracking, j, self.law.sample_time) for j in range(k)]
        self.reason = ""  # of the last fault, where one reading led to it: which, and how far it was off

    def step(
        self, readings: np.ndarray, known: np.ndarray, mode: int, hold: np.ndarray, life: int = 0,
        added: np.ndarray | None = None, trigger: bool = False, wheel: np.ndarray | None = None, shifting: bool = False,
    ) -> Answer:  # fmt: skip
        """One sample.

        Parameters
        ----------
        readings, known, hold : ndarray (y,), (w,), (k,)
            Readings in SI, known torques (N·m), speeds to hold (rad/s).
        mode : int
            That is asked for. Zero torque also ends a fault that is over.
        life : int
            A number that changes from sample to sample as long as the sender lives.
        added : ndarray (k,), optional
            Torques, N·m, that speed hold and emulation add to their own and the check of the channels commands alone.
        trigger : bool
            From false to true: the manoeuvre begins, and what was learned of it is played.
        wheel : ndarray (k,), optional
            Speeds, rad/s, that a vehicle which is stepped outside gives at the cuts; :attr:`cut_torque` goes to it.
        shifting : bool
            The specimen shifts, or a clutch of it may open: a torque that is gone meanwhile is no broken shaft.
        """
        added = np.zeros(len(self._sent)) if added is None else added
        self._wheel = np.zeros(len(self._sent)) if wheel is None else wheel
        if np.isfinite(known).all() and np.isfinite(self._wheel).all():
            self._catch_up(known, life, trigger)
        fault = self._check(readings, known, np.concatenate([hold, added]), life, shifting)
        readings, below = self._seen, HELD_BELOW_LIMIT * self.settings.speed_limit
        if fault and not self._fault and self._mode != ZERO_TORQUE:
            self._fault, self._holdable = fault, self._mode != CHANNEL_CHECK
            self._fallback = SPEED_HOLD if fault in HOLDABLE and self._holdable else ZERO_TORQUE
            self._held = np.clip(readings[self._speeds], -below, below) if fault in HOLDABLE else self._held
        elif fault and fault not in HOLDABLE:
            self._fallback = ZERO_TORQUE
        elif fault == OVERSPEED and self._fault and self._fallback == ZERO_TORQUE and self._holdable:
            # without torque the rotors run away, and their speeds are known: they are held
            self._fallback, self._held = SPEED_HOLD, np.clip(readings[self._speeds], -below, below)
        if not fault and mode == ZERO_TORQUE:
            self._fault, self._distrusted = 0, np.zeros(len(readings), bool)
        unknown = bool(fault) and fault not in HOLDABLE
        wanted = self._fallback if self._fault else mode
        self._enter(ZERO_TORQUE if unknown else wanted, readings, known, hold)
        self._follow_trigger(trigger)
        self._sent = self._command(readings, known, hold, added)
        if isinstance(self.law, ForeignVehicleLaw):
            self._drive_vehicle(readings, unknown)
        if not np.isfinite(self._sent).all():  # a law that has left all bounds
            self._mode, self._fault, self._fallback = ZERO_TORQUE, 1, ZERO_TORQUE
            self._sent = np.zeros(len(self._sent))
        if not unknown:
            if self._mode != EMULATION:
                self._average(readings, known)
            self._follow_delivery(readings)
            self._last = readings.copy()
            self._past_torques = np.vstack([self._flange_torques(readings), self._past_torques[:-1]])
        return Answer(self._sent / self.settings.torque_gain, self._mode, self._fault)

    @property
    def tracked(self) -> list[Tracked]:
        """What is known of torque gain, flange zero and dead time of each dynamometer (k)."""
        return [tracker.tracked for tracker in self._trackers]

    @property
    def vehicle(self) -> Emulation:
        """What the emulated vehicle does, as the last sample left it."""
        assert self._emulation is not None
        return self._emulation[0]

    def shown(self) -> np.ndarray:
        """What the emulated vehicle does (e,), as the last sample left it: see
        :func:`modelling.bed.stepped.shown_of`; NaN while nothing is emulated."""
        vehicle = own_vehicle(self.law)
        if vehicle is None or self._mode != EMULATION:
            return np.full(len(shown_of(self.law)), np.nan)
        now = self.vehicle
        tyres = vehicle.outputs(
            now.vehicle, np.zeros(len(self._sent)), np.zeros(len(vehicle.inputs)), self.road
        ).full()  # fmt: skip
        speed = vehicle.radius * vehicle.body @ now.vehicle
        return np.r_[speed, now.distance, vehicle.wheel @ now.vehicle, tyres[: 2 * len(vehicle.tyres), 0]]

    def _drive_vehicle(self, readings: np.ndarray, unknown: bool) -> None:
        """Torques at the cuts of a vehicle that is stepped outside.

        In emulation they are those of the law. In speed hold they run the vehicle to the rotors' speeds, elsewhere
        there are none.
        """
        law = self.law
        assert isinstance(law, ForeignVehicleLaw)
        if self._mode == EMULATION:
            assert self._followed is not None
            self.cut_torque = self._followed.cut_torque
        elif self._mode == SPEED_HOLD and not unknown:
            own, slower = law.run_in, law.started(readings) - self._wheel
            slower = np.where(np.isfinite(slower), slower, 0.0)
            asked = own.proportional * slower + self._cut_integral
            self.cut_torque = np.clip(asked, -own.largest, own.largest)
            within = asked == self.cut_torque
            self._cut_integral = self._cut_integral + within * own.integral * law.sample_time * slower
            samples = min(self._averaged + 1, self._mean_samples)
            self._held_cut = self._held_cut + (self.cut_torque - self._held_cut) / samples
        else:
            self.cut_torque = self._held_cut = self._cut_integral = np.zeros(len(self._sent))

    def _follow_trigger(self, trigger: bool) -> None:
        if trigger and not self._triggered:
            self._played = 1
        elif 0 < self._played <= len(self._learned):
            self._played += 1
        self._triggered = trigger

    def _catch_up(self, known: np.ndarray, life: int, trigger: bool) -> None:
        """Samples of an emulation that did not run: a sign of life that rises by one a sample tells how many.

        The bed held the last commands in them; law and vehicle are stepped with these and the readings that the model
        expects.
        """
        risen = 0 if self._life is None else (life - self._life) % 2**32
        settings, before = self.settings, self.missed_samples
        if self._mode != EMULATION:
            self.missed_samples = before = 0
        elif 1 < risen <= settings.ride_samples + 1 and settings.life_samples and self._even_life >= EVEN_LIFE:
            for _ in range(risen - 1):
                self._follow_trigger(trigger)
                self._emulate(self._start[0] + self.law.E @ self._state, known, (self._sent, self._sent), 0.0)
                self.missed_samples += 1
        self._missed = self.missed_samples > before
        if risen == 1:
            self._even_life = min(self._even_life + 1, 2 * EVEN_LIFE)
        elif risen > 1:
            self._even_life = max(self._even_life - 2, 0)

    def _check(self, readings: np.ndarray, known: np.ndarray, asked: np.ndarray, life: int, shifting: bool) -> int:
        """The first of :data:`FAULTS` that shows."""
        settings = self.settings
        self._lifeless = self._lifeless + 1 if life == self._life else 0
        self._life = life
        self._refused[:] = False
        self._seen = readings.copy()
        if not all(np.isfinite(each).all() for each in (known, asked, self.road)) or (self.road[:-1] <= 0).any():
            return 1  # friction and mass are above 0
        if self._mode == EMULATION:
            self._refuse(readings)
        elif self._distrusted.any():
            self._replace_speeds()
        if not np.isfinite(self._seen).all():
            self.sensor = int(np.argmin(np.isfinite(self._seen)))
            return 1
        if 0 < settings.life_samples <= self._lifeless:
            return 2
        speeds = np.abs(self._seen[self._speeds])
        still = np.array_equal(readings, self._last) and (speeds > TURNING).any()
        self._unchanged = self._unchanged + 1 if still else 0
        if 0 < settings.frozen_samples <= self._unchanged:
            return 3
        fastest = settings.check_speed if self._mode == CHANNEL_CHECK else settings.speed_limit
        if (speeds > fastest).any():
            at = int(np.argmax(speeds / fastest))
            self._why(self._speeds[at], self._seen, fastest[at])
            return OVERSPEED
        if self._mode != EMULATION:
            self._surprised = 0
            return 0
        if not np.isfinite(self._wheel).all():  # of the vehicle, while what the bed reads is right
            self.sensor, self.reason = -1, "the speed of the vehicle at a cut is not finite"
            return UNEXPECTED
        expected = self._start[0] + self.law.E @ self._state
        self._deviations = np.vstack([self._seen - expected, self._deviations[:-1]])
        # a torque that is gone is no wrong reading: it counts as it is read
        if self._has_lost_torque(np.where(np.isfinite(readings), readings, self._seen), shifting):
            self._why(self._torques[int(np.argmax(self._gone))], readings, None)
            return TORQUE_GONE
        off = np.abs(self._deviations[0]) > settings.unexpected
        together = self._refused.sum() > 1 or off.any()
        self._surprised = self._surprised + 1 if together else 0
        wrong = self._refused | off
        if wrong.any():
            at = int(np.argmax(np.where(wrong, self._lost, -1)))
            self._why(at, readings, settings.unexpected[at], expected[at])
        if self._surprised >= SAMPLES_IN_A_ROW:
            # the model does not hold: what is read counts, but for speeds that right ones determine or contradict
            self._distrusted = self._refused & ~np.isfinite(readings)
            self._seen = np.where(np.isfinite(readings), readings, self._seen)
            self._distrust_contradicted()
            self._replace_speeds()
            return UNEXPECTED if np.isfinite(self._seen).all() else 1
        if settings.ride_samples and self._lost.max() >= settings.ride_samples:
            self._distrusted = self._refused.copy()
            for j, at in enumerate(self._torques):  # a false speed contradicts the torque: hold neither of them true
                if at >= 0 and self._refused[at] and (self._by_others[j] != 0).any():
                    self._distrusted[self._speeds[j]] = True
            self._replace_speeds()
            return UNEXPECTED if np.isfinite(self._seen).all() else 1
        return NOT_DELIVERED if self._is_undelivered() else 0

    def _follow_delivery(self, readings: np.ndarray) -> None:
        """Filter what was commanded, as it acts now, what the flange says and how fast the rotor turns, all alike."""
        self._past_sent = np.vstack([self._sent, self._past_sent[:-1]])
        now = np.stack([
            self._rotors.acting(self._past_sent), self._flange_torques(readings), readings[self._speeds],
        ])  # fmt: skip
        before = now if self._delivery is None else self._delivery
        self._delivery = before + self.law.sample_time / DELIVERY_S * (now - before)
        counts = self._mode == EMULATION and not self._missed and not self._refused.any()
        for tracker, judged, (acting, flange, speed) in zip(
            self._trackers, self._rotors.inertia > 0, now.T.tolist(), strict=True
        ):
            if judged:
                tracker.step(acting, flange, speed, counts and abs(speed) > TURNING)

    def _is_undelivered(self) -> bool:
        """Torque of the flange and the rotor's own inertia say another air-gap torque than was commanded."""
        rotors, settings = self._rotors, self.settings
        if self._delivery is None:
            return False
        sent, flange, speed = self._delivery
        rate = (self._last[self._speeds] - speed) / DELIVERY_S
        delivered = rotors.air_torque(rate, speed, flange)
        judged = (rotors.inertia > 0) & (np.abs(sent) > settings.lost_torque) & (settings.undelivered_share > 0)
        off = judged & (np.abs(delivered - sent) > settings.undelivered_share * np.abs(sent))
        self._undelivered_for = np.where(off, self._undelivered_for + 1, 0)
        at = int(np.argmax(self._undelivered_for))
        if self._undelivered_for[at] < undelivered_samples(self.law.sample_time):
            return False
        self.sensor = self._torques[at]
        self.reason = f"{delivered[at]:.4g} N·m act on a rotor, {sent[at]:.4g} N·m were commanded"
        return True

    def _refuse(self, readings: np.ndarray) -> None:
        """Refuse readings that are not finite or far from what the model expects, at once or in the mean."""
        settings, expected = self.settings, self._start[0] + self.law.E @ self._state
        finite = np.isfinite(readings)
        off = np.where(finite, readings, expected) - expected
        counted = np.clip(off, -settings.unexpected, settings.unexpected)  # a jump that is over leaves the mean soon
        self._off_mean = self._off_mean + np.where(finite, counted - self._off_mean, 0.0) / MEAN_OF_OFF
        if not settings.ride_samples:
            return
        far = (np.abs(off) > settings.unexpected) | (np.abs(self._off_mean) > MEAN_SHARE * settings.unexpected)
        self._refused = far | ~finite
        self._lost = np.where(self._refused, self._lost + 1, 0)
        self._seen = np.where(self._refused, expected, readings)

    def _distrust_contradicted(self) -> None:
        """Trust no rotor's speed any more that is furthest from what the others say, and further than is allowed, nor
        one that was refused where the others were not."""
        apart = np.abs(self._seen[self._speeds] - self._by_others @ self._seen)
        apart = np.where((self._by_others != 0).any(axis=1), apart / self.settings.unexpected[self._speeds], 0.0)
        if len(apart) and apart.max() > 1:
            self._distrusted[self._speeds[int(np.argmax(apart))]] = True
        for j, at in enumerate(self._speeds):
            used = self._by_others[j] != 0
            if self._refused[at] and used.any() and not self._refused[used].any():
                self._distrusted[at] = True

    def _replace_speeds(self) -> None:
        """Speeds of rotors whose sensors are not trusted, by the others; not finite where these do not determine them.

        Other readings that are not trusted count as 0: speed hold does not use them.
        """
        others = np.where(self._distrusted, np.nan, self._seen)
        self._seen = np.where(self._distrusted, 0.0, self._seen)
        for j, at in enumerate(self._speeds):
            if self._distrusted[at]:
                used = self._by_others[j] != 0
                self._seen[at] = self._by_others[j, used] @ others[used] if used.any() else np.nan

    def _why(self, at: int, readings: np.ndarray, limit: float | None, expected: float | None = None) -> None:
        """Note which reading led to a fault, and by how much."""
        self.sensor = at
        parts = [f"{self.law.sensors[at]} reads {readings[at]:.4g}"]
        if expected is not None:
            parts.append(f"{expected:.4g} ± {limit:.3g} was expected")
        elif limit is not None:
            parts.append(f"{limit:.4g} is the limit")
        self.reason = ", ".join(parts)

    def _flange_torques(self, readings: np.ndarray) -> np.ndarray:
        """Torques (k,) of the flanges; 0 without one, which never seems lost."""
        return np.array([readings[at] if at >= 0 else 0.0 for at in self._torques])

    def _has_lost_torque(self, readings: np.ndarray, shifting: bool) -> bool:
        """A flange torque is gone, or a shaft has opened; not where a clutch may open."""
        if shifting:
            self._gone[:] = False
            self._watch.reset()
            return False
        settings, before = self.settings, self._past_torques
        self._gone = has_gone(np.vstack([self._flange_torques(readings), before[:KEPT_SAMPLES]]), settings.lost_torque)
        opened = self._watch.opened(
            self._deviations.ravel(), before[WATCHED_SAMPLES - 1], settings.opened_torque, settings.opened_share
        )
        self._gone |= (self._watch.watched.carried[opened] != 0).any(axis=0)  # the rotors that it loaded
        return bool(self._gone.any())

    def _average(self, readings: np.ndarray, known: np.ndarray) -> None:
        """What an emulation begins from is averaged before it: noise of one sample is no offset of the emulation."""
        self._averaged = min(self._averaged + 1, self._mean_samples)
        for mean, slow, value in zip(self._means, self._slow, (readings, known, self._sent), strict=True):
            mean += (value - mean) / self._averaged
            slow += (mean - slow) / self._averaged

    def _enter(self, mode: int, readings: np.ndarray, known: np.ndarray, hold: np.ndarray) -> None:
        if mode == self._mode:
            return
        self._mode = mode
        if mode != EMULATION:
            self._averaged = 0
        if mode == SPEED_HOLD:
            wanted = self._held if self._fault else hold
            # a rotor whose load is gone would be swung by the torque that balanced it
            carried = np.where(self._gone & (self._fault == TORQUE_GONE), 0.0, self._sent)
            blind = self._distrusted[self._speeds]
            error = np.where(blind, 0.0, wanted - readings[self._speeds])
            self._integral = carried - self.settings.hold_proportional * error
            self._cut_integral = self.cut_torque
        if mode == EMULATION:
            self._average(readings, known)
            readings_start, known_start, sent_start = (
                2 * mean - slow for mean, slow in zip(self._means, self._slow, strict=True)
            )
            self._start = readings_start, known_start, sent_start
            if isinstance(self.law, ForeignVehicleLaw):
                law, at = self.law, readings_start
                self._follow_start = law.started(at), law.cut_torque_read(at, sent_start), law.started_speed(at)
                self._followed = law.start_following(at, sent_start, self._held_cut, self._wheel)
            elif isinstance(self.law, SteppedLaw):
                begun, cut = self.law.begin(readings_start, sent_start)
                self._emulation = begun, begun, cut
            self._state = np.zeros(self.law.states)
            self._past_torques[:] = self._flange_torques(readings)
            self._surprised = 0
            self._undelivered_for[:] = 0
            self._off_mean[:], self._lost[:] = 0.0, 0
            self._deviations[:] = 0.0
            self._watch.reset()

    def _torque_limits(self, readings: np.ndarray) -> np.ndarray:
        """Largest torques (k,), N·m, at the speeds that are read."""
        settings, speeds = self.settings, np.abs(readings[self._speeds])
        of_power = settings.power_limit / np.maximum(speeds, SLOWEST)
        of_curve = np.interp(speeds, settings.curve_speeds, settings.curve_torques)
        return np.minimum(np.minimum(settings.torque_limit, of_power), of_curve)

    def _emulate(
        self, readings: np.ndarray, known: np.ndarray, limits: tuple[np.ndarray, np.ndarray], added: np.ndarray | float
    ) -> np.ndarray:
        """Torques (k,), N·m, between limits, and the states a sample later."""
        y0, w0, u0 = self._start
        within = limits[0] - u0, limits[1] - u0
        if isinstance(self.law, ForeignVehicleLaw):
            assert self._followed is not None
            sent, now_followed = self.law.follow(
                self._followed, self._follow_start, readings - y0, known - w0, self._wheel, within,
                readings[self._speeds], added,
            )  # fmt: skip
            self._followed, self._state = now_followed, now_followed.state
        elif isinstance(self.law, SteppedLaw):
            assert self._emulation is not None
            now, begun, cut = self._emulation
            sent, now = self.law.step(
                now, begun, cut, readings - y0, known - w0, known[len(known) - len(self.law.stepped.inputs) :],
                within, self.road, readings[self._speeds], added,
            )  # fmt: skip
            self._emulation, self._state = (now, begun, cut), now.state
        else:
            sent, self._state = self.law.step(self._state, readings - y0, known - w0, within, added)
        return u0 + sent

    def _command(self, readings: np.ndarray, known: np.ndarray, hold: np.ndarray, added: np.ndarray) -> np.ndarray:
        settings, limit = self.settings, self._torque_limits(readings)
        if self._mode == EMULATION:
            if 0 < self._played <= len(self._learned):
                added = added + self._learned[self._played - 1]
            return self._emulate(readings, known, (-limit, limit), added)
        if self._mode == SPEED_HOLD:
            error = (self._held if self._fault else hold) - readings[self._speeds]
            blind = self._distrusted[self._speeds]  # others hold the speed; their readings would swing this rotor
            asked = np.where(blind, 0.0, settings.hold_proportional * error) + self._integral + added
            sent = np.clip(asked, -limit, limit)
            within = asked == sent
            held = self._integral + within * settings.hold_integral * self.law.sample_time * error
            self._integral = np.where(blind, self._integral * (1 - self.law.sample_time / FADE_S), held)
            return sent
        if self._mode == CHANNEL_CHECK:
            small = np.minimum(limit, settings.check_torque)
            return np.clip(added, -small, small)
        return np.zeros(len(self._sent))


# --- A controller with all that its export needs: law, settings, and what the signals are.


@dataclass(frozen=True)
class ExportedController:
    """What becomes C.

    Attributes
    ----------
    title : str
    law : ControlLaw or SteppedLaw
    settings : Settings
    units : tuple of str (y)
        SI units of the readings.
    torque_readings, speed_readings : tuple of int (k)
        Which readings are the dynamometers' flange torques, −1 without a flange, and speeds.
    watched : WatchedShafts
        Shafts whose opening is noticed by what it does to the readings.
    shafts : tuple of OpenedShaft
        How the opening of every shaft of the rig is noticed.
    by_others : ndarray (k, y)
        Speed of each rotor by other readings of speeds where the rig turns as one, 0 where they do not determine it.
    learned : ndarray (n, k)
        Torques, N·m, that emulation adds sample by sample from the trigger of a manoeuvre on; (0, k) without any.
    delivery : Rotors, optional
        What tells the delivered air-gap torques; without it they are not judged.
    tracking : Tracking, optional
        How their drifts are tracked, and from where on one is a warning.
    may_shift : bool
        The law knows nothing of the specimen, which may shift: its FMU can be told when.
    pedals : tuple of str
        Known inputs that are pedals, 0 to 1, and no torques.
    """

    title: str
    law: Law
    settings: Settings
    units: tuple[str, ...]
    torque_readings: tuple[int, ...]
    speed_readings: tuple[int, ...]
    watched: WatchedShafts
    shafts: tuple[OpenedShaft, ...]
    by_others: np.ndarray
    learned: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    delivery: Rotors | None = None
    tracking: Tracking | None = None
    may_shift: bool = False
    pedals: tuple[str, ...] = ()

    @property
    def rotors(self) -> Rotors:
        """``delivery``, or that nothing is judged."""
        return Rotors.unknown(len(self.speed_readings)) if self.delivery is None else self.delivery

    @property
    def drifts(self) -> Tracking:
        """``tracking``, or that nothing is a warning."""
        return Tracking.unknown(len(self.speed_readings)) if self.tracking is None else self.tracking

    def running(self) -> SupervisedController:
        """The same controller in Python, at zero torque."""
        return SupervisedController(
            self.law, self.settings, list(self.torque_readings), list(self.speed_readings), self.watched,
            self.by_others, self.learned, self.rotors, self.drifts,
        )  # fmt: skip


# --- Gains of the speed hold that the controller falls back to: slow, plain, and checked on the rig's model.

CROSSOVER_TIMES_DELAY = 0.25  # rad: crossover of the lone rotor over the sum of dead time and lags; 76° of phase margin
INTEGRAL_BELOW = 20.0  # the integral sets in this many times below the crossover
HALVINGS = 12  # of both gains, until the rig's model is stable
ON_THE_CIRCLE = 1e-6  # of |z|: poles this near 1 are angles that nothing depends on


def hold_gains(
    bed: StateSpace,
    rotor_inertias: np.ndarray,
    dead_time: float,
    lag: float,
    sample_time: float,
    largest: np.ndarray | float = np.inf,
) -> tuple[np.ndarray, np.ndarray]:
    """Proportional (k,) and integral (k,) gains, N·m·s/rad and N·m/rad, of a speed hold that is stable on the rig.

    Parameters
    ----------
    bed : StateSpace
        Inputs start with the torque commands (k); outputs are the rotor speeds (k).
    rotor_inertias : ndarray (k,)
        kg·m².
    dead_time, lag, sample_time : float
        s; the lag of inverter and sensor together.
    largest : ndarray (k,) or float
        N·m·s/rad: a larger proportional gain would make more command of a speed's noise than is allowed.

    Raises
    ------
    NoDesign
        If no such gains are stable.
    """
    crossover = CROSSOVER_TIMES_DELAY / (dead_time + lag + sample_time)
    proportional = np.minimum(rotor_inertias * crossover, largest)
    integral = proportional**2 / rotor_inertias / INTEGRAL_BELOW  # its crossover is the gain over the inertia
    for _ in range(HALVINGS):
        if _is_stable(bed, proportional, integral, dead_time, sample_time):
            return proportional, integral
        proportional, integral = proportional / 2, integral / 4
    raise NoDesign("no speed hold is stable on this rig; check dead time, lags and the rotors' inertias")


def _is_stable(bed: StateSpace, proportional: np.ndarray, integral: np.ndarray, dead: float, step: float) -> bool:
    k, delay = len(proportional), int(np.ceil(dead / step - 1e-9))
    A, B, *_ = scipy.signal.cont2discrete((bed.A, bed.B[:, :k], bed.C, np.zeros((k, k))), step)
    n, fifo = len(A), k * delay
    size = n + fifo + k
    law = np.zeros((k, size))  # the command on [bed, commands on their way (oldest first), integrals]
    law[:, :n], law[:, n + fifo :] = -proportional[:, None] * bed.C, np.eye(k)
    M = np.zeros((size, size))
    M[:n, :n] = A
    if delay:
        M[:n, n : n + k] = B
        M[n : n + fifo - k, n + k : n + fifo] = np.eye(fifo - k)
        M[n + fifo - k : n + fifo] = law
    else:
        M[:n] += B @ law
    M[n + fifo :, :n], M[n + fifo :, n + fifo :] = -step * integral[:, None] * bed.C, np.eye(k)
    return bool(np.abs(np.linalg.eigvals(M)).max() <= 1 + ON_THE_CIRCLE)
