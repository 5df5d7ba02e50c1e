"""The diagnosis: recordings → base fit → causes → verdict → extended model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from matching.diagnosis.candidates.backlash_one_flank import as_late_as_contact, bounded_below
from matching.diagnosis.candidates.extend import extended_system
from matching.diagnosis.candidates.motion import simulated_motion
from matching.diagnosis.candidates.short_windows import window_uncertainties
from matching.diagnosis.data.holdout_fidelity import fidelity
from matching.diagnosis.data.holdout_residuals import HoldoutData, ModelResiduals, holdout_data
from matching.diagnosis.data.holdout_split import split_holdout
from matching.diagnosis.data.preparation import prepare_data
from matching.diagnosis.data.segments import FitData
from matching.diagnosis.fitting.batch_simulation import compile_models
from matching.diagnosis.fitting.fit import Fit, solve
from matching.diagnosis.fitting.holdout import (
    RESTART_SECONDS,
    Holdout,
    OtherRecordings,
    RestartedRest,
    RestOfRecordings,
    holdout_residuals,
    rms_by_sensor,
)
from matching.diagnosis.fitting.problem import base_problem
from matching.diagnosis.fitting.uncertainty import Estimate, at_least, discretisation_shift, estimates
from matching.diagnosis.identify_causes import IdentifiedCauses, best_without, identify_causes
from matching.diagnosis.loggers import with_clocks
from matching.diagnosis.search.hypothesis import Hypothesis, at_noise
from matching.diagnosis.search.profile_likelihood import equivalent_fits, widened
from matching.diagnosis.search.refit_candidates import Progress
from matching.diagnosis.search.remembered import RememberedHoldout
from matching.diagnosis.search.state import SearchState
from matching.diagnosis.search.unseen_data import UnseenData
from matching.diagnosis.verdict.closed_loop import closed_loop_notes
from matching.diagnosis.verdict.discrepancy import discrepancy_curves
from matching.diagnosis.verdict.errors import (
    errors_by_sensor,
    pooled_errors,
    remaining_errors,
    residual_once,
    scatter_notes,
)
from matching.diagnosis.verdict.indistinguishable import KnownScreening
from matching.diagnosis.verdict.influence import correlated_uncertainties
from matching.diagnosis.verdict.kept_table import KeptTable, kept_table
from matching.diagnosis.verdict.named_causes import (
    JudgedCause,
    named_causes,
    recording_to_tell_rivals,
    refitted_candidates,
)
from matching.diagnosis.verdict.result import Diagnosis, Pictured, PlotData
from modelling.measurement.recording import Recording
from modelling.model.system import System
from modelling.simulation.speed_units import check_speed_units

EXPLAINED_HOLDOUT_RATIO = 1.25  # error on held-out data, in times the noise, up to which causes count as explaining all


def diagnose(
    system: System,
    recordings: Sequence[Recording],
    holdout: Recording | Sequence[Recording] | None = None,
    progress: Progress = lambda _: None,
    keep_rest: bool = False,
    pictured: Callable[[Pictured], None] = lambda _: None,
) -> Diagnosis:
    """Find out what a model lacks against recordings of the system.

    Parameters
    ----------
    system : System
        Its quantities with a range are fitted, those without are taken as known until a wrong one is named.
    recordings : sequence of Recording
    holdout : Recording or sequence of Recording, optional
        Judges all fits and is not fitted; without it the last 30 % of every recording.
    progress : callable
        Is given the name of each step.
    keep_rest : bool
        Whether the extended model keeps the torque that no cause explains as a table, where unseen data gain by it.
    pictured : callable
        Is given what the figures show before the causes are judged.

    Raises
    ------
    InputError
        If the recordings lack what is needed, or have speeds without a unit that fit in 1/min only.
    """
    judging = [holdout] if isinstance(holdout, Recording) else list(holdout or [])
    stated, system = system, with_clocks(system, [*recordings, *judging])
    whole, train, judge, notes = _data(system, recordings, judging)
    remembered = RememberedHoldout(judge)
    progress("base model")
    compile_models([system])
    identified = identify_causes(system, solve(*base_problem(system, train)), remembered, progress)
    state, fits = identified.state, equivalent_fits(identified.state.best.fit, identified.state.best.causes)
    base, final = state.base, replace(state.best, fit=fits[0])
    state.best = final
    judge, restarted = _predictable(final, judge, remembered)
    notes += restarted + closed_loop_notes(final, recordings) + scatter_notes(final)
    residuals = [holdout_residuals(judge.simulate(hypothesis.fit)) for hypothesis in (base, final)]
    before, after = (rms_by_sensor(parts) for parts in residuals)
    verdict, rest = _verdict(final, after), remaining_errors(final)
    explained = verdict == "explained"
    unseen = holdout_data(train.noise, *_by_segment(judge, (base, final), residuals))
    curves = discrepancy_curves(final) if rest else []
    errors = errors_by_sensor(system, base, final, before, after)
    pictured(Pictured(errors, curves, plot_data := _plot_data(state, final, unseen)))
    values = _estimates(final, fits)
    judged = _judged_causes(identified)
    kept = kept_table(final, curves, UnseenData(judge)) if keep_rest else None
    return Diagnosis(
        verdict, named_causes(system, final, values, judged, explained),
        {name: value for name, value in values.items() if name in system.uncertain}, system.units,
        errors, pooled_errors(whole, before, after), fidelity(system, unseen), refitted_candidates(judged),
        identified.fitted, rest, curves, recording_to_tell_rivals(final, judged, explained), notes,
        _extended(stated, final, kept), plot_data, kept,
    )  # fmt: skip


def _by_segment(judge: Holdout, models: Sequence[Hypothesis], residuals: Sequence[list]) -> Iterator[ModelResiduals]:
    """The residuals of several models on held-out data with the segments they belong to."""
    return (ModelResiduals(judge.segments(model.fit), r) for model, r in zip(models, residuals, strict=True))


def _estimates(final: Hypothesis, fits: list[Fit]) -> dict[str, Estimate]:
    """All fitted parameters by name; ``fits`` are equivalent to the final one, which comes first."""
    correlated = None if at_noise(final) else correlated_uncertainties(final.fit)
    values = widened(estimates(final.fit, discretisation_shift(final.fit), correlated), fits)
    if _rattles(final):
        values = at_least(values, window_uncertainties(final.fit))
    return bounded_below(as_late_as_contact(values, final.fit, final.causes), final.fit, final.causes)


def _extended(stated: System, final: Hypothesis, kept: KeptTable | None) -> System:
    """The stated system with the causes, and with a table of what they leave where one is kept."""
    if kept is None:
        return extended_system(stated, final.causes, final.fit.values)
    return extended_system(stated.with_effects(kept.effect), final.causes, kept.values)


def _data(
    system: System, recordings: Sequence[Recording], judging: Sequence[Recording]
) -> tuple[FitData, FitData, Holdout, list[str]]:
    """All data of the recordings, those to fit, those to judge, and notes."""
    for recording in [*recordings, *judging]:
        check_speed_units(system, recording)
    whole, remarks = prepare_data(system, recordings)
    notes = [note for recording in recordings for note in recording.notes] + remarks
    if not judging:
        train, counts = split_holdout(whole)
        return whole, train, RestOfRecordings(whole, counts), notes
    other, remarks = prepare_data(system, judging)
    notes += [f"hold-out: {note}" for note in (*(note for recording in judging for note in recording.notes), *remarks)]
    return whole, whole, OtherRecordings(FitData(other.segments, whole.noise)), notes


def _rattles(hypothesis: Hypothesis) -> bool:
    return any(effect.law.abrupt for effect in hypothesis.fit.problem.system.effects)


def _predictable(final: Hypothesis, judge: Holdout, remembered: RememberedHoldout) -> tuple[Holdout, list[str]]:
    """Held-out data as far as a model predicts them, and notes.

    Where a shaft rattles and the free continuation of the fit loses the way: windows with start states of their own.
    """
    if not (isinstance(judge, RestOfRecordings) and at_noise(final) and _rattles(final)):
        return remembered, []
    errors = rms_by_sensor(holdout_residuals(remembered.simulate(final.fit)))
    if np.nanmax(errors, initial=0.0) <= EXPLAINED_HOLDOUT_RATIO:
        return remembered, []
    note = f"held-out data are simulated in windows of {RESTART_SECONDS:g} s: rattling forgets where it began"
    return RestartedRest(judge.whole, judge.counts), [note]


def _verdict(final: Hypothesis, after_holdout: np.ndarray) -> str:
    """``adequate``, ``explained`` or ``unexplained``; errors (y,) on held-out data in times the noise."""
    if not at_noise(final):
        return "unexplained"
    if not final.causes:
        return "adequate"
    return "unexplained" if np.nanmax(after_holdout, initial=0.0) > EXPLAINED_HOLDOUT_RATIO else "explained"


def _judged_causes(identified: IdentifiedCauses) -> list[JudgedCause]:
    """Every cause of the best hypothesis with its rivals, and the best hypothesis without it."""
    state = identified.state
    causes = zip(state.best.causes, identified.rated, strict=True)
    known = KnownScreening(state.screening, state.screened)
    return [
        JudgedCause(cause, ratings, best_without(state, place), known) for place, (cause, ratings) in enumerate(causes)
    ]


def _plot_data(state: SearchState, final: Hypothesis, unseen: HoldoutData) -> PlotData:
    data, balance, system = state.base.fit.problem.data, state.screening.balance, state.base.model.base
    measured = np.concatenate([segment.readings for segment in data.segments])
    before, after = (
        np.where(np.isfinite(measured), residual_once(hypothesis) * data.noise, np.nan)
        for hypothesis in (state.base, final)
    )
    return PlotData(
        simulated_motion(state.base.fit), simulated_motion(final.fit), measured, before, after,
        {part.name: balance.inertias[:, i] for i, part in enumerate(system.inertias)},
        {part.name: balance.shafts[:, i] for i, part in enumerate(system.shafts)},
        [sensor.name for sensor in system.sensors], data.noise, unseen,
    )  # fmt: skip
