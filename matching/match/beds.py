"""Sets of beds under a sampled controller: what they have to keep, what they reach, and how the figures change."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from matching.match.box import Box
from matching.match.case import Case
from matching.match.damping import damping_ratios, rates, swinging, without_resting
from matching.match.kept import FollowedModes, allowed_of, kept
from matching.match.loop import (
    BedSet,
    FrequencyResponse,
    SampledController,
    bed_set,
    can_be_unmeasured,
    closed_poles,
    errors,
    frequency_response,
    return_difference,
    sampled_beds,
    variant_of,
)
from matching.match.loop_modes import ClosedLoop
from matching.match.opened import SHARES, STAYS_OPEN_S, Opened
from matching.match.requirements import Requirements
from modelling.bed.observer import dynamometer_sizes, sensor_noise
from modelling.linear.resolvent import Resolvent, resolvent

# --- What a controller does on a set of beds and what it asks of them: the figures that the search works with.

PLAN_POINTS = 240  # log-spaced frequencies from the band's lower edge to half the sampling frequency
MARGIN_ROUNDS, MARGIN_POINTS = 3, 9  # in looking for the least margin between frequencies, each to a quarter
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
    command_noise : mapping of str to float
        N·m rms of each dynamometer's command, of the sensors' uncertainties alone.
    unexpected_torque : mapping of str to float
        N·m by dynamometer: how far its flange torque is from what the observer expects, a minute after every sensor is
        off by its uncertainty; empty without an observer.
    """

    modulus_margin: float
    margin_at: float
    largest_rolled_off: float
    command_noise: Mapping[str, float]
    unexpected_torque: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Planned:
    """The bed as planned: over the band, and at all frequencies that margin, roll-off and noise need.

    ``uncertainty`` (y,) are the standard deviations of the sensors.
    """

    band: BedSet
    every: BedSet
    uncertainty: np.ndarray

    @cached_property
    def _form(self) -> Resolvent:
        return resolvent(self.every.sampled.A[0])

    def held(self, frequencies: np.ndarray) -> np.ndarray:
        """Readings for commands (f, y, k) at other frequencies (f,), Hz."""
        z = np.exp(2j * np.pi * frequencies * self.every.case.loop["sample_time"])
        held: np.ndarray = self.every.sampled.C[0] @ self._form.columns(z, self.every.sampled.B[0])
        return held


def planned(case: Case, uncertainty: np.ndarray) -> Planned:
    """Prepare the bed as planned; ``uncertainty`` (y,): standard uncertainties of the controller's sensors, SI."""
    over_band = bed_set(case, [{}], np.geomspace(*case.band, 2 * BED_POINTS))
    return Planned(over_band, bed_set(case, [{}], loop_frequencies(case)), uncertainty)


def loop_frequencies(case: Case) -> np.ndarray:
    """Frequencies (f,), Hz, at which margin, roll-off and noise are looked at: up to half the sampling frequency."""
    top = 0.499 / case.loop["sample_time"]
    return np.geomspace(min(case.band[0], top / 2), top, PLAN_POINTS)


def noise_of_sensors(case: Case, sensors: Sequence[str]) -> np.ndarray:
    """Standard uncertainties (y,) of sensors of the rig, SI, counts of encoders that state them included.

    See :func:`modelling.bed.observer.sensor_noise`.
    """
    by_name = {sensor.name: sensor for sensor in case.rig.sensors}
    return np.array([sensor_noise(by_name[name], case.loop["sample_time"]) for name in sensors])


def balanced(matrices: np.ndarray, case: Case) -> np.ndarray:
    """Matrices (…, k, k) from commands to commands, in units of what each dynamometer usually gives.

    A singular value depends on these units where the dynamometers are not alike: 1 N·m of a light machine in the
    engine's place is as much as 10 N·m of one at a wheel. See :func:`modelling.bed.observer.dynamometer_sizes`.
    """
    sizes = dynamometer_sizes(case.rig, case.loop)
    made: np.ndarray = matrices * (sizes / sizes[:, None])
    return made


