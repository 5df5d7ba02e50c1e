"""What a selection is worth, as three answers: is something there, of what kind is it, how much is left; and what to
record next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from matching.diagnosis.causes import Cause
from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.hypotheses import Hypothesis, at_noise, is_simpler
from matching.diagnosis.latent import free_force, map_force
from matching.diagnosis.moves import Selection, weighted
from matching.diagnosis.result import (
    Alternative,
    Candidate,
    FittedCandidate,
    KnownScreening,
    NamedCause,
    cause_parameters,
    differs_from_nothing,
    not_told_apart,
)
from matching.diagnosis.screening import Screening
from matching.diagnosis.settings import DiagnosisSettings
from matching.diagnosis.simulation import simulate_readings
from matching.diagnosis.statistics import AT_BOUND, Estimate, estimates, residual_inflation
from matching.diagnosis.unseen import UnseenData, UnseenError
from modelling.effects import EFFECTS
from modelling.effects.effect import place_in_words
from modelling.system import System

# --- The confidence in the kind of a cause, among its rivals.
#
# Where a hypothesis leaves noise, that is its share of the evidence: −½ of χ² + (variables)·ln(readings) of all data
# (Schwarz 1978). Where more than noise is left, no hypothesis is right, and such a likelihood would decide by far too
# much. The hypotheses are then mixed so that the mixture predicts the unseen blocks best (stacking of predictive
# distributions; Yao, Vehtari, Simpson and Gelman, Bayesian Analysis 13, 2018), averaged over draws of the blocks
# (Huggins and Miller, arXiv 2007.14845): a difference that is smaller than its scatter decides nothing.

STACKED_DRAWS, STACKING_ROUNDS = 200, 60  # of the blocks; of the iterations that find the weights of each


@dataclass(frozen=True)
class RatedCause:
    """A cause, or a rival in its place, with its share of the confidence."""

    kind: str
    at: str
    share: float
    hypothesis: Hypothesis


def rate_rivals(selected: Selection, index: int, unseen: UnseenData) -> list[RatedCause]:
    """A cause of the best hypothesis and its rivals with their shares, largest first; the selection stays as it is.

    Of a cause that explains as much as a kind which holds it as a special case, that kind is no rival.
    """
    best, cause = selected.best, selected.best.causes[index]
    others = [other for other in selected.rivals[index] if not other.model.not_taken(other.fit)]
    if not at_noise(best):
        others = [o for o in others if not is_simpler(cause, o) or unseen.accepts(o, best)]
    hypotheses = [selected.compared[index], *others]
    if at_noise(best):
        shares = evidence_shares(np.array([h.cost for h in hypotheses]) / chi_square_inflation(best))
    else:
        shares = stacking_weights([unseen.error(h) for h in hypotheses])
    names = [(cause.kind, cause.at), *((other.causes[-1].kind, other.causes[-1].at) for other in others)]
    rated = [RatedCause(*name, float(p), h) for name, p, h in zip(names, shares, hypotheses, strict=True)]
    return sorted(rated, key=lambda rating: -rating.share)


def evidence_shares(scores: np.ndarray) -> np.ndarray:
    """Shares (h,) of the evidence, which add to 1, from −2 ln of each (h,)."""
    evidence = np.exp(-0.5 * (scores - scores.min()))
    return evidence / evidence.sum()


def stacking_weights(errors: Sequence[UnseenError | None]) -> np.ndarray:
    """Weights (h,) with which hypotheses predict unseen blocks best together, by their mean squares in each block: the
    error is normal, of the variance that the best of them leaves, at least the noise."""
    known = [error for error in errors if error is not None]
    if not known:
        return np.full(len(errors), 1 / len(errors))
    squares = np.array([np.full_like(known[0].blocks, np.inf) if e is None else e.blocks for e in errors])
    variance = np.maximum(np.min([np.nanmean(e.blocks, axis=0) for e in known], axis=0), 1.0)
    independent = np.max([e.independent for e in known], axis=0)
    density = -0.5 * np.nansum(squares / variance * independent, axis=2)
    likelihood = np.exp(density - density.max(axis=0))
    count = likelihood.shape[1]
    drawn = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), size=STACKED_DRAWS) / count
    weights = np.full((STACKED_DRAWS, len(errors)), 1 / len(errors))
    for _ in range(STACKING_ROUNDS):
        weights *= (drawn / np.maximum(weights @ likelihood, 1e-300)) @ likelihood.T
    return weights.mean(axis=0)


def chi_square_inflation(hypothesis: Hypothesis) -> float:
    """By how much the χ² of a hypothesis overstates what it knows, see :func:`residual_inflation`."""
    segments, residuals = hypothesis.fit.problem.data.segments, hypothesis.fit.by_sensor()
    return residual_inflation([np.where(s.measured, r, np.nan) for s, r in zip(segments, residuals, strict=True)])


# --- Every candidate that was fitted alone, with its misfit and why it was not taken.


def fitted_candidates(selected: Selection, unseen: UnseenData) -> list[FittedCandidate]:
    """The candidates that were added to the base model by themselves, best first, and the causes of the best
    hypothesis among them as taken; then those that have no fit. Unseen data are asked about those near the best, where
    that leaves more than noise."""
    before, out = np.nan, list[FittedCandidate]()
    near = 0.0 if at_noise(selected.best) else unseen.settings.near_ratio * selected.best.chi_square
    for hypothesis in selected.with_one_cause:
        (cause,) = hypothesis.causes
        taken = (cause.kind, cause.at) in selected.best.places
        asked = taken or hypothesis.chi_square < near or unseen.knows(hypothesis)
        left = unseen.misfit(hypothesis) if asked else np.nan
        before = unseen.misfit(selected.base) if asked else before
        reason = "" if taken else _reason(selected, hypothesis, left, before)
        out.append(FittedCandidate(cause.kind, cause.at, hypothesis.misfit, left, hypothesis.chi_square, reason))
    fitted = {(one.kind, one.at) for one in out}
    for (kind, at), why in selected.failed.items():
        if (kind, at) not in fitted:
            out.append(FittedCandidate(kind, at, np.nan, np.nan, np.nan, "no_fit", why))
    return out


def _reason(selected: Selection, hypothesis: Hypothesis, left: float, before: float) -> str:
    """Why a candidate was not taken, in the words of ``diagnosis.json``: the reason that decided, where one did."""
    (cause,) = hypothesis.causes
    if refused := selected.refused.get((cause.kind, cause.at)):
        return refused
    least = selected.noise_threshold * hypothesis.chi_square_per_reading
    too_little = hypothesis.chi_square > selected.base.chi_square - least
    if too_little or hypothesis.model.negligible(hypothesis.fit):
        return "not_better"
    impossible = hypothesis.model.not_taken(hypothesis.fit)
    if impossible:
        return impossible
    if left > before:
        return "worse_unseen"
    notes = estimates(hypothesis.fit)
    if any(notes[name].note.startswith("at the bound") for name in cause.names().values()):
        return "at_bound"
    return "rival" if selected.best.causes else "not_better"  # without a cause there is none that it rivals


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
        N·m; of a pedal from 0 to 1.
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
    pedal: bool = False

    def sentence(self, cause: str, rival: str) -> str:
        """What to record, in words."""
        size = f"{self.amplitude:.3g}" if self.pedal else f"{self.amplitude:.3g} N·m"
        what = f"{self.waveform} of {size} on {self.input} for {self.duration:g} s"
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
                torque[:, i] = amplitude * (np.maximum(shape, 0.0) if name in model.system.pedals else shape)
                readings = _readings(hypothesis, time, torque)
                difference = readings - _readings(rival, time, torque)
                separation = np.sqrt(np.mean((difference / data.noise) ** 2, axis=0))
                if not np.isfinite(separation).all() or np.any(np.abs(readings).max(axis=0) > recorded):
                    continue
                j = int(np.argmax(separation))
                if best is None or separation[j] > CLEARLY_BETTER * best.separation:
                    best = ProposedManoeuvre(
                        name, waveform, amplitude, DURATION, float(separation[j]), model.sensors[j],
                        name in model.system.pedals,
                    )  # fmt: skip
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
        Share of the misfit on unseen data that it explains, of the sensor where that is most: a fault of a channel
        explains nothing of the others. 1 where all is explained.
    second : float
        Error of all sensors on a second recording with the cause over that without it; NaN without such a recording.
    """

    cause: Cause
    rated: Sequence[RatedCause]
    without: Hypothesis
    known: KnownScreening | None
    explained: float
    second: float

    @property
    def rivals(self) -> list[RatedCause]:
        """The most likely first."""
        return [rating for rating in self.rated if (rating.kind, rating.at) != (self.cause.kind, self.cause.at)]


