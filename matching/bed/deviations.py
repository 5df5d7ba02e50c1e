"""What the check of the channels measures of a bed: gains and delays of every channel, and what of the bed is off.

One fit of the recording holds every quantity near its stated value, as far as its tolerance says. A quantity that is
far off bends all others in such a fit. So one quantity after another is released from its tolerance: the one by which
the misfit falls most, as long as it falls beyond chance. A quantity that was released and lies beyond its tolerance is
off; everything else keeps its place. Where the bed has free play that its model does not have, a misfit is left, no
quantity is called off, and :mod:`matching.bed.lost_motion` looks for it. With that free play in the model the fit is
made again.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import process_time

import numpy as np

from matching.bed.simulated_bed import own_times
from matching.bed.stated import Deviation
from matching.match.case import Case
from modelling.effects.friction_and_compliance import CoulombFriction
from modelling.effects.sensors_and_actuators import DeadTime, InputGain
from modelling.equations.casadi_code import Model, compiled
from modelling.equations.lagrange import STICK_SPEED
from modelling.simulation.simulate import sensitivities, simulate, simulate_batch
from modelling.simulation.stepping import SimulationError, steps_per_second
from modelling.system import Effect, Quantity, System


@dataclass(frozen=True)
class DeviationSettings:
    """How the bed is measured by the check; the reason of a number stands next to it."""

    model_error: float = (
        0.005  # of a channel's rms: what a right model of a healthy bed leaves (virtual beds: 0.2 to 1 %)
    )
    least_error: float = 0.002  # the same at least, in the stated uncertainties
    least_share: float = 0.001  # standard uncertainty of any factor at least: no model is as exact as its noise says
    least_time: float = 2e-5  # s, the same of a dead time: a command acts at a sample, not between
    correlated: float = 0.05  # s over which such an error keeps its sign: three quarters of a period of 15 Hz
    sensor_gain: float = 0.01  # tolerance of a sensor that the case does not name: classes of torque flanges end at 1 %
    input_gain: float = 0.05  # tolerance of a torque that no dynamometer gives: an inverter or an engine by its map
    input_delay: float = 1e-3  # s, the same of its dead time: a step of a usual bus
    shortest: float = (
        -1.0
    )  # natural logarithm of a lag over the stated one: shorter ones cost many steps and say little
    damping: float = 0.7  # natural logarithm, of a damping that the case calls exact: none is, and none is named
    friction: float = 0.1  # of the largest torque of a manoeuvre: expected friction where no dynamometer acts
    stick_speeds: tuple[float, float] = (
        0.03,
        1e-3,
    )  # rad/s over which the sign of friction changes: of the first fit, and of all others, where it bends nothing
    factors: tuple[float, ...] = (0.15, 0.3, 0.55, 1.8, 3.3, 6.0)  # starts of a released quantity
    delays: tuple[float, ...] = (1e-3, 2.5e-3, 5e-3, 1e-2)  # s beyond the stated dead time: starts as well
    fall: float = 40.0  # of χ² by which a release is beyond chance: six standard uncertainties
    promised: float = 0.5  # of that fall, to first order, below which a candidate is not fitted
    far: float = 0.01  # misfit of a channel, relative, above which a release begins at far values as well
    explained: float = 0.06  # misfit of a channel, relative, up to which a linear bed explains it: friction leaves 0.02
    right: float = 0.015  # the same, up to which nothing is missing in the model: dry friction leaves more
    worth: float = 0.2  # of what χ² has beyond noise, by which a release is worth its place
    refitted: int = 4  # candidates of a round that are fitted; the others fall less already to first order
    most: int = 3  # releases at most: the recording tells no more
    chance: float = 0.3  # of χ²: a fall that says nothing
    part: float = 0.12  # of a recording, that is fitted first where shafts have play: to the end of the first pulses
    stride: float = 0.05  # by which that part grows: what moves freely has minima at every beat
    shortest_stride: float = 0.006  # the same, below which the model does not follow the recording any further
    followed: float = 0.008  # misfit of a channel, relative, up to which a model follows the longer part
    well_told: float = (
        0.3  # of its tolerance: uncertainty beside free play at which a quantity is told. Derivatives hold
    )
    # for tiny changes alone where impacts happen earlier or later, so that longer parts seem to tell more than they do
    least_part: float = 0.3  # of the recording, that a model with free play explains at least
    weak: float = 0.4  # of its tolerance, of an uncertainty from which on a step may lead a quantity astray
    farthest: float = 3.0  # tolerances that a quantity is off at most, as long as it is not released
    at_end: float = 0.99  # of that range, from which on the quantity stands at its end
    stiffest: float = 10.0  # damping of a step that still does not help: the fit has ended
    iterations: int = 10  # of a fit
    fastest: float = 2e5  # steps a second that are worth their time
    hardly: float = 1e-3  # of what χ² has beyond noise, or as an absolute number: a smaller fall ends a fit
    at_last: tuple[int, float] = (20, 1e-4)  # iterations, and the relative fall, of the fit that is kept
    far_value: float = 0.4  # natural logarithm, of a factor of 1.5 or 0.67: beyond it stiff modes have other minima
    beside: tuple[float, ...] = (
        -1.5,
        -0.8,
        -0.4,
        0.0,
        0.4,
    )  # natural logarithm beside a far value, from which a fit begins too
    edge: float = 0.5  # of a torque's largest value, by which it jumps at an edge
    about_edge: tuple[float, float] = (0.01, 0.018)  # s before and after an edge: the rotor turns before shafts answer
    tried: float = 1e-4  # s between the delays that are tried at edges
    edge_error: float = 3e-4  # s: standard uncertainty of such a delay at least, by beds off by 4 % (largest 0.7 ms)
    told: float = (
        0.7  # of its tolerance, that the uncertainty of a quantity is smaller: else the recording tells nothing
    )
    coverage: float = 3.0  # standard uncertainties by which a value lies beyond its tolerance
    near_minima: float = 40.0  # of χ²: ends of fits that are nearly as good, whose distance counts as uncertainty
    alike: float = 20.0  # of χ²: what falls nearly as much may be the cause as well
    longest: float = 180.0  # s of processor time, after which nothing more is released: a bed with two axles has 70
    # quantities, and a round takes minutes
    nearly: float = 1.3  # of χ²: candidates up to it may be the best one at the end of their fits


DEVIATIONS = DeviationSettings()


@dataclass(frozen=True)
class Deviations:
    """All quantities that the check measures; ``misfit``: largest error of a channel, relative.

    ``share`` is the part of the recording, from its begin, that they are measured on: with free play the model may not
    follow the whole of it. ``coordinates`` are where the fit ended, by name, in the model's units.
    ``readings`` (t,) by sensor: those of the bed with these values and right gains, less their zeros.
    """

    quantities: tuple[Deviation, ...]
    misfit: float
    readings: Mapping[str, np.ndarray] = field(repr=False)
    share: float = 1.0
    coordinates: Mapping[str, float] = field(default_factory=dict, repr=False)

    def __getitem__(self, name: str) -> Deviation:
        """A quantity by its name."""
        return next(one for one in self.quantities if one.name == name)

    def get(self, name: str) -> Deviation | None:
        """The same; None where the fit does not have it."""
        return next((one for one in self.quantities if one.name == name), None)

    @property
    def beyond(self) -> tuple[Deviation, ...]:
        """Those beyond their tolerances."""
        return tuple(one for one in self.quantities if one.beyond)


@dataclass(frozen=True)
class _Free:
    """A coordinate x of the fit: the parameter it moves, or the sensor whose gain it is, and how far it is expected.

    The value is stated·exp(x) (``log``), or stated + x; ``width`` is its tolerance in x, ``starts`` where a release
    begins.
    """

    name: str
    parameter: str
    stated: float
    width: float
    log: bool
    starts: tuple[float, ...] = ()
    sensor: int = -1
    lowest: float = -np.inf

    def at(self, x: float) -> float:
        return self.stated * float(np.exp(x)) if self.log else self.stated + x

    def coordinate(self, value: float) -> float:
        return float(np.log(value / self.stated)) if self.log else value - self.stated


WIDE = {True: 8.0, False: 1.0}  # of a released coordinate: ln of a factor of 3000; s


TINY = 1e-100


@dataclass(frozen=True)
class _Errors:
    """Weighted errors (t, y), half the slope (p,) of their squares, and Gram's matrix (y, p, p) of each channel."""

    left: np.ndarray
    slope: np.ndarray
    gram: np.ndarray

    @property
    def square(self) -> float:
        return float(np.sum(self.left**2))


