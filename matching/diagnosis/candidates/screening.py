"""Screening: what of the residual each candidate could take, to first order, after the base parameters had their say.

The response of the readings to a torque is that of the linear base model. Inputs are linear between samples, so the
response to any sampled torque is exactly the convolution with the response to one hat; it is done by FFT.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from scipy import fft
from scipy.linalg import qr
from scipy.stats import chi2

from matching.diagnosis.candidates.balance import leftover
from matching.diagnosis.candidates.motion import seen
from matching.diagnosis.data.segments import Segment
from matching.diagnosis.fitting import batch_simulation as runs
from matching.diagnosis.fitting.fit import Fit
from modelling.effects import EFFECTS
from modelling.effects.first_guess import Guess
from modelling.equations.compiled import compiled
from modelling.model.components import Input
from modelling.model.system import System

WORTHWHILE = 100.0  # decrease of χ² from which guesses near the best are looked at too
TOGETHER = 16  # guesses that are freed at once


@dataclass(frozen=True)
class Screened:
    """A candidate with its best guess: how much of χ² it would take to first order."""

    kind: str
    at: str
    parameters: dict[str, float]
    reduction: float


class Screen:
    """The view from one fit: residual, what base parameters can take of it, and the responses to further torques."""

    def __init__(self, fit: Fit):
        self.fit = fit
        self.data = fit.problem.data
        self.system = fit.problem.system
        self.noise = self.data.noise
        self.mask = np.concatenate([segment.counts for segment in self.data.segments])
        columns = fit.jacobian / np.maximum(np.linalg.norm(fit.jacobian, axis=0), 1e-300)
        self.basis = qr(columns, mode="economic", check_finite=False)[0]
        self.residual = self.free(fit.residual)
        self.draws: np.ndarray | None = None  # (r, d) noise offered to every guess looked at, for the bootstrap
        self.taken: list[np.ndarray] = []  # (d,) what each guess takes of it
        self.hats = _hat_responses(fit)
        self._spectra: dict[tuple[str, int], np.ndarray] = {}
        self.seen = seen(fit)
        scale = max(
            [float(np.std(own)) for own in (*self.seen.torque.values(), *self.seen.input.values())], default=1.0
        )
        self.leftover = leftover(fit, without_effects(self.system), dict(self.seen.value), scale)
        self.seen = seen(fit, self.leftover)
        self.seen = replace(self.seen, torque_gradient=self._pull())
        self._sensors = [sensor.name for sensor in self.system.sensors]
        self._shafts = {shaft.name: shaft for shaft in self.system.shafts}
        self._on = {part.name: part.on for part in self.system.inputs}

    def free(self, signature: np.ndarray) -> np.ndarray:
        """A signature (r,) without what base parameters and start states can take of it."""
        return signature - self.basis @ (self.basis.T @ signature)

    def response(self, torques: dict[str, np.ndarray]) -> np.ndarray:
        """Readings (t, y) that torques (t,) on inertias add."""
        out = np.zeros((len(self.seen.time), len(self.noise)))
        for part in self.seen.segments if torques else ():
            size = part.stop - part.start
            length = fft.next_fast_len(2 * size, real=True)
            total = np.zeros((length // 2 + 1, len(self.noise)), dtype=complex)
            for name, torque in torques.items():
                total += self._spectrum(name, size) * fft.rfft(torque[part], length)[:, None]
            out[part] = fft.irfft(total, length, axis=0)[:size]
        return out

    def _spectrum(self, name: str, size: int) -> np.ndarray:
        """Spectrum (f, y) of the readings after a hat of torque on an inertia, for as many samples."""
        if (name, size) not in self._spectra:
            length = fft.next_fast_len(2 * size, real=True)
            self._spectra[name, size] = fft.rfft(self.hats[name][:size], length, axis=0)
        return self._spectra[name, size]

    def _pull(self) -> dict[str, np.ndarray]:
        """The residual's gradient by a torque at each inertia and moment (correlation, the adjoint of ``response``)."""
        weighted = self.residual.reshape(-1, len(self.noise)) / self.noise
        out = {}
        for name in self.hats:
            own = np.zeros(len(weighted))
            for part in self.seen.segments:
                size = part.stop - part.start
                length = fft.next_fast_len(2 * size, real=True)
                hat = np.conj(self._spectrum(name, size))
                own[part] = fft.irfft((hat * fft.rfft(weighted[part], length, axis=0)).sum(axis=1), length)[:size]
            out[name] = own
        return out

    def signature(self, push: dict[str, np.ndarray | float]) -> np.ndarray:
        """What a push adds to the readings, in times the noise, (r,)."""
        torques: dict[str, np.ndarray] = {}
        direct = np.zeros((len(self.seen.time), len(self.noise)))
        column = np.zeros(direct.size)

        def add(name: str, torque: np.ndarray) -> None:
            torques[name] = torques.get(name, 0.0) + torque

        for place, what in push.items():
            table, name = place.split(".")[:2]
            if place.count(".") == 2:
                column += self._by_value(place) * what
            elif table == "inertias":
                add(name, np.asarray(what))
            elif table == "inputs":
                add(self._on[name], np.asarray(what))
            elif table == "sensors":
                direct[:, self._sensors.index(name)] += what
            else:
                shaft = self._shafts[name]
                ratio = self.seen.value.get(f"shafts.{name}.ratio", 1.0)
                add(shaft.between[0], -np.asarray(what) / ratio)
                add(shaft.between[1], np.asarray(what))
                for j, sensor in enumerate(self.system.sensors):
                    if sensor.measures == "torque" and sensor.of == name:
                        direct[:, j] += what
        total = (self.response(torques) + direct) / self.noise
        total[~self.mask] = 0.0
        return total.ravel() + column

    def _by_value(self, name: str) -> np.ndarray:
        """Derivative (r,) of the simulated readings, in times the noise, by a known quantity."""
        problem = self.fit.problem
        index = problem.model.parameters.index(name)
        p, starts = problem.unpack(self.fit.v)
        h = 1e-3 * (abs(p[index]) or 1.0)
        moved = p.copy()
        moved[index] += h
        out = []
        for segment, start in zip(self.data.segments, starts, strict=True):
            y = runs.readings(problem.model, segment, np.array([moved, p]), np.array([start, start]), problem.steps)
            difference = (y[0] - y[1]) / h / self.noise
            difference[~segment.counts] = 0.0
            out.append(difference.ravel())
        return np.concatenate(out)

    def reduction(self, guess: Guess) -> tuple[float, dict[str, float] | None]:
        """How much a guess lowers χ² at its best amplitudes, and the parameters it then has (None: no such effect)."""
        return self._reductions([guess])[0]

    def _reductions(self, guesses: Sequence[Guess]) -> list[tuple[float, dict[str, float] | None]]:
        """The same of several guesses, all freed at once: the basis is long, and reading it is what takes the time."""
        raw = [[self.signature(dict(push)) for push in guess.additions] for guess in guesses]
        kept = [all(np.isfinite(one).all() for one in own) for own in raw]
        rows = np.array([one for own, good in zip(raw, kept, strict=True) if good for one in own])
        before = np.linalg.norm(rows, axis=1) if len(rows) else np.empty(0)
        if len(rows):
            rows -= (rows @ self.basis) @ self.basis.T
        at = 0
        out: list[tuple[float, dict[str, float] | None]] = []
        spans: list[tuple[Guess, np.ndarray]] = []
        for guess, own, good in zip(guesses, raw, kept, strict=True):
            part = slice(at, at + len(own) * good)
            at = part.stop
            out.append(self._along(guess, rows[part].T, before[part], spans) if good else (0.0, None))
        if self.draws is not None and spans:
            square = (np.concatenate([span.T for _, span in spans], dtype=np.float32) @ self.draws) ** 2
            ends = np.cumsum([0, *(span.shape[1] for _, span in spans)])
            for (guess, span), drawn in zip(spans, np.split(square, ends[1:-1]), strict=True):
                self.taken.append(best_of(guess.chosen_from, drawn.sum(axis=0), span.shape[1]))
        return out

    def _along(
        self, guess: Guess, columns: np.ndarray, before: np.ndarray, spans: list[tuple[Guess, np.ndarray]]
    ) -> tuple[float, dict[str, float] | None]:
        """What the freed signatures (r, c) of a guess take, of lengths (c,) before; their orthonormal span is added."""
        length = np.linalg.norm(columns, axis=0)
        if np.any(length < 1e-6 * before) or not np.all(length > 0):
            return 0.0, None
        span, triangle = columns / length, np.eye(1)
        if len(length) > 1:
            span, triangle = np.linalg.qr(span)
        if np.abs(np.diag(triangle)).min() < 1e-6:
            return 0.0, None
        spans.append((guess, span))
        along = span.T @ self.residual
        return float(along @ along), guess.parameters(np.linalg.solve(triangle, along) / length)

    def candidates(self, system: System | None = None) -> Iterator[Screened]:
        """Every kind at every place that can lower χ², each guess by itself, unsorted."""
        system = system or self.system
        taken_places = {(effect.kind, effect.at) for effect in system.effects}
        for kind, own in EFFECTS.items():
            places = [
                at
                for at in own.places(system)
                if (kind, at) not in taken_places and not (own.replaces_quantity and system.parameters[at].uncertain)
            ]
            found = list(self._tried(kind, ((at, guess) for at in places for guess in own.guesses(self.seen, at))))
            yield from found
            best: dict[str, Screened] = {}
            for one in sorted(found, key=lambda one: -one.reduction):
                best.setdefault(one.at, one)
            most = max((one.reduction for one in best.values()), default=0.0)
            good = [one for one in best.values() if one.reduction > max(WORTHWHILE, 0.5 * most)]
            nearby = ((one.at, guess) for one in good for guess in own.nearby(self.seen, one.at, one.parameters))
            yield from self._tried(kind, nearby)

    def _tried(self, kind: str, guesses: Iterable[tuple[str, Guess]]) -> Iterator[Screened]:
        """Those guesses at places that lower χ²."""
        rest = iter(guesses)
        while some := list(islice(rest, TOGETHER)):
            for (at, _), found in zip(some, self._reductions([guess for _, guess in some]), strict=True):
                reduction, parameters = found
                if parameters is not None and reduction > 0:
                    yield Screened(kind, at, parameters, reduction)