def named_causes(
    system: System,
    final: Hypothesis,
    estimates: Mapping[str, Estimate],
    judged: Sequence[JudgedCause],
    unseen: UnseenData,
) -> list[NamedCause]:
    """The causes of the final hypothesis, in its order.

    *There*: the probability that unseen data are met better with the cause, drawn block by block. *Kind*: the least of
    its share among its rivals, of what a free force at its place leaves of that share, and of twice what it explains.
    *Left*: the errors of the sensors on unseen data without it and with it.

    Parameters
    ----------
    estimates : dict of str to Estimate
        Of all fitted parameters, by name.
    """
    causes, settings, all_explained = [], unseen.settings, at_noise(final)
    screening = None if all_explained or not final.causes else Screening(final.fit)
    for judgement in judged:
        cause, rivals = judgement.cause, judgement.rivals
        rating = next(r for r in judgement.rated if (r.kind, r.at) == (cause.kind, cause.at))
        weighed = {(rival.kind, rival.at) for rival in rivals if rival.share > 0}
        alike = _all_alike(system, final, judgement)
        same = [name for name in alike if name not in weighed]
        parameters = cause_parameters(system, cause, estimates)
        differs = all_explained or differs_from_nothing(final, cause, estimates, settings.beyond)
        there, kind, over, share = 1.0, rating.share, "", 0.0
        if screening is not None:
            there = unseen.probability(final, judgement.without)
            over, share = _free_force_beside(final, screening, judgement)
            rest = share * (1 - judgement.explained) / max(judgement.explained, 1e-300)
            kind = min(kind, max(0.0, 1 - rest / settings.kind_rest), 2 * judgement.explained)
            if any(estimates[name].note.startswith(AT_BOUND) for name in cause.names().values()):
                kind = min(kind, settings.kind_at_bound)
        kind /= 1 + len(same)  # of what no recording, or not this one, tells apart, any may stand
        alternatives = [Alternative(at_kind, at, kind) for at_kind, at in same]
        alternatives += [Alternative(r.kind, r.at, r.share) for r in rivals]
        enough = judgement.explained >= settings.explains or judgement.second < 1 - settings.helps
        harms, helps = judgement.second > 1 + settings.harms, judgement.second < 1 - settings.helps
        of_map = not all_explained and not helps and _stands_for_map(final, judgement, settings)
        causes.append(
            NamedCause(
                cause.kind, cause.at, parameters, kind,
                _evidence(system, judgement.without, final, rivals[0].hypothesis if rivals else None)
                + _in_words(alike),
                [a for a in alternatives if a.confidence > SMALLEST_CONFIDENCE],
                judgement.without.chi_square / final.chi_square,
                there if differs else 0.0,
                _left(system, unseen, judgement.without, final), (over, share),
                1 - there < settings.chance and differs and enough and not harms and not of_map,
                _not_in_model(there, differs, enough, harms, settings.chance) or ("map" if of_map else ""),
            )
        )  # fmt: skip
    return causes