class Fit:
    """A model of the bed on a recording: readings, weighted errors and their derivatives at coordinates x (p,)."""

    def __init__(self, run: RecordedCheck):
        self.run = run
        self.model: Model = compiled(run.system)
        self.free = run.free
        self.moved = [one.parameter for one in self.free if one.sensor < 0]
        self.places = [n for n, one in enumerate(self.free) if one.sensor < 0]

    def parameters(self, x: np.ndarray) -> np.ndarray:
        """Parameters of the model at coordinates (p,)."""
        p = np.array(self.model.p0, dtype=float)
        for n in self.places:
            p[self.model.parameters.index(self.free[n].parameter)] = self.free[n].at(float(x[n]))
        if STICK_SPEED in self.model.parameters:
            p[self.model.parameters.index(STICK_SPEED)] = self.run.stick_speed
        return p

    def gains(self, x: np.ndarray) -> np.ndarray:
        """Of the sensors (y,) at coordinates (p,)."""
        gains = np.ones(self.run.read.shape[1])
        for n, one in enumerate(self.free):
            if one.sensor >= 0:
                gains[one.sensor] = one.at(float(x[n]))
        return gains

    def errors(self, x: np.ndarray) -> _Errors:
        """Weighted errors at coordinates (p,)."""
        run = self.run
        p = self.parameters(x)
        done = sensitivities(self.model, run.time, run.sent, p, self.moved, steps_per_second=self._rate(p))
        readings = done.readings[:, run.columns]
        gains, J = self.gains(x), np.zeros((*run.read.shape, len(self.free)))
        J[:, :, self.places] = done.jacobian[:, run.columns] * gains[:, None]
        for n, one in enumerate(self.free):
            if one.sensor >= 0:
                J[:, one.sensor, n] = readings[:, one.sensor]
            if one.log:
                J[:, :, n] *= one.at(float(x[n]))
        left = (run.read - readings * gains) * run.weights
        J *= -run.weights[:, None]
        left[~run.there], J[~run.there] = 0.0, 0.0
        J[np.abs(J) < TINY] = 0.0  # numbers too small to be normal take a hundred times as long
        return _Errors(
            left, np.einsum("tyi,ty->i", J, left), np.stack([J[:, i].T @ J[:, i] for i in range(J.shape[1])])
        )

    def _rate(self, p: np.ndarray) -> float:
        """Explicit steps a second for parameters (p,)."""
        rate = max(steps_per_second(self.model, p[None]), 2 / float(np.median(np.diff(self.run.time))))
        if rate > self.run.settings.fastest:
            raise SimulationError("simulation", f"needs {rate:.3g} steps a second", "a value is out of all bounds")
        return rate

    def size(self, x: np.ndarray, now: Found | None = None) -> float:
        """χ² of the readings at coordinates (p,), without derivatives; infinite for what cannot be simulated."""
        run, p = self.run, self.parameters(x)
        if (
            now is not None and self is now.fit and (x[self.places] == now.x[self.places]).all()
        ):  # gains of sensors alone
            model = run.read - now.errors.left / run.weights
            left = (run.read - model * self.gains(x) / self.gains(now.x)) * run.weights
            return float((np.where(run.there, left, 0.0) ** 2).sum())
        with contextlib.suppress(SimulationError):
            done = simulate_batch(self.model, run.time, run.sent, p[None], steps_per_second=self._rate(p))[0]
            left = (run.read - done[:, run.columns] * self.gains(x)) * run.weights
            found = float((np.where(run.there, left, 0.0) ** 2).sum())
            return found if np.isfinite(found) else np.inf
        return np.inf

    def widths(self, released: Sequence[str]) -> np.ndarray:
        """How far (p,) each coordinate is expected from 0."""
        return np.array([WIDE[one.log] if one.name in released else one.width for one in self.free])