def margins_of(beds: BedSet, controller: SampledController) -> np.ndarray:
    """Least singular values of I + L over the set's frequencies and between them, of every bed (b,).

    Between frequencies the square is taken for a parabola about the lowest point.
    """
    difference = balanced(return_difference(beds, frequency_response(controller, beds.frequencies)), beds.case)
    squares = np.linalg.svd(difference, compute_uv=False)[..., -1] ** 2
    rows, place = np.arange(len(squares)), np.log(beds.frequencies)
    at = np.clip(squares.argmin(axis=1), 1, len(place) - 2)
    low, middle, high = (squares[rows, at + i] for i in (-1, 0, 1))
    down, up = place[at] - place[at - 1], place[at + 1] - place[at]
    falls, rises = (middle - low) / down, (high - middle) / up
    half_curvature = (rises - falls) / (down + up)
    slope = falls + half_curvature * down
    with np.errstate(divide="ignore", invalid="ignore"):
        bottom = np.where(half_curvature > 0, middle - slope**2 / (4 * half_curvature), middle)
        inside = (np.abs(slope) < 2 * half_curvature * np.maximum(down, up)) & (bottom > 0)
    least: np.ndarray = np.sqrt(np.where(inside, np.minimum(bottom, squares.min(axis=1)), squares.min(axis=1)))
    return least


@dataclass(frozen=True)
class LoopCurves:
    """Of the bed as planned, at all its frequencies (f,).

    Attributes
    ----------
    difference : ndarray (f, k, k)
        I + L.
    margin, closed : ndarray (f,)
        Least singular value of I + L, at a local minimum the least between its neighbours; largest of T; of both in
        balance, see :func:`balanced`.
    margin_at : ndarray (f,)
        Where that is, Hz.
    held, at_margin : ndarray (f, y, k), (f, k, k)
        Readings for commands, and I + L in balance there.
    minima : ndarray (n,)
        Numbers of these minima.
    noise : ndarray (f, k, y)
        Commands for the sensors' standard deviations.
    """

    difference: np.ndarray
    margin: np.ndarray
    closed: np.ndarray
    noise: np.ndarray
    margin_at: np.ndarray
    held: np.ndarray
    at_margin: np.ndarray
    minima: np.ndarray


def loop_curves(
    bed: Planned, controller: SampledController, acting: FrequencyResponse, required: Requirements, below: float
) -> LoopCurves:
    """Return difference, complementary sensitivity and noise of the bed as planned, which the requirements limit.

    The margin's local minima ``below`` a value, from where it counts on, are searched between the frequencies.
    """
    difference, f = return_difference(bed.every, acting)[0], bed.every.frequencies
    case, identity = bed.every.case, np.eye(difference.shape[-1])
    inverse, in_balance = np.linalg.inv(difference), balanced(difference, case)
    margin = np.linalg.svd(in_balance, compute_uv=False)[:, -1]
    at, held, there, begin = f.copy(), bed.every.held[0].copy(), in_balance.copy(), min(required.margin_from, f[-1])
    padded = np.concatenate([[np.inf], np.where(f >= begin, margin, np.inf), [np.inf]])
    low = (margin <= padded[:-2]) & (margin <= padded[2:]) & (margin < below) & (f >= begin)
    minima = np.flatnonzero(low)
    ends = np.stack([np.maximum(f[np.maximum(minima - 1, 0)], begin), f[np.minimum(minima + 1, len(f) - 1)]])
    for _ in range(MARGIN_ROUNDS if len(minima) else 0):
        grid = np.geomspace(ends[0], ends[1], MARGIN_POINTS)  # (p, minima)
        held_there = bed.held(grid.ravel())
        acting_there = frequency_response(controller, grid.ravel()).of_readings
        differences = balanced(identity - acting_there @ held_there, case)
        least = np.linalg.svd(differences, compute_uv=False)[:, -1].reshape(grid.shape)
        lowest, column = least.argmin(axis=0), np.arange(len(minima))
        better = least[lowest, column] < margin[minima]
        flat, rows = (lowest * len(minima) + column)[better], minima[better]
        margin[rows], at[rows] = least.ravel()[flat], grid.ravel()[flat]
        held[rows], there[rows] = held_there[flat], differences[flat]
        ends = np.stack(
            [grid[np.maximum(lowest - 1, 0), column], grid[np.minimum(lowest + 1, MARGIN_POINTS - 1), column]]
        )
    return LoopCurves(
        difference, margin, np.linalg.svd(balanced(inverse - identity, case), compute_uv=False)[:, 0],
        inverse @ (acting.of_readings * bed.uncertainty), at, held, there, minima,
    )  # fmt: skip


