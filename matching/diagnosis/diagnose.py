"""The diagnosis: recordings → base fit → causes → verdict → extended model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from matching.diagnosis import audit, inputs
from matching.diagnosis.base import fit_base
from matching.diagnosis.causes import extended_system, simulated_motion
from matching.diagnosis.closed_loop import closed_loop_notes
from matching.diagnosis.data import FitData, prepare_data
from matching.diagnosis.descent import Fit, balanced_fit, solve
from matching.diagnosis.holdout import (
    RESTART_SECONDS,
    Holdout,
    HoldoutData,
    ModelResiduals,
    OtherRecordings,
    RememberedHoldout,
    RestartedRest,
    RestOfRecordings,
    fidelity,
    holdout_data,
    holdout_residuals,
    rms_by_sensor,
    split_holdout,
)
from matching.diagnosis.loggers import with_clocks
from matching.diagnosis.problem import base_problem
from matching.diagnosis.result import (
    Candidate,
    Diagnosis,
    FittedCandidate,
    KeptTable,
    KnownScreening,
    NamedCause,
    Pictured,
    PlotData,
    correlated_uncertainties,
    discrepancy_curves,
    errors_by_sensor,
    kept_table,
    pooled_errors,
    remaining_errors,
    residual_once,
    scatter_notes,
)
from matching.diagnosis.screening import (
    Screening,
    as_late_as_contact,
    bounded_below,
)
from matching.diagnosis.search import (
    Progress,
    SearchState,
    Suspected,
    first_readings,
    search_causes,
    search_window,
    simplified,
    without,
)
from matching.diagnosis.selection import (
    Hypothesis,
    UnseenData,
    at_noise,
    equivalent_fits,
    largest_error,
    rms_errors,
    scatters_only,
    widened,
)
from matching.diagnosis.settings import DiagnosisSettings
from matching.diagnosis.simulation import compile_models
from matching.diagnosis.statistics import Estimate, at_least, discretisation_shift, estimates, prediction
from matching.diagnosis.times import channel_times
from matching.diagnosis.verdict import (
    TOLD_FROM_NOTHING,
    JudgedCause,
    RatedCause,
    acts,
    cause_parameters,
    final_fit,
    final_fit_on,
    fitted_candidates,
    named_causes,
    rate_rivals,
    recording_to_tell_rivals,
    refitted_candidates,
)
from matching.diagnosis.windows import window_uncertainties
from modelling.errors import FitError, InputError
from modelling.recordings.recording import Recording
from modelling.resources import ended_early_by, ends_early, is_limited, limited, time_is_over
from modelling.simulation.simulate import check_exchanged, check_speed_units
from modelling.system import System

# --- From a base fit to causes with their rivals; of long data by way of a time window.


@dataclass(frozen=True)
class IdentifiedCauses:
    """The state of the search at its end, for each cause its rivals, itself included, and all fitted candidates."""

    state: SearchState
    rated: list[list[RatedCause]]
    fitted: list[FittedCandidate]


def identify_causes(
    system: System,
    base: Fit,
    holdout: Holdout,
    settings: DiagnosisSettings,
    progress: Progress,
    suspected: Sequence[Suspected] = (),
) -> IdentifiedCauses:
    """The causes that a base fit lacks, and for each its rivals, itself included.

    Weights by noise are right for a model that can be perfect. Where the best one is far from the noise, causes are
    searched for again with each sensor weighted by what the base model leaves of it, and taken if they meet unseen data
    better.
    """
    identified = _identify(system, base, holdout, settings, progress, suspected)
    best = identified.state.best
    if scatters_only(best) or largest_error(best.fit) < settings.left_by_model or time_is_over(settings.search_share):
        return identified
    progress("sensors weighted by what the model leaves")
    if largest_error(base) < settings.far_from_noise:
        settings = replace(settings, far_from_noise=settings.left_by_model)
    balanced = _identify(system, _balanced(system, base), holdout, settings, progress, suspected)
    unseen = UnseenData(holdout, settings)
    return balanced if unseen.pooled(balanced.state.best) < unseen.pooled(best) else identified


def _identify(
    system: System,
    base: Fit,
    holdout: Holdout,
    settings: DiagnosisSettings,
    progress: Progress,
    suspected: Sequence[Suspected],
) -> IdentifiedCauses:
    """Causes with their rivals, sensors weighted as in the base fit.

    Of long data, causes are searched for in the time window where the base model is worst, then fitted to all data. If
    the residual of all data is not noise though that of the window is, they are searched for in all data.
    """
    window = search_window(base, settings.window)
    if window is not None:
        progress(f"a time window of {sum(np.ptp(segment.time) for segment in window.segments):.3g} s")
        judge = RememberedHoldout(OtherRecordings(first_readings(holdout.data, settings.window)))
        identified = _search_and_rate(system, _solved_as(base, system, window), judge, settings, progress, suspected)
        state = identified.state
        progress("all data")
        best = final_fit_on(state.best, base)
        if at_noise(best) or not at_noise(state.best) or time_is_over(settings.search_share):
            state.best, state.base, state.screening = best, replace(state.base, fit=base), Screening(base)
            state.screened = []
            return identified
    return _search_and_rate(system, base, holdout, settings, progress, suspected)


def _balanced(system: System, base: Fit) -> Fit:
    return balanced_fit(base, base_problem(system, base.problem.data)[1])


def _solved_as(base: Fit, system: System, data: FitData) -> Fit:
    """A base fit of other data, weighted as another is."""
    problem, v = base_problem(system, data)
    return solve(replace(problem, weighting=base.problem.weighting), v)


def _search_and_rate(
    system: System,
    base: Fit,
    holdout: Holdout,
    settings: DiagnosisSettings,
    progress: Progress,
    suspected: Sequence[Suspected],
) -> IdentifiedCauses:
    unseen = UnseenData(holdout, settings)
    state = search_causes(system, base, unseen, settings, progress, suspected)
    progress("final fit")
    state.best = simplified(final_fit(state.best))
    _leave_out(state, unseen)
    # Beside an error of the model a sensor may lose what the base model had fitted of that: all together decide.
    if state.best.causes and not unseen.keeps(state.best, state.base, by_sensor=False):
        state.best, state.rivals = state.base, []
    if not state.best.causes:
        state.base = state.best
    rated = []
    for index in range(len(state.best.causes)):
        progress("rivals")
        rated.append(rate_rivals(state, index, unseen))
    return IdentifiedCauses(state, rated, fitted_candidates(state, holdout))


def _leave_out(state: SearchState, unseen: UnseenData) -> None:
    """Leave out each cause of several, the last first, without which the final fit meets unseen data as well, or whose
    torque is not told from nothing."""
    for index in reversed(range(len(state.best.causes))):
        rest = without(state.best, index)
        if rest is None:
            continue
        if not rest.causes and _lower(rest.fit, state.base.fit):
            state.base = final_fit(rest)
        best = state.best
        parameters = cause_parameters(best.model.base, best.causes[index], _estimates(best, [best.fit]))
        nothing = best.model.negligible(best.fit, index) or acts(parameters) < TOLD_FROM_NOTHING
        if nothing or not unseen.keeps(best, rest):
            state.best = final_fit(rest)
            del state.rivals[index : index + 1]


def _lower(fit: Fit, other: Fit) -> bool:
    """Whether a fit leaves less than another one of the same data, in the same weights."""
    same = fit.residual.shape == other.residual.shape and fit.problem.weighting is other.problem.weighting
    return same and fit.cost < other.cost


# --- Diagnosis

FAR_OFF = 0.25  # error of the base model over a sensor's standard deviation, from which its unit is checked
EXPLAINED_HOLDOUT_RATIO = 1.25  # error on held-out data, in times the noise, up to which causes count as explaining all


@threadpool_limits.wrap(limits=1, user_api="blas")
def diagnose(
    system: System,
    recordings: Sequence[Recording],
    holdout: Recording | Sequence[Recording] | None = None,
    progress: Progress = lambda _: None,
    keep_rest: bool = False,
    pictured: Callable[[Pictured], None] = lambda _: None,
    settings: DiagnosisSettings | None = None,
    time_limit: float | None = None,
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
    settings : DiagnosisSettings, optional
    time_limit : float, optional
        Seconds that it may take; then it answers the best so far, and a note says so. Without it
        ``settings.processor_seconds`` of the processor.
    """
    settings = settings or DiagnosisSettings()
    by_default = time_limit is None and not is_limited()
    with (
        ends_early(),
        limited(settings.processor_seconds if by_default else time_limit, of_processor=by_default) as limit,
    ):
        judging = [holdout] if isinstance(holdout, Recording) else list(holdout or [])
        stated, system = system, with_clocks(system, [*recordings, *judging])
        whole, train, judge, notes = _data(system, recordings, judging)
        remembered = RememberedHoldout(judge)
        progress("base model")
        compile_models([system])
        base_fit = _base_fit(system, train, [*recordings, *judging], settings)
        order, base_fit = audit.with_channels_of(system, base_fit, train, settings)
        hum = audit.find_hum(system, base_fit)
        whole, train = (_mended(system, data, base_fit, order, hum) for data in (whole, train))
        judge = _mended_holdout(judge, whole, lambda data: _mended(system, data, base_fit, order, hum))
        remembered = RememberedHoldout(judge)
        if hum:
            base_fit = fit_base(system, train, settings, base_fit)
        notes += audit.notes_on(system, order, hum)
        straight = (inputs.STRAIGHT,) * len(system.inputs)
        kinds, base_fit = inputs.likeliest(system, train, base_fit, straight)
        recorded = inputs.with_rounding(train, base_fit), judge
        for last in (False, True):
            if kinds != straight or recorded[0].rounding is not None:
                train, judge = inputs.as_taken(recorded[0], kinds), inputs.with_inputs(recorded[1], kinds)
                remembered = RememberedHoldout(judge)
                base_fit = fit_base(system, train, settings, base_fit)
            suspected = audit.time_hypotheses(system, base_fit, times := channel_times(system, base_fit))
            identified = identify_causes(system, base_fit, remembered, settings, progress, suspected)
            best = identified.state.best
            if last or not best.causes or (at_noise(best) and kinds != straight):
                break
            progress("inputs between samples")
            others, _ = inputs.likeliest(system, recorded[0], best.fit, kinds)
            if others == kinds:
                break
            kinds = others
        notes += inputs.note_on(system, kinds) + audit.notes_on_times(system, times, train.sampling_interval)
        recorded_judge, weak, weighed = judge, list[NamedCause](), list[Candidate]()
        while True:
            state, fits = identified.state, equivalent_fits(identified.state.best.fit, identified.state.best.causes)
            base, final = state.base, replace(state.best, fit=fits[0])
            state.best = final
            judge, restarted = _predictable(final, recorded_judge, remembered)
            residuals = [holdout_residuals(judge.simulate(hypothesis.fit)) for hypothesis in (base, final)]
            before, after = (rms_by_sensor(parts) for parts in residuals)
            verdict, unseen = _verdict(final, judge, after, train.rounding), UnseenData(judge, settings)
            values, judging_data = _estimates(final, fits), None if verdict == "explained" else unseen
            judged = _judged_causes(identified, final, judging_data)
            named = named_causes(system, final, values, judged, judging_data)
            doubtful = [index for index, cause in enumerate(named) if not cause.in_model]
            if not doubtful:
                break
            least = min(doubtful, key=lambda index: named[index].confidence)
            weak.append(named[least])
            weighed += refitted_candidates([judged[least]])
            identified = _without(identified, least)
        notes += restarted + closed_loop_notes(final, recordings) + scatter_notes(final)
        rest = remaining_errors(final)
        if verdict == "unexplained" and not final.causes and at_noise(final):
            notes.append(
                "the fitted data are reproduced to their noise, held-out data are not: something happens in those"
            )
        held_out = holdout_data(train.noise, *_by_segment(judge, (base, final), residuals))
        curves = discrepancy_curves(final) if rest else []
        errors = errors_by_sensor(system, base, final, before, after)
        pictured(Pictured(errors, curves, plot_data := _plot_data(state, final, held_out)))
        kept = kept_table(final, curves, unseen) if keep_rest else None
        found = Diagnosis(
            verdict, [*sorted(named, key=lambda cause: -cause.gain), *reversed(weak)],
            {name: value for name, value in values.items() if name in system.uncertain}, system.units,
            errors, pooled_errors(whole, before, after), fidelity(system, held_out),
            refitted_candidates(judged) + weighed, identified.fitted, rest, curves,
            recording_to_tell_rivals(final, judged), notes,
            _extended(stated, final, kept), plot_data, kept,
            audit.audited(system, base_fit, times, order, kinds, hum),
        )  # fmt: skip
    if ended_early_by():
        found.notes.append("interrupted: the best answer so far")
    elif limit.ended_at and (by_default or time_limit is not None):
        spent = f"{settings.processor_seconds:g} s of processor time" if by_default else f"{time_limit:g} s"
        found.notes.append(f"cut short after {spent}: the best answer so far")
    return found


