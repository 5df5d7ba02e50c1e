"""Many draws of a feedback loop at once: modulus margins, stability and modes, from the exact loop.

Stability of a draw: det(I + L(jω)) of the draw over that of the nominal loop, which is known to be stable, must not
turn round the origin. Where it turns too fast to be followed on the grid, more frequencies are put in between; what
cannot be followed so is left to encirclements.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.programme.closed_loop import closed_loop
from modelling.simulation.integrator.c_library import external

AT_ONCE = 1024  # values of s in one call
FOLLOWED = 1.0  # rad: largest step of the phase between frequencies that is believed
HALVINGS = 16  # of a step between frequencies
FINER = 9  # frequencies in a valley of the grid
GOLDEN, SECTIONS = (5**0.5 - 1) / 2, 10  # of a valley among those


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
    near : float
        Hz, where the nominal margin is reached.
    """

    def __init__(self, case: Case, names: Sequence[str], center: np.ndarray, corners: Sequence[float], near: float):
        self.k, self.center = len(case.loop.dynamometers), center
        self.difference = external(closed_loop(case, [(name,) for name in names]).difference.map(AT_ONCE))
        about = [part * np.linspace(0.92, 1.08, 9) for part in (near, *corners)]
        fine = np.geomspace(0.5 * min(corners, default=1.0), 2 * max(corners, default=1.0), 500)
        self.frequencies = np.unique(np.concatenate([np.geomspace(0.01, 1500, 140), fine, *about]))
        self.nominal = determinant(self.returns(2j * np.pi * self.frequencies, center[None])[0])

    def returns(self, s: np.ndarray, x: np.ndarray) -> np.ndarray:
        """I + L (b, f, k, k) at s (f,) for draws x (b, p)."""
        return self._at(np.tile(s, len(x)), np.repeat(x, len(s), axis=0)).reshape(len(x), len(s), self.k, self.k)

    def _at(self, s: np.ndarray, x: np.ndarray) -> np.ndarray:
        """I + L (n, k, k), each s (n,) with its own draw (n, p)."""
        out = np.empty((len(s), self.k * self.k), complex)
        operands: list[Any] = [np.ones(AT_ONCE), np.ones(AT_ONCE), np.tile(self.center, (AT_ONCE, 1))]
        results: list[Any] = [np.empty((AT_ONCE, self.k * self.k)) for _ in range(2)]
        calls: tuple[Any, Any] = self.difference.buffer()
        buffer, evaluate = calls  # of this call: threads may share what is prepared
        for place, array in enumerate(operands):
            buffer.set_arg(place, memoryview(array))
        for place, array in enumerate(results):
            buffer.set_res(place, memoryview(array))
        for begin in range(0, len(s), AT_ONCE):
            part = slice(begin, begin + AT_ONCE)
            count = len(s[part])
            operands[0][:count], operands[1][:count], operands[2][:count] = s[part].real, s[part].imag, x[part]
            evaluate()
            out[part].real, out[part].imag = results[0][:count], results[1][:count]
        return out.reshape(-1, self.k, self.k)

    def margins(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Modulus margins (b,) and return differences' determinants (b, f)."""
        least, determinants = [], []
        for begin in range(0, len(x), 64):
            some = x[begin : begin + 64]
            D = self.returns(2j * np.pi * self.frequencies, some)
            least.append(self._deepest(some, _distance(D)))
            determinants.append(determinant(D))
        return np.concatenate(least), np.concatenate(determinants)

    def _deepest(self, x: np.ndarray, on_grid: np.ndarray) -> np.ndarray:
        """Least distances (b,) between the frequencies of a grid (b, f) too.

        Every valley of the grid is looked at more finely, as two may be one there, and those by golden section.
        """
        rows, before, after = _valleys(on_grid)
        low, high = np.log(self.frequencies[before]), np.log(self.frequencies[after])
        places = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, FINER)

        def distance(place: np.ndarray, drawn: np.ndarray) -> np.ndarray:
            return _distance(self._at(2j * np.pi * np.exp(place), drawn))

        within = distance(places.ravel(), np.repeat(x[rows], FINER, axis=0)).reshape(-1, FINER)
        coarse, before, after = _valleys(within)
        low, high, rows = places[coarse, before], places[coarse, after], rows[coarse]
        drawn = x[rows]

        inner = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)]
        distances = [distance(place, drawn) for place in inner]
        least = on_grid.min(axis=1)
        for _ in range(SECTIONS):
            left = distances[0] < distances[1]
            high, low = np.where(left, inner[1], high), np.where(left, low, inner[0])
            new = np.where(left, high - GOLDEN * (high - low), low + GOLDEN * (high - low))
            at_new = distance(new, drawn)
            inner = [np.where(left, new, inner[1]), np.where(left, inner[0], new)]
            distances = [np.where(left, at_new, distances[1]), np.where(left, distances[0], at_new)]
            np.minimum.at(least, rows, at_new)
        return least

    def turning(self, x: np.ndarray, determinants: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which draws (b,) turn round the origin, and which could not be followed."""
        ratio = determinants / self.nominal
        steps = np.angle(ratio[:, 1:] / ratio[:, :-1])
        rows, columns = np.nonzero(np.abs(steps) > FOLLOWED)
        left = np.zeros(len(x), bool)
        if len(rows):
            edges = self.frequencies[columns], self.frequencies[columns + 1]
            steps[rows, columns], unclear = self._followed(
                x[rows], edges, (ratio[rows, columns], ratio[rows, columns + 1])
            )
            left[rows[unclear]] = True
        turns = np.abs(steps.sum(axis=1) + np.angle(ratio[:, 0]) - np.angle(ratio[:, -1]))
        return turns >= np.pi, left

    def _followed(
        self, x: np.ndarray, edges: tuple[np.ndarray, np.ndarray], ratios: tuple[np.ndarray, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Turns (n,) between edges in Hz, each with its own draw (n, p), halved where they are large; which stay so."""
        total, of = np.zeros(len(x)), np.arange(len(x))
        (low, high), (first, last) = edges, ratios
        for _ in range(HALVINGS):
            middle = np.sqrt(low * high)
            s, center = 2j * np.pi * middle, np.tile(self.center, (len(middle), 1))
            ratio = determinant(self._at(s, x[of])) / determinant(self._at(s, center))
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
            last = determinant(self._at(before, x))
            for _ in range(25):
                value = determinant(self._at(s, x))
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


def _valleys(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row and columns before and after the lowest of every valley in rows (b, f), their ends included."""
    walls = np.pad(values, ((0, 0), (1, 1)), constant_values=np.inf)
    rows, columns = np.nonzero((values <= walls[:, :-2]) & (values <= walls[:, 2:]))
    return rows, np.maximum(columns - 1, 0), np.minimum(columns + 1, values.shape[1] - 1)


def _distance(D: np.ndarray) -> np.ndarray:
    """Least singular values (…,) of matrices (…, k, k); up to two rows from trace and determinant of DᴴD."""
    if D.shape[-1] > 2:
        return np.linalg.svd(D, compute_uv=False)[..., -1]
    square = np.sum(np.abs(D) ** 2, axis=(-2, -1))
    if D.shape[-1] == 1:
        return np.sqrt(square)
    root = np.sqrt(np.maximum(square**2 / 4 - np.abs(determinant(D)) ** 2, 0.0))
    return np.sqrt(np.maximum(square / 2 - root, 0.0))