@dataclass(frozen=True)
class RecordedCheck:
    """The recording of a check as the fit needs it; ``weights`` (y,) are one over the expected error of a sample."""

    system: System
    time: np.ndarray
    sent: dict[str, np.ndarray]
    read: np.ndarray
    there: np.ndarray
    weights: np.ndarray
    noise: np.ndarray
    noise_error: float
    columns: list[int]
    names: list[str]
    free: list[_Free]
    of_noise: float
    hold: float
    stick_speed: float
    settings: DeviationSettings
    begun: float = field(default_factory=process_time)

    @property
    def over(self) -> bool:
        """Whether the time for releases is over."""
        return process_time() - self.begun > self.settings.longest

    def until(self, share: float, stick_speed: float | None = None) -> RecordedCheck:
        """The first part of the recording; with friction that is easily fitted, where no stick speed is given."""
        n = round(share * len(self.time))
        sent = {name: torque[:n] for name, torque in self.sent.items()}
        return replace(
            self, time=self.time[:n], sent=sent, read=self.read[:n], there=self.there[:n],
            of_noise=share * self.of_noise, stick_speed=stick_speed or self.settings.stick_speeds[0],
        )  # fmt: skip


@dataclass(frozen=True)
class Found:
    """A fit that has ended: coordinates (p,), χ² with what the tolerances add, and what was released."""

    fit: Fit
    x: np.ndarray
    cost: float
    released: tuple[str, ...]
    errors: _Errors = field(repr=False)
    apart: Mapping[str, float] = field(default_factory=dict)  # by name: how far nearly as good fits end beside x

    @property
    def values(self) -> dict[str, float]:
        """Where the fit ended, by name, in the model's units."""
        return {one.name: one.at(float(x)) for one, x in zip(self.fit.free, self.x, strict=True)}


def solved(
    fit: Fit,
    begin: np.ndarray,
    released: tuple[str, ...],
    last: tuple[int, float] = (0, 0.0),
    apart: Mapping[str, float] | None = None,
) -> Found:
    """Least squares by Gauss and Newton, with Levenberg's damping where a step fails."""
    settings, widths = fit.run.settings, fit.widths(released)
    most, hardly = last if last[0] else (settings.iterations, settings.hardly)
    held_within = np.where([one.name in released for one in fit.free], 1.0, settings.farthest) * widths
    lowest = np.maximum([one.lowest for one in fit.free], -held_within)
    x, damping = np.clip(begin, lowest, held_within), 1e-3
    errors = fit.errors(x)
    cost = errors.square + float(np.sum((x / widths) ** 2))
    for _ in range(most):
        H, slope = errors.gram.sum(axis=0) + np.diag(widths**-2.0), errors.slope + x / widths**2
        held = ((x <= lowest) & (slope > 0)) | ((x >= held_within) & (slope < 0))
        H[held], H[:, held], slope = 0.0, 0.0, np.where(held, 0.0, slope)
        H[held, held] = 1.0
        while True:
            step = np.linalg.solve(H + damping * np.diag(np.diag(H)), -slope)
            tried = np.clip(x + np.clip(step, -1.0, 1.0), lowest, held_within)
            after = fit.size(tried) + float(np.sum((tried / widths) ** 2))
            if after < cost or damping > settings.stiffest:
                break
            damping = max(10 * damping, 1e-2)
        if not after < cost:
            break
        of_tried = fit.errors(tried)
        gained, (x, errors, cost) = cost - after, (tried, of_tried, after)
        damping /= 10
        if gained < max(hardly * (cost - fit.run.of_noise), settings.chance):
            break
    return Found(fit, x, cost, released, errors, {} if apart is None else apart)


