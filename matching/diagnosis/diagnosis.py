"""The walk: recordings → base fit → causes → verdict → extended model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from matching.diagnosis import runs
from matching.diagnosis.candidates import fitted, without_cause
from matching.diagnosis.compare import Named, at_noise, where_not_noise
from matching.diagnosis.extend import extended
from matching.diagnosis.fit import base_problem, solve
from matching.diagnosis.holdout import elsewhere, ratios, rest_of
from matching.diagnosis.motion import seen
from matching.diagnosis.next_recording import propose
from matching.diagnosis.preparation import prepare_data, split
from matching.diagnosis.result import CauseFound, Diagnosis, Pictures, finite
from matching.diagnosis.several import Search, search
from matching.diagnosis.statistics import noise_of
from matching.diagnosis.uncertainty import estimates
from matching.diagnosis.verdict import confidence, weights
from modelling.effects import EFFECTS
from modelling.recording import Recording
from modelling.system import System

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

    def unseen(named: Named) -> list[np.ndarray]:
        return rest_of(named.fit, whole, counts) if holdout is None else elsewhere(named.fit, other)

    tell("base model")
    runs.prepare([system])
    problem, start = base_problem(system, train)
    state = search(system, solve(problem, start), tell)
    final = state.best
    if final.causes:
        tell("final fit")
        final = _polished(state)
    held_out = unseen(final)
    after = ratios(held_out)
    white = at_noise(final.noise())
    good_holdout = not np.nanmax(after, initial=0.0) > HELD_OUT_AT_MOST
    if not final.causes:
        verdict = "adequate" if white else "unexplained"
    else:
        verdict = "explained" if white and good_holdout else "unexplained"
    tell("rivals")
    causes, proposal = _causes(system, state, final, verdict == "explained", unseen)
    numbers = estimates(final.fit, state.best.fit if final.fit is not state.best.fit else None)
    base_unseen = ratios(unseen(state.base))
    return Diagnosis(
        verdict, causes, {name: own for name, own in numbers.items() if name in system.uncertain}, system.units,
        _errors(system, state.base, final, base_unseen, after),
        _gain(system, whole, base_unseen, after), _rest(final), proposal, notes,
        extended(system, final.causes, final.fit.values), _pictures(state, final),
    )  # fmt: skip


def _polished(state: Search) -> Named:
    """The best fit again with finer steps, ending on its own Jacobian."""
    best = state.best
    trial = type(best.trial)(
        best.trial.system, best.causes, best.trial.bounds, best.trial.values | best.fit.values, tuple(best.fit.starts)
    )
    try:
        fine = fitted(trial, best.fit, 12, True, 6.0)
    except (FloatingPointError, np.linalg.LinAlgError):
        return best
    return Named(trial, fine, best.screened) if fine.cost < 1.01 * best.fit.cost + 10 else best


def _causes(
    system: System, state: Search, final: Named, explained: bool, unseen: Callable[[Named], list[np.ndarray]]
) -> tuple[list[CauseFound], str | None]:
    found: list[CauseFound] = []
    proposal: tuple[float, str] | None = None
    numbers = estimates(final.fit, state.best.fit if final.fit is not state.best.fit else None)
    cache: dict[int, float] = {}

    def held_out(named: Named) -> float:
        if id(named) not in cache:
            try:
                cache[id(named)] = float(sum(np.nansum(own**2) for own in unseen(named)))
            except (FloatingPointError, np.linalg.LinAlgError):
                cache[id(named)] = 1e30
        return cache[id(named)]

    for index, cause in enumerate(final.causes):
        rivals = state.rivals[index] if index < len(state.rivals) else [state.best]
        here = [one for one in rivals if _is(one, cause, index, final)]
        others = [one for one in rivals if one not in here][:5]
        lone = here[:1] or [state.best]
        shares = _shares(lone[0], others, cause, held_out)
        without = _without(state, final, index)
        count = float(final.fit.problem.data.samples.sum())
        taken = (without.fit.cost - final.fit.cost) / max(without.fit.cost - count, 1.0)
        sure = {(kind, at): confidence(share, explained, taken) for kind, at, share in shares}
        parameters = {
            key: (numbers[name], EFFECTS[cause.kind].unit(key, cause.at, system)) for key, name in cause.names().items()
        }
        alternatives = [(k, a, c) for (k, a), c in sure.items() if (k, a) != (cause.kind, cause.at) and c > 1e-4]
        found.append(
            CauseFound(
                cause.kind, cause.at, parameters, sure[cause.kind, cause.at], _evidence(system, without, final, others),
                alternatives, without.fit.cost / final.fit.cost,
            )
        )  # fmt: skip
        if alternatives and alternatives[0][2] > RIVAL:
            kind, at, share = alternatives[0]
            rival = next(one for one in others if (one.causes[-1].kind, one.causes[-1].at) == (kind, at))
            manoeuvre = propose(lone[0], rival)
            if manoeuvre and (proposal is None or share > proposal[0]):
                proposal = (share, manoeuvre.sentence(f"{cause.kind} at {cause.at}", f"{kind} at {at}"))
    found.sort(key=lambda one: -one.gain)
    return found, proposal[1] if proposal else None


def _is(named: Named, cause: Any, index: int, final: Named) -> bool:
    own = {(one.kind, one.at) for one in named.causes}
    return own == {(one.kind, one.at) for one in final.causes}


def _shares(lone: Named, others: list[Named], cause: Any, held_out: Callable[[Named], float]) -> list[tuple[str, str, float]]:
    """Shares of evidence of a cause and its rivals, the cause itself written last among its fit's causes."""
    trial = lone.trial
    order = tuple(one for one in trial.causes if one != cause) + (cause,)
    named = Named(type(trial)(trial.system, order, trial.bounds, trial.values, trial.starts), lone.fit, lone.screened)
    return weights([named, *others], held_out)


