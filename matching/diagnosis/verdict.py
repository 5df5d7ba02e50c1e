"""What a search has found, judged on held-out data: confidence, values, evidence, and what to record next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import erf

from matching.diagnosis.causes import Cause
from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import (
    FINAL_STEPS,
    Fit,
    FitOptions,
    discrepancy,
    polished,
    reweighted,
    with_sharper_friction,
)
from matching.diagnosis.holdout import Holdout, holdout_residuals
from matching.diagnosis.latent import free_force
from matching.diagnosis.result import (
    Alternative,
    Candidate,
    CauseParameter,
    FittedCandidate,
    KnownScreening,
    NamedCause,
    not_told_apart,
)
from matching.diagnosis.screening import Screening, fit_extended
from matching.diagnosis.search import SearchState
from matching.diagnosis.selection import Hypothesis, UnseenData, UnseenError, at_noise, with_sharpest_friction
from matching.diagnosis.simulation import simulate_readings
from matching.diagnosis.statistics import (
    Estimate,
    Prediction,
    effective_share,
    estimates,
    prediction,
    residual_inflation,
)
from modelling.effects import EFFECTS
from modelling.effects.effect import SHARED, place_in_words
from modelling.errors import FitError
from modelling.resources import time_is_over
from modelling.system import System

# --- The final fit of a hypothesis: finer integration steps, sharper friction, exact derivatives.

ITERATIONS = 12
FINER = 2.0  # times as many integration steps as in a search
WORSE_SHARE, WORSE = 0.01, 10.0  # of χ², and χ²: what finer steps may add; more, and they ended elsewhere


def final_fit(hypothesis: Hypothesis) -> Hypothesis:
    """A hypothesis fitted with steps half as long, ending on a Jacobian of its own point, if that is no worse."""
    if time_is_over():
        return hypothesis
    if not hypothesis.causes:
        return replace(hypothesis, fit=polished(hypothesis.fit))
    model = replace(hypothesis.at_fit(), starts=tuple(hypothesis.fit.starts))
    try:
        fit = fit_extended(model, hypothesis.fit, FitOptions(ITERATIONS), FINER)
        fit = polished(with_sharper_friction(fit, FINAL_STEPS))
    except FitError:
        return hypothesis
    finer = with_sharpest_friction(replace(hypothesis, fit=fit))
    return finer if finer.fit.cost < (1 + WORSE_SHARE) * hypothesis.fit.cost + WORSE else hypothesis


def final_fit_on(hypothesis: Hypothesis, base: Fit) -> Hypothesis:
    """A hypothesis of a part of the data fitted to all that a base fit has."""
    model = hypothesis.at_fit()
    fit = fit_extended(model, base, FitOptions()) if hypothesis.causes else base
    return final_fit(Hypothesis(model, fit))


# --- The confidence in a cause: its share of the evidence among its rivals; where more than noise is left, times the
# share of the misfit on unseen data that it explains, since the rest may be of something that the vocabulary lacks.
#
# Evidence of a hypothesis is −½ of χ² + (variables)·ln(readings) on the fitted data (Schwarz 1978) and of the score of
# its prediction of held-out data (:mod:`matching.diagnosis.statistics`). χ² is first divided by how much larger
# than noise the best residual is and by the share of independent samples in it: a model that is not perfect must not
# count its error as if it were noise, thousands of times over.

MOST_RIVALS = 4  # that are fitted as finely as the best
OUT_OF_QUESTION = 60.0  # difference of χ², over its inflation: a share of the evidence below 1e-13
NOT_SIMULATED = 1e30  # χ² of what does not simulate


@dataclass(frozen=True)
class RatedCause:
    """A cause, or a rival in its place, with its share of the evidence."""

    kind: str
    at: str
    share: float
    hypothesis: Hypothesis


def rate_rivals(state: SearchState, index: int, unseen: UnseenData) -> list[RatedCause]:
    """A cause of the best hypothesis and its rivals with their shares of the evidence, largest first.

    Rivals near a best fit at the noise are refitted as finely as it. A rival with more evidence replaces a cause where
    it is possible and meets unseen data better than the base model.
    """
    best, cause = state.best, state.best.causes[index]
    others = [_weighted_as(best, rival) for rival in _rivals(state, index)]
    inflation = chi_square_inflation(best)
    scores = fitted_scores([best, *others], inflation)
    near = [rival for rival, s in zip(others, scores[1:], strict=True) if s - scores[0] < OUT_OF_QUESTION][:MOST_RIVALS]
    hypotheses = [best, *([final_fit(rival) for rival in near] if at_noise(best) else near)]
    names = [(cause.kind, cause.at)] + [
        (hypothesis.causes[-1].kind, hypothesis.causes[-1].at) for hypothesis in hypotheses[1:]
    ]
    shares = evidence_shares(_scores(hypotheses, unseen.holdout, inflation)) if near else np.ones(1)
    rated = [
        RatedCause(*name, float(p), hypothesis) for name, p, hypothesis in zip(names, shares, hypotheses, strict=True)
    ]
    rated += [
        RatedCause(rival.causes[-1].kind, rival.causes[-1].at, 0.0, rival) for rival in others if rival not in near
    ]
    rated.sort(key=lambda rating: -rating.share)
    leading = next(
        rating.hypothesis
        for rating in rated
        if rating.hypothesis is best
        or (not rating.hypothesis.model.not_taken(rating.hypothesis.fit)
            and unseen.keeps(rating.hypothesis, state.base, by_sensor=False))
    )  # fmt: skip
    if leading is not best:
        state.best = _in_place(leading, index)
    return rated


def _rivals(state: SearchState, index: int) -> list[Hypothesis]:
    """Hypotheses with another cause in the place of one of the best's, beside the others of it."""
    best, cause = state.best, state.best.causes[index]
    beside = best.places - {(cause.kind, cause.at)}
    rivals = state.rivals[index] if index < len(state.rivals) else []
    return [
        rival
        for rival in rivals
        if rival.places != best.places and beside < rival.places and len(rival.causes) == len(best.causes)
    ]