def _first_order(now: Found, released: tuple[str, ...], x: np.ndarray | None = None) -> float:
    """χ² that one step of a fit leaves from coordinates x, or from where a fit ended, to first order."""
    errors = now.errors if x is None else now.fit.errors(x)
    x, widths = now.x if x is None else x, now.fit.widths(released)
    H, slope = errors.gram.sum(axis=0) + np.diag(widths**-2.0), errors.slope + x / widths**2
    return errors.square + float(np.sum((x / widths) ** 2) - slope @ np.linalg.solve(H, slope))


@dataclass(frozen=True)
class Begun:
    """A fit that may release further quantities.

    Attributes
    ----------
    share : float
        As in :class:`Deviations`.
    rivals : mapping of str to tuple of str
        By released quantity: those with which the misfit falls nearly as much.
    misfit : float
        Largest error of a channel, relative.
    cost : float
        χ² with what the tolerances add.
    """

    now: Found
    share: float
    run: RecordedCheck
    rivals: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    ended: bool = False  # no release gains more

    @property
    def misfit(self) -> float:
        """See the attributes."""
        return misfit_of(self.now)

    @property
    def cost(self) -> float:
        """See the attributes."""
        return self.now.cost

    def released(self) -> Begun:
        """With one more quantity released, the one by which the misfit falls most; ended where none gains enough."""
        now, run, settings = self.now, self.run, self.run.settings
        if run.over:
            return replace(self, ended=True)
        tried = sorted(_next(now), key=lambda one: one[1].cost)
        if not tried:
            return replace(self, ended=True)
        name, best = tried[0]
        needed = max(settings.fall, settings.worth * (now.cost - run.of_noise))
        if now.cost - best.cost >= needed:  # a fit may have ended early: what it gains without the release is no cause
            with contextlib.suppress(SimulationError):
                again = solved(now.fit, best.x, now.released, apart=now.apart)
                now = min(now, again, key=lambda one: one.cost)
        if now.cost - best.cost < needed:
            return replace(self, now=now, ended=True)
        # these fits have not ended: those that fall nearly as much go on to their ends before one of them is chosen
        ended = dict[str, Found]()
        for other, one in tried:
            if one.cost > settings.nearly * best.cost or any(misfit_of(e) <= settings.right for e in ended.values()):
                break
            ended[other] = _best_of(one, other)
        name = min(ended, key=lambda other: ended[other].cost)
        now = ended[name]
        alike = tuple(
            other for other, one in (dict(tried) | ended).items()
            if other != name and one.cost - now.cost < settings.alike
        )  # fmt: skip
        return replace(self, now=now, rivals={**self.rivals, name: alike})

    def measured(self) -> Deviations:
        """The fit gone on to its end."""
        begun, settings = self, self.run.settings
        for _ in range(settings.most - len(self.rivals)):
            if begun.ended:
                break
            begun = begun.released()
        now, rivals = _needed(begun.now, dict(begun.rivals))
        for _ in range(settings.most):
            now = _settled(now)
            held = _held(now) if misfit_of(now) <= settings.right else ()
            if not 0 < len(held) <= settings.most:  # as many as that are bent by something else
                break
            with contextlib.suppress(SimulationError):
                now = solved(now.fit, now.x, (*now.released, *held), settings.at_last, now.apart)
        alone = _alone(now) if self.share == 1 and not self.run.over else None
        if alone is not None:
            now, rivals = alone, {}
        return _measured(now, rivals, self.run, self.share)


def begun_fit(
    case: Case, system: System, time: np.ndarray, sent: Mapping[str, np.ndarray], read: Mapping[str, np.ndarray],
    lead: int, settings: DeviationSettings = DEVIATIONS, begin: Mapping[str, float] | None = None,
) -> Begun | None:  # fmt: skip
    """The fit of :func:`deviations` with nothing released; None where no model of the bed can be simulated."""
    run = recorded_check(case, system, time, sent, read, lead, settings)
    try:
        now, share = _begun(run, begin or {})
    except SimulationError:
        return None
    return Begun(now, share, run)


