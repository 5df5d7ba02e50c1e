"""Screening: what each candidate could take of a fit's residual, to first order, after the base parameters did."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np
from scipy import fft
from scipy.linalg import LinAlgError, cholesky, qr, solve_triangular
from scipy.special import chdtrc, chdtri

from matching.diagnosis.causes import (
    Cause,
    ExtendedModel,
    known_jacobian,
    simulated_motion,
    start_states,
    states_from,
    torque_balance,
)
from matching.diagnosis.data import Segment
from matching.diagnosis.descent import SEARCH, Fit, FitOptions, solve
from matching.diagnosis.problem import BATCH, STEPS_PER_RADIAN, FitProblem, with_enough_steps
from matching.diagnosis.simulation import simulate_readings, steps_and_stick_speed
from matching.diagnosis.statistics import Estimate
from modelling.effects import EFFECTS
from modelling.effects.effect import FittedMotion, Guess, members
from modelling.equations.casadi_code import compiled
from modelling.resources import time_is_over
from modelling.system import Input, System

# --- Backlash: what neither noise nor the Jacobian of a fit tells of the uncertainty of its gap.
#
# A recording may show one flank only.
#
# With drive torque throughout, a shaft crosses its backlash once at most: what part of the gap was ahead at the start
# is known, what part was behind is not. χ² is then constant in the gap from some value on, so the fit ends anywhere
# there, and its Jacobian takes that value for well known.
#
# The gap is the way from one flank to the other, so it is known no better than the time of contact. A rattling shaft
# magnifies every difference, and its Jacobian takes that for knowledge of times far below a sampling interval, where
# neither the channels of a sample nor two integrations of the motion agree.

CONTACT_TIME_SHARE = 0.01  # of the sampling interval: how well the channels of a sample belong to the same instant
CONTACT_SHARE = 0.02  # of the largest torque of the shaft, from which a flank is in contact


def bounded_below(estimates: Mapping[str, Estimate], fit: Fit, causes: Sequence[Cause]) -> dict[str, Estimate]:
    """Estimates with gaps of which one flank was touched as uncertain as they are large, with a note that says so."""
    out = dict(estimates)
    backlashes = [cause for cause in causes if EFFECTS[cause.kind].free_play]
    if not backlashes:
        return out
    motion = simulated_motion(fit)
    for cause in backlashes:
        shaft, name = cause.at.split(".")[1], cause.names()[EFFECTS[cause.kind].free_play]
        torque, twist, gap = motion.torque[shaft], motion.twist[shaft], out[name]
        contact = CONTACT_SHARE * abs(torque).max()
        if torque.min() > -contact:
            crossed = gap.value / 2 - float(twist.min())
        elif torque.max() < contact:
            crossed = gap.value / 2 + float(twist.max())
        else:
            continue
        note = f"only one side of the free play is touched: it is at least {min(crossed, gap.value):.3g} rad"
        uncertainty = max(gap.standard_uncertainty, abs(gap.value))
        out[name] = replace(gap, standard_uncertainty=uncertainty, note=note)
    return out


def as_late_as_contact(estimates: Mapping[str, Estimate], fit: Fit, causes: Sequence[Cause]) -> dict[str, Estimate]:
    """Estimates with gaps as uncertain, besides noise, as the twist that passes while a contact may be."""
    out = dict(estimates)
    backlashes = [cause for cause in causes if EFFECTS[cause.kind].free_play]
    if not backlashes:
        return out
    motion = simulated_motion(fit)
    unknown_time = CONTACT_TIME_SHARE * fit.problem.data.sampling_interval
    for cause in backlashes:
        shaft, name = cause.at.split(".")[1], cause.names()[EFFECTS[cause.kind].free_play]
        gap = out[name]
        crossing = motion.twist_rate[shaft][np.abs(motion.twist[shaft]) < gap.value / 2]
        if len(crossing):
            passed = unknown_time * float(np.sqrt(np.mean(crossing**2)))
            out[name] = replace(gap, standard_uncertainty=float(np.hypot(gap.standard_uncertainty, passed)))
    return out


# --- Which decrease of χ² the best of all candidates reaches in pure noise: a parametric bootstrap of the screening.
#
# White noise stands beside the residual; every guess that is screened may take what it can of both. A candidate counts
# where it takes more of the residual than the best candidate takes of noise in all but one of a thousand cases.

DRAWS = 40
PASSED_BY_NOISE = 1e-3  # probability with which noise alone passes the threshold
EULER_GAMMA = 0.5772156649


class NoiseDraws:
    """White noise and what the guesses took of it.

    Parameters
    ----------
    mask : ndarray (r,)
        Which residuals are readings.
    free : callable
        Signals (r, d) → without what base parameters and start states can take of them.
    """

    def __init__(self, mask: np.ndarray, free: Callable[[np.ndarray], np.ndarray], seed: int = 0):
        noise = np.random.default_rng(seed).standard_normal((len(mask), DRAWS)).astype(np.float32)
        noise[~mask] = 0.0
        self.noise = free(noise).astype(np.float32)
        self.decreases: list[np.ndarray] = []

    def offer(self, taken: list[np.ndarray], chosen_from: list[float]) -> None:
        """Let several guesses take what they can.

        Parameters
        ----------
        taken : list of ndarray (c, d)
            How far the noise lies along each guess's orthonormal signatures.
        chosen_from : list of float
            How many independent guesses each stands for.
        """
        for own, count in zip(taken, chosen_from, strict=True):
            self.decreases.append(best_of(count, (own**2).sum(axis=0), len(own)))

    def threshold(self) -> float:
        """Decrease of χ² that noise reaches with the probability ``PASSED_BY_NOISE``.

        The largest decreases of many draws follow Gumbel's distribution, fitted by its moments.
        """
        if not self.decreases:
            return 0.0
        largest = np.max(self.decreases, axis=0)
        scale = float(largest.std(ddof=1)) * np.sqrt(6) / np.pi
        location = float(largest.mean()) - EULER_GAMMA * scale
        return location - scale * float(np.log(-np.log1p(-PASSED_BY_NOISE)))


def best_of(count: float, decrease: np.ndarray, c: int) -> np.ndarray:
    """What the best of ``count`` guesses takes of noise, given what one of them takes (d,).

    χ² with c degrees of freedom mapped, at equal probability, to the largest of that many.
    """
    if count <= 1:
        return decrease
    exceeded = np.clip(chdtrc(c, np.asarray(decrease, float)), 0.0, 1 - 1e-12)
    return chdtri(c, -np.expm1(np.log1p(-exceeded) / count))


# --- The fit of an extended model, begun where the fit of its parent ended.

ABRUPT_STEPS = 8  # integration steps a sample where a torque jumps: with fewer, χ² is too rough to descend
STICK_STEPS = 2  # the same with dry friction, which is as sharp as the steps are short
MOST_START_STATES = 4  # at which the fastest rate is looked at, besides rest


def fit_extended(model: ExtendedModel, parent: Fit, options: FitOptions = SEARCH, finer: float = 1.0) -> Fit:
    """Fit an extended model, beginning at values, start states and Jacobian of the fit it came from; with ``finer``
    times as many integration steps as a search takes."""
    problem, p = extended_problem(model, parent)
    v = problem.pack(model.values, list(model.starts) or start_states(problem, parent, p))
    v = np.clip(v, problem.lower, problem.upper)
    problem = with_enough_steps(problem, v)
    most = max(problem.steps_per_second, ABRUPT_STEPS / problem.data.sampling_interval)
    finer = min(finer, most / problem.steps_per_second)
    if finer > 1:
        sharper = problem.stick_speed / finer
        problem = replace(problem, steps_per_second=finer * problem.steps_per_second, stick_speed=sharper)
    return solve(problem, v, known_jacobian(problem, parent, v), options)


def extended_problem(model: ExtendedModel, parent: Fit) -> tuple[FitProblem, np.ndarray]:
    """The problem of an extended model on the data of its parent, and its parameters (p,) to begin with."""
    system = model.system()
    equations, data = compiled(system), parent.problem.data
    starts = states_from(parent.starts[:MOST_START_STATES], equations.states, parent)
    rest = np.zeros(len(equations.states))
    sampling = 1 / data.sampling_interval
    p = equations.vector({name: value for name, value in model.values.items() if name in equations.parameters})
    least = 0.0
    if any(EFFECTS[effect.kind].sticks for effect in system.effects):
        least = STICK_STEPS * sampling
    if any(EFFECTS[effect.kind].abrupt for effect in system.effects):
        least = ABRUPT_STEPS * sampling
    if np.isfinite(parent.problem.stick_speed):  # friction that had to be sharper stays so
        least = max(least, min(parent.problem.steps_per_second, ABRUPT_STEPS * sampling))
    steps, stick_speed = steps_and_stick_speed(
        equations, p, np.array([*starts, rest]), sampling, STEPS_PER_RADIAN, least
    )
    held = parent.problem.held_states
    held = None if held is None else states_from(held, equations.states, parent)
    return FitProblem(system, data, model.bounds, steps, stick_speed, held, parent.problem.weighting), p


# --- Readings that torques on the inertias add, by the linear base model.
#
# Inputs are linear between samples, so the response to any sampled torque is exactly the convolution with the response
# to one triangular pulse; it is done by FFT.


class TorqueResponse:
    """The linear response of the readings of a fit to torques on its inertias.

    Attributes
    ----------
    parts : tuple of slice
        The segments, one after another.
    """

    def __init__(self, fit: Fit, parts: tuple[slice, ...]):
        self.parts = parts
        self._pulses = _pulse_responses(fit)
        self._sensors = len(fit.problem.data.noise)
        self._noise, self._weighting = fit.problem.data.noise, fit.problem.weighting
        self._spectra: dict[tuple[str, int], np.ndarray] = {}
        self._gains: dict[tuple[str, int], np.ndarray] = {}

    def readings(self, torques: dict[str, np.ndarray]) -> np.ndarray:
        """Readings (t, y), SI, that torques (t,) on inertias, N·m, add."""
        out = np.zeros((self.parts[-1].stop, self._sensors))
        for part in self.parts if torques else ():
            size = part.stop - part.start
            length = fft.next_fast_len(2 * size, real=True)
            total = np.zeros((self._sensors, length // 2 + 1), dtype=complex)
            for name, torque in torques.items():
                total += self._spectrum(name, size) * fft.rfft(torque[part], length)
            out[part] = fft.irfft(total, length)[:, :size].T
        return out

    def correlation(self, weights: np.ndarray) -> dict[str, np.ndarray]:
        """By inertia (t,): Σ weights·readings for a torque of 1 N·m at each sample; the adjoint of ``readings``.

        Parameters
        ----------
        weights : ndarray (t, y)
        """
        out = {}
        for name in self._pulses:
            values = np.zeros(len(weights))
            for part in self.parts:
                size = part.stop - part.start
                length = fft.next_fast_len(2 * size, real=True)
                spectrum = np.conj(self._spectrum(name, size)) * fft.rfft(weights[part].T, length)
                values[part] = fft.irfft(spectrum.sum(axis=0), length)[:size]
            out[name] = values
        return out

    def power(self, name: str, torque: np.ndarray) -> float:
        """Sum of squares of what a torque (t,) on an inertia, N·m, adds to the readings, as they count, all measured;
        to a fifth or so, for what fades in a small part of a segment."""
        total = 0.0
        for part in self.parts:
            size = part.stop - part.start
            length = fft.next_fast_len(2 * size, real=True)
            if (name, size) not in self._gains:
                gain = np.abs(self._spectrum(name, size) / self._noise[:, None]) ** 2
                if self._weighting is not None:
                    turn = np.exp(-2j * np.pi * np.arange(gain.shape[1]) / length)
                    gain *= np.abs((1 - np.outer(self._weighting.memory, turn)) / self._weighting.scale[:, None]) ** 2
                self._gains[name, size] = gain.sum(axis=0).astype(np.float32)
            spectrum = fft.rfft(torque[part].astype(np.float32), length)
            total += 2 / length * float(self._gains[name, size] @ (spectrum.real**2 + spectrum.imag**2))
        return total

    def _spectrum(self, name: str, size: int) -> np.ndarray:
        """Spectrum (y, f) of the readings after a pulse on an inertia, for as many samples."""
        if (name, size) not in self._spectra:
            length = fft.next_fast_len(2 * size, real=True)
            self._spectra[name, size] = fft.rfft(self._pulses[name][:size].T, length)
        return self._spectra[name, size]


def _pulse_responses(fit: Fit) -> dict[str, np.ndarray]:
    """By inertia: readings (t, y) of the linear model after a torque that is 1 N·m at the first sample and falls
    linearly to 0 at its neighbours."""
    plain = without_effects(fit.problem.system)
    imposed = (effect for effect in fit.problem.system.effects if effect.law.imposes_motion)
    plain = plain.with_effects(*imposed)  # what is imposed, no torque moves
    plain = plain.with_values({name: value for name, value in fit.values.items() if name in plain.parameters})
    probes = tuple(Input(f"probe{i}", part.name, "torque") for i, part in enumerate(plain.inertias))
    model = compiled(replace(plain, inputs=probes))
    longest = max(fit.problem.data.segments, key=lambda segment: len(segment.time))
    step = float(np.median(np.diff(longest.time)))
    time = step * np.arange(len(longest.time) + 1)
    start = np.zeros((1, len(model.states)))
    out = {}
    for i, part in enumerate(plain.inertias):
        inputs = np.zeros((len(time), len(plain.inertias)))
        inputs[1, i] = 1.0
        segment = Segment(time, inputs, np.full((len(time), len(plain.sensors)), np.nan))
        steps = fit.problem.steps_per_second
        out[part.name] = simulate_readings(model, [segment], model.p0[None], [start], steps)[0][0, 1:]
    return out


def without_effects(system: System) -> System:
    """The linear drivetrain of a system, all inputs torques; a wrong parameter stays as it is said to be."""
    inputs = tuple(replace(part, measures="torque") for part in system.inputs)
    return replace(system, inputs=inputs, effects=tuple(e for e in system.effects if e.law.replaces_quantity))


# --- Screening

WORTHWHILE, WORTHWHILE_SHARE = 100.0, 0.5  # decrease of χ², absolute and of a kind's best, to look at nearby guesses
HOPEFUL_SHARE = 0.1  # of the best of all kinds: nearby guesses gain a few times as much, not ten times
FOLLOWING = 100  # guesses of a kind at pairs of inertias that are projected
TOGETHER = 16  # guesses that are projected at once
DEPENDENT = 1e-6  # of a signature's length: what is left by others that take its place
ROUNDING = 1e-14  # relative, of an inner product of long signatures
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


def _typical_torque(fit: Fit, motion: FittedMotion) -> float:
    """A torque (N·m) typical of the drivetrain: of inputs and shafts, or where there is none, of its coming to rest."""
    torques = [float(np.std(torque)) for torque in (*motion.torque.values(), *motion.input.values())]
    if max(torques, default=0.0) > 0:
        return max(torques)
    inertia = sum(value for name, value in motion.value.items() if name.endswith(".J"))
    over = {"angle": 2, "speed": 1, "acceleration": 0}  # how often the time divides
    changes = []
    for segment in fit.problem.data.segments:
        duration = float(np.ptp(segment.time)) or 1.0
        for sensor, readings in zip(fit.problem.system.sensors, segment.readings.T, strict=True):
            there = readings[np.isfinite(readings)]
            if sensor.measures in over and there.size:
                changes.append(float(np.ptp(there)) / duration ** over[sensor.measures])
    return inertia * max(changes, default=0.0) or 1.0


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
        self.balance = torque_balance(
            fit, without_effects(self.system), dict(motion.value), _typical_torque(fit, motion)
        )
        lacking = {part.name: self.balance.inertias[:, i] for i, part in enumerate(self.system.inertias)}
        by_reading = self._gradient_by_readings() / self.noise
        gradient = self.response.correlation(by_reading)
        of_model = motion.angle
        motion = simulated_motion(fit, self.balance)
        self.motion = replace(
            motion, torque_gradient=gradient, torque_lacking=lacking, model_angle=of_model,
            reading_gradient={s.name: by_reading[:, j] for j, s in enumerate(self.system.sensors)},
        )  # fmt: skip
        self._quantities = [name for name in fit.problem.model.parameters if name.count(".") == 2]
        self._by_quantity: dict[str, np.ndarray] = {}

    def motion_as_measured(self) -> np.ndarray:
        """States (t, x) of the fit's model as the measurement has them, segments one after another."""
        problem = self.fit.problem
        return self.balance.added_to(problem.model.states, np.concatenate(problem.states(self.fit.v)))

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
        """Derivative (r,) of the simulated readings, in times the noise, by a known quantity.

        Those of the next quantities are simulated with it, and kept until others are asked for.
        """
        if name not in self._by_quantity:
            first = self._quantities.index(name)
            self._by_quantity = self._derivatives(self._quantities[first : first + BATCH - 1])
        return self._by_quantity[name]

    def _derivatives(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        problem = self.fit.problem
        p, starts = problem.unpack(self.fit.v)
        points, steps = np.repeat(p[None], len(names) + 1, axis=0), []
        for row, name in zip(points, names, strict=False):
            index = problem.model.parameters.index(name)
            steps.append(VALUE_STEP * (abs(p[index]) or 1.0))
            row[index] += steps[-1]
        segments, begins = problem.data.segments, [np.repeat(start[None], len(points), axis=0) for start in starts]
        simulated = simulate_readings(problem.model, segments, points, begins, problem.steps_per_second)
        moved = [(y[:-1] - y[-1]) / self.noise for y in simulated]
        for segment, difference in zip(segments, moved, strict=True):
            difference[:, ~segment.measured] = 0.0
        every = np.concatenate(moved, axis=1)
        return {name: self._weighted(every[i] / steps[i]) for i, name in enumerate(names)}

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
            by_kind[kind] = list(self._screened(kind, self._likeliest(guesses) if effect.follows else guesses))
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

    def _likeliest(self, guesses: Iterable[tuple[str, Guess]]) -> list[tuple[str, Guess]]:
        """Of torques on inertias those that promise most where base parameters and start states take nothing of them:
        pairs of inertias are many, and what a torque promises so follows from its spectrum alone."""
        every = list(guesses)
        if len(every) <= FOLLOWING:
            return every
        promised = [self._promised(guess) for _, guess in every]
        return [every[i] for i in np.argsort(promised)[::-1][:FOLLOWING]]

    def _promised(self, guess: Guess) -> float:
        """How much of χ² torques of a guess would take if nothing else took any of it, and each by itself."""
        total = 0.0
        for place, torque in (item for addition in guess.additions for item in addition.items()):
            name = place.split(".")[1]
            along = float(self.motion.torque_gradient[name] @ torque)
            total += along**2 / max(self.response.power(name, np.asarray(torque)), 1e-300)
        return total

    def _screened(self, kind: str, guesses: Iterable[tuple[str, Guess]]) -> Iterator[ScreenedCandidate]:
        """The guesses at places that lower χ²."""
        rest = iter(guesses)
        while (some := list(islice(rest, TOGETHER))) and not time_is_over():
            reductions = self.reductions([guess for _, guess in some])
            for (at, guess), (reduction, parameters) in zip(some, reductions, strict=True):
                if parameters is not None and reduction > 0:
                    yield ScreenedCandidate(kind, at, parameters, reduction, guess)

    def reductions(self, guesses: Sequence[Guess]) -> list[tuple[float, dict[str, float] | None]]:
        """How much each guess lowers χ² at its best amplitudes, and its parameters then (None: no such effect).

        Signatures are long and many. What base parameters and start states leave of them is therefore never made: its
        inner products, with itself, the residual and the noise, follow from those of the signatures with the basis.
        """
        signatures = [np.array([self.signature(dict(addition)) for addition in guess.additions]) for guess in guesses]
        finite = [i for i, rows in enumerate(signatures) if np.isfinite(np.vdot(rows, rows))]
        out: list[tuple[float, dict[str, float] | None]] = [(0.0, None)] * len(guesses)
        if not finite:
            return out
        every = np.concatenate([signatures[i] for i in finite])
        inside, along = every @ self.basis, every @ self.residual  # the residual has nothing of the basis
        whole = every @ every.T
        left = whole - inside @ inside.T
        noise = None if self.draws is None else every.astype(np.float32) @ self.draws.noise
        begin, taken, counts = 0, list[np.ndarray](), list[float]()
        for i in finite:
            own = slice(begin, begin := begin + len(signatures[i]))
            factor = _triangle(left[own, own], np.diag(whole)[own])
            if factor is None:
                continue
            toward = solve_triangular(factor, along[own], trans="T")
            out[i] = float(toward @ toward), guesses[i].parameters(solve_triangular(factor, toward))
            if noise is not None:
                taken.append(solve_triangular(factor, noise[own], trans="T"))
                counts.append(guesses[i].chosen_from)
        if self.draws is not None:
            self.draws.offer(taken, counts)
        return out


def _triangle(left: np.ndarray, whole: np.ndarray) -> np.ndarray | None:
    """Upper triangle R (c, c) with RᵀR the inner products of signatures without what base parameters take (c, c);
    None where the signatures depend on each other or on the base parameters.

    Parameters
    ----------
    whole : ndarray (c,)
        Squares of the signatures' lengths before.
    """
    squares = np.diag(left)
    if np.any(squares <= DEPENDENT**2 * whole):
        return None
    lengths = np.sqrt(squares)
    try:
        factor = cholesky(left / np.outer(lengths, lengths), check_finite=False)
    except LinAlgError:
        return None
    unknown = np.sqrt(ROUNDING * (whole / squares).max())  # of a length, by the rounding of what was subtracted
    if np.diag(factor).min() < max(DEPENDENT, float(unknown)):
        return None
    return factor * lengths
