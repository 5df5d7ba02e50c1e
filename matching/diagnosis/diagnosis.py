"""The walk: recordings → base fit → causes → verdict → extended model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from matching.diagnosis.candidates.backlash_one_flank import bounded_below
from matching.diagnosis.candidates.extend import extended
from matching.diagnosis.candidates.motion import seen
from matching.diagnosis.data.holdout_fidelity import HoldoutData, fidelity, holdout_data
from matching.diagnosis.data.preparation import prepare_data, split
from matching.diagnosis.fitting import batch_simulation as runs
from matching.diagnosis.fitting.fit import Fit, base_problem, solve
from matching.diagnosis.fitting.holdout import (
    Ahead,
    elsewhere,
    ratios,
    residuals,
    rest_of,
    rest_segments,
    unseen_segments,
)
from matching.diagnosis.fitting.uncertainty import Estimate, discretisation, estimates
from matching.diagnosis.identify_causes import walk, without
from matching.diagnosis.search.compare import Named, at_noise, where_not_noise
from matching.diagnosis.search.greedy_search import Search
from matching.diagnosis.search.profile_likelihood import as_good, widened
from matching.diagnosis.verdict.next_recording import propose
from matching.diagnosis.verdict.result import Candidate, Diagnosis, NamedCause, PlotData, finite
from matching.diagnosis.verdict.verdict import Rated, confidence
from modelling.effects import EFFECTS
from modelling.measurement.recording import Recording
from modelling.model.system import System

HELD_OUT_AT_MOST = 1.25  # times the noise, on unseen data, of what counts as explained
RIVAL = 0.02  # confidence from which a rival is worth a further recording


def diagnose(
    system: System,
    recordings: Sequence[Recording],
    holdout: Recording | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Find out what a model lacks against recordings of the system.

    Parameters
    ----------
    system : System
        Its quantities with a range are fitted, those without are taken as known until a wrong one is named.
    recordings : sequence of Recording
    holdout : Recording, optional
        Unseen by all fits; without it the last 30 % of every recording is.
    tell : callable
        Gets a line on each step.

    Raises
    ------
    InputError
        If the recordings lack what is needed.
    """
    whole, notes = prepare_data(system, recordings)
    notes = [note for recording in recordings for note in recording.notes] + notes
    if holdout is None:
        train, counts = split(whole)
    else:
        train, counts = whole, []
        other, more = prepare_data(system, [holdout])
        notes += [f"hold-out: {note}" for note in (*holdout.notes, *more)]
        other = type(other)(other.segments, train.noise)

    def ahead(named: Named) -> list[Ahead]:
        return rest_of(named.fit, whole, counts) if holdout is None else elsewhere(named.fit, other)

    tell("base model")
    runs.prepare([system])
    rest = other if holdout is not None else replace(whole, segments=tuple(unseen_segments(whole, counts)))
    state, rivals = walk(system, solve(*base_problem(system, train)), ahead, rest, tell)
    valley = as_good(state.best.fit, state.best.causes)
    state.best = final = replace(state.best, fit=valley[0])
    residual_after, residual_before = (residuals(ahead(named)) for named in (final, state.base))
    after, base_unseen = ratios(residual_after), ratios(residual_before)
    white = at_noise(final)
    good_holdout = not np.nanmax(after, initial=0.0) > HELD_OUT_AT_MOST
    if not final.causes:
        verdict = "adequate" if white else "unexplained"
    else:
        verdict = "explained" if white and good_holdout else "unexplained"
    numbers = widened(estimates(final.fit, discretisation(final.fit)), valley)
    numbers = bounded_below(numbers, final.fit, final.causes)
    less = [without(state, index) for index in range(len(final.causes))]
    causes, proposal = _causes(system, final, numbers, rivals, less, verdict == "explained")
    segments = [
        list(other.segments) if holdout is not None else rest_segments(named.fit, whole, counts)
        for named in (state.base, final)
    ]
    judged = holdout_data(train.noise, (segments[0], residual_before), (segments[1], residual_after))
    return Diagnosis(
        verdict, causes, {name: own for name, own in numbers.items() if name in system.uncertain}, system.units,
        _errors(system, state.base, final, base_unseen, after),
        _gain(system, whole, base_unseen, after), fidelity(system, judged), _candidates(final, rivals), _rest(final),
        proposal, notes, extended(system, final.causes, final.fit.values), _plot_data(state, final, judged),
    )  # fmt: skip