def _scores(hypotheses: list[Hypothesis], holdout: Holdout, inflation: float) -> np.ndarray:
    """(h,) −2 ln of the evidence of several hypotheses, but for a constant."""
    predictions = [_predicted(hypothesis, holdout, inflation) for hypothesis in hypotheses]
    variance = min((residual_inflation(prediction.updated) for prediction in predictions if prediction), default=1.0)
    unseen = [prediction.score(variance) if prediction else NOT_SIMULATED for prediction in predictions]
    return fitted_scores(hypotheses, inflation) + np.array(unseen)


def fitted_scores(hypotheses: Sequence[Hypothesis], inflation: float) -> np.ndarray:
    """(h,) −2 ln of the evidence of fitted data, but for a constant, the first hypothesis being the best.

    Where sensors are weighted by what the model leaves of them, memory and scale are estimated: n·ln of the
    squared innovation of each, n the number of independent samples in what the best leaves.
    """
    best = hypotheses[0]
    if best.fit.problem.weighting is None:
        return np.array([hypothesis.cost / inflation for hypothesis in hypotheses])
    segments, residuals = best.fit.problem.data.segments, best.fit.by_sensor()
    count = np.array([
        sum(
            effective_share(r[s.measured[:, j], j]) * s.measured[:, j].sum()
            for s, r in zip(segments, residuals, strict=True) if s.measured[:, j].any()
        )
        for j in range(len(best.fit.problem.data.noise))
    ])  # fmt: skip
    logarithms = [np.log(discrepancy(hypothesis.fit).scale ** 2) for hypothesis in hypotheses]
    price = [len(hypothesis.fit.v) * np.log(max(count.sum(), 2.0)) for hypothesis in hypotheses]
    return np.array(
        [float(count @ part) + parameters_price for part, parameters_price in zip(logarithms, price, strict=True)]
    )


