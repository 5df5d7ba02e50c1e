"""What manufacturing tolerances of the bed do to a match whose controller stays as it is.

Every quantity of the rig that has a range in its file, and what the user adds, is drawn evenly from it, each on its
own (a mirror image too). Margin, stability, the feedback loop's modes and the response errors come of every draw. Where
quantities of the controller are drawn as well, response errors have to be worked out singly, and come of the first few
hundred. A component that vehicle and rig share is the same piece of hardware: there the vehicle it is compared with has
the drawn value too.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import scipy

from matching.match.beds import requirements
from matching.match.case import Case, apply
from matching.match.case_file import case_files, movable
from matching.match.continuous_loop import encirclements, feedback_modes
from matching.match.loop import Parts, body, parts_of, watched
from matching.match.programme import LinearResponse, closed_loop
from matching.match.responses import (
    BandNodes,
    ComparedBed,
    SampledLoop,
    feed_forward_action,
    log_squares,
    nodes_of,
    pooled,
)
from matching.studies import run
from modelling.bed.vehicle import cut
from modelling.display import Displayed
from modelling.equations.casadi_code import Complex, compiled, exp, joined, solve
from modelling.errors import VERSION, InputError, unknown
from modelling.modal.modes import modes
from modelling.simulation.compiled import VectorFunction
from modelling.system import System

# --- How a result spreads over draws, and which inputs drive it.

LEVELS = (0.01, 0.05, 0.5, 0.95, 0.99)
CONFIDENCE = 0.95  # of the intervals of quantiles
BINS = 60


@dataclass(frozen=True)
class Spread:
    """Distribution of one result.

    Attributes
    ----------
    nominal, mean, standard_deviation : float
    quantiles : dict of float to float
    intervals : dict of float to (float or None, float or None)
        Confidence interval (95 %) of each quantile from order statistics, whatever the distribution; None for an end
        that so few draws do not bound (David and Nagaraja, Order Statistics, 2003, 7.1).
    drivers : tuple of (str, float)
        Share of the variance that goes along with each input, straight or as its square, largest first: covariance of
        its part of a regression with the regression (Pratt 1987). For independent inputs these are the squared
        standardised regression coefficients (Saltelli et al., Global Sensitivity Analysis, 2008, 1.2.5); they add up
        to ``explained`` also where the draws are correlated by chance.
    explained : float
        Share of the variance that all inputs explain so (R²), each for itself; NaN where nothing spreads.
    edges, counts : ndarray (b + 1,), (b,)
        Histogram.
    """

    name: str
    unit: str
    nominal: float
    mean: float
    standard_deviation: float
    quantiles: dict[float, float]
    intervals: dict[float, tuple[float | None, float | None]]
    drivers: tuple[tuple[str, float], ...]
    explained: float
    draws: int
    edges: np.ndarray
    counts: np.ndarray

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "name": self.name, "unit": self.unit, "nominal": self.nominal, "mean": self.mean,
            "standard_deviation": self.standard_deviation, "draws": self.draws,
            "quantiles": {f"{level:g}": value for level, value in self.quantiles.items()},
            "quantile_intervals": {f"{level:g}": list(ends) for level, ends in self.intervals.items()},
            "drivers": [{"name": name, "share": share} for name, share in self.drivers],
            "explained": self.explained if np.isfinite(self.explained) else None,
        }  # fmt: skip


class Regressors:
    """Draws x (b, p) of named inputs, straight and squared, each with mean 0 and standard deviation 1."""

    def __init__(self, inputs: Sequence[str], x: np.ndarray):
        self.inputs = tuple(inputs)
        plain = _standard(x)
        self._terms = np.hstack([plain, _standard(plain**2)])
        self._products = self._terms.T @ self._terms

    def __len__(self) -> int:
        return len(self._terms)

    def explained(self, values: np.ndarray) -> tuple[list[float], float]:
        """Share of the variance of values (b,) by input, and of all together, by least squares; NaN for too few."""
        if len(self) <= 2 * len(self.inputs) + 1:
            return [0.0] * len(self.inputs), float("nan")
        wanted = (values - values.mean()) / values.std()
        coefficients = np.linalg.lstsq(self._products, self._terms.T @ wanted, rcond=None)[0]
        along = coefficients * (self._products @ coefficients) / len(self)  # covariance of each term with the fit
        shares = np.clip(np.sum(along.reshape(2, -1), axis=0), 0, 1).tolist()
        return shares, float(1 - np.mean((wanted - self._terms @ coefficients) ** 2))


def spread(name: str, unit: str, nominal: float, values: np.ndarray, drawn: Regressors) -> Spread:
    """Spread of values (b,) over draws of the inputs."""
    shares, explained = [0.0] * len(drawn.inputs), float("nan")
    size = float(values.std())
    if size > 1e-9 * max(abs(nominal), 1e-300):
        shares, explained = drawn.explained(values)
    counts, edges = np.histogram(values, BINS)
    ranked = sorted(zip(drawn.inputs, shares, strict=True), key=lambda pair: -pair[1])
    return Spread(
        name, unit, float(nominal), float(values.mean()), size,
        dict(zip(LEVELS, np.quantile(values, LEVELS).tolist(), strict=True)), quantile_intervals(values),
        tuple(ranked), explained, len(values), edges, counts,
    )  # fmt: skip


def quantile_intervals(values: np.ndarray) -> dict[float, tuple[float | None, float | None]]:
    """Confidence intervals of the quantiles :data:`LEVELS` by order statistics of values (b,).

    The number of draws below a quantile is binomial, so the interval from one ordered draw to another covers it at
    least as often as stated.
    """
    ordered, count = np.sort(values), len(values)
    intervals: dict[float, tuple[float | None, float | None]] = {}
    for level in LEVELS:
        # this many draws and one lie below, or fewer
        first = int(scipy.stats.binom.ppf((1 - CONFIDENCE) / 2, count, level)) - 1
        last = int(scipy.stats.binom.ppf((1 + CONFIDENCE) / 2, count, level))
        below = float(ordered[first]) if first >= 0 else None
        intervals[level] = (below, float(ordered[last]) if last < count else None)
    return intervals


def _standard(x: np.ndarray) -> np.ndarray:
    """Columns (b, p) with mean 0 and standard deviation 1."""
    size = x.std(axis=0)
    return (x - x.mean(axis=0)) / np.where(size > 0, size, 1.0)


# --- Response errors of many drawn beds at once, with the controller as it is.
#
# At each of the frequencies at which the nominal errors have converged, rig and vehicle of all draws are solved as
# dynamic stiffnesses and the sampled controller is closed round them, as in
# :mod:`matching.match.responses`. One thing is not worked out anew for every draw: what the images of
# the
# held command beyond half the sampling frequency add to the sampled plant, some 10⁻⁴ of it, goes through the nominal
# rig.
# The first image on either side is late and lagged as drawn, the others are late as drawn. A study checks some of its
# draws exactly and states the largest difference.

AT_ONCE = 128  # draws
HARDWARE = ("loop.dead_time", "loop.inverter_lag", "loop.torque_sensor_lag")  # of the loop; the rest is the controller

Matrix = list[list[Complex]]


def covered(names: Sequence[str]) -> bool:
    """Whether every drawn quantity is hardware; other quantities of the loop change the controller."""
    return all(not name.startswith("loop.") or name in HARDWARE for name in names)


class DrawnErrors:
    """Response errors of a bed with some of its quantities drawn.

    Parameters
    ----------
    bed : ComparedBed
        Nominal.
    names : sequence of str
        The quantities, p of them, :func:`covered`.
    center : ndarray (p,)
        Their nominal values.
    nodes : BandNodes
        f frequencies.
    """

    def __init__(self, bed: ComparedBed, names: Sequence[str], center: np.ndarray, nodes: BandNodes):
        self._weights, f = nodes.weights, nodes.frequencies
        functions = BedExpressions(bed, names)
        k, loop = functions.k, SampledLoop(bed.parts, f)
        s = 2j * np.pi * f
        held = -np.expm1(-s * bed.parts.case.loop["sample_time"]) / (s * bed.parts.case.loop["sample_time"])
        controller = [loop.control]
        if functions.measured:
            assert bed.feed_forward is not None, "what takes measured torques has a feed-forward"
            names_of = [dynamometer.name for dynamometer in bed.parts.dynamometers]
            action = feed_forward_action(bed.feed_forward, bed.parts.toward, names_of, f)
            controller += [action.commands, action.expected]
        table = [s[:, None], held[:, None], *(part.reshape(len(f), -1) for part in controller)]

        def uniform(images: Sequence[np.ndarray]) -> np.ndarray:
            every = np.concatenate([*table, *(image.reshape(len(f), -1) for image in images)], axis=1).T
            return np.concatenate([every.real, every.imag])[:, :, None]

        none = [np.zeros((len(f), 2 * k, k), complex)] * 3
        re, im = np.split(VectorFunction(functions.of_commands)(uniform(none), center[:, None, None])[:, :, 0], 2)
        rest = loop.of_commands - (re + 1j * im).T.reshape(-1, 2 * k, k)
        first = [loop.image(n) for n in (1, -1)]
        self._uniform = uniform([*first, rest - first[0] - first[1]])
        self._squares = VectorFunction(functions.squares)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Response errors (b, 2) of draws x (b, p): to torques as the case measures them, and to unmeasured ones."""
        errors = []
        for begin in range(0, len(x), AT_ONCE):
            squares = self._squares(self._uniform, x[begin : begin + AT_ONCE].T[:, None])
            errors.append(np.sqrt(np.einsum("f,efb->be", self._weights, squares)))
        return np.concatenate(errors)