def _causes(
    system: System,
    final: Named,
    numbers: Mapping[str, Estimate],
    rivals: Sequence[Sequence[Rated]],
    without: Sequence[Named],
    explained: bool,
) -> tuple[list[NamedCause], str | None]:
    """Each cause with values, confidence, evidence and rivals, strongest first; and what to record next."""
    found: list[NamedCause] = []
    proposals: list[tuple[float, str]] = []
    count = float(final.fit.problem.data.samples.sum())
    for cause, own, rest in zip(final.causes, rivals, without, strict=True):
        taken = (rest.fit.cost - final.fit.cost) / max(rest.fit.cost - count, 1.0)
        here = (cause.kind, cause.at)
        sure = [(one, confidence(one.share, explained, taken)) for one in own]
        others = [(one, share) for one, share in sure if (one.kind, one.at) != here]
        mine = next(share for one, share in sure if (one.kind, one.at) == here)
        values = EFFECTS[cause.kind].canonical({key: numbers[name].value for key, name in cause.names().items()})
        parameters = {
            key: (replace(numbers[name], value=values[key]), EFFECTS[cause.kind].unit(key, cause.at, system))
            for key, name in cause.names().items()
        }
        alternatives = [(one.kind, one.at, share) for one, share in others if share > 1e-4]
        evidence = _evidence(system, rest, final, others[0][0].named if others else None)
        gain = rest.fit.cost / final.fit.cost
        found.append(NamedCause(cause.kind, cause.at, parameters, mine, evidence, alternatives, gain))
        if others and others[0][1] > RIVAL:
            rival, share = others[0]
            manoeuvre = propose(final, rival.named)
            if manoeuvre:
                proposals.append(
                    (share, manoeuvre.sentence(f"{cause.kind} at {cause.at}", f"{rival.kind} at {rival.at}"))
                )
    found.sort(key=lambda one: -one.gain)
    return found, max(proposals)[1] if proposals else None


def _candidates(final: Named, rivals: Sequence[Sequence[Rated]]) -> list[Candidate]:
    out = []
    for cause, own in zip(final.causes, rivals, strict=True):
        for one in own:
            chi_square, count = one.named.fit.cost, float(one.named.fit.problem.data.samples.sum())
            misfit = float(np.sqrt(chi_square / count))
            out.append(Candidate(one.kind, one.at, f"{cause.kind} at {cause.at}", misfit, chi_square, one.share))
    return out


def _evidence(system: System, without: Named, final: Named, next_best: Named | None) -> str:
    before, after = (np.array([one.ratio for one in named.noise()]) for named in (without, final))
    j = int(np.nanargmax(before - after))
    text = f"with it the error of {system.sensors[j].name} falls from {before[j]:.3g} to {after[j]:.3g} times the noise"
    if next_best:
        left = np.array([one.ratio for one in next_best.noise()])
        i = int(np.nanargmax(left))
        cause = next_best.causes[-1]
        text += f"; the next best, {cause.kind} at {cause.at}, leaves {left[i]:.3g} times the noise"
        text += f" in {system.sensors[i].name}"
    return text


def _errors(
    system: System, base: Named, final: Named, base_unseen: np.ndarray, after_unseen: np.ndarray
) -> dict[str, dict[str, float | None]]:
    noise = final.fit.problem.data.noise
    before, after = ([one.ratio for one in named.noise()] for named in (base, final))
    out: dict[str, dict[str, float | None]] = {}
    for j, sensor in enumerate(system.sensors):
        if not final.fit.problem.data.samples[j]:
            continue
        own = {
            "before": before[j],
            "after": after[j],
            "before_holdout": base_unseen[j],
            "after_holdout": after_unseen[j],
        }
        out[sensor.name] = {"noise": float(noise[j])}
        out[sensor.name].update({key: finite(float(value * noise[j])) for key, value in own.items()})
    return out