def _weighted_as(best: Hypothesis, other: Hypothesis) -> Hypothesis:
    """A hypothesis with its sensors weighted as those of the best."""
    weighting = best.fit.problem.weighting
    same = other.fit.problem.weighting is weighting
    return other if same else replace(other, fit=reweighted(other.fit, weighting))


def evidence_shares(scores: np.ndarray) -> np.ndarray:
    """Shares (h,) of the evidence, which add to 1, from −2 ln of each (h,)."""
    evidence = np.exp(-0.5 * (scores - scores.min()))
    return evidence / evidence.sum()


def _in_place(hypothesis: Hypothesis, index: int) -> Hypothesis:
    """The same with its last cause at a place among the others."""
    *rest, last = hypothesis.causes
    causes = (*rest[:index], last, *rest[index:])
    return replace(hypothesis, model=replace(hypothesis.model, causes=causes))


def _predicted(hypothesis: Hypothesis, holdout: Holdout, factor: float) -> Prediction | None:
    """What a hypothesis predicts of held-out data; None where it does not simulate."""
    try:
        return prediction(hypothesis.fit, holdout.simulate(hypothesis.fit), factor)
    except FitError:
        return None


def chi_square_inflation(hypothesis: Hypothesis) -> float:
    """By how much the χ² of a hypothesis overstates what it knows, see :func:`residual_inflation`."""
    segments, residuals = hypothesis.fit.problem.data.segments, hypothesis.fit.by_sensor()
    return residual_inflation([np.where(s.measured, r, np.nan) for s, r in zip(segments, residuals, strict=True)])


# --- Every candidate that was fitted alone, with its misfit and why it was not taken.


def fitted_candidates(state: SearchState, holdout: Holdout) -> list[FittedCandidate]:
    """The candidates that were added to the base model by themselves, best first, and the causes of the best
    hypothesis among them as taken; then those that have no fit."""
    base_holdout = holdout_misfit(state.base, holdout)
    out = []
    for hypothesis in state.with_one_cause:
        (cause,) = hypothesis.causes
        misfit_holdout = holdout_misfit(hypothesis, holdout)
        taken = (cause.kind, cause.at) in state.best.places
        reason = "" if taken else _reason(state, hypothesis, misfit_holdout, base_holdout)
        out.append(
            FittedCandidate(cause.kind, cause.at, hypothesis.misfit, misfit_holdout, hypothesis.chi_square, reason)
        )
    fitted = {(one.kind, one.at) for one in out}
    for (kind, at), why in state.failed.items():
        if (kind, at) not in fitted:
            out.append(FittedCandidate(kind, at, np.nan, np.nan, np.nan, "no_fit", why))
    return out


def holdout_misfit(hypothesis: Hypothesis, holdout: Holdout) -> float:
    """Root mean square of all residuals on held-out data, in times the noise; infinite where it does not simulate."""
    try:
        residuals = holdout_residuals(holdout.simulate(hypothesis.fit))
    except FitError:
        return np.inf
    values = np.concatenate([part.ravel() for part in residuals]) if residuals else np.empty(0)
    values = values[~np.isnan(values)]
    with np.errstate(over="ignore"):
        return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


def _reason(state: SearchState, hypothesis: Hypothesis, misfit_holdout: float, base_holdout: float) -> str:
    """Why a candidate was not taken, in the words of ``diagnosis.json``."""
    least = state.noise_threshold * hypothesis.chi_square_per_reading
    if hypothesis.chi_square > state.base.chi_square - least or hypothesis.model.negligible(hypothesis.fit):
        return "not_better"
    impossible = hypothesis.model.not_taken(hypothesis.fit)
    if impossible:
        return impossible
    if misfit_holdout > base_holdout:
        return "worse_unseen"
    (cause,) = hypothesis.causes
    notes = estimates(hypothesis.fit)
    if any(notes[name].note.startswith("at the bound") for name in cause.names().values()):
        return "at_bound"
    return "rival" if state.best.causes else "not_better"  # without a cause there is none that it rivals


# --- What to record to tell rivals apart: both are simulated over several manoeuvres.