def deviations(
    case: Case, system: System, time: np.ndarray, sent: Mapping[str, np.ndarray], read: Mapping[str, np.ndarray],
    lead: int, settings: DeviationSettings = DEVIATIONS, begin: Mapping[str, float] | None = None,
) -> Deviations | None:  # fmt: skip
    """Measure a bed by the recording of the check of its channels; None where no model of it can be simulated.

    Parameters
    ----------
    system : System
        :func:`matching.bed.simulated_bed.bed_system` of the case.
    time : ndarray (t,)
        s, even.
    sent, read : mapping of str to ndarray (t,)
        Commands of all inputs, and readings of channels whose sign, unit and place are right.
    lead : int
        Samples at rest before the first torque.
    begin : mapping of str to float, optional
        Where the fit begins, as :attr:`Deviations.coordinates`; the stated values otherwise.
    """
    begun = begun_fit(case, system, time, sent, read, lead, settings, begin)
    return None if begun is None else begun.measured()


def _begun(run: RecordedCheck, begin: Mapping[str, float]) -> tuple[Found, float]:
    """The first fit, and the share of the recording that it is of: with free play as much as the model follows."""
    settings = run.settings
    x = np.array([one.coordinate(begin[one.name]) if one.name in begin else 0.0 for one in run.free])
    if not run.system.free_plays:
        rough = solved(Fit(replace(run, stick_speed=settings.stick_speeds[0])), x, ())
        return _settled(solved(Fit(run), rough.x, ())), 1.0
    released = tuple(
        one.name for one, own in zip(run.free, x, strict=True)
        if one.starts and abs(own) > settings.farthest * one.width
    )  # fmt: skip
    share, stride = settings.part, settings.stride
    now = solved(Fit(run.until(share, run.stick_speed)), x, released)
    widths = np.array([one.width for one in run.free])
    spread = np.sqrt(np.diag(_covariance(now)))
    while share < 1 and stride >= settings.shortest_stride:
        further = min(share + stride, 1.0)
        with contextlib.suppress(SimulationError):
            tried = solved(Fit(run.until(further, run.stick_speed)), now.x, now.released)
            if misfit_of(tried) <= settings.followed:
                now, share, stride = tried, further, min(2 * stride, settings.stride)
                of_part = np.sqrt(np.diag(_covariance(now)))
                least = settings.well_told * widths if share > settings.least_part else 0.0
                spread = np.where(spread > least, np.minimum(np.maximum(of_part, least), spread), spread)
                continue
        stride /= 2
    return replace(now, apart={one.name: float(own) for one, own in zip(run.free, spread, strict=True)}), share


def _settled(now: Found) -> Found:
    """The fit run to its end, and once more from where quantities that are hardly told have their stated values."""
    settings = now.fit.run.settings
    if now.fit.run.system.free_plays or misfit_of(now) > settings.explained:
        return now
    spread = np.sqrt(np.diag(_covariance(now)))
    widths = now.fit.widths(now.released)
    weak = (spread > settings.weak * widths) | (np.abs(now.x) > settings.at_end * settings.farthest * widths)
    weak &= np.array([one.name not in now.released for one in now.fit.free])
    ends = [now]
    for x in [now.x, np.where(weak, 0.0, now.x)] if weak.any() else [now.x]:
        with contextlib.suppress(SimulationError):
            ends.append(solved(now.fit, x, now.released, settings.at_last, now.apart))
    return min(ends, key=lambda one: one.cost)


def _covariance(now: Found) -> np.ndarray:
    """Of the coordinates (p, p), by the weights of the fit."""
    return _inverse(now.errors.gram.sum(axis=0), now.fit.widths(now.released))