def command_noise(curves: LoopCurves, frequencies: np.ndarray) -> np.ndarray:
    """N·m rms (k,): a sample's noise is spread evenly up to half the sampling frequency."""
    power = (np.abs(curves.noise) ** 2).sum(axis=2)
    return np.sqrt(noise_weights(frequencies) @ power)


# --- What offsets of the sensors make of an observer's expectation.
#
# An observer that does not listen to the flange knows the twist of a shaft as the integral of a difference of speeds,
# and an offset of a speed becomes a torque that grows. The step response, weighted by exp(−t) with t in minutes, is
# what the loop makes of a constant at z = exp(T/60 s); it is finite also where a motion rests at z = 1.

OFFSET_TIME_S = 60.0


@dataclass(frozen=True)
class OffsetFigures:
    """What offsets do; f flanges, k dynamometers, x states of the controller, y sensors.

    Attributes
    ----------
    torque : ndarray (f,)
        N·m: flange torques less what is expected, of offsets as large as the sensors' uncertainties, root sum square.
    left, right : ndarray (f, x + k), (f, x + y)
        A change of the controller's matrices dM changes a torque by left·dM·right.
    """

    torque: np.ndarray
    left: np.ndarray
    right: np.ndarray


def offset_figures(bed: Planned, controller: SampledController) -> OffsetFigures | None:
    """What offsets do on the bed as planned; None without an observer."""
    if controller.expected is None or controller.delayed_commands is None:
        return None
    o, k, y = controller.reached, len(controller.C), len(controller.sensors)
    f = len(bed.every.case.loop.flanges)  # the first readings
    z = np.exp(controller.sample_time / OFFSET_TIME_S)
    held = bed.held(np.array([np.log(z) / (2j * np.pi * controller.sample_time)]))[0].real  # (y, k)
    feedback, expected = controller.feedback, controller.expected[:, :o]
    forward = np.linalg.inv(z * np.eye(o) - feedback.A)
    states = forward @ feedback.B
    acting = feedback.C @ states + feedback.D
    seen = np.linalg.inv(np.eye(y) - held @ acting)
    missing = np.eye(y) - expected @ states
    unexpected = (missing @ seen)[:f]
    of_command = np.hstack([feedback.C @ forward, np.eye(k)])
    left = np.hstack([-expected @ forward, np.zeros((y, k))]) + missing @ seen @ held @ of_command
    square = (unexpected * bed.uncertainty) ** 2
    torque = np.sqrt(square.sum(axis=1))
    weights = unexpected * bed.uncertainty**2 / np.maximum(torque, 1e-300)[:, None]
    right = (np.vstack([states, np.eye(y)]) @ seen @ weights.T).T
    return OffsetFigures(torque, left[:f], right)


def noise_weights(f: np.ndarray) -> np.ndarray:
    """Weights (f,) of a mean over all frequencies up to the last; below the first it counts as there."""
    edges = np.r_[0.0, (f[1:] + f[:-1]) / 2, f[-1]]
    return np.diff(edges) / f[-1]


def counted(bed: Planned, required: Requirements) -> tuple[np.ndarray, np.ndarray]:
    """At which frequencies (f,) the margin counts, and at which the roll-off."""
    f = bed.every.frequencies
    return f >= min(required.margin_from, f[-1]), f >= required.rolled_off_from


def loop_figures(bed: Planned, controller: SampledController, required: Requirements) -> LoopFigures:
    """Margin, roll-off and noise of a controller."""
    f = bed.every.frequencies
    curves = loop_curves(bed, controller, frequency_response(controller, f), required, np.inf)
    margin, rolled_off = counted(bed, required)
    lowest = int(np.where(margin, curves.margin, np.inf).argmin())
    largest = curves.closed[rolled_off].max(initial=0.0)
    noise = dict(zip(controller.dynamometers, command_noise(curves, f).tolist(), strict=True))
    offsets = offset_figures(bed, controller)
    unexpected = [] if offsets is None else offsets.torque.tolist()
    flanges = [controller.dynamometers[j] for j in bed.every.case.loop.with_flange]
    return LoopFigures(
        float(curves.margin[lowest]), float(curves.margin_at[lowest]), float(largest), noise,
        dict(zip(flanges, unexpected)),
    )  # fmt: skip


