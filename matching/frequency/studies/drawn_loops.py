"""Many draws of a feedback loop at once: modulus margins, stability and modes, from the exact loop.

Stability of a draw: det(I + L(jω)) of the draw over that of the nominal loop, which is known to be stable, must not
turn round the origin. Where it turns too fast to be followed on the grid, more frequencies are put in between; what
cannot be followed so is left to encirclements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.programme.closed_loop import closed_loop
from modelling.simulation.integrator.vector_function import VectorFunction

AT_ONCE = 128  # draws: what they need on the whole grid stays in the processor's cache
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