class BedExpressions:
    """The bed at one frequency as functions of a table of what all draws share there and of the drawn values (p,).

    The table holds, real parts before imaginary parts: s, the hold's response, the controller (k, 2k + r), commands
    (k, w) and expected readings (2k, w) of the feed-forward, and the first image above, the one below and all others,
    each (2k, k); row by row.

    Attributes
    ----------
    squares : casadi.Function
        Means over the compared functions of |log(H_rig/H_vehicle)|², as measured and unmeasured.
    of_commands : casadi.Function
        The sampled readings by commands (2k·k), real parts, then imaginary parts.
    """

    def __init__(self, bed: ComparedBed, names: Sequence[str]):
        parts, case = bed.parts, bed.parts.case
        self._parts, self.k = parts, len(parts.dynamometers)
        feed_forward = bed.feed_forward if bed.measured.any() else None
        self.measured = () if feed_forward is None else tuple(feed_forward.measured)
        width, w, k = 2 * self.k + len(parts.simulated), len(self.measured), self.k
        count = 2 + k * width + 3 * k * w + 6 * k * k
        table, x = ca.SX.sym("table", 2 * count), ca.SX.sym("x", len(names))
        values = iter(Complex(table[i], table[count + i]) for i in range(count))
        s, hold = next(values), next(values)
        control, commands, expected, *images = (
            _matrix(values, *shape) for shape in ((k, width), (k, w), (2 * k, w), *[(2 * k, k)] * 3)
        )
        drawn = dict(zip(names, ca.vertsplit(x), strict=True)) if names else {}
        loop = {name: drawn.get(f"loop.{name}", ca.SX(value)) for name, value in case.loop.values.items()}
        delay = ca.fmax(loop["dead_time"] - case.loop["sample_time"] / 2, 0)
        self._lag = 1 / (1 + s * loop["torque_sensor_lag"])
        self._acting = hold * exp(-(s * delay)) / (1 + s * loop["inverter_lag"])
        self._rig = _linear(parts.rig.system, drawn, s)
        self._control = control
        columns = [self._readings(dynamometer.torque_input) for dynamometer in parts.dynamometers]
        changes = self._image_changes(s, loop, delay)
        self._plant = [
            [
                sum((image[i][j] * change for image, change in zip(images, changes)), columns[j][i] * self._acting)
                for j in range(k)
            ]
            for i in range(2 * k)
        ]
        entries = [entry for row in self._plant for entry in row]
        self.of_commands = ca.Function(
            "of_commands", [table, x], [ca.vertcat(*(e.re for e in entries)), ca.vertcat(*(e.im for e in entries))]
        )
        sources = list(dict.fromkeys(pair.input for pair in case.compared))
        unmeasured = self._answers(sources, *self._feedback_alone(sources))
        matched = unmeasured | self._answers(self.measured, commands, expected) if self.measured else unmeasured
        vehicle = _linear(bed.vehicle.system, drawn, s)
        means = [
            sum(_log_square(answers[pair] / vehicle.response(pair[1], pair[0])) for pair in bed.pairs) / len(bed.pairs)
            for answers in (matched, unmeasured)
        ]
        self.squares = ca.Function("squares", [table, x], ca.cse([ca.SX(mean) for mean in means]))

    def _image_changes(self, s: Complex, loop: Mapping[str, ca.SX], delay: ca.SX) -> list[Complex]:
        """What drawn dead time and lag make of the image above, the one below and all others, over the nominal ones."""
        nominal, spacing = self._parts.case.loop, 2 * np.pi / self._parts.case.loop["sample_time"]
        later = delay - nominal.command_delay()
        changes = []
        for side in (1, -1):
            at = s + Complex(0.0, side * spacing)
            lag = (1 + at * nominal["inverter_lag"]) / (1 + at * loop["inverter_lag"])
            changes.append(exp(-(at * later)) * lag)
        return [*changes, exp(-(s * later))]

    def _readings(self, source: str) -> list[Complex]:
        """Signed, lagged flange torques and rotor speeds (2k) for an input of the rig."""
        torques = [self._rig.response(dynamometer.torque_sensor, source) for dynamometer in self._parts.dynamometers]
        signed = [torque * sign * self._lag for torque, sign in zip(torques, self._parts.toward.tolist(), strict=True)]
        return signed + [
            self._rig.response(dynamometer.speed_sensor, source) for dynamometer in self._parts.dynamometers
        ]

    def _feedback_alone(self, sources: Sequence[str]) -> tuple[Matrix, Matrix]:
        """Commands (k, w) of simulated torques among the sources; expected readings (2k, w), which are zero."""
        simulated, zero = self._parts.simulated, Complex(0.0)
        place = {source: 2 * self.k + simulated.index(source) for source in sources if source in simulated}
        commands = [[row[place[u]] if u in place else zero for u in sources] for row in self._control]
        return commands, [[zero] * len(sources)] * (2 * self.k)

    def _answers(
        self, sources: Sequence[str], commands: Matrix, expected: Matrix
    ) -> dict[tuple[str, str], Complex]:  # fmt: skip
        """Compared responses by input and sensor to these sources."""
        k, on_rig = self.k, self._rig.inputs
        difference: list[dict[int, Complex]] = [{} for _ in range(k)]
        right = [list(row) for row in commands]
        read = [self._readings(u) if u in on_rig else [Complex(0.0)] * (2 * k) for u in sources]
        for j in range(k):
            for i in range(2 * k):
                for column in range(k):
                    start = difference[j].get(column, Complex(1.0 if j == column else 0.0))
                    difference[j][column] = start - self._control[j][i] * self._plant[i][column]
                for u in range(len(sources)):
                    right[j][u] = right[j][u] + self._control[j][i] * (read[u][i] - expected[i][u])
        issued = solve(difference, [_row(row) for row in right])
        answers = {}
        for pair in self._parts.case.compared:
            if pair.input in sources:
                u = list(sources).index(pair.input)
                total = self._rig.response(pair.sensor, pair.input) if pair.input in on_rig else Complex(0.0)
                for j, dynamometer in enumerate(self._parts.dynamometers):
                    acting = self._rig.response(pair.sensor, dynamometer.torque_input) * self._acting
                    total = total + acting * issued[j][u]
                answers[pair.input, pair.sensor] = total
        return answers