# --- The worst beds of a box: descent by the gradients of dampings, ascent of the error, from planned and drawn beds.
#
# The least damped mode may be one of the residual vehicle that no bed moves, and another one fall below it in a corner
# of the box. So the descent follows those modes that their gradients promise to be damped least in a corner.

STARTS = 1  # drawn beds with the least damping, in addition to the bed as planned
ROUNDS = 4  # of the descent at most, each with a gradient of its own
ERROR_ROUNDS = 2  # of the error's, which takes longer to work out
DIFFERENCE = 0.02  # of a half-width
CORNER_SHARES = (1.0, 0.5, 0.25)  # of the way to the corner that the gradient points to
DEPENDS = 1e-6  # relative change over a half-width below which a figure does not depend on anything: rounding
FOLLOWED = 4  # figures whose corners are tried in a round
WORTH_A_ROUND = 0.02  # relative fall below which no other round follows
NAMED = 4  # quantities that a figure depends on most


@dataclass(frozen=True)
class NamedMode:
    """A mode of one bed's closed loop, in the words that a sentence needs.

    Attributes
    ----------
    frequency : float
        Hz.
    damping_ratio, asked : float
        What it has, and what it is asked for.
    owner : str
        Component that holds most of its energy, as ``shafts.NAME`` or ``residual_vehicle.inertias.NAME``; empty where
        it is one of the controller's from sample to sample.
    share : float
        Of the kinetic or potential energy that the owner holds.
    kind : str
        ``kinetic`` or ``potential``: which of them.
    """

    frequency: float
    damping_ratio: float
    asked: float
    owner: str
    share: float
    kind: str

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return dict(vars(self))

    def words(self) -> str:
        """Frequency and owner."""
        where = f"{self.frequency:.3g} Hz"
        if not self.owner:
            return f"{where} (a mode of the controller)"
        return f"{where} ({self.owner}, {100 * self.share:.0f} % of its {self.kind} energy)"


@dataclass(frozen=True)
class WorstBed:
    """The bed of the box with the least damping, over what its mode is asked for, that was met.

    Attributes
    ----------
    mode : NamedMode or None
        None where the bed grows without swinging.
    damping_ratio : float
        Negative where it is not stable.
    values : mapping
        SI, by name.
    named : tuple of str
        Quantities that its damping depends on most, most first.
    """

    damping_ratio: float
    values: Mapping[str, float]
    named: tuple[str, ...]
    mode: NamedMode | None = None

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "damping_ratio": self.damping_ratio, "stable": self.damping_ratio > 0, "values": dict(self.values),
            "depends_most_on": list(self.named), "mode": None if self.mode is None else self.mode.to_dict(),
        }  # fmt: skip


@dataclass(frozen=True)
class DampingFault:
    """Drawn beds with one mode damped by less than it is asked for: how many, and the mode where that is worst."""

    beds: int
    mode: NamedMode

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {"beds": self.beds, **self.mode.to_dict()}


@dataclass(frozen=True)
class LargestError:
    """The bed of the box with the largest response error to unmeasured torques that was met; as :class:`WorstBed`."""

    unmeasured: float
    values: Mapping[str, float]
    named: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {"unmeasured": self.unmeasured, "values": dict(self.values), "depends_most_on": list(self.named)}


def worst_bed(
    dampings: Callable[[np.ndarray], np.ndarray], box: Box, positions: np.ndarray
) -> WorstBed | None:  # fmt: skip
    """Look for the bed with the least damping; None where nothing is uncertain.

    Parameters
    ----------
    dampings : callable
        Damping ratios (b, m) of the least damped modes of beds at positions (b, p), least first.
    positions : ndarray (b, p)
        Drawn beds in the box, least damped first.
    """
    if not box.uncertain or not len(positions):
        return None
    starts = [np.zeros(len(box.uncertain)), *positions[:STARTS]]
    descents = [descended(dampings, position, ROUNDS) for position in starts]
    ratio, position, slopes = min(descents, key=lambda descent: descent[0])
    return WorstBed(ratio, box.at(position), _named(box, slopes))