def _without(state: Search, final: Named, index: int) -> Named:
    if len(final.causes) == 1:
        return state.base
    trial = without_cause(final.trial, index, final.fit)
    return Named(trial, fitted(trial, final.fit))


def _evidence(system: System, without: Named, final: Named, others: list[Named]) -> str:
    before, after = (np.array([one.ratio for one in named.noise()]) for named in (without, final))
    j = int(np.nanargmax(before - after))
    text = f"with it the error of {system.sensors[j].name} falls from {before[j]:.3g} to {after[j]:.3g} times the noise"
    if others:
        next_best = others[0]
        left = np.array([one.ratio for one in next_best.noise()])
        i = int(np.nanargmax(left))
        cause = next_best.causes[-1]
        text += f"; the next best, {cause.kind} at {cause.at}, leaves {left[i]:.3g} times the noise in {system.sensors[i].name}"
    return text


def _errors(
    system: System, base: Named, final: Named, base_unseen: np.ndarray, after_unseen: np.ndarray
) -> dict[str, dict[str, float | None]]:
    noise = final.fit.problem.data.noise
    before, after = ([one.ratio for one in named.noise()] for named in (base, final))
    out = {}
    for j, sensor in enumerate(system.sensors):
        if not final.fit.problem.data.samples[j]:
            continue
        own = {"before": before[j], "after": after[j], "before_holdout": base_unseen[j], "after_holdout": after_unseen[j]}
        out[sensor.name] = {"noise": float(noise[j])} | {key: finite(float(value * noise[j])) for key, value in own.items()}
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
    for j, scale in where_not_noise(noises):
        motion = motion or seen(final.fit)
        worst: tuple[float, int, int, int] = (-1.0, 0, 0, 0)
        for i, own in enumerate(residuals):
            length = max(len(own) // 16, 8)
            squares = [float(np.mean(own[a : a + length, j] ** 2)) for a in range(0, max(len(own) - length, 1), length)]
            k = int(np.argmax(squares))
            worst = max(worst, (squares[k], i, k * length, k * length + length))
        square, i, first, last = worst
        time, part = problem.data.segments[i].time, motion.parts[i]
        stretch = slice(part.start + first, min(part.start + last, part.stop))
        out.append({
            "sensor": problem.model.sensors[j], "ratio": noises[j].ratio, "worst_ratio": float(np.sqrt(square)),
            "from": float(time[first]), "to": float(time[min(last, len(time) - 1)]),
            "slower_than": float(scale * np.median(np.diff(time))),
            "speed": {name: [float(own[stretch].min()), float(own[stretch].max())] for name, own in motion.speed.items()},
            "torque": {name: [float(own[stretch].min()), float(own[stretch].max())] for name, own in motion.torque.items()},
        })  # fmt: skip
    return out


def _pictures(state: Search, final: Named) -> Pictures:
    data, screen = final.fit.problem.data, state.screen
    measured = np.concatenate([segment.readings for segment in data.segments])
    missing = ~np.isfinite(measured)
    before, after = (np.concatenate(named.fit.by_sensor()) * data.noise for named in (state.base, final))
    before[missing], after[missing] = np.nan, np.nan
    system = state.base.trial.system
    inertias = {part.name: screen.leftover.inertias[:, i] for i, part in enumerate(system.inertias)}
    shafts = {part.name: screen.leftover.shafts[:, i] for i, part in enumerate(system.shafts)}
    names = [sensor.name for sensor in system.sensors]
    return Pictures(seen(state.base.fit), seen(final.fit), measured, before, after, inertias, shafts, names, data.noise)


__all__ = ["diagnose", "noise_of"]