def _matrix(values: Iterator[Complex], rows: int, columns: int) -> Matrix:
    return [[next(values) for _ in range(columns)] for _ in range(rows)]


def _row(values: Sequence[Complex]) -> Complex:
    return joined([Complex(ca.SX(value.re), ca.SX(value.im)) for value in values])


def _linear(system: System, drawn: Mapping[str, ca.SX], s: Complex) -> LinearResponse:
    """A system at s with the drawn quantities of the rig that it has; what rig and vehicle share has one value."""
    model = compiled(system)
    values = [
        drawn.get(f"rig.{name}", drawn.get(f"vehicle.{name}", ca.SX(value)))
        for name, value in zip(model.parameters, model.p0.tolist(), strict=True)
    ]
    return LinearResponse(model, ca.vertcat(*values), s)


def _log_square(ratio: Complex) -> ca.SX:
    """|log z|², complex logarithm, principal value."""
    return (ca.log(ratio.re**2 + ratio.im**2) / 2) ** 2 + ca.atan2(ratio.im, ratio.re) ** 2


# --- Many draws of a feedback loop at once: modulus margins, stability and modes, from the exact loop.
#
# Stability of a draw: det(I + L(jω)) of the draw over that of the nominal loop, which is known to be stable, must not
# turn round the origin. Where it turns too fast to be followed on the grid, more frequencies are put in between; what
# cannot be followed so is left to encirclements.