def largest_error(
    error: Callable[[np.ndarray], np.ndarray], box: Box, position: np.ndarray
) -> LargestError | None:  # fmt: skip
    """Look for the bed with the largest error; None where nothing is uncertain.

    Parameters
    ----------
    error : callable
        Response errors (b,) of beds at positions (b, p); infinite where one is not stable, which no ascent goes to.
    position : ndarray (p,)
        The drawn bed with the largest error.
    """
    if not box.uncertain:
        return None

    def to_lower(positions: np.ndarray) -> np.ndarray:
        values = error(positions)
        return np.where(np.isfinite(values), -values, 0.0)[:, None]

    lowered, end, slopes = descended(to_lower, position, ERROR_ROUNDS)
    return LargestError(-lowered, box.at(end), _named(box, slopes))


def _named(box: Box, slopes: np.ndarray) -> tuple[str, ...]:
    return tuple(box.uncertain[i].name for i in np.argsort(-np.abs(slopes))[:NAMED])


def descended(
    of: Callable[[np.ndarray], np.ndarray], position: np.ndarray, rounds: int
) -> tuple[float, np.ndarray, np.ndarray]:  # value, position (p,), slopes (p,)
    """The least value met on the way from a position, towards the corners that the gradients of figures point to.

    ``of`` gives figures (b, m) at positions (b, p), least first; one that depends on nothing has no gradient but
    rounding.
    """
    figures, named = of(position[None])[0], np.zeros(len(position))
    for _ in range(rounds):
        inward = np.where(position > 0, -DIFFERENCE, DIFFERENCE)
        slopes = (of(position + np.diag(inward)) - figures) / inward[:, None]
        depends = np.flatnonzero(np.abs(slopes).max(axis=0) > DEPENDS * np.abs(figures))
        if not len(depends):
            break
        in_corner = (figures - np.abs(slopes).sum(axis=0))[depends]
        pointing = slopes.T[depends[np.argsort(in_corner, kind="stable")[:FOLLOWED]]]
        tried = [
            (slope, position + share * (-np.sign(slope) - position)) for slope in pointing for share in CORNER_SHARES
        ]
        ends = of(np.array([place for _, place in tried]))
        best = int(np.argmin(ends[:, 0]))
        named = tried[best][0]
        if ends[best][0] > figures[0] - WORTH_A_ROUND * abs(figures[0]):
            break
        figures, position = ends[best], tried[best][1]
    return float(figures[0]), position, named


# --- Fresh beds drawn from what is not known exactly, judged by the exact loop.

ERROR_POINTS = 150  # of the response error over the band, midpoints of equal parts of its logarithm
MODES = 16  # of a bed, the least damped ones, that the search for the worst bed looks at
AT_ONCE = 50  # beds


