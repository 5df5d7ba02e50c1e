"""Screening: what each candidate could take of a fit's residual, to first order, after the base parameters did."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np
from scipy.linalg import qr

from matching.diagnosis.candidates.balance import torque_balance
from matching.diagnosis.candidates.motion import simulated_motion
from matching.diagnosis.candidates.noise_threshold import NoiseDraws
from matching.diagnosis.candidates.torque_response import TorqueResponse, without_effects
from matching.diagnosis.fitting.batch_simulation import simulate_readings
from matching.diagnosis.fitting.fit import Fit
from modelling.effects import EFFECTS
from modelling.effects.first_guess import Guess
from modelling.effects.place import members
from modelling.model.system import System

WORTHWHILE, WORTHWHILE_SHARE = 100.0, 0.5  # decrease of χ², absolute and of a kind's best, to look at nearby guesses
HOPEFUL_SHARE = 0.1  # of the best of all kinds: nearby guesses gain a few times as much, not ten times
TOGETHER = 16  # guesses that are projected at once
DEPENDENT = 1e-6  # of a signature's length: what is left by others that take its place
VALUE_STEP = 1e-3  # relative, of the differences by a known quantity


@dataclass(frozen=True)
class ScreenedCandidate:
    """A candidate with its best guess: how much of χ² it would take to first order."""

    kind: str
    at: str
    parameters: dict[str, float]
    reduction: float
    guess: Guess | None = field(default=None, repr=False, compare=False)

    @property
    def kind_and_place(self) -> tuple[str, str]:
        """What it is and where."""
        return self.kind, self.at


class Screening:
    """The residual of a fit, what base parameters can take of it, and what further effects could.

    Attributes
    ----------
    fit : Fit
    residual : ndarray (r,)
        In times the noise, without what base parameters and start states can take.
    basis : ndarray (r, v)
        Orthonormal, of what base parameters and start states change.
    motion : FittedMotion
        Of the fit, with the deviations of the measurement.
    balance : TorqueBalance
        Torques that the measurement asks for.
    draws : NoiseDraws, optional
        Noise that every guess may take from too.
    """

    def __init__(self, fit: Fit):
        self.fit = fit
        self.system = fit.problem.system
        self.noise = fit.problem.data.noise
        self.draws: NoiseDraws | None = None
        self.mask = np.concatenate([segment.measured for segment in fit.problem.data.segments])
        columns = fit.jacobian / np.maximum(np.linalg.norm(fit.jacobian, axis=0), 1e-300)
        self.basis = qr(columns, mode="economic", check_finite=False)[0]
        self.residual = self.free(fit.residual)
        motion = simulated_motion(fit)
        self.response = TorqueResponse(fit, motion.segments)
        torques = [float(np.std(torque)) for torque in (*motion.torque.values(), *motion.input.values())]
        self.balance = torque_balance(fit, without_effects(self.system), dict(motion.value), max(torques, default=1.0))
        weights = self._gradient_by_readings() / self.noise
        self.motion = replace(simulated_motion(fit, self.balance), torque_gradient=self.response.correlation(weights))

    def free(self, signal: np.ndarray) -> np.ndarray:
        """A signal (r,) or (r, c) without what base parameters and start states can take of it."""
        return signal - self.basis @ (self.basis.T @ signal)

    def signature(self, addition: dict[str, np.ndarray | float]) -> np.ndarray:
        """What an addition of a guess changes in the readings, in times the noise, (r,)."""
        torques: dict[str, np.ndarray] = {}
        direct = np.zeros(self.mask.shape)
        column = np.zeros(direct.size)
        inertia_of_input = {part.name: part.on for part in self.system.inputs}
        for place, what in addition.items():
            table, name = place.split(".")[:2]
            if place.count(".") == 2:
                column += self._by_value(place) * what
            elif table == "sensors":
                direct[:, [sensor.name for sensor in self.system.sensors].index(name)] += what
            elif table == "shafts":
                self._add_shaft_torque(name, np.asarray(what), torques, direct)
            else:
                inertia = name if table == "inertias" else inertia_of_input[name]
                torques[inertia] = torques.get(inertia, 0.0) + np.asarray(what)
        total = (self.response.readings(torques) + direct) / self.noise
        total[~self.mask] = 0.0
        return self._weighted(total) + column

    def _add_shaft_torque(
        self, name: str, torque: np.ndarray, torques: dict[str, np.ndarray], direct: np.ndarray
    ) -> None:
        """Add, in place, a further torque (t,) of a shaft: on both inertias, and in its sensors (t, y)."""
        shaft = next(shaft for shaft in self.system.shafts if shaft.name == name)
        first, second = shaft.between
        ratio = self.motion.value.get(f"shafts.{name}.ratio", 1.0)
        torques[first] = torques.get(first, 0.0) - torque / ratio
        torques[second] = torques.get(second, 0.0) + torque
        for j, sensor in enumerate(self.system.sensors):
            if sensor.measures == "torque" and sensor.of == name:
                direct[:, j] += torque

    def _by_value(self, name: str) -> np.ndarray:
        """Derivative (r,) of the simulated readings, in times the noise, by a known quantity."""
        problem = self.fit.problem
        index = problem.model.parameters.index(name)
        p, starts = problem.unpack(self.fit.v)
        step = VALUE_STEP * (abs(p[index]) or 1.0)
        moved = p.copy()
        moved[index] += step
        segments, pairs = problem.data.segments, [np.array([start, start]) for start in starts]
        simulated = simulate_readings(problem.model, segments, np.array([moved, p]), pairs, problem.steps_per_second)
        out = []
        for segment, y in zip(segments, simulated, strict=True):
            difference = (y[0] - y[1]) / step / self.noise
            difference[~segment.measured] = 0.0
            out.append(difference)
        return self._weighted(np.concatenate(out))

    def _weighted(self, errors: np.ndarray) -> np.ndarray:
        """Errors (t, y) of all segments, in times the noise, as they count, (r,)."""
        parts = [
            self.fit.problem.counted(errors[part][None], i)[0].ravel() for i, part in enumerate(self.response.parts)
        ]
        return np.concatenate(parts)

    def _gradient_by_readings(self) -> np.ndarray:
        """(t, y) −½·∂χ²/∂reading, in times the noise."""
        weighted = self.residual.reshape(-1, len(self.noise))
        weighting = self.fit.problem.weighting
        if weighting is None:
            return weighted
        return np.concatenate([weighting.weigh_transposed(weighted[p], self.mask[p]) for p in self.response.parts])

    def candidates(
        self, system: System | None = None, left_out: Collection[tuple[str, str]] = ()
    ) -> Iterator[ScreenedCandidate]:
        """Every kind at every place that can lower χ², each guess by itself, unsorted.

        Parameters
        ----------
        system : System, optional
            Effects that it has are not repeated; the fit's system if not given.
        left_out : collection of (str, str), optional
            Kinds and places that are not asked for.
        """
        system = system or self.system
        present = {(effect.kind, place) for effect in system.effects for place in effect.places}
        by_kind: dict[str, list[ScreenedCandidate]] = {}
        for kind, effect in EFFECTS.items():
            places = [
                at
                for at in (*effect.candidate_places(system), *effect.shared_places(system))
                if (kind, at) not in left_out
                and not any((kind, place) in present for place in members(at))
                and not (effect.replaces_quantity and system.parameters[at].uncertain)
            ]
            guesses = ((at, guess) for at in places for guess in effect.shared_guesses(self.motion, at))
            by_kind[kind] = list(self._screened(kind, guesses))
            yield from by_kind[kind]
        hopeful = HOPEFUL_SHARE * max(
            (candidate.reduction for some in by_kind.values() for candidate in some), default=0.0
        )
        for kind, screened in by_kind.items():
            best: dict[str, ScreenedCandidate] = {}
            for candidate in sorted(screened, key=lambda candidate: -candidate.reduction):
                best.setdefault(candidate.at, candidate)
            largest = max((candidate.reduction for candidate in best.values()), default=0.0)
            least = max(WORTHWHILE, WORTHWHILE_SHARE * largest, hopeful)
            good = [c for c in best.values() if c.reduction > least]
            nearby = ((c.at, guess) for c in good for guess in EFFECTS[kind].nearby(self.motion, c.at, c.parameters))
            yield from self._screened(kind, nearby)

    def _screened(self, kind: str, guesses: Iterable[tuple[str, Guess]]) -> Iterator[ScreenedCandidate]:
        """The guesses at places that lower χ²."""
        rest = iter(guesses)
        while some := list(islice(rest, TOGETHER)):
            reductions = self.reductions([guess for _, guess in some])
            for (at, guess), (reduction, parameters) in zip(some, reductions, strict=True):
                if parameters is not None and reduction > 0:
                    yield ScreenedCandidate(kind, at, parameters, reduction, guess)

    def reductions(self, guesses: Sequence[Guess]) -> list[tuple[float, dict[str, float] | None]]:
        """How much each guess lowers χ² at its best amplitudes, and its parameters then (None: no such effect).

        All are projected at once: the basis is long, and reading it is what takes the time.
        """
        signatures = [np.array([self.signature(dict(addition)) for addition in guess.additions]) for guess in guesses]
        finite = [i for i, rows in enumerate(signatures) if np.isfinite(rows).all()]
        out: list[tuple[float, dict[str, float] | None]] = [(0.0, None)] * len(guesses)
        if not finite:
            return out
        every = np.concatenate([signatures[i] for i in finite])
        lengths = np.linalg.norm(every, axis=1)
        every -= (every @ self.basis) @ self.basis.T
        ends = np.cumsum([len(signatures[i]) for i in finite])[:-1]
        spans, counts = [], []
        for i, rows, length in zip(finite, np.split(every, ends), np.split(lengths, ends), strict=True):
            factors = _orthonormal(rows.T, length)
            if factors is None:
                continue
            span, triangle = factors
            along = span.T @ self.residual
            out[i] = float(along @ along), guesses[i].parameters(np.linalg.solve(triangle, along))
            spans.append(span)
            counts.append(guesses[i].chosen_from)
        if self.draws is not None and spans:
            self.draws.offer(spans, counts)
        return out


def _orthonormal(columns: np.ndarray, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """QR factors of projected signatures (r, c), of these lengths (c,) before; None where they depend on each other or
    on the base parameters."""
    left = np.linalg.norm(columns, axis=0)
    if np.any(left < DEPENDENT * lengths) or not np.all(left > 0):
        return None
    span, triangle = (columns / left, np.eye(1)) if len(left) == 1 else np.linalg.qr(columns / left)
    if np.abs(np.diag(triangle)).min() < DEPENDENT:
        return None
    return span, triangle * left