def _base_fit(system: System, train: FitData, recordings: Sequence[Recording], settings: DiagnosisSettings) -> Fit:
    """The fit of a system as given. Where it is far off, a speed or an angle without a unit may be in another one than
    taken, or two columns may be exchanged: an InputError then says which."""
    try:
        fit = fit_base(system, train, settings)
    except FitError as reason:
        for recording in recordings:
            check_speed_units(system, recording)
            check_exchanged(system, recording)
        source, wrong = recordings[0].source, f"the model cannot be fitted to it: {reason}"
        raise InputError(source, wrong, "check units and signs of the channels, and the values of the model") from None
    readings = np.concatenate([segment.readings for segment in train.segments])
    spread = [float(np.std(values[np.isfinite(values)])) if np.isfinite(values).any() else 0.0 for values in readings.T]
    if (rms_errors(fit) * train.noise > FAR_OFF * np.array(spread)).any():
        for recording in recordings:
            check_speed_units(system, recording)
            check_exchanged(system, recording)
    return fit


def _without(identified: IdentifiedCauses, index: int) -> IdentifiedCauses:
    """The same without one of the causes of its best hypothesis, which is fitted without it."""
    state = identified.state
    rest = best_without(state, index)
    state.best = final_fit(rest) if rest.causes else rest
    del state.rivals[index : index + 1]
    rated = [each for number, each in enumerate(identified.rated) if number != index]
    return replace(identified, rated=rated)