@dataclass(frozen=True)
class BedsCheck:
    """Of all drawn beds.

    Attributes
    ----------
    drawn, stable, damped, kept : int
        ``damped`` beds have every mode damped by what it is asked for (:mod:`matching.match.damping`); ``kept`` ones
        keep that, both response errors and every target mode (:mod:`matching.match.kept`).
    smallest_damping_ratio, required_damping : float
        Of any mode on any bed, −1 where one grows without swinging; and what is asked for of a mode that is neither the
        vehicle's nor the bed's own.
    measured, unmeasured : tuple of float
        Response errors of every stable bed, smallest first, each against the vehicle with the same specimen.
    worst : WorstBed or None
        The least damped bed of the box that descents from the bed as planned and from the worst drawn one find.
    largest_error : LargestError or None
        The bed with the largest error to unmeasured torques that an ascent from the worst of the drawn ones finds.
    opened : mapping of float to float
        Least damping ratio of the bed as planned, by the share that is left of its cut shafts' stiffness and damping;
        −1 where it grows without swinging, faster than play stays open. In ``result.json``: ``opened_cut_shafts``, a
        list with ``share_left``, ``damping_ratio``, ``stable`` and ``smallest_damping_ratio_alone``, that with one cut
        shaft opened alone.
    opened_alone : mapping of str to mapping of float to float
        The same where one cut shaft opens and the others do not, by its name.
    faults : tuple of DampingFault
        Modes that are damped too little on stable beds, the most frequent first.
    """

    drawn: int
    stable: int
    damped: int
    smallest_damping_ratio: float
    required_damping: float
    measured: tuple[float, ...]
    unmeasured: tuple[float, ...]
    worst: WorstBed | None = None
    largest_error: LargestError | None = None
    opened: Mapping[float, float] = field(default_factory=dict)
    opened_alone: Mapping[str, Mapping[float, float]] = field(default_factory=dict)
    faults: tuple[DampingFault, ...] = ()
    kept: int = 0

    @property
    def holds(self) -> bool:
        """Whether every bed is stable and damped."""
        return self.stable == self.damped == self.drawn

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "drawn": self.drawn, "stable": self.stable, "damped": self.damped, "kept": self.kept,
            "smallest_damping_ratio": self.smallest_damping_ratio,
            "required_damping_ratio": self.required_damping,
            "damped_too_little": [fault.to_dict() for fault in self.faults],
            "error_median": quantile(self.measured, 0.5), "error_95": quantile(self.measured, 0.95),
            "unmeasured_median": quantile(self.unmeasured, 0.5), "unmeasured_95": quantile(self.unmeasured, 0.95),
            "worst": None if self.worst is None else self.worst.to_dict(),
            "largest_error": None if self.largest_error is None else self.largest_error.to_dict(),
            "opened_cut_shafts": [
                {"share_left": share, "damping_ratio": ratio, "stable": ratio > 0,
                 "smallest_damping_ratio_alone": min(
                     (alone[share] for alone in self.opened_alone.values()), default=ratio
                 )}
                for share, ratio in self.opened.items()
            ],
        }  # fmt: skip


def quantile(values: Sequence[float], share: float) -> float | None:
    """Quantile of values; None where there are none."""
    return float(np.quantile(values, share)) if values else None


@dataclass(frozen=True)
class BedVerdicts:
    """Of b beds, each (b,).

    Attributes
    ----------
    stable, damped : ndarray of bool
    damping_ratio : ndarray
        Least of any mode; −1 where a bed grows without swinging.
    mode, asked : ndarray
        Eigenvalue (1/s) of the mode that has least of what it is asked for, and the damping ratio that it is asked for.
    measured, unmeasured : ndarray
        Response errors: the controller knows the rig's torques as the case says, or does not.
    kept : ndarray of bool
        Which beds keep everything that is asked of a drawn bed (:mod:`matching.match.kept`), target modes included
        where the judge follows them.
    """

    stable: np.ndarray
    damping_ratio: np.ndarray
    damped: np.ndarray
    mode: np.ndarray
    asked: np.ndarray
    measured: np.ndarray
    unmeasured: np.ndarray
    kept: np.ndarray


