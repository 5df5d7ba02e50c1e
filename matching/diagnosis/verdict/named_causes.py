"""Named causes with values, confidence, evidence and rivals, and what to record to tell them apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from matching.diagnosis.candidates.cause import Cause
from matching.diagnosis.fitting.uncertainty import Estimate
from matching.diagnosis.search.hypothesis import Hypothesis
from matching.diagnosis.verdict.causes import Alternative, Candidate, CauseParameter, NamedCause
from matching.diagnosis.verdict.confidence import (
    UNEXPLAINED_SHARE,
    RatedCause,
    chi_square_inflation,
    confidence,
)
from matching.diagnosis.verdict.indistinguishable import KnownScreening, not_told_apart
from matching.diagnosis.verdict.next_recording import propose_manoeuvre
from modelling.effects import EFFECTS
from modelling.effects.place import place_in_words
from modelling.model.system import System

WORTH_RECORDING = 0.02  # confidence of a rival from which a further recording is proposed
COVERAGE = 2.0  # standard uncertainties, from which a size is told from nothing
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
    """

    cause: Cause
    rated: Sequence[RatedCause]
    without: Hypothesis
    known: KnownScreening | None


def named_causes(
    system: System,
    final: Hypothesis,
    estimates: Mapping[str, Estimate],
    judged: Sequence[JudgedCause],
    explained: bool,
) -> list[NamedCause]:
    """The causes of the final hypothesis, strongest first.

    Parameters
    ----------
    estimates : dict of str to Estimate
        Of all fitted parameters, by name.
    explained : bool
        Whether the verdict is ``explained``.
    """
    causes = []
    for judgement in judged:
        cause, part = judgement.cause, share_explained_by(final, judgement.without)
        rating = next(r for r in judgement.rated if (r.kind, r.at) == (cause.kind, cause.at))
        rivals = _rivals(judgement)
        weighed = {(rival.kind, rival.at) for rival in rivals if rival.share > 0}
        alike = _all_alike(system, final, judgement)
        same = [name for name in alike if name not in weighed]
        certain = confidence(rating.share, explained, part) / (1 + len(same))
        parameters = _parameters(system, cause, estimates)
        if not told_from_nothing(parameters):
            certain = min(certain, UNEXPLAINED_SHARE)
        alternatives = [Alternative(kind, at, certain) for kind, at in same]
        alternatives += [Alternative(r.kind, r.at, confidence(r.share, explained, part)) for r in rivals]
        causes.append(
            NamedCause(
                cause.kind, cause.at, parameters, certain,
                _evidence(system, judgement.without, final, rivals[0].hypothesis if rivals else None)
                + _in_words(alike),
                [a for a in alternatives if a.confidence > SMALLEST_CONFIDENCE],
                judgement.without.chi_square / final.chi_square,
            )
        )  # fmt: skip
    return sorted(causes, key=lambda cause: -cause.gain)


def told_from_nothing(parameters: Mapping[str, CauseParameter]) -> bool:
    """Whether one of the torques of a cause, if it has any, is more than its uncertainty."""
    torques = [parameter for parameter in parameters.values() if parameter.unit == "N*m"]
    return not torques or any(abs(torque.value) > COVERAGE * torque.standard_uncertainty for torque in torques)


def share_explained_by(final: Hypothesis, without: Hypothesis) -> float:
    """Share of the misfit beyond noise that the final hypothesis explains more than one without a cause."""
    excess = without.chi_square - final.fit.problem.data.readings_count
    return (without.chi_square - final.chi_square) / max(excess, 1.0)


def recording_to_tell_rivals(final: Hypothesis, judged: Sequence[JudgedCause], explained: bool) -> str | None:
    """What to record to tell the most likely rival from its cause; None where none is likely enough."""
    proposals: list[tuple[float, str]] = []
    for judgement in judged:
        part = share_explained_by(final, judgement.without)
        rival = next(iter(_rivals(judgement)), None)
        if rival and confidence(rival.share, explained, part) > WORTH_RECORDING:
            manoeuvre = propose_manoeuvre(final, rival.hypothesis)
            if manoeuvre:
                names = (f"{named.kind} at {place_in_words(named.at)}" for named in (judgement.cause, rival))
                proposals.append((confidence(rival.share, explained, part), manoeuvre.sentence(*names)))
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


def _rivals(judged: JudgedCause) -> list[RatedCause]:
    """The rivals of a cause, the most likely first."""
    return [rating for rating in judged.rated if (rating.kind, rating.at) != (judged.cause.kind, judged.cause.at)]


def _parameters(system: System, cause: Cause, estimates: Mapping[str, Estimate]) -> dict[str, CauseParameter]:
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