def _not_in_model(there: float, differs: bool, enough: bool, harms: bool, chance: float) -> str:
    """Why a cause stays out of the extended model, in the words of ``diagnosis.json``; empty where it is in."""
    if harms:
        return "second_recording"
    if not differs:
        return "within_uncertainty"
    if 1 - there >= chance:
        return "by_chance"
    return "" if enough else "explains_little"


def _stands_for_map(final: Hypothesis, judgement: JudgedCause, settings: DiagnosisSettings) -> bool:
    """Whether a cause imitates the map of a machine: in its place the input of that, times a curve over its speed or
    angle, predicts clearly more of the misfit.

    What a law leaves may follow the input beside a right law; only in its place the two compete.
    """
    system = final.fit.problem.system
    machines = [f"inputs.{part.name}" for part in system.inputs if part.name not in system.imposed_by]
    if judgement.cause.at.startswith("sensors.") or not machines:
        return False
    rest, other = (weighted(each, by_noise=True) for each in (judgement.without, final))
    screening = (judgement.known.of(rest.fit) if judgement.known else None) or Screening(rest.fit)
    count = final.fit.problem.data.readings_count
    basis = np.linalg.qr(other.fit.jacobian / np.maximum(np.linalg.norm(other.fit.jacobian, axis=0), 1e-300))[0]
    left = other.fit.residual - basis @ (
        basis.T @ other.fit.residual
    )  # where it was weighted, its minimum is elsewhere
    by_map = max(map_force(rest, screening, machine).decrease for machine in machines)
    without = float(screening.residual @ screening.residual) - count
    return without - by_map < settings.map_leaves * (float(left @ left) - count)


def _left(system: System, unseen: UnseenData, without: Hypothesis, final: Hypothesis) -> dict[str, tuple[float, float]]:
    """By sensor, root mean square error on unseen data in times the noise, without a cause and with it."""
    errors = [unseen.error(without), unseen.error(final)]
    if errors[0] is None or errors[1] is None:
        return {}
    before, after = (error.rms_by_sensor for error in errors if error is not None)
    return {
        sensor.name: (float(a), float(b))
        for sensor, a, b in zip(system.sensors, before, after, strict=True)
        if np.isfinite(a) and np.isfinite(b)
    }


def _free_force_beside(final: Hypothesis, screening: Screening, judgement: JudgedCause) -> tuple[str, float]:
    """What a free force at the place of a cause depends on, and which share it predicts of what the cause leaves.

    It is held against what the cause itself explains: a kind that leaves little of its own size is right, however much
    of another origin is left beside it.
    """
    left, count = float(final.fit.residual @ final.fit.residual), final.fit.problem.data.readings_count
    left -= count if final.fit.problem.weighting is None else 0
    if left <= 0:
        return "", 0.0
    force = free_force(final, screening, judgement.cause.at)
    return force.family, max(force.decrease, 0.0) / left


def recording_to_tell_rivals(final: Hypothesis, judged: Sequence[JudgedCause]) -> str | None:
    """What to record to tell the most likely rival from its cause; None where none is likely enough."""
    proposals: list[tuple[float, str]] = []
    for judgement in judged:
        for rival in judgement.rivals[:1]:
            likely = min(rival.share, judgement.explained)
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