def _gain(system: System, whole: Any, before: np.ndarray, after: np.ndarray) -> dict[str, float | None]:
    """Errors on unseen data over each sensor's own range, pooled."""
    every = np.concatenate([segment.readings for segment in whole.segments])
    there = np.isfinite(every).any(axis=0) & np.isfinite(after)
    spread = np.array([np.ptp(own[np.isfinite(own)]) if ok else np.nan for own, ok in zip(every.T, there, strict=True)])
    there &= np.nan_to_num(spread) > 0
    share = whole.noise[there] / spread[there]

    def pooled(ratio: np.ndarray) -> float | None:
        return finite(float(np.sqrt(np.mean((ratio[there] * share) ** 2)))) if there.any() else None

    return {"nrmse_before": pooled(before), "nrmse_after": pooled(after), "noise_floor": pooled(np.ones(len(before)))}


def _rest(final: Named) -> list[dict[str, Any]]:
    """Where and when what is more than noise sits: by sensor the worst stretch, with speed and torque there."""
    out = []
    problem = final.fit.problem
    noises = final.noise()
    residuals = final.fit.by_sensor()
    motion = None
    for j, scale in where_not_noise(final):
        motion = motion or seen(final.fit)
        worst: tuple[float, int, int, int] = (-1.0, 0, 0, 0)
        for i, own in enumerate(residuals):
            length = max(len(own) // 16, 8)
            squares = [float(np.mean(own[a : a + length, j] ** 2)) for a in range(0, max(len(own) - length, 1), length)]
            k = int(np.argmax(squares))
            worst = max(worst, (squares[k], i, k * length, k * length + length))
        square, i, first, last = worst
        time, part = problem.data.segments[i].time, motion.segments[i]
        stretch = slice(part.start + first, min(part.start + last, part.stop))
        out.append({
            "sensor": problem.model.sensors[j], "ratio": noises[j].ratio, "worst_ratio": float(np.sqrt(square)),
            "from": float(time[first]), "to": float(time[min(last, len(time) - 1)]),
            "slower_than": float(scale * np.median(np.diff(time))),
            "speed": _spans(motion.speed, stretch),
            "torque": _spans(motion.torque, stretch),
        })  # fmt: skip
    return out


def _spans(signals: Mapping[str, np.ndarray], stretch: slice) -> dict[str, list[float]]:
    return {name: [float(own[stretch].min()), float(own[stretch].max())] for name, own in signals.items()}


def _plot_data(state: Search, final: Named, judged: HoldoutData) -> PlotData:
    data, screen = state.base.fit.problem.data, state.screen
    measured = np.concatenate([segment.readings for segment in data.segments])
    before, after = (np.concatenate(_once(named.fit)) * data.noise for named in (state.base, final))
    before, after = (np.where(np.isfinite(measured), own, np.nan) for own in (before, after))
    system = state.base.trial.system
    inertias = {part.name: screen.leftover.inertias[:, i] for i, part in enumerate(system.inertias)}
    shafts = {part.name: screen.leftover.shafts[:, i] for i, part in enumerate(system.shafts)}
    names = [sensor.name for sensor in system.sensors]
    return PlotData(
        seen(state.base.fit), seen(final.fit), measured, before, after, inertias, shafts, names, data.noise, judged
    )


def _once(fit: Fit) -> list[np.ndarray]:
    """Residuals (t, y) with every sample once, where windows share the last of one and the first of the next."""
    segments, out = fit.problem.data.segments, []
    for i, own in enumerate(fit.by_sensor()):
        shared = i + 1 < len(segments) and segments[i + 1].name == segments[i].name
        shared = shared and segments[i + 1].time[0] == segments[i].time[-1]
        out.append(own[:-1] if shared else own)
    return out