def _inverse(gram: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Covariance (p, p) of coordinates that are expected within ``widths`` (p,); they differ by many powers of ten."""
    both = np.outer(widths, widths)
    values, vectors = np.linalg.eigh(gram * both + np.eye(len(widths)))
    return np.asarray(both * ((vectors / np.maximum(values, 1.0)) @ vectors.T))


def _held(now: Found) -> tuple[str, ...]:
    """What is held back by the weights of the fit, and can be released."""
    return tuple(one.name for one in _held_back(now, np.sqrt(np.diag(_covariance(now)))) if one.starts)


def _held_back(now: Found, spread: np.ndarray) -> list[_Free]:
    """What the recording tells, by its uncertainty (p,), and its tolerance holds back: it bends all others."""
    settings = now.fit.run.settings
    return [
        one for n, one in enumerate(now.fit.free)
        if one.name not in now.released and spread[n] < settings.told * one.width
        and abs(now.x[n]) > settings.at_end * settings.farthest * one.width
    ]  # fmt: skip


def _beyond(now: Found) -> tuple[str, ...]:
    """What ended beyond its tolerance, of what the recording tells."""
    spread, settings = np.sqrt(np.diag(_covariance(now))), now.fit.run.settings
    return tuple(
        one.name for n, one in enumerate(now.fit.free)
        if one.starts and abs(now.x[n]) > one.width and spread[n] < settings.told * one.width
    )  # fmt: skip


def _alone(now: Found) -> Found | None:
    """A fit as good with one quantity alone far off, where several were off together; None where there is none.

    A shaft that is a tenth as stiff answers like several small changes about it, as far as a fit from the stated values
    sees. Two defects are not that: one alone leaves a misfit.
    """
    fit, settings, off = now.fit, now.fit.run.settings, len(_beyond(now))
    if off < 2:
        return None
    begins = list[tuple[float, int, str, np.ndarray]]()
    for n, one in enumerate(fit.free):
        if not one.log or not one.starts:
            continue
        xs = np.zeros((len(one.starts), len(fit.free)))
        xs[:, n] = one.starts
        x = xs[int(np.argmin([fit.size(each) for each in xs]))]
        with contextlib.suppress(SimulationError):
            begins.append((_first_order(now, (one.name,), x), len(begins), one.name, x))
    for _, _, name, x in sorted(begins, key=lambda one: one[:2])[: settings.refitted]:
        with contextlib.suppress(SimulationError):
            alone = solved(fit, x, (name,), settings.at_last)
            if alone.cost - now.cost < settings.fall and len(_beyond(alone)) < off:
                return alone
    return None


def delays_at_edges(
    case: Case, system: System, time: np.ndarray, sent: Mapping[str, np.ndarray], read: Mapping[str, np.ndarray],
    settings: DeviationSettings = DEVIATIONS,
) -> tuple[Deviation, ...]:  # fmt: skip
    """Dead time of each dynamometer by the kinks of its rotor's speed where its torque jumps.

    For a bed that no linear fit explains: free play lies behind the rotor's inertia, so the kink comes at its time. A
    straight line and the model's answer are fitted about every edge, for one delay after another.
    """
    done = simulate(system, time, dict(sent), sensors=[one.speed_sensor for one in case.loop.dynamometers])
    step = float(np.median(np.diff(time)))
    before, after = (round(seconds / step) for seconds in settings.about_edge)
    box = {one.name: one for one in case.uncertainty.uncertain}
    found = []
    for one, stated in zip(case.loop.dynamometers, case.loop.command_delays(), strict=True):
        torque, width = sent[one.torque_input], box.get("loop.dead_time")
        jumps = np.flatnonzero(np.abs(np.diff(torque)) > settings.edge * np.abs(torque).max())
        edges = [e for e in jumps if before <= e < len(time) - after]
        if one.speed_sensor not in read or not edges or width is None:
            continue
        model, speed = done[one.speed_sensor], read[one.speed_sensor]
        delays = np.arange(-stated, settings.delays[-1], settings.tried)
        left = np.zeros(len(delays))
        for e in edges:
            at = slice(e - before, e + after)
            line = np.stack([np.ones(before + after), np.linspace(-1, 1, before + after)], axis=1)
            for k, late in enumerate(delays):
                A = np.column_stack([line, np.interp(time[at] - late, time, model)])
                x = np.linalg.lstsq(A, speed[at])[0]
                left[k] += float(np.sum((speed[at] - A @ x) ** 2))
        k = int(np.clip(np.argmin(left), 1, len(delays) - 2))
        curved = (left[k - 1] - 2 * left[k] + left[k + 1]) / settings.tried**2 / 2
        spread = np.sqrt(left[k] / max(len(edges) * (before + after - 3), 1) / max(curved, 1e-300))
        spread = max(float(spread), settings.edge_error)
        late = float(delays[k]) + case.loop["dead_time"] - case.loop.command_delay() + float(stated)
        beyond = abs(delays[k]) - width.half_width > settings.coverage * spread
        found.append(Deviation(f"dynamometers.{one.name}.dead_time", late - float(delays[k]), late, spread,
                               width.half_width, bool(beyond), bool(beyond)))  # fmt: skip
    return tuple(found)


def _next(now: Found) -> Iterator[tuple[str, Found]]:
    """Fits with one more quantity released: those that promise most."""
    settings, fit = now.fit.run.settings, now.fit
    begins, misfit, base, least = list[tuple[float, int, str, np.ndarray]](), misfit_of(now), now.x, now.errors.square
    if misfit > settings.explained:  # what is far off has bent all others
        base = np.where([one.name in now.released for one in fit.free], now.x, 0.0)
        least = fit.size(base)
    for n, one in enumerate(fit.free):
        if one.name in now.released or not one.starts:
            continue
        released = (*now.released, one.name)
        begins.append((_first_order(now, released), len(begins), one.name, now.x))
        if misfit <= settings.far or fit.run.over:
            continue
        xs = np.tile(base, (len(one.starts), 1))
        xs[:, n] = one.starts
        sizes = [fit.size(x, now) for x in xs]
        best = int(np.argmin(sizes))
        if sizes[best] < least:
            with contextlib.suppress(SimulationError):
                begins.append((_first_order(now, released, xs[best]), len(begins), one.name, xs[best]))
    begins.sort(key=lambda one: one[:2])
    found: dict[str, Found] = {}
    for promised, _, name, x in begins[: settings.refitted]:
        if now.cost - promised < settings.promised * settings.fall or (found and fit.run.over):
            break
        with contextlib.suppress(SimulationError):
            ended = solved(fit, x, (*now.released, name), apart=now.apart)
            if name not in found or ended.cost < found[name].cost:
                found[name] = ended
    yield from found.items()


def _best_of(found: Found, name: str) -> Found:
    """The fit with its last release, to its end; of a far value also from beside: stiff modes have minima there."""
    settings, n = found.fit.run.settings, [one.name for one in found.fit.free].index(name)
    done = [solved(found.fit, found.x, found.released, settings.at_last)]
    far = abs(done[0].x[n]) > settings.far_value and misfit_of(done[0]) > settings.right
    if name.startswith("rig.") and far and not found.fit.run.over:
        for side in settings.beside:
            x = np.where([one.name in found.released for one in found.fit.free], done[0].x, 0.0)
            x[n] += side
            with contextlib.suppress(SimulationError):
                done.append(solved(found.fit, x, found.released, settings.at_last))
            if sum(misfit_of(one) <= settings.right for one in done) > 1:  # two ends tell how far minima lie apart
                break
    best = min(done, key=lambda one: one.cost)
    near = [one.x[n] for one in done if one.cost - best.cost < settings.near_minima]
    apart = float(np.sqrt(np.mean((np.array(near) - best.x[n]) ** 2)))
    return replace(best, apart={**found.apart, name: apart})


def misfit_of(now: Found) -> float:
    """Largest rms error of a channel beyond its noise, over its rms."""
    run = now.fit.run
    left, size = now.errors.left / run.weights, np.sqrt(np.mean(run.read**2, axis=0))
    beyond = np.maximum((left**2).mean(axis=0) - (1 + run.noise_error) * run.noise**2, 0.0)
    return float(np.max(np.sqrt(beyond) / np.maximum(size, 1e-12), initial=0.0))


def _needed(now: Found, rivals: dict[str, tuple[str, ...]]) -> tuple[Found, dict[str, tuple[str, ...]]]:
    """The fit without releases that the later ones made needless."""
    for name in now.released[:-1]:  # the last one was accepted beside all others
        fewer = tuple(one for one in now.released if one != name)
        with contextlib.suppress(SimulationError):
            without = solved(now.fit, now.x, fewer, apart=now.apart)
            if without.cost - now.cost < now.fit.run.settings.fall:
                now = without
    return now, {name: others for name, others in rivals.items() if name in now.released}


def _measured(now: Found, rivals: Mapping[str, tuple[str, ...]], whole: RecordedCheck, share: float) -> Deviations:
    """The quantities with their uncertainties, by the errors that are left."""
    fit, run, settings = now.fit, now.fit.run, now.fit.run.settings
    left = now.errors.left / run.weights
    size = np.sqrt(np.mean(np.where(run.there, run.read, 0.0) ** 2, axis=0))
    beyond_noise = np.maximum((left**2).mean(axis=0) - run.noise**2, (settings.least_error * size) ** 2)
    per = max(settings.correlated / float(np.median(np.diff(run.time))), 1.0)
    weights = 1 / np.sqrt(run.noise**2 + per * beyond_noise)
    gram = (now.errors.gram * ((weights / run.weights) ** 2)[:, None, None]).sum(axis=0)
    covariance = _inverse(gram, fit.widths(now.released))
    covariance[np.diag_indices_from(covariance)] += [
        now.apart.get(one.name, 0.0) ** 2
        + (settings.least_share if one.log or one.sensor >= 0 else settings.least_time) ** 2
        for one in fit.free
    ]
    spread, misfit, out = np.sqrt(np.diag(covariance)), misfit_of(now), []
    held = bool(_held_back(now, spread))
    for n, one in enumerate(fit.free):
        value, hold = one.at(float(now.x[n])), run.hold if one.name.endswith(".dead_time") else 0.0
        slope = value if one.log else 1.0
        at_end = now.x[n] <= one.lowest
        # where the model is right, a value beyond its tolerance counts although releasing it gained too little
        counts = one.name in now.released or (misfit <= settings.right and not held)
        free = counts and misfit <= settings.explained and not at_end
        # from the nearer end of the tolerance on, whatever the uncertainty
        far = abs(now.x[n]) - one.width > settings.coverage * spread[n]
        out.append(
            Deviation(
                one.name, one.stated + hold, value + hold, float(spread[n] * slope),
                float(one.width * (one.stated if one.log else 1.0)),
                bool(free and far), bool(far or spread[n] < settings.told * one.width), rivals.get(one.name, ())[:2],
            )
        )  # fmt: skip
    gains = fit.gains(now.x)
    shown = run.read - left if share == 1 else whole.read - Fit(whole).errors(now.x).left / whole.weights
    readings = dict(zip(run.names, (shown / gains).T, strict=True))
    return Deviations(tuple(out), misfit, readings, share, now.values)


def recorded_check(
    case: Case, system: System, time: np.ndarray, sent: Mapping[str, np.ndarray], read: Mapping[str, np.ndarray],
    lead: int, settings: DeviationSettings,
) -> RecordedCheck:  # fmt: skip
    """A recording as the fit needs it, see :func:`deviations`; ``system`` may have free play."""
    names = list(read)
    values = np.stack([read[name] for name in names], axis=1)
    there = np.isfinite(values)
    values = np.where(there, values, 0.0)
    rest = values[:lead]
    noise = np.maximum(np.std(rest, axis=0), 1e-12)
    values = values - rest.mean(axis=0)
    size = np.sqrt(np.mean(values**2, axis=0))
    noise_error = settings.coverage * np.sqrt(2 / max(lead, 1))  # relative, of its square
    per = max(settings.correlated / float(np.median(np.diff(time))), 1.0)
    weights = 1 / np.sqrt(noise**2 + per * (settings.model_error * np.maximum(size, noise)) ** 2)
    with_all, free = _coordinates(case, system, names, settings)
    model = compiled(with_all)
    columns = [model.sensors.index(name) for name in names]
    commands = {name: np.asarray(torque) for name, torque in sent.items()}
    of_noise = float(there.sum(axis=0) @ (weights * noise) ** 2)
    hold = case.loop["dead_time"] - case.loop.command_delay()
    return RecordedCheck(
        with_all, time, commands, values, there, weights, noise, float(noise_error), columns, names, free, of_noise,
        hold, settings.stick_speeds[1], settings,
    )  # fmt: skip


def _coordinates(
    case: Case, system: System, sensors: Sequence[str], settings: DeviationSettings
) -> tuple[System, list[_Free]]:
    """The bed with a gain of every torque and a friction where no dynamometer acts; all that is not known exactly."""
    loop, box = case.loop, {one.name: one for one in case.uncertainty.uncertain}
    driven = {one.torque_input: one for one in loop.dynamometers}
    rubbed = {effect.at for effect in system.effects if effect.kind == CoulombFriction.kind}
    added, free = [], list[_Free]()
    factors = tuple(float(np.log(factor)) for factor in settings.factors)
    for name, quantity in system.parameters.items():
        own, (table, *_, key) = box.get(f"rig.{name}"), name.split(".")
        if table not in ("inertias", "shafts") or not quantity.value > 0:
            continue
        if key == "damping":
            width = settings.damping if own is None else own.half_width / quantity.value
            free.append(_Free(f"rig.{name}", name, quantity.value, width or settings.damping, True))
        elif own is not None and own.half_width > 0:
            free.append(_Free(f"rig.{name}", name, quantity.value, own.half_width / quantity.value, True, factors))
    for part in system.inputs:
        one, place = driven.get(part.name), f"inputs.{part.name}"
        if one is None:
            added += [Effect(InputGain.kind, place, (("factor", Quantity(1.0)),)),
                      Effect(DeadTime.kind, place, (("delay", Quantity(0.0)),))]  # fmt: skip
            free += [
                _Free(f"{place}.gain", f"{place}.{InputGain.kind}.factor", 1.0, settings.input_gain, True, factors),
                _Free(f"{place}.delay", f"{place}.{DeadTime.kind}.delay", 0.0, settings.input_delay, False,
                      settings.delays, lowest=0.0),
            ]  # fmt: skip
            at = f"inertias.{part.on}"
            if at not in rubbed and case.largest_torque:
                rubbed.add(at)
                added.append(Effect(CoulombFriction.kind, at, (("torque", Quantity(0.0)),)))
                free.append(_Free(f"{at}.friction", f"{at}.{CoulombFriction.kind}.torque", 0.0,
                                  settings.friction * case.largest_torque, False, lowest=0.0))  # fmt: skip
            continue
        whole = f"dynamometers.{one.name}"
        gain = box.get(f"{whole}.torque_gain")
        width = gain.half_width if gain is not None and gain.half_width > 0 else settings.sensor_gain
        factor = f"{place}.{InputGain.kind}.factor"
        free.append(_Free(f"{whole}.torque_gain", factor, system.parameters[factor].value, width, True, factors))
        for key, parameter in own_times(one).items():
            stated, of_loop = system.parameters[parameter].value, box.get(f"loop.{key}")
            if of_loop is None or of_loop.half_width <= 0:
                continue
            if key == "dead_time":
                late = tuple(delay for delay in settings.delays)
                free.append(_Free(f"{whole}.{key}", parameter, stated, of_loop.half_width, False,
                                  (*late, -0.5 * stated), lowest=-stated))  # fmt: skip
            elif stated > 0:
                free.append(_Free(f"{whole}.{key}", parameter, stated, of_loop.half_width / of_loop.value, True,
                                  factors[3:], lowest=settings.shortest))  # fmt: skip
    for effect in system.effects:
        if effect.law.free_play:
            gap = f"{effect.name}.{effect.law.free_play}"
            free.append(
                _Free(f"{effect.at}.{effect.law.free_play}", gap, system.parameters[gap].value, WIDE[True], True)
            )
    for i, name in enumerate(sensors):
        gain = box.get(f"sensors.{name}.gain")
        width = gain.half_width if gain is not None and gain.half_width > 0 else settings.sensor_gain
        free.append(_Free(f"sensors.{name}.gain", "", 1.0, width, True, factors, i))
    return system.with_effects(*added), free
