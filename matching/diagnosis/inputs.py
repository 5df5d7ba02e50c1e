"""Inputs between their samples: straight, held or smooth. Three hypotheses without a parameter, compared first of all.

A simulation takes inputs as straight between samples. A controller holds its command until the next sample: taken as
straight, it acts half a sample early. A signal that is smooth loses the share 1 − sinc²(f·h) of its component at f on
straight lines, 1.4 % at 12 Hz and 187 samples per second: 13 standard uncertainties of an inertia.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np
from scipy.linalg import qr

from matching.diagnosis.base import as_hypothesis
from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import Fit, FitOptions, expected_cost, solve
from matching.diagnosis.hypotheses import Hypothesis, at_noise
from matching.diagnosis.statistics import BLOCK_LENGTHS, residual_inflation, whiteness
from modelling.effects.effect import members
from modelling.effects.sensors_and_actuators import LATE_SIGN, Lag
from modelling.errors import FitError
from modelling.recordings.corrections import resolution
from modelling.resources import time_is_over
from modelling.system import System

STRAIGHT, HELD, SMOOTH = "straight", "held", "smooth"
KINDS = (STRAIGHT, HELD, SMOOTH)
NOTICED = 0.05  # change of the readings, root mean square of the worst sensor in times the noise: less tells nothing
LIKELIER = 25.0  # decrease of χ² over its inflation for another hypothesis to be taken: five standard deviations
MOST = (
    0.5  # share of the misfit beyond noise that another hypothesis has to explain: what a cause leaves decides nothing
)
WORTH = 0.2  # of that, to first order: another hypothesis that gains less is not fitted
DELAY = 0.25  # of a sample: step of the derivative by a delay
ITERATIONS = 60
HALF = 0.4, 0.6  # of a sample: a dead time or lag in between is looked at as that of an input that is held


def as_taken(data: FitData, kinds: Sequence[str]) -> FitData:
    """Data as recorded with inputs that are taken so between their samples, one kind an input."""
    held, smooth = (tuple(j for j, own in enumerate(kinds) if own == kind) for kind in (HELD, SMOOTH))
    return replace(data, segments=tuple(replace(part, held=held, smooth=smooth) for part in data.segments))


def likeliest(system: System, recorded: FitData, fit: Fit, kinds: tuple[str, ...]) -> tuple[tuple[str, ...], Fit]:
    """How inputs are most likely taken between their samples, one kind an input, and the fit with that.

    All inputs are compared first, since one device sends or records them, then each by itself. What the fitted
    quantities, and a delay of every input, can take of the residual is left out of the comparison: a hidden delay is no
    proof that inputs are held.

    Parameters
    ----------
    recorded : FitData
        The data of the fit, inputs as recorded.
    fit : Fit
        With inputs taken as ``kinds`` says.
    """
    torques = [j for j, part in enumerate(system.inputs) if part.name not in system.imposed_by]
    if not torques or [len(part.time) for part in recorded.segments] != [
        len(part.time) for part in fit.problem.data.segments
    ]:
        return kinds, fit
    known, told = {kinds: fit}, cache(partial(_with_delays, fit))
    for group in [torques, *([j] for j in torques if len(torques) > 1)]:
        for kind in KINDS:
            other = tuple(kind if j in group else now for j, now in enumerate(kinds))
            if (
                other not in known
                and not time_is_over()
                and (found := _refitted(fit, as_taken(recorded, other), told)) is not None
            ):
                known[other] = found
        kinds = _likelier(system, recorded, known, kinds)
        if known[kinds] is not fit:
            fit, told = known[kinds], cache(partial(_with_delays, known[kinds]))
    return kinds, fit


def held_for_delay(system: System, best: Hypothesis, kinds: tuple[str, ...]) -> tuple[str, ...]:
    """The kinds with those inputs held that a hypothesis has act half a sample later than recorded: a torque that a
    drive holds until the next sample does so on average.

    A delay or lag of all sensors is one of all inputs.
    """
    step = best.fit.problem.data.sampling_interval
    read = {
        f"sensors.{s.name}" for s, n in zip(system.sensors, best.fit.problem.data.readings_by_sensor, strict=True) if n
    }
    every = {f"inputs.{part.name}" for part in system.inputs if part.name not in system.imposed_by}
    late = set[str]()
    for cause in best.causes:
        places = set(members(cause.at))
        if cause.kind == Lag.kind:
            sign = 1.0
        elif cause.kind in LATE_SIGN:
            sign = LATE_SIGN[cause.kind] * (1.0 if places >= read else -1.0)
        else:
            continue
        (name,) = cause.names().values()
        if HALF[0] * step <= sign * best.fit.values[name] <= HALF[1] * step:
            late |= every if places >= read else places & every
    return tuple(HELD if f"inputs.{p.name}" in late else k for p, k in zip(system.inputs, kinds, strict=True))


def note_on(system: System, kinds: Sequence[str]) -> list[str]:
    """What is said of inputs that are not straight between their samples."""
    out = []
    for kind, what in ((HELD, "held between samples"), (SMOOTH, "smooth between samples")):
        names = [part.name for part, own in zip(system.inputs, kinds, strict=True) if own == kind]
        if names:
            which = "inputs are" if len(names) == len(kinds) else f"{' and '.join(names)} is"
            out.append(f"{which} taken as {what}, not as straight lines: the model fits better so")
    return out


def _refitted(fit: Fit, data: FitData, told: Callable[[], np.ndarray]) -> Fit | None:
    """A fit with other inputs; None where that changes nothing, gains nothing to first order, or does not simulate.

    ``told`` gives the basis of :func:`_with_delays`: what it can take decides nothing.
    """
    problem = replace(fit.problem, data=data)
    residual = problem.residuals(fit.v[None])[0]
    change = problem.by_sensor(residual - fit.residual)
    squares = np.sum([np.sum(part**2, axis=0) for part in change], axis=0)
    if not np.sqrt(squares / np.maximum(data.readings_by_sensor, 1)).max(initial=0.0) >= NOTICED:
        return None
    if expected_cost(fit, residual) > fit.cost + LIKELIER:
        return None
    before, after = (float(np.sum((r - told() @ (told().T @ r)) ** 2)) for r in (fit.residual, residual))
    if before - after < WORTH * LIKELIER:
        return None
    try:
        return solve(problem, fit.v, fit.jacobian, FitOptions(ITERATIONS, exact=False))
    except FitError:
        return None


def _likelier(
    system: System, recorded: FitData, known: dict[tuple[str, ...], Fit], now: tuple[str, ...]
) -> tuple[str, ...]:
    """The likeliest of several hypotheses; the present one unless another is so by more than chance, or leaves nothing
    but noise where the present one leaves more."""
    perfect = [kinds for kinds, fit in known.items() if at_noise(as_hypothesis(system, fit))]
    if perfect and now not in perfect:
        return min(perfect, key=lambda kinds: known[kinds].cost)
    lower = [kinds for kinds, fit in known.items() if fit.cost < known[now].cost]
    left = {kinds: _free_of_delays(known[kinds]) for kinds in ([now, *lower] if lower else [])}
    best = min(left, key=lambda kinds: float(left[kinds] @ left[kinds]), default=now)
    if best == now:
        return now
    problem = known[best].problem
    inflation = residual_inflation(
        [np.where(s.measured, r, np.nan) for s, r in zip(recorded.segments, problem.by_sensor(left[best]), strict=True)]
    )
    before, after = (float(left[kinds] @ left[kinds]) for kinds in (now, best))
    gain, excess = before - after, before - recorded.readings_count
    return best if gain > max(LIKELIER * inflation, MOST * excess) else now


def _free_of_delays(fit: Fit) -> np.ndarray:
    """The residual (r,) of a fit without what its variables and a delay of each input can take."""
    basis = _with_delays(fit)
    return fit.residual - basis @ (basis.T @ fit.residual)


def _with_delays(fit: Fit) -> np.ndarray:
    """Orthonormal basis (r, n) of what the variables of a fit and a delay of each input change."""
    problem, columns = fit.problem, []
    for j in range(problem.data.segments[0].inputs.shape[1]):
        later = replace(problem, data=replace(problem.data, segments=tuple(_late(s, j) for s in problem.data.segments)))
        moved = later.residuals(fit.v[None])[0] - fit.residual
        if np.isfinite(moved).all():
            columns.append(moved)
    matrix = np.column_stack([fit.jacobian, *columns])
    lengths = np.linalg.norm(matrix, axis=0)
    return qr(matrix / np.where(lengths > 0, lengths, 1.0), mode="economic", check_finite=False)[0]


def _late(segment: Segment, j: int) -> Segment:
    """A segment with an input that comes a share of a sample later."""
    inputs = segment.inputs.copy()
    step = np.gradient(segment.time)
    inputs[:, j] = np.interp(segment.time - DELAY * step, segment.time, segment.inputs[:, j])
    return replace(segment, inputs=inputs)


# --- The resolution of inputs: what rounding them adds to the residual of a perfect model.

DRAWS = 6  # of the rounding; its mean power is then known to a fifth at the slowest scale


def with_rounding(data: FitData, fit: Fit) -> FitData:
    """Data that know what the resolution of their inputs adds to a residual, by simulation with the model of a fit."""
    recorded = np.concatenate([segment.inputs for segment in data.segments])
    steps = np.array([resolution(column) for column in recorded.T])
    if not steps.any():
        return data
    rng, problem = np.random.default_rng(0), fit.problem
    lengths = np.linalg.norm(fit.jacobian, axis=0)
    basis = qr(fit.jacobian / np.where(lengths > 0, lengths, 1.0), mode="economic", check_finite=False)[0]
    powers = []
    for _ in range(DRAWS):
        rounded = tuple(
            replace(s, inputs=s.inputs + steps * rng.uniform(-0.5, 0.5, s.inputs.shape)) for s in problem.data.segments
        )
        added = replace(problem, data=replace(problem.data, segments=rounded)).residuals(fit.v[None])[0] - fit.residual
        added -= basis @ (basis.T @ added)
        parts = problem.by_sensor(added)
        tests = [whiteness([part[:, j] for part in parts]) for j in range(len(data.noise))]
        powers.append([_padded(test.excess + 1 / np.array(BLOCK_LENGTHS[: len(test.excess)])) for test in tests])
    return replace(data, rounding=np.mean(powers, axis=0))


def _padded(excess: np.ndarray) -> np.ndarray:
    """With 0 for the block lengths for which there are too few samples."""
    return np.pad(excess, (0, len(BLOCK_LENGTHS) - len(excess)))