class Judge:
    """A controller on any variant of the bed of a case.

    Parameters
    ----------
    neutral : int
        Rigid motions that nothing slows: poles that may rest at 1.
    required : Requirements
    followed : FollowedModes, optional
        Of the bed as planned: target modes are judged as well.
    """

    def __init__(
        self, case: Case, controller: SampledController, neutral: int, required: Requirements,
        followed: FollowedModes | None = None,
    ):  # fmt: skip
        self.case, self.controller, self.neutral, self.required = case, controller, neutral, required
        self.followed = followed
        low, high = np.log(case.band)
        self.frequencies = np.exp(low + (high - low) * (np.arange(ERROR_POINTS) + 0.5) / ERROR_POINTS)
        self.acting = frequency_response(controller, self.frequencies)
        self._counted = np.ones(len(case.compared), bool), can_be_unmeasured(case)

    def verdicts(self, values: Sequence[Mapping[str, float]]) -> BedVerdicts:
        """Beds with these values, by name, SI."""
        parts = [self._verdicts(values[i : i + AT_ONCE]) for i in range(0, len(values), AT_ONCE)]
        names = [field.name for field in fields(BedVerdicts)]
        return BedVerdicts(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def _verdicts(self, values: Sequence[Mapping[str, float]]) -> BedVerdicts:
        beds, step, rows = (
            bed_set(self.case, values, self.frequencies),
            self.controller.sample_time,
            np.arange(len(values)),
        )
        z = without_resting(closed_poles(beds.sampled, self.controller), self.neutral)
        ratios, stable = damping_ratios(z, step), (np.abs(z) < 1).all(axis=1)
        asked = beds.sampled.asked_damping(z, step, self.required)
        worst = (ratios / asked).argmin(axis=1)
        measured, unmeasured = (
            np.sqrt(errors(beds, self.acting, known)[:, pairs].mean(axis=1))
            for known, pairs in zip((self.case.loop.measured, ()), self._counted, strict=True)
        )
        least, damped = ratios.min(axis=1), np.asarray((ratios >= asked).all(axis=1))
        figures = {
            "stable": stable, "damped": damped, "response_error": measured, "response_error_unmeasured": unmeasured,
        }  # fmt: skip
        if self.followed is not None:
            figures |= self.followed.errors(self.case, values, rates(z, step))
        return BedVerdicts(
            stable, np.where(stable | (least < 0), least, -1.0), damped, rates(z, step)[rows, worst],
            asked[rows, worst], measured, unmeasured, kept(figures, allowed_of(self.case, figures))["all"],
        )  # fmt: skip

    def _ratios(self, values: Sequence[Mapping[str, float]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Damping ratios (b, x), what each mode is asked for (b, x), and which beds (b,) are stable."""
        beds, step = sampled_beds(self.case, values), self.controller.sample_time
        z = without_resting(closed_poles(beds, self.controller), self.neutral)
        ratios = damping_ratios(z, step)
        return ratios, beds.asked_damping(z, step, self.required), (np.abs(z) < 1).all(axis=1)

    def dampings(self, positions: np.ndarray) -> np.ndarray:
        """Damping (b, m) of the least damped modes of beds at positions (b, p) of the box, least first.

        Each counts over what it is asked for, times what is asked for at most; −1 where a bed grows without swinging.
        """
        values = [self.case.uncertainty.at(position) for position in positions]
        ratios, asked, stable = self._ratios(values)
        return _least_first(ratios * self.required.damping_ratio / asked, stable)

    def opened(self, values: Sequence[Mapping[str, float]]) -> np.ndarray:
        """Least damping ratio (b,) of beds with opened cut shafts; −1 where one grows, faster than play stays open."""
        beds, step = sampled_beds(self.case, values), self.controller.sample_time
        z = without_resting(closed_poles(beds, self.controller), self.neutral)
        drift = np.where(swinging(z, step), 0.0, np.abs(z)).max(axis=1)
        least = damping_ratios(z, step).min(axis=1)
        return np.where(np.log(np.maximum(drift, 1e-300)) / step < 1 / STAYS_OPEN_S, least, np.minimum(least, -1.0))

    def named_mode(self, values: Mapping[str, float], s: complex, asked: float) -> NamedMode:
        """The mode of a bed with these values that has an eigenvalue (1/s), in words."""
        bed = variant_of(self.case, values)
        modes = ClosedLoop.of(bed, self.controller).modes()
        upper = complex(s.real, abs(s.imag))
        nearest = min(
            (mode for mode in modes if mode.belongs_to == "feedback" and mode.frequency > 0),
            key=lambda mode: abs(mode.eigenvalue - upper), default=None,
        )  # fmt: skip
        owner, share, kind = "", 0.0, ""
        if nearest is not None and abs(nearest.eigenvalue - upper) < SAME_MODE * abs(upper):
            shares = [
                (part, name, kind) for kind in ("kinetic", "potential") for name, part in getattr(nearest, kind).items()
            ]
            share, owner, kind = max(shares, default=(0.0, "", ""))
        return NamedMode(abs(s) / (2 * np.pi), -s.real / abs(s), asked, owner, float(share), kind)

    def unmeasured(self, positions: np.ndarray) -> np.ndarray:
        """Response errors (b,) to unmeasured torques; infinite where a bed is not stable."""
        found = self.verdicts([self.case.uncertainty.at(position) for position in positions])
        return np.where(found.stable, found.unmeasured, np.inf)


def _least_first(ratios: np.ndarray, stable: np.ndarray) -> np.ndarray:
    """Damping (b, m) of the least damped modes, of pairs one each; −1 first where a bed (b,) grows without swinging."""
    padded = np.pad(ratios, ((0, 0), (0, 2 * MODES)), constant_values=1.0)  # sets differ in delayed commands
    least: np.ndarray = np.sort(padded, axis=1)[:, : 2 * MODES : 2]
    least[:, 0] = np.where(stable | (least[:, 0] < 0), least[:, 0], -1.0)
    return least


SAME_MODE = 1e-3  # relative: between an eigenvalue of a batch and of one loop
ONE_MODE = 1.25  # between the frequencies of a mode on two beds, at most


def damping_faults(judge: Judge, values: Sequence[Mapping[str, float]], found: BedVerdicts) -> tuple[DampingFault, ...]:
    """The modes that are damped too little on stable beds; on every bed that which lacks most."""
    lacking = np.flatnonzero(found.stable & ~found.damped)
    lacking = lacking[np.argsort(np.abs(found.mode[lacking]))]
    groups: list[list[int]] = []
    for number in lacking.tolist():
        if groups and np.abs(found.mode[number]) < ONE_MODE * np.abs(found.mode[groups[-1][0]]):
            groups[-1].append(number)
        else:
            groups.append([number])
    faults = []
    for group in groups:
        ratios = -found.mode[group].real / np.abs(found.mode[group]) / found.asked[group]
        worst = group[int(ratios.argmin())]
        mode = judge.named_mode(values[worst], complex(found.mode[worst]), float(found.asked[worst]))
        faults.append(DampingFault(len(group), mode))
    return tuple(sorted(faults, key=lambda fault: -fault.beds))


def check_beds(
    case: Case, controller: SampledController, neutral: int, required: Requirements, count: int, seed: int
) -> BedsCheck:  # fmt: skip
    """Draw fresh beds from the case's box and judge every one; then look for the worst of the box."""
    followed = FollowedModes.of_targets(case, ClosedLoop.of(variant_of(case, {}), controller))
    judge, box = Judge(case, controller, neutral, required, followed), case.uncertainty
    positions = box.draw(count, seed)
    values = [box.at(position) for position in positions]
    found = judge.verdicts(values)
    # rounded: beds whose least damped mode is the same that none of them moves stay as they were drawn
    shares = np.where(found.stable, -found.mode.real / np.abs(found.mode) / found.asked, -1.0)
    worst = worst_bed(judge.dampings, box, positions[np.argsort(np.round(shares, 9), kind="stable")])
    if worst is not None:
        worst = _with_mode(judge, worst)
    candidates = np.where(found.stable, found.unmeasured, -np.inf)
    at = int(np.argmax(candidates))
    largest = largest_error(judge.unmeasured, box, positions[at]) if found.stable[at] else None
    shafts = [dynamometer.follows for dynamometer in case.loop.dynamometers]
    alone = {
        name: _dampings_opened(judge, None if len(shafts) == 1 else name) for name in shafts
    }  # fmt: skip
    together = alone[shafts[0]] if len(shafts) == 1 else _dampings_opened(judge, None)
    return BedsCheck(
        count, int(found.stable.sum()), int((found.stable & found.damped).sum()), float(found.damping_ratio.min()),
        required.damping_ratio, tuple(np.sort(found.measured[found.stable]).tolist()),
        tuple(np.sort(found.unmeasured[found.stable]).tolist()), worst, largest, opened=together, opened_alone=alone,
        faults=damping_faults(judge, values, found), kept=int(found.kept.sum()),
    )  # fmt: skip


def _with_mode(judge: Judge, worst: WorstBed) -> WorstBed:
    """The worst bed with its own damping ratio, and the mode that it belongs to."""
    found = judge.verdicts([worst.values])
    if not found.stable[0] and found.damping_ratio[0] <= -1:
        return replace(worst, damping_ratio=-1.0)
    mode = judge.named_mode(worst.values, complex(found.mode[0]), float(found.asked[0]))
    return replace(worst, damping_ratio=mode.damping_ratio, mode=mode)


def _dampings_opened(judge: Judge, alone: str | None) -> dict[float, float]:
    """Least damping ratio of the bed as planned by the share left of its cut shafts, or of one of them alone."""
    found = judge.opened([Opened(share, alone).values(judge.case, {}) for share in SHARES])
    return dict(zip(SHARES, found.tolist(), strict=True))