DURATION = 8.0  # s
STEP_TIME = 0.5  # s
STEPS_PER_RUN = 4.0  # periods of the alternating steps
SLOW_HZ, SWEEP_HZ = 0.5, (0.5, 30.0)  # the band of drivability
FACTORS = (1.0, 0.5, 0.25, 0.1)  # of the largest recorded torque: a bed is only known to bear what was recorded
BEYOND_RECORDED = 1.05  # of the largest reading; a manoeuvre that drives a sensor further is not proposed
CLEARLY_BETTER = 1.2  # times the separation for a later manoeuvre to be preferred


@dataclass(frozen=True)
class ProposedManoeuvre:
    """One input's waveform, and by how much two rivals then differ.

    Attributes
    ----------
    input, waveform : str
    amplitude : float
        N·m.
    duration : float
        s.
    separation : float
        Root mean square of the difference, in times the noise of ``sensor``.
    sensor : str
    """

    input: str
    waveform: str
    amplitude: float
    duration: float
    separation: float
    sensor: str

    def sentence(self, cause: str, rival: str) -> str:
        """What to record, in words."""
        what = f"{self.waveform} of {self.amplitude:.3g} N·m on {self.input} for {self.duration:g} s"
        if self.separation < 1:
            return (
                f"no torque on the inputs tells {cause} from {rival}: at best {self.separation:.2g} times the noise "
                f"of {self.sensor} ({what}); measure a further shaft torque or speed next to them"
            )
        return (
            f"record {what}: {cause} and {rival} would differ by {self.separation:.3g} times the noise of {self.sensor}"
        )


def waveforms(time: np.ndarray) -> dict[str, np.ndarray]:
    """Shapes (t,) between −1 and 1 over time (t,), s, by name."""
    span = time[-1]
    low, high = SWEEP_HZ
    sweep = np.sin(2 * np.pi * (low * time + (high - low) * time**2 / (2 * span)))
    return {
        "a step": np.where(time > STEP_TIME, 1.0, 0.0),
        "steps to and fro": np.sign(np.sin(2 * np.pi * STEPS_PER_RUN * time / span + 1e-9)),
        f"a slow sine ({SLOW_HZ:g} Hz)": np.sin(2 * np.pi * SLOW_HZ * time),
        f"a sweep from {low:g} to {high:g} Hz": sweep,
        f"a sweep from {low:g} to {high:g} Hz about a constant torque": 0.5 + 0.5 * sweep,
    }


def propose_manoeuvre(hypothesis: Hypothesis, rival: Hypothesis) -> ProposedManoeuvre | None:
    """The manoeuvre in which two hypotheses differ most, from rest; None if nothing could be simulated.

    Simpler waveforms come first and are kept unless a later one is clearly better. Each has the largest amplitude that
    drives no speed, acceleration or shaft torque beyond what was recorded.
    """
    data, model = hypothesis.fit.problem.data, hypothesis.fit.problem.model
    time = data.sampling_interval * np.arange(round(DURATION / data.sampling_interval))
    largest = np.max([np.abs(segment.inputs).max(axis=0) for segment in data.segments], axis=0)
    recorded = _largest_readings(data, model.system)
    best: ProposedManoeuvre | None = None
    for i, name in enumerate(model.inputs):
        for waveform, shape in waveforms(time).items():
            for factor in FACTORS:
                amplitude = factor * float(largest[i])
                torque = np.zeros((len(time), len(model.inputs)))
                torque[:, i] = amplitude * shape
                readings = _readings(hypothesis, time, torque)
                difference = readings - _readings(rival, time, torque)
                separation = np.sqrt(np.mean((difference / data.noise) ** 2, axis=0))
                if not np.isfinite(separation).all() or np.any(np.abs(readings).max(axis=0) > recorded):
                    continue
                j = int(np.argmax(separation))
                if best is None or separation[j] > CLEARLY_BETTER * best.separation:
                    best = ProposedManoeuvre(
                        name, waveform, amplitude, DURATION, float(separation[j]), model.sensors[j]
                    )
                break
    return best