def _mended(system: System, data: FitData, base: Fit, order: list[int], hum: list[audit.Hum]) -> FitData:
    """Data with exchanged channels where they belong, and without hum."""
    return audit.without_hum(system, audit.reordered(data, order), base, hum)


def _mended_holdout(judge: Holdout, whole: FitData, mended: Callable[[FitData], FitData]) -> Holdout:
    """Held-out data of mended data."""
    return (
        RestOfRecordings(whole, judge.counts)
        if isinstance(judge, RestOfRecordings)
        else OtherRecordings(mended(judge.data))
    )


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


def _verdict(final: Hypothesis, judge: Holdout, after_holdout: np.ndarray, rounding: np.ndarray | None = None) -> str:
    """``adequate``, ``explained`` or ``unexplained``; errors (y,) on held-out data in times the noise.

    A model without causes may drift away on held-out data as far as its quantities are uncertain. What the resolution
    of the inputs adds (y, l) is no error of it.
    """
    if not at_noise(final):
        return "unexplained"
    if not final.causes:
        predicted = prediction(final.fit, judge.simulate(final.fit))
        after_holdout = rms_by_sensor(predicted.updated) if predicted else after_holdout
    added = 0.0 if rounding is None else np.maximum(rounding[:, 0], 0.0)
    met = np.nanmax(after_holdout**2 - added, initial=0.0) <= EXPLAINED_HOLDOUT_RATIO**2
    return "unexplained" if not met else "explained" if final.causes else "adequate"


def best_without(state: SearchState, index: int) -> Hypothesis:
    """The best hypothesis without one of its causes; the base model where the others alone do not simulate."""
    return (without(state.best, index) if len(state.best.causes) > 1 else None) or state.base


def _judged_causes(identified: IdentifiedCauses, final: Hypothesis, unseen: UnseenData | None) -> list[JudgedCause]:
    """Every cause of the best hypothesis with its rivals, the best hypothesis without it, and what it explains of
    unseen data; None: all is explained."""
    state, judged = identified.state, []
    known = KnownScreening(state.screening, state.screened)
    for place, (cause, ratings) in enumerate(zip(state.best.causes, identified.rated, strict=True)):
        rest = best_without(state, place)
        part = 1.0 if unseen is None else unseen.share_explained(final, rest)
        judged.append(JudgedCause(cause, ratings, rest, known, part))
    return judged


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
