"""The diagnosis: recordings → audit → base fit → causes → verdict → extended model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from threadpoolctl import threadpool_limits

from matching.diagnosis import audit, inputs
from matching.diagnosis.base import fit_base
from matching.diagnosis.causes import extended_system, simulated_motion
from matching.diagnosis.closed_loop import closed_loop_notes
from matching.diagnosis.data import FitData, prepare_data
from matching.diagnosis.descent import Fit, balanced_fit, solve
from matching.diagnosis.holdout import (
    Holdout,
    HoldoutData,
    ModelResiduals,
    fidelity,
    holdout_data,
    holdout_residuals,
    parameters_by_recording,
    rms_by_sensor,
)
from matching.diagnosis.hypotheses import (
    Hypothesis,
    at_noise,
    equivalent_fits,
    final_fit,
    final_fit_on,
    largest_error,
    rms_errors,
    scatters_only,
)
from matching.diagnosis.loggers import with_clocks
from matching.diagnosis.moves import Progress, Search, Selection, Suspected, search_window, without
from matching.diagnosis.problem import base_problem
from matching.diagnosis.result import (
    BEST_SO_FAR,
    Candidate,
    Diagnosis,
    FittedCandidate,
    KeptTable,
    KnownScreening,
    NamedCause,
    Pictured,
    PlotData,
    correlations,
    discrepancy_curves,
    errors_by_sensor,
    fitted_values,
    kept_table,
    pooled_errors,
    remaining_errors,
    residual_once,
    scatter_notes,
)
from matching.diagnosis.screening import Screening
from matching.diagnosis.settings import DiagnosisSettings
from matching.diagnosis.simulation import compile_models
from matching.diagnosis.statistics import adapted, shares_of_ranges
from matching.diagnosis.times import Times, channel_times
from matching.diagnosis.unseen import UnseenData, blocks_for, recordings_of, unseen_errors
from matching.diagnosis.verdict import (
    JudgedCause,
    RatedCause,
    fitted_candidates,
    named_causes,
    rate_rivals,
    recording_to_tell_rivals,
    refitted_candidates,
)
from modelling.effects.effect import members
from modelling.errors import FitError, InputError
from modelling.recordings.recording import Recording
from modelling.resources import ended_early_by, ends_early, is_limited, limited, time_is_over
from modelling.simulation.simulate import check_exchanged, check_speed_units
from modelling.system import System

# --- From a base fit to causes with their rivals; of long data by way of a time window.


@dataclass(frozen=True)
class IdentifiedCauses:
    """What was selected, for each cause its rivals, itself included, and all fitted candidates."""

    selected: Selection
    rated: list[list[RatedCause]]
    fitted: list[FittedCandidate]


def search_causes(
    system: System,
    base: Fit,
    unseen: UnseenData,
    progress: Progress,
    suspected: Sequence[Suspected] = (),
    only_at: str = "",
) -> Found:
    """The causes that a base fit lacks.

    Weights by noise are right for a model that can be perfect. Where a model is far from that, most of its error is
    what some torque has done long before, and only weights by what the model leaves show which torque that is: they
    come first then, else where the best answer is far from the noise. Of two answers that by noise is finished if it
    comes near the noise, else that which meets unseen data better.
    """
    settings = unseen.settings
    far = largest_error(base) > settings.far_from_noise

    def near_noise(best: Hypothesis) -> bool:
        """Whether weights by noise are the right ones."""
        return scatters_only(best) or largest_error(best.fit) < settings.left_by_model

    found: Found | None = None
    for by_noise in (not far, far):
        if found and not far and near_noise(found.best):
            break
        if found and time_is_over(settings.search_share):
            break
        begin, judge = base, unseen
        if not by_noise:
            progress("sensors weighted by what the model leaves")
            begin = balanced_fit(base, base_problem(system, base.problem.data)[1])
            if not far:
                judge = UnseenData(unseen.blocks, replace(settings, far_from_noise=settings.left_by_model))
        other = _searched(system, begin, judge, progress, suspected, only_at)
        right = by_noise and near_noise(other.best)
        found = other if found is None or right or unseen.prefers(other.best, found.best) else found
    assert found is not None
    return found


@dataclass(frozen=True)
class Found:
    """A search, and the best of what it found, fitted to all data; of long data the search is of a time window."""

    search: Search
    best: Hypothesis
    base: Fit  # to all data


def _searched(
    system: System, base: Fit, unseen: UnseenData, progress: Progress, suspected: Sequence[Suspected], only_at: str
) -> Found:
    """Causes, sensors weighted as in the base fit.

    Of long data, they are searched for in the time window where the base model is worst, then fitted to all data. If
    the residual of all data is not noise though that of the window is, they are searched for in all data.
    """
    settings = unseen.settings
    window = search_window(base, settings.window)
    if window is not None:
        progress(f"a time window of {sum(np.ptp(segment.time) for segment in window.segments):.3g} s")
        problem, v = base_problem(system, window)
        part = solve(replace(problem, weighting=base.problem.weighting), v)
        search = Search(system, part, UnseenData(blocks_for(part, settings), settings), progress, suspected, only_at)
        search.run()
        progress("all data")
        best = final_fit_on(search.state.best, base)
        if at_noise(best) or not at_noise(search.state.best) or time_is_over(settings.search_share):
            return Found(search, best, base)
    search = Search(system, base, unseen, progress, suspected, only_at)
    search.run()
    return Found(search, search.state.best, base)


def with_rivals(found: Found, progress: Progress) -> IdentifiedCauses:
    """What a search found, fitted to its end, and for each cause its rivals, itself included, all on all data."""
    selected, unseen = found.search.finish(), found.search.unseen
    rated = [rate_rivals(selected, index, unseen) for index in range(len(selected.best.causes))]
    identified = IdentifiedCauses(selected, rated, fitted_candidates(selected, unseen))
    if selected.base.fit.problem.data is not found.base.problem.data:  # of a time window
        progress("all data")
        same = selected.best.places == found.best.places
        selected.best = found.best if same else final_fit_on(selected.best, found.base)
        selected.base, selected.screened = replace(selected.base, fit=found.base), []
        selected.screening = Screening(found.base)
    return identified


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
        Not fitted. It decides last which causes the extended model has, and measures the answer. Without it blocks of
        the recordings measure, each predicted by a fit to the others.
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
    seconds = settings.processor_seconds if by_default else time_limit
    with (
        ends_early(),
        limited(None if seconds is None else (1 - settings.reserved) * seconds, of_processor=by_default) as limit,
    ):
        measuring = [holdout] if isinstance(holdout, Recording) else list(holdout or [])
        stated, system = system, with_clocks(system, [*recordings, *measuring])
        data, other, notes = _data(system, recordings, measuring)
        progress("base model")
        compile_models([system])
        base_fit = _base_fit(system, data, [*recordings, *measuring], settings)
        order, base_fit = audit.with_channels_of(system, base_fit, data, settings)
        hum = audit.find_hum(system, base_fit)
        data, other = (_mended(system, each, base_fit, order, hum) for each in (data, other))
        if hum:
            base_fit = fit_base(system, data, settings, base_fit)
        notes += audit.notes_on(system, order, hum)
        straight = (inputs.STRAIGHT,) * len(system.inputs)
        kinds, base_fit = inputs.likeliest(system, data, base_fit, straight)
        recorded = inputs.with_rounding(data, base_fit)
        if kinds != straight or recorded.rounding is not None:
            base_fit = fit_base(system, inputs.as_taken(recorded, kinds), settings, base_fit)

        def searched(fit: Fit) -> tuple[Times, UnseenData, Found]:
            times = channel_times(system, fit)
            judge = UnseenData(blocks_for(fit, settings), settings)
            return times, judge, search_causes(system, fit, judge, progress, audit.time_hypotheses(system, fit, times))

        times, unseen, found = searched(base_fit)
        if found.best.causes and not (at_noise(found.best) and kinds != straight) and not time_is_over():
            progress("inputs between samples")
            others, _ = inputs.likeliest(system, recorded, final_fit(found.best).fit, kinds)
            if others != kinds:
                kinds = others
                base_fit = fit_base(system, inputs.as_taken(recorded, kinds), settings, base_fit)
                times, unseen, found = searched(base_fit)
        held = inputs.held_for_delay(system, found.best, kinds)
        if held != kinds and not time_is_over():
            progress("inputs held in place of a delay")
            other_base = fit_base(system, inputs.as_taken(recorded, held), settings, base_fit)
            with_held = searched(other_base)
            if with_held[-1].best.cost < found.best.cost:
                kinds, base_fit, (times, unseen, found) = held, other_base, with_held
        wrong, fault_there = "", None
        if not (at_noise(found.best) or time_is_over()):
            wrong, fault_there = audit.wrong_channel(system, base_fit, settings)
        if wrong:
            progress(f"{wrong} alone")
            found = search_causes(system, base_fit, unseen, progress, (), f"sensors.{wrong}")
            notes.append(
                f"without {wrong} the model leaves noise alone in all other channels: the error is in that channel; "
                + (fault_there.advice if fault_there else "look at its samples over those simulated")
            )
        data = base_fit.problem.data
        identified = with_rivals(found, progress)
        best = identified.selected.best
        notes += inputs.note_on(system, kinds)
        judge = Holdout(inputs.as_taken(other, kinds)) if other.segments else None
        second = SecondRecording(judge, data, settings)
        weak, weighed = list[NamedCause](), list[Candidate]()
        while True:
            selected, fits = identified.selected, equivalent_fits(best.fit, best.causes)
            base, final = selected.base, replace(best, fit=fits[0])
            left = [_left(base, judge, unseen)]
            left.append(left[0] if final.fit is base.fit else _left(final, judge, unseen))
            before, after = (rms_by_sensor(list(of.residuals)) for of in left)
            verdict = _verdict(final, judge, after, data.rounding)
            values = fitted_values(final, fits)
            judged = _judged_causes(identified, final, unseen, second, verdict == "explained")
            named = named_causes(system, final, values, judged, unseen)
            doubtful = [index for index, cause in enumerate(named) if not cause.in_model]
            if not doubtful and named and second.ratio(final, base) > 1 + settings.harms:
                doubtful = list(range(len(named)))  # each helps beside the others, all together harm
            why = "second_recording"
            unsure = [index for index, cause in enumerate(named) if cause.confidence < settings.named]
            if keep_rest and not doubtful and unsure and _table_is_better(identified, unsure, final, unseen):
                doubtful, why = unsure, "table"
            if not doubtful:
                break
            least = min(doubtful, key=lambda index: (named[index].in_model, named[index].confidence))
            weak.append(replace(named[least], in_model=False, why_not=named[least].why_not or why))
            weighed += refitted_candidates([judged[least]])
            identified = _without(identified, least)
            best = identified.selected.best
        places = {place for at in (*(c.at for c in final.causes), *(c.at for c in weak)) for place in members(at)}
        notes += audit.notes_on_times(system, times, places)
        notes += closed_loop_notes(final, recordings) + scatter_notes(final)
        if judge is not None and any(cause.why_not == "second_recording" for cause in weak):
            notes.append(
                "the hold-out recording decided which causes the extended model has, so it no longer measures the "
                "errors independently; another recording would"
            )
        rest = remaining_errors(final)
        if verdict == "unexplained" and not final.causes and at_noise(final):
            notes.append(
                "the fitted data are reproduced to their noise, held-out data are not: something happens in those"
            )
        held_out = holdout_data(data.noise, *left)
        curves = discrepancy_curves(final) if rest else []
        errors = errors_by_sensor(system, base, final, before, after)
        pictured(Pictured(errors, curves, plot_data := _plot_data(selected, final, held_out)))
        kept = kept_table(final, curves, unseen) if keep_rest else None
        diagnosis = Diagnosis(
            verdict, [*sorted(named, key=lambda cause: -cause.gain), *reversed(weak)],
            {name: value for name, value in values.items() if name in system.uncertain}, system.units,
            errors, pooled_errors(data, before, after), fidelity(system, held_out),
            refitted_candidates(judged) + weighed, identified.fitted, rest, curves,
            recording_to_tell_rivals(final, judged), notes,
            _extended(stated, final, kept), plot_data, kept,
            audit.audited(system, base_fit, times, order, kinds, hum),
            second.kind, correlations(final.fit), tuple(recording.source for recording in recordings),
        )  # fmt: skip
    if ended_early_by():
        diagnosis.notes.append(f"interrupted: {BEST_SO_FAR}")
    elif limit.ended_at and seconds is not None:
        spent = f"{seconds:g} s{' of processor time' if by_default else ''}"
        diagnosis.notes.append(f"cut short after {spent}: {BEST_SO_FAR}")
    return diagnosis


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
    """The same without one of the causes of its best hypothesis, which is fitted without it: what is not sure of its
    kind stays out of the answer and of the extended model."""
    selected = identified.selected
    rest = best_without(selected, index)
    best = final_fit(rest) if rest.causes else rest
    rated = [each for number, each in enumerate(identified.rated) if number != index]
    return replace(identified, selected=replace(selected, best=best), rated=rated)


def _mended(system: System, data: FitData, base: Fit, order: list[int], hum: list[audit.Hum]) -> FitData:
    """Data with exchanged channels where they belong, and without hum."""
    return audit.without_hum(system, audit.reordered(data, order), base, hum)


def _left(hypothesis: Hypothesis, judge: Holdout | None, unseen: UnseenData) -> ModelResiduals:
    """What a hypothesis leaves of the hold-out recordings where there are any, else of every block by a fit to the
    others; windows of a fit share their last sample with the next, which counts once."""
    if judge is not None:
        return ModelResiduals(judge.data.segments, holdout_residuals(judge.simulate(hypothesis.fit)))
    segments, residuals = list(hypothesis.fit.problem.data.segments), unseen_errors(hypothesis.fit, unseen.blocks)
    for i, (segment, following) in enumerate(pairwise(segments)):
        if following.name == segment.name and following.time[0] == segment.time[-1]:
            count = len(segment.time) - 1
            segments[i], residuals[i] = segment.part(0, count), residuals[i][:count]
    return ModelResiduals(segments, residuals)


def _extended(stated: System, final: Hypothesis, kept: KeptTable | None) -> System:
    """The stated system with the causes, and with a table of what they leave where one is kept."""
    if kept is None:
        return extended_system(stated, final.causes, final.fit.values)
    return extended_system(stated.with_effects(kept.effect), final.causes, kept.values)


def _data(
    system: System, recordings: Sequence[Recording], measuring: Sequence[Recording]
) -> tuple[FitData, FitData, list[str]]:
    """Data to fit, data of hold-out recordings, and notes."""
    data, remarks = prepare_data(system, recordings)
    notes = [note for recording in recordings for note in recording.notes] + remarks + system.doubts
    if not measuring:
        return data, replace(data, segments=()), notes
    other, remarks = prepare_data(system, measuring)
    notes += [
        f"hold-out: {note}" for note in (*(note for recording in measuring for note in recording.notes), *remarks)
    ]
    return data, replace(data, segments=other.segments), notes


def _verdict(
    final: Hypothesis, judge: Holdout | None, after_holdout: np.ndarray, rounding: np.ndarray | None = None
) -> str:
    """``adequate``, ``explained`` or ``unexplained``; errors (y,) on unseen data in times the noise.

    A model without causes may drift away on a hold-out recording as far as its quantities are uncertain. What the
    resolution of the inputs adds (y, l) is no error of it.
    """
    if not at_noise(final):
        return "unexplained"
    said = "explained" if final.causes else "adequate"
    if judge is None:  # all is fitted, and every block is noise
        return said
    if not final.causes:
        left = adapted(final.fit, judge.simulate(final.fit))
        after_holdout = rms_by_sensor(left) if left else after_holdout
    added = 0.0 if rounding is None else np.maximum(rounding[:, 0], 0.0)
    met = np.nanmax(after_holdout**2 - added, initial=0.0) <= EXPLAINED_HOLDOUT_RATIO**2
    return said if met else "unexplained"


def best_without(selected: Selection, index: int) -> Hypothesis:
    """The best hypothesis without one of its causes; the base model where the others alone do not simulate."""
    return (without(selected.best, index) if len(selected.best.causes) > 1 else None) or selected.base


class SecondRecording:
    """What a recording says of a model that was not fitted to it: the hold-out, else each of several fitted recordings,
    by a fit to the others; nothing where there is one recording.

    Attributes
    ----------
    kind : str
        ``holdout``, ``recordings`` or ``blocks``.
    """

    def __init__(self, holdout: Holdout | None, data: FitData, settings: DiagnosisSettings):
        self.holdout, self._known = holdout, dict[int, tuple[Fit, float]]()
        recordings = recordings_of(data)
        self._others = UnseenData(recordings, settings)
        several = "recordings" if recordings.count > 1 else "blocks"
        self.kind = several if holdout is None else "holdout"

    def error(self, hypothesis: Hypothesis) -> float:
        """Root mean square over the sensors of the error over the sensor's range; NaN without a second recording, or
        where a parameter of the model holds in one recording alone."""
        fit = hypothesis.fit
        if id(fit) not in self._known:
            self._known[id(fit)] = fit, self._error(hypothesis)
        return self._known[id(fit)][1]

    def _error(self, hypothesis: Hypothesis) -> float:
        fit = hypothesis.fit
        if self.holdout is not None:
            readings = np.concatenate([segment.readings for segment in self.holdout.data.segments])
            errors = np.concatenate(holdout_residuals(self.holdout.simulate(fit)))
            shares = shares_of_ranges(errors, readings, self.holdout.data.noise)
            return float(np.sqrt(np.nanmean(shares**2))) if np.isfinite(shares).any() else np.nan
        if self.kind == "blocks" or parameters_by_recording(fit.problem.system):
            return np.nan
        return self._others.pooled(hypothesis)

    def ratio(self, hypothesis: Hypothesis, other: Hypothesis) -> float:
        """Error of a hypothesis over that of another; NaN where it is not known."""
        before = self.error(other)
        return self.error(hypothesis) / before if before > 0 else np.nan


def _table_is_better(
    identified: IdentifiedCauses, unsure: Sequence[int], final: Hypothesis, unseen: UnseenData
) -> bool:
    """Whether a table of the remaining torque in the place of causes whose kind is open meets unseen data better."""
    for index in reversed(unsure):
        identified = _without(identified, index)
    bare = identified.selected.best
    kept = kept_table(bare, discrepancy_curves(bare), unseen)
    return kept is not None and kept.nrmse_after < unseen.pooled(final)


def _judged_causes(
    identified: IdentifiedCauses, final: Hypothesis, unseen: UnseenData, second: SecondRecording, explained: bool
) -> list[JudgedCause]:
    """Every cause of the best hypothesis with its rivals, the best hypothesis without it, and what it explains of
    unseen data and of a second recording; ``explained``: of the misfit nothing is left."""
    selected, judged = identified.selected, []
    known = KnownScreening(selected.screening, selected.screened)
    for place, (cause, ratings) in enumerate(zip(selected.best.causes, identified.rated, strict=True)):
        rest = best_without(selected, place)
        part = 1.0 if explained else float(np.clip(unseen.shares_explained(final, rest).max(), 0.0, 1.0))
        judged.append(JudgedCause(cause, ratings, rest, known, part, second.ratio(final, rest)))
    return judged


def _plot_data(selected: Selection, final: Hypothesis, unseen: HoldoutData) -> PlotData:
    data, balance, system = selected.base.fit.problem.data, selected.screening.balance, selected.base.model.base
    measured = np.concatenate([segment.readings for segment in data.segments])
    before, after = (
        np.where(np.isfinite(measured), residual_once(hypothesis) * data.noise, np.nan)
        for hypothesis in (selected.base, final)
    )
    return PlotData(
        simulated_motion(selected.base.fit), simulated_motion(final.fit), measured, before, after,
        {part.name: balance.inertias[:, i] for i, part in enumerate(system.inertias)},
        {part.name: balance.shafts[:, i] for i, part in enumerate(system.shafts)},
        [sensor.name for sensor in system.sensors], data.noise, unseen,
    )  # fmt: skip