FOLLOWED = 1.0  # rad: largest step of the phase between frequencies that is believed
HALVINGS = 16  # of a step between frequencies
FINER = 9  # frequencies about a local minimum of the grid
CANDIDATE = 1.3  # times the least so far: a local minimum expected above that is not looked into
PARABOLAS = 4  # through three points about each local minimum, one after the other


class Loops:
    """The loop of a case with some quantities drawn, as one compiled function.

    Parameters
    ----------
    names : sequence of str
        The quantities, p of them.
    center : ndarray (p,)
        Their values in the nominal loop, which is stable.
    corners : sequence of float
        Hz, where the bed resonates: from half the lowest to twice the highest the grid is fine.
    near, margin_from : float
        Hz, where the nominal margin is reached, and from where on it counts.
    """

    def __init__(
        self, case: Case, names: Sequence[str], center: np.ndarray, corners: Sequence[float], near: float,
        margin_from: float,
    ):  # fmt: skip
        self.k, self.center = len(case.loop.dynamometers), center
        self.difference = VectorFunction(closed_loop(case, [(name,) for name in names]).difference)
        about = [part * np.linspace(0.92, 1.08, 9) for part in (near, *corners)]
        fine = np.geomspace(0.5 * min(corners, default=1.0), 2 * max(corners, default=1.0), 500)
        self.frequencies = np.unique(np.concatenate([np.geomspace(0.01, 1500, 140), fine, [margin_from], *about]))
        self._counts = self.frequencies >= margin_from  # for the margin
        self.nominal = determinant(self.returns(2j * np.pi * self.frequencies, center[None]))

    def returns(self, s: np.ndarray, x: np.ndarray) -> np.ndarray:
        """I + L (f, b, k, k) at s (f,) for draws x (b, p)."""
        return self._at(s[:, None], x.T[:, None])

    def _at(self, s: np.ndarray, x: np.ndarray) -> np.ndarray:
        """I + L (f, b, k, k) at s (f, b), f or b being 1 where it is the same there, for draws x (p, 1, b)."""
        parts = self.difference(s.real[None], s.imag[None], x)
        values = np.empty((self.k * self.k, *parts.shape[1:]), complex)
        values.real, values.imag = np.split(parts, 2)
        return values.reshape(self.k, self.k, *parts.shape[1:]).transpose(2, 3, 0, 1)

    def margins(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Modulus margins (b,) and return differences' determinants (f, b) of draws x (b, p)."""
        least, determinants = [], []
        for begin in range(0, len(x), AT_ONCE):
            some = x[begin : begin + AT_ONCE]
            D = self.returns(2j * np.pi * self.frequencies, some)
            least.append(self._deepest(some, _distance(D[self._counts])))
            determinants.append(determinant(D))
        return np.concatenate(least), np.concatenate(determinants, axis=1)

    def _deepest(self, x: np.ndarray, on_grid: np.ndarray) -> np.ndarray:
        """Least distances (b,) between the frequencies from where the margin counts, a grid (f, b), too.

        The square of the distance is a parabola at a local minimum, also at a narrow one past a resonance. Every local
        minimum of the grid that may be the least is looked at more finely, as two may be one there; those that are
        found so are approached by parabolas.
        """
        grid = np.broadcast_to(np.log(self.frequencies[self._counts])[:, None], on_grid.shape)
        rows, draws = _local_minima(on_grid)
        minima = _Minima.of(grid, on_grid, rows, draws, draws).kept(on_grid.min(axis=0))
        least = on_grid.min(axis=0)

        def squares(place: np.ndarray, drawn: np.ndarray) -> np.ndarray:
            return _distance(self._at(2j * np.pi * np.exp(place), x.T[:, None, drawn])) ** 2

        places = minima.places[0] + (minima.places[2] - minima.places[0]) * np.linspace(0, 1, FINER)[:, None]
        finer = np.sqrt(squares(places, minima.draws))
        np.minimum.at(least, minima.draws, finer.min(axis=0))
        rows, columns = _local_minima(finer)
        minima = _Minima.of(places, finer, rows, columns, minima.draws[columns]).kept(least)
        for _ in range(PARABOLAS):
            new = minima.bottom()
            at_new = squares(new[None], minima.draws)[0]
            np.minimum.at(least, minima.draws, np.sqrt(at_new))
            minima = minima.narrowed(new, at_new)
        return least

    def turning(self, x: np.ndarray, determinants: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which draws (b,) turn round the origin, and which could not be followed."""
        begins = range(0, len(x), AT_ONCE)
        parts = [self._turning(x[i : i + AT_ONCE], determinants[:, i : i + AT_ONCE]) for i in begins]
        turning, unclear = zip(*parts, strict=True)
        return np.concatenate(turning), np.concatenate(unclear)

    def _turning(self, x: np.ndarray, determinants: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        ratio = determinants * (1 / self.nominal)
        steps = np.angle(ratio[1:] * ratio[:-1].conj())
        rows, draws = np.nonzero(np.abs(steps) > FOLLOWED)
        left = np.zeros(len(x), bool)
        if len(rows):
            edges = self.frequencies[rows], self.frequencies[rows + 1]
            steps[rows, draws], unclear = self._followed(x[draws], edges, (ratio[rows, draws], ratio[rows + 1, draws]))
            left[draws[unclear]] = True
        turns = np.abs(steps.sum(axis=0) + np.angle(ratio[0]) - np.angle(ratio[-1]))
        return turns >= np.pi, left

    def _followed(
        self, x: np.ndarray, edges: tuple[np.ndarray, np.ndarray], ratios: tuple[np.ndarray, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Turns (n,) between edges in Hz, each with its own draw (n, p), halved where they are large; which stay so."""
        total, of = np.zeros(len(x)), np.arange(len(x))
        (low, high), (first, last) = edges, ratios
        for _ in range(HALVINGS):
            middle = np.sqrt(low * high)
            s = 2j * np.pi * middle[None]
            drawn = determinant(self._at(s, x[of].T[:, None]))[0]
            ratio = drawn / determinant(self._at(s, self.center[:, None, None]))[0]
            low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
            first, last = np.concatenate([first, ratio]), np.concatenate([ratio, last])
            of = np.tile(of, 2)
            step = np.angle(last / first)
            small = np.abs(step) <= 0.5 * FOLLOWED
            np.add.at(total, of[small], step[small])
            low, high, first, last, of = (part[~small] for part in (low, high, first, last, of))
            if not len(of):
                break
        return total, np.isin(np.arange(len(x)), of)

    def roots(self, x: np.ndarray, goals: Sequence[complex]) -> np.ndarray:
        """Eigenvalues (b, goals) of the loop, each followed from the nominal one by the secant rule on det(I + L)."""
        eigenvalues = np.empty((len(x), len(goals)), complex)
        for j, goal in enumerate(goals):
            before, s = np.full(len(x), goal * (1 + 1e-4)), np.full(len(x), goal)
            last = determinant(self._at(before[None], x.T[:, None]))[0]
            for _ in range(25):
                value = determinant(self._at(s[None], x.T[:, None]))[0]
                slope = value - last
                step = np.where(slope == 0, 0, value * (s - before) / np.where(slope == 0, 1, slope))
                limit = 0.2 * np.abs(goal)
                step = np.where(np.abs(step) > limit, step * limit / np.maximum(np.abs(step), 1e-300), step)
                before, last, s = s, value, s - step
                if np.abs(step).max() < 1e-9 * abs(goal):
                    break
            eigenvalues[:, j] = s
        return eigenvalues


def determinant(D: np.ndarray) -> np.ndarray:
    """Of matrices (…, k, k); one and two rows are written out, which is faster."""
    if D.shape[-1] > 2:
        return np.linalg.det(D)
    return D[..., 0, 0] if D.shape[-1] == 1 else D[..., 0, 0] * D[..., 1, 1] - D[..., 0, 1] * D[..., 1, 0]


@dataclass(frozen=True)
class _Minima:
    """Local minima of distances: squares (3, n) at places (3, n) in log Hz, the lowest in the middle; draws (n,)."""

    places: np.ndarray
    squares: np.ndarray
    draws: np.ndarray

    @classmethod
    def of(
        cls, places: np.ndarray, distances: np.ndarray, rows: np.ndarray, columns: np.ndarray, draws: np.ndarray
    ) -> _Minima:
        """About the lowest places (rows, columns) of distances (f, b); one at an end begins or ends there."""
        three = np.stack([np.maximum(rows - 1, 0), rows, np.minimum(rows + 1, len(distances) - 1)])
        return cls(places[three, columns], distances[three, columns] ** 2, draws)

    def _parabola(self) -> tuple[np.ndarray, np.ndarray]:
        """Slope at the middle and half the second derivative, (n,) each; at an end not finite."""
        with np.errstate(divide="ignore", invalid="ignore"):
            falls, rises = np.diff(self.squares, axis=0) / np.diff(self.places, axis=0)
            down, up = np.diff(self.places, axis=0)
            half_curvature = (rises - falls) / (down + up)
            return falls + half_curvature * down, half_curvature

    def bottom(self) -> np.ndarray:
        """Where the parabolas have their lowest points, (n,), within the three places."""
        slope, half_curvature = self._parabola()
        with np.errstate(divide="ignore", invalid="ignore"):
            place = self.places[1] - slope / (2 * half_curvature)
        low, middle, high = self.places
        inside = np.where(np.isfinite(place), np.clip(place, low, high), (low + high) / 2)
        apart = np.abs(inside - middle) > 1e-9
        return np.where(apart, inside, np.where(high - middle > middle - low, (middle + high) / 2, (low + middle) / 2))

    def kept(self, least: np.ndarray) -> _Minima:
        """Those that may be deeper than what is the least (b,) of each draw so far."""
        slope, half_curvature = self._parabola()
        with np.errstate(divide="ignore", invalid="ignore"):
            expected = self.squares[1] - slope**2 / (4 * half_curvature)
        kept = ~(expected > (CANDIDATE * least[self.draws]) ** 2)
        return _Minima(self.places[:, kept], self.squares[:, kept], self.draws[kept])

    def narrowed(self, place: np.ndarray, square: np.ndarray) -> _Minima:
        """With one more place (n,) in each."""
        places, squares = np.concatenate([self.places, place[None]]), np.concatenate([self.squares, square[None]])
        order = np.argsort(places, axis=0)
        places, squares = np.take_along_axis(places, order, 0), np.take_along_axis(squares, order, 0)
        first = np.where(squares[1] <= squares[2], 0, 1)
        three, every = first + np.arange(3)[:, None], np.arange(places.shape[1])
        return _Minima(places[three, every], squares[three, every], self.draws)


def _local_minima(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of every local minimum in columns (f, b), their ends included."""
    falls, rises = values[1:] <= values[:-1], values[:-1] <= values[1:]
    edge = np.ones((1, values.shape[1]), bool)
    rows, columns = np.nonzero(np.concatenate([edge, falls]) & np.concatenate([rises, edge]))
    return rows, columns


def _distance(D: np.ndarray) -> np.ndarray:
    """Least singular values (…,) of matrices (…, k, k); up to two rows from trace and determinant of DᴴD."""
    if D.shape[-1] > 2:
        return np.linalg.svd(D, compute_uv=False)[..., -1]
    rows = range(D.shape[-1])
    square = np.zeros(D.shape[:-2])
    for i in rows:
        for j in rows:
            square += _square(D[..., i, j])
    if D.shape[-1] == 1:
        return np.sqrt(square)
    root = np.sqrt(np.maximum(square**2 / 4 - _square(determinant(D)), 0.0))
    return np.sqrt(np.maximum(square / 2 - root, 0.0))


def _square(values: np.ndarray) -> np.ndarray:
    """|z|² of any shape."""
    return values.real**2 + values.imag**2


# --- Draws of a match whose hardware varies: margin, stability, modes and response errors, and what checks them.
#
# All draws of a chunk are worked out together; some of them once more by the verification of a match, one by one.

CLOSE = 0.6  # relative distance within which a mode of the loop counts as the target's
CHECKED = 8  # draws of the first chunk that are worked out exactly as well


@dataclass(frozen=True)
class Varied:
    """A quantity that is drawn evenly from its range, SI."""

    name: str
    value: float
    lower: float
    upper: float
    unit: str


def draw(varied: tuple[Varied, ...], seed: int, number: int, count: int) -> np.ndarray:
    """Values (count, p) of chunk ``number``."""
    random = np.random.default_rng([seed, number])
    lower, upper = (np.array([getattr(quantity, key) for quantity in varied]) for key in ("lower", "upper"))
    return lower + (upper - lower) * random.random((count, len(varied)))


class Prepared(Loops):
    """What all chunks share, built once a worker."""

    def __init__(self, task: tuple[Case, tuple[Varied, ...], int]):
        self.case, self.varied, self.seed = task
        self.parts: Parts = parts_of(self.case)
        corners = [mode.frequency for mode in modes(self.case.rig) if 0 < mode.frequency < 1000]
        center = np.array([quantity.value for quantity in self.varied])
        names = [quantity.name for quantity in self.varied]
        self.margin_from = requirements(self.case).margin_from
        near = encirclements(self.parts, margin_from=self.margin_from).margin_frequency
        super().__init__(self.case, names, center, corners, near, self.margin_from)
        self.margin = float(self.margins(center[None])[0][0])
        goals = self._goals()
        self.targets, self.goals = list(goals), list(goals.values())
        loop = self.case.loop
        reference = cut(self.case.emulated_vehicle, self.case.rig)
        self.feed_forward = loop.structure.feed_forward(self.case.rig, reference, loop)
        self.vehicle = body(self.case.vehicle)
        bed = ComparedBed(self.case, self.parts, self.feed_forward, self.vehicle)
        self.nodes = nodes_of(bed)
        self.center_errors = self.errors(center)
        self.drawn_errors = DrawnErrors(bed, names, center, self.nodes) if covered(names) else None

    def stable(self, x: np.ndarray, determinants: np.ndarray) -> np.ndarray:
        """Whether each draw is stable, (b,)."""
        turning, unclear = self.turning(x, determinants)
        stable = ~turning
        for i in np.flatnonzero(unclear):
            winding = encirclements(self.true(x[i]), self.dead_time(x[i]))
            stable[i] = winding.unstable == 0 and winding.clear
        return stable

    def true(self, x: np.ndarray) -> Parts:
        """The bed of a draw (p,), with the controller as it is."""
        values = self._drawn(x, "rig.")
        system = self.case.rig.with_values(values)
        loop = self._drawn(x, "loop.")
        case = replace(self.case, loop=self.case.loop.with_values(loop)) if loop else self.case
        return replace(self.parts, case=case, rig=body(watched(system, self.parts.cuts, rig_side=True)))

    def _drawn(self, x: np.ndarray, prefix: str) -> dict[str, float]:
        """Values of a draw (p,) by name, of the quantities whose names begin so."""
        by_name = {quantity.name: value for quantity, value in zip(self.varied, x)}
        return {name.removeprefix(prefix): value for name, value in by_name.items() if name.startswith(prefix)}

    def dead_time(self, x: np.ndarray) -> float:
        """Dead time (s) of a draw (p,)."""
        names = [quantity.name for quantity in self.varied]
        return float(x[names.index("loop.dead_time")]) if "loop.dead_time" in names else self.case.loop["dead_time"]

    def errors(self, x: np.ndarray) -> list[float]:
        """Response error of a draw (p,) to all torques as the case measures them, and to unmeasured ones; exactly."""
        rig_values = {quantity.name.removeprefix("rig."): value for quantity, value in zip(self.varied, x)}
        shared = {name: v for name, v in rig_values.items() if name in self.case.vehicle.parameters}
        vehicle = body(self.case.vehicle.with_values(shared)) if shared else self.vehicle
        responses = ComparedBed(self.case, self.true(x), self.feed_forward, vehicle, self.dead_time(x)).at(
            self.nodes.frequencies
        )
        matched = [responses.matched, responses.unmeasured] if self.feed_forward is not None else [responses.unmeasured]
        return [pooled(self.nodes.root_mean(log_squares(response, responses.vehicle))) for response in matched]

    def _goals(self) -> dict[int, complex]:
        """Modes of the nominal feedback loop near the targets, as far as it has any, by the target's mode number."""
        goals = {}
        eigenvalues = [
            mode.eigenvalue for mode in feedback_modes(self.parts) if mode.frequency > 0 and mode.eigenvalue.imag > 0
        ]
        plain = modes(self.case.vehicle)
        for target in self.case.targets:
            wanted = 2j * np.pi * plain[target.mode - 1].frequency
            near = min(eigenvalues, key=lambda s: abs(s - wanted), default=0j)
            if abs(near - wanted) < CLOSE * abs(wanted):
                goals[target.mode] = complex(near)
        return goals


def work(prepared: Prepared, chunk: list[int]) -> dict[str, Any]:
    """One chunk: number, draws, and how many of them get response errors where those have to be worked out singly."""
    number, count, few = chunk
    x = draw(prepared.varied, prepared.seed, number, count)
    least, determinants = prepared.margins(x)
    values: dict[str, Any] = {
        "modulus_margin": least.tolist(), "stable": prepared.stable(x, determinants).astype(float).tolist(),
    }  # fmt: skip
    units, nominal = {"modulus_margin": ""}, {"modulus_margin": prepared.margin}
    for mode, goal, root in zip(prepared.targets, prepared.goals, prepared.roots(x, prepared.goals).T):
        for what, unit, of in (("frequency", "Hz", _frequency), ("damping_ratio", "", _damping)):
            name = f"target_mode_{mode}_{what}"
            values[name], units[name], nominal[name] = of(root).tolist(), unit, float(of(np.array([goal]))[0])
    here = prepared.center_errors
    names = ["response_error", "response_error_unmeasured"] if len(here) == 2 else ["response_error"]
    at_once = prepared.drawn_errors
    errors = np.array([prepared.errors(row) for row in x[:few]]) if at_once is None else at_once(x)
    for j, name in enumerate(names):
        values[name], units[name], nominal[name] = errors[:, j].tolist(), "", here[j]
    check = _differences(prepared, x[:CHECKED], values, names) if number == 0 else {}
    return {"values": values, "units": units, "nominal": nominal, "check": check}


def _differences(
    prepared: Prepared, x: np.ndarray, values: dict[str, Any], errors: list[str]
) -> dict[str, float]:  # fmt: skip
    """Largest relative differences from draws (b, p) worked out exactly; of stability the share that differs."""
    windings = [encirclements(prepared.true(row), prepared.dead_time(row), prepared.margin_from) for row in x]
    exact = {"modulus_margin": np.array([winding.modulus_margin for winding in windings])}
    if prepared.drawn_errors is not None:
        exact |= dict(zip(errors, np.array([prepared.errors(row) for row in x]).T, strict=True))
    differences = {
        name: float(np.max(np.abs(np.array(values[name][: len(x)]) / exact[name] - 1))) for name in exact
    }  # fmt: skip
    stable = np.array([winding.unstable == 0 and winding.clear for winding in windings])
    return differences | {"stable": float(np.mean(stable != (np.array(values["stable"][: len(x)]) > 0.5)))}


def _frequency(root: np.ndarray) -> np.ndarray:
    return np.abs(root) / (2 * np.pi)


def _damping(root: np.ndarray) -> np.ndarray:
    return -root.real / np.abs(root)


# --- Tolerance

CHUNK = 1000  # draws
RESPONSES = 400  # draws whose response errors are worked out where that is done singly
TARGET_FREQUENCY_TOLERANCE = 0.01  # relative, about the nominal value; as a target's own default
TARGET_DAMPING_TOLERANCE = 0.02  # of the damping ratio, absolute


@dataclass(frozen=True)
class Tolerance(Displayed):
    """A tolerance study.

    Attributes
    ----------
    draws, seed : int
    varied : tuple of Varied
    spreads : tuple of Spread
        Modulus margin, modes of the feedback loop near the targets, response errors.
    differences : dict of str to float
        By result: largest relative difference from the draws that were worked out exactly as well; of ``stable`` the
        share that differs.
    shares : dict of str to float
        Yield: the share of draws that is stable, keeps the margin asked for, keeps every target mode near its nominal
        value (1 % in frequency, 0.02 in damping ratio), and all of these.
    asked, asked_from : float
        Modulus margin that is required, and from which frequency (Hz) on it counts.
    """

    title: str
    draws: int
    seed: int
    varied: tuple[Varied, ...]
    spreads: tuple[Spread, ...]
    differences: dict[str, float]
    shares: dict[str, float]
    asked: float
    asked_from: float

    def to_dict(self) -> dict[str, Any]:
        """The content of ``tolerance.json``."""
        return {
            "title": self.title, "draws": self.draws, "seed": self.seed,
            "varied": [vars(quantity) for quantity in self.varied],
            "quantities": [spread.to_dict() for spread in self.spreads], "yield": self.shares,
            "modulus_margin_asked": self.asked, "modulus_margin_from": self.asked_from,
            "checked_exactly": {"draws": min(CHECKED, self.draws), "largest_difference": self.differences},
        }  # fmt: skip


def varied_of(case: Case, added: Mapping[str, float] | None = None) -> tuple[Varied, ...]:
    """What varies: quantities of the rig with a range, and ``added`` ones by their relative tolerance."""
    known = {f"rig.{name}": (parameter.value, case.rig.units[name]) for name, parameter in case.rig.parameters.items()}
    every = movable(case.rig, case.residual_vehicle, case.loop)
    known |= {name: (place.start, place.unit) for name, place in every.items() if not name.startswith("rig.")}
    varied = {}
    for name, quantity in case.rig.uncertain.items():
        if quantity.lower is not None and quantity.upper is not None and quantity.lower < quantity.upper:
            unit = known[f"rig.{name}"][1]
            varied[f"rig.{name}"] = Varied(f"rig.{name}", quantity.value, quantity.lower, quantity.upper, unit)
    for name, share in _named(added or {}, known):
        if name.startswith("residual_vehicle."):
            raise InputError(
                "--tolerance", f"{name} is a number in the controller", "name a quantity of the rig or loop"
            )
        value, unit = known[name]
        if not 0 < share < 1 or value == 0:
            raise InputError("--tolerance", f"{name} = {value:g} cannot vary by {share:g}", "give 0 < SHARE < 1")
        varied[name] = Varied(name, value, value - share * abs(value), value + share * abs(value), unit)
    if not varied:
        right = 'write { value = …, tolerance = 0.05 } in the rig file, or add --tolerance "rig.*.stiffness=0.05"'
        raise InputError(case.path, "no quantity of the rig has a tolerance", right)
    return tuple(varied.values())


def _named(added: Mapping[str, float], known: Mapping[str, tuple[float, str]]) -> list[tuple[str, float]]:
    """Names with their tolerances; a pattern stands for all of the rig and loop that it fits and that are not zero."""
    named = []
    for name, share in added.items():
        fitting = [name] if name in known else []
        if "*" in name:
            not_zero = [candidate for candidate in known if known[candidate][0] != 0]
            possible = [candidate for candidate in not_zero if not candidate.startswith("residual_vehicle.")]
            fitting = fnmatch.filter(possible, name)
        if not fitting:
            raise unknown(name, list(known), "--tolerance")
        named += [(match, share) for match in fitting]
    return named


def tuned(case: Case) -> Case:
    """The case at the start values of its ``[move]``, which a match writes as tuned."""
    return apply(case, {name: move.start for move in case.moves for name in move.together})


def what_varies(case: Case, added: Mapping[str, float] | None) -> tuple[Varied, ...]:
    """What varies of a case as tuned, see :func:`varied_of`."""
    if case.loop.structure.is_observer:
        right = "the match's own drawn beds say it: state the tolerances under [uncertainty]"
        raise InputError(f"{case.path}: loop.structure", "the study does not cover 'observer'", right)
    return varied_of(tuned(case), added)


# more than six parameters: what is drawn, and how the study runs
def tolerance(
    case: Case, draws: int, executor: Executor, *, seed: int = 0, added: Mapping[str, float] | None = None,
    record: Path | None = None, progress: Callable[[int, int], None] | None = None,
) -> Tolerance:  # fmt: skip
    """Spread of margin, modes and response errors over tolerances, with the yield and what drives it.

    Parameters
    ----------
    case : Case
        Its moves stand at their start values: give the case file that a match wrote.
    draws : int
    executor : concurrent.futures.Executor
    added : mapping of str to float, or None
        Relative tolerances beside those of the rig file, by name or by a pattern such as ``rig.*.stiffness``; what
        stands later counts.
    record, progress : see :func:`matching.studies.run`
    """
    varied = what_varies(case, added)
    case = tuned(case)
    winding = encirclements(parts_of(case))
    if winding.unstable or not winding.clear:
        raise InputError(case.path, "the loop is unstable as it stands", "match first and give DIR/case.toml")
    few = -(-RESPONSES // max(1, -(-draws // CHUNK)))
    chunks = [[number, min(CHUNK, draws - CHUNK * number), few] for number in range(-(-draws // CHUNK))]
    content = [VERSION, str(seed), *(str(vars(quantity)) for quantity in varied)]
    content += [f"{name}: {text}" for name, text in case_files(case).items()]
    rows = run(
        work, Prepared, (case, varied, seed), chunks, executor,
        content="\n".join(content), record=record, progress=progress,
    )  # fmt: skip
    values: dict[str, np.ndarray] = {
        name: np.concatenate([np.array(row["values"][name], float) for row in rows]) for name in rows[0]["values"]
    }
    x = np.concatenate([draw(varied, seed, number, count) for number, count, _ in chunks])
    first = np.concatenate([np.arange(count) < few for _, count, _ in chunks])
    nominal = rows[0]["nominal"]
    names = [quantity.name for quantity in varied]
    every, some = Regressors(names, x), Regressors(names, x[first])
    spreads = [
        spread(name, unit, nominal[name], values[name], every if len(values[name]) == len(x) else some)
        for name, unit in rows[0]["units"].items()
    ]
    asked, counted_from = case.limits["modulus_margin"], requirements(case).margin_from
    shares = yields(values, nominal, asked)
    return Tolerance(case.title, draws, seed, varied, tuple(spreads), rows[0]["check"], shares, asked, counted_from)


def yields(values: Mapping[str, np.ndarray], nominal: Mapping[str, float], asked: float) -> dict[str, float]:
    """Shares of draws that keep each demand, and all of them; see :class:`Tolerance`.

    Parameters
    ----------
    values : mapping of str to ndarray (b,)
        ``stable`` (1 or 0), ``modulus_margin``, and by target ``target … frequency`` in Hz and its damping ratio.
    nominal : mapping of str to float
        The same without tolerances.
    asked : float
        Modulus margin.
    """
    kept = {"stable": values["stable"] > 0.5}
    kept["modulus_margin"] = kept["stable"] & (values["modulus_margin"] >= asked)
    for name in nominal:
        if name.startswith("target"):
            low, high = required_range(name, nominal[name], asked)
            kept[name] = (values[name] >= low) & (values[name] <= high)
    kept["all"] = np.logical_and.reduce(list(kept.values()))
    return {name: float(value.mean()) for name, value in kept.items()}


def required_range(name: str, nominal: float, asked: float) -> tuple[float, float]:
    """Least and largest value of a result with which a bed counts in the yield; infinite where nothing is required.

    Parameters
    ----------
    name : str
        As in :func:`yields`.
    nominal : float
        Value of the bed as planned: Hz for a frequency.
    asked : float
        Modulus margin.
    """
    if name == "modulus_margin":
        return asked, np.inf
    if not name.startswith("target"):
        return -np.inf, np.inf
    reach = TARGET_FREQUENCY_TOLERANCE * nominal if name.endswith("frequency") else TARGET_DAMPING_TOLERANCE
    return nominal - reach, nominal + reach