def best_of(count: float, taken: np.ndarray, c: int) -> np.ndarray:
    """What the best of ``count`` guesses takes of noise, as likely as what one of them takes (d,): χ² with c degrees of
    freedom to the largest of as many."""
    if count <= 1:
        return taken
    rarer = -np.expm1(np.log1p(-np.clip(chi2.sf(taken, c), 0.0, 1 - 1e-12)) / count)
    return chi2.isf(rarer, c)


def _hat_responses(fit: Fit) -> dict[str, np.ndarray]:
    """Readings (t, y) of the linear model after a torque on each inertia that is 1 at the first sample and linear to 0
    at its neighbours."""
    plain = without_effects(fit.problem.system)
    values = {name: value for name, value in fit.values.items() if name in plain.parameters}
    plain = plain.with_values(values)
    probe = replace(plain, inputs=tuple(Input(f"probe{i}", part.name) for i, part in enumerate(plain.inertias)))
    model = compiled(probe)
    longest = max(fit.problem.data.segments, key=lambda segment: len(segment.time))
    step = float(np.median(np.diff(longest.time)))
    time = step * np.arange(len(longest.time) + 1)
    start = np.zeros((1, len(model.states)))
    out = {}
    for i, part in enumerate(plain.inertias):
        inputs = np.zeros((len(time), len(plain.inertias)))
        inputs[1, i] = 1.0
        segment = Segment(time, inputs, np.full((len(time), len(plain.sensors)), np.nan))
        out[part.name] = runs.readings(model, segment, model.p0[None], start, fit.problem.steps)[0][1:]
    return out


def without_effects(system: System) -> System:
    """The linear chain of a system; a wrong parameter stays as it is said to be."""
    return replace(system, effects=tuple(effect for effect in system.effects if effect.law.replaces_quantity))