def _largest_readings(data: FitData, system: System) -> np.ndarray:
    """(y,) largest magnitudes that may be reached; infinite for angles, and for sensors that were not recorded."""
    readings = np.abs(np.concatenate([segment.readings for segment in data.segments]))
    largest = BEYOND_RECORDED * np.max(np.where(np.isfinite(readings), readings, 0.0), axis=0)
    free = [sensor.measures == "angle" for sensor in system.sensors]
    return np.where(free | (largest == 0), np.inf, largest)


def _readings(hypothesis: Hypothesis, time: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Readings (t, y), SI, of a hypothesis from rest."""
    problem = hypothesis.fit.problem
    p, _ = problem.unpack(hypothesis.fit.v)
    segment = Segment(time, inputs, np.full((len(time), len(problem.data.noise)), np.nan))
    start = np.zeros((1, len(problem.model.states)))
    return simulate_readings(problem.model, [segment], p[None], [start], problem.steps_per_second)[0][0]


# --- Named causes with values, confidence, evidence and rivals, and what to record to tell them apart.

WORTH_RECORDING = 0.02  # confidence of a rival from which a further recording is proposed
TOLD_FROM_NOTHING = 0.95  # probability that a torque acts, from which a further cause is kept
RISES = 1.05  # ratio of errors from which one is said to rise
SMALLEST_CONFIDENCE = 1e-4  # of a rival that is listed


@dataclass(frozen=True)
class JudgedCause:
    """A cause of the final hypothesis.

    Attributes
    ----------
    cause : Cause
    rated : list of RatedCause
        Itself and its rivals, with their shares of the evidence.
    without : Hypothesis
        The final hypothesis without it.
    known : KnownScreening or None
        The screening of what that leaves, where the search has made it.
    explained : float
        Share of the misfit on unseen data that it explains; 1 where all is explained.
    """

    cause: Cause
    rated: Sequence[RatedCause]
    without: Hypothesis
    known: KnownScreening | None
    explained: float

    @property
    def rivals(self) -> list[RatedCause]:
        """The most likely first."""
        return [rating for rating in self.rated if (rating.kind, rating.at) != (self.cause.kind, self.cause.at)]


def named_causes(
    system: System,
    final: Hypothesis,
    estimates: Mapping[str, Estimate],
    judged: Sequence[JudgedCause],
    unseen: UnseenData | None,
) -> list[NamedCause]:
    """The causes of the final hypothesis, in its order.

    Parameters
    ----------
    estimates : dict of str to Estimate
        Of all fitted parameters, by name.
    unseen : UnseenData or None
        None where the hypothesis explains all.
    """
    causes = []
    screening = Screening(final.fit) if unseen is not None and final.causes else None
    for judgement in judged:
        cause, rivals = judgement.cause, judgement.rivals
        rating = next(r for r in judgement.rated if (r.kind, r.at) == (cause.kind, cause.at))
        weighed = {(rival.kind, rival.at) for rival in rivals if rival.share > 0}
        alike = _all_alike(system, final, judgement)
        same = [name for name in alike if name not in weighed]
        parameters = cause_parameters(system, cause, estimates)
        share, place = rating.share, 1.0
        if unseen is not None and screening is not None:
            share, place = _chosen(judgement, rating, unseen)
            if judgement.explained < MOSTLY and _free_force_is_left(final, screening, cause.at):
                share = min(share, NOT_THE_KIND)
        certain = share * judgement.explained * acts(parameters) / (1 + len(same))
        whole = certain * (1 + len(same))  # of what no recording, or not this one, tells apart, any may stand
        alternatives = [Alternative(kind, at, certain) for kind, at in same]
        alternatives += [Alternative(r.kind, r.at, r.share * judgement.explained) for r in rivals]
        causes.append(
            NamedCause(
                cause.kind, cause.at, parameters, certain,
                _evidence(system, judgement.without, final, rivals[0].hypothesis if rivals else None)
                + _in_words(alike),
                [a for a in alternatives if a.confidence > SMALLEST_CONFIDENCE],
                judgement.without.chi_square / final.chi_square,
                max(place, whole),
                whole > LEAST_CONFIDENCE and (unseen is None or _beyond_its_uncertainty(system, cause, parameters)),
            )
        )  # fmt: skip
    return causes


# --- Confidence where more than noise is left. The evidence of a likelihood that no hypothesis fulfils decides by far
# too much between kinds that are all wrong. Unseen data are therefore drawn again, block by block, and a hypothesis
# counts as often as it predicts them best (bagged posteriors: Huggins and Miller, arXiv 2007.14845), the place as often
# as any with a cause there does. The kind counts no more than ``NOT_THE_KIND`` where a free force at its place predicts
# much of what it leaves (:mod:`matching.diagnosis.latent`).

LEAST_CONFIDENCE = 0.5  # of a kind, from which a cause stands in the answer and in the extended model
NOT_THE_KIND = 0.4  # most that is said of a kind that leaves a force at its own place
LEFT_SHARE = 0.3  # of the misfit beyond noise, from which a free force is more than a detail
MOSTLY = 0.95  # of the misfit on unseen data: a kind that explains so much is right, whatever is left beside it
ALIKE = 2e-3  # difference of ln of the mean squares, for each sensor, up to which predictions are equal
BEYOND = 2.0  # standard uncertainties by which a value differs from that of no effect


def _chosen(judgement: JudgedCause, rating: RatedCause, unseen: UnseenData) -> tuple[float, float]:
    """Confidence in kind and place: shares of the draws of unseen blocks, and no more of the kind than its evidence."""
    rivals = [r for r in judgement.rated if r is not rating]
    hypotheses = [rating.hypothesis, *(r.hypothesis for r in rivals), judgement.without]
    shares = drawn_shares([unseen.error(hypothesis) for hypothesis in hypotheses], unseen.settings.draws)
    there = [_component(r.at) == _component(rating.at) for r in rivals]
    return min(rating.share, float(shares[0])), float(shares[0] + shares[1:-1][there].sum())


def drawn_shares(errors: Sequence[UnseenError | None], draws: int) -> np.ndarray:
    """Share (h,) of the draws of unseen blocks in which each hypothesis predicts best; equal ones share a draw."""
    blocks = next((error.blocks for error in errors if error is not None), None)
    if blocks is None:
        return np.zeros(len(errors))
    chosen = np.random.default_rng(0).multinomial(len(blocks), np.full(len(blocks), 1 / len(blocks)), size=draws)
    scores = np.full((len(errors), draws), np.inf)
    for row, error in zip(scores, errors, strict=True):
        if error is not None and error.blocks.shape == blocks.shape:
            known = np.isfinite(error.blocks)
            square = (chosen @ np.where(known, error.blocks, 0.0)) / np.maximum(chosen @ known, 1.0)
            row[:] = np.log(np.maximum(square, 1.0)).sum(axis=1)
    best = scores <= scores.min(axis=0) + ALIKE * blocks.shape[1]
    return np.mean(best / best.sum(axis=0), axis=1)


def _component(at: str) -> str:
    """The component that a place is of: inertias.body of inertias.body.J."""
    return ".".join(at.split(".")[:2]) if SHARED not in at else at


def _free_force_is_left(final: Hypothesis, screening: Screening, at: str) -> bool:
    """Whether a free force at the place of a cause predicts much of what the cause leaves."""
    left, count = float(final.fit.residual @ final.fit.residual), final.fit.problem.data.readings_count
    noise = count if final.fit.problem.weighting is None else 0
    return free_force(final, screening, at).decrease > LEFT_SHARE * max(left - noise, 0.0)


def _beyond_its_uncertainty(system: System, cause: Cause, parameters: Mapping[str, CauseParameter]) -> bool:
    """Whether a parameter of a cause differs from that of no effect by more than its uncertainty."""
    for key, parameter in parameters.items():
        nothing = 1.0 if key.startswith("factor") else 0.0
        if cause.replaces_quantity:
            nothing = system.parameters[cause.at].value
        if abs(parameter.value - nothing) > BEYOND * parameter.standard_uncertainty:
            return True
    return False


def acts(parameters: Mapping[str, CauseParameter]) -> float:
    """Probability that one of the torques of a cause, if it has any, is not nothing: normal errors, two-sided."""
    torques = [parameter for parameter in parameters.values() if parameter.unit == "N*m"]
    if not torques:
        return 1.0
    return float(erf(max(abs(one.value) / max(one.standard_uncertainty, 1e-300) for one in torques) / np.sqrt(2)))


def recording_to_tell_rivals(final: Hypothesis, judged: Sequence[JudgedCause]) -> str | None:
    """What to record to tell the most likely rival from its cause; None where none is likely enough."""
    proposals: list[tuple[float, str]] = []
    for judgement in judged:
        for rival in judgement.rivals[:1]:
            likely = rival.share * judgement.explained
            manoeuvre = propose_manoeuvre(final, rival.hypothesis) if likely > WORTH_RECORDING else None
            if manoeuvre:
                names = (f"{named.kind} at {place_in_words(named.at)}" for named in (judgement.cause, rival))
                proposals.append((likely, manoeuvre.sentence(*names)))
    return max(proposals)[1] if proposals else None


def refitted_candidates(judged: Sequence[JudgedCause]) -> list[Candidate]:
    """What was refitted in the place of each cause."""
    out = []
    for judgement in judged:
        for rated in judgement.rated:
            misfit, chi_square = rated.hypothesis.misfit, rated.hypothesis.chi_square
            instead_of = f"{judgement.cause.kind} at {place_in_words(judgement.cause.at)}"
            out.append(Candidate(rated.kind, rated.at, instead_of, misfit, chi_square, rated.share))
    return out


def _all_alike(system: System, final: Hypothesis, judgement: JudgedCause) -> list[tuple[str, str]]:
    """What no recording tells from a cause, then what this one does not, with what no recording tells from that."""
    cause = judgement.cause
    alike = not_told_apart(final, judgement.without, cause, chi_square_inflation(final), judgement.known)
    names = [(cause.kind, cause.at), *alike]
    names += [same for kind, at in names for same in EFFECTS[kind].same_as(at, system)]
    return list(dict.fromkeys(names))[1:]


def _in_words(same: Sequence[tuple[str, str]]) -> str:
    """What the recording does not tell from a cause, in words; empty where there is nothing."""
    if not same:
        return ""
    return f"; this recording does not tell it from {' or '.join(f'{k} at {place_in_words(at)}' for k, at in same)}"


def cause_parameters(system: System, cause: Cause, estimates: Mapping[str, Estimate]) -> dict[str, CauseParameter]:
    """The parameters of a cause, SI, from the estimates of all fitted ones by name."""
    kind, names = EFFECTS[cause.kind], cause.names()
    values = kind.canonical({key: estimates[name].value for key, name in names.items()})
    return {
        key: CauseParameter(
            values[key], estimates[name].standard_uncertainty, kind.unit(key, cause.at, system), estimates[name].note
        )
        for key, name in names.items()
    }


def _evidence(system: System, without: Hypothesis, final: Hypothesis, next_best: Hypothesis | None) -> str:
    before, after = (np.array([test.ratio for test in fit.whiteness()]) for fit in (without, final))
    j = int(np.nanargmax(before - after))
    text = f"with it the error of {system.sensors[j].name} falls from {before[j]:.3g} to {after[j]:.3g} times the noise"
    i = int(np.nanargmax(after / np.maximum(before, 1.0)))
    if after[i] > RISES * max(before[i], 1.0):
        text += f", that of {system.sensors[i].name} rises from {before[i]:.3g} to {after[i]:.3g}"
    if next_best:
        left = np.array([test.ratio for test in next_best.whiteness()])
        i = int(np.nanargmax(left))
        cause = next_best.causes[-1]
        text += f"; the next best, {cause.kind} at {place_in_words(cause.at)}, leaves {left[i]:.3g} times the noise"
        text += f" in {system.sensors[i].name}"
    return text
