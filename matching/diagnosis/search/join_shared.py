"""Causes of one kind and size at several channels, as one: a filter, a clock or a supply that these share.

Groups by the measured quantity compete from the start. A logger may have some channels of a quantity and lack others;
its delay is then found channel by channel.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from matching.diagnosis.candidates.cause import Cause, compilable
from matching.diagnosis.candidates.refit import fit_extended
from matching.diagnosis.search.hypothesis import Hypothesis
from matching.diagnosis.search.refinement import FIT_ERRORS, RefitBudget
from matching.diagnosis.search.state import chi_square_per_reading
from modelling.effects import EFFECTS
from modelling.effects.place import members, shared_place

ALIKE = 1.5  # ratio of two sizes from which they are not tried as one


def with_shared_causes(hypothesis: Hypothesis, budget: RefitBudget) -> Hypothesis:
    """A hypothesis whose causes of one kind at several channels are one, where that is as likely with fewer sizes."""
    for first, second in combinations(hypothesis.causes, 2):
        if not _may_be_one(hypothesis, first, second) or not budget.take():
            continue
        joined = _joined(hypothesis, first, second)
        if joined is not None and joined.chi_square < hypothesis.chi_square + _saved(hypothesis, joined):
            return with_shared_causes(joined, budget)
    return hypothesis


def _may_be_one(hypothesis: Hypothesis, first: Cause, second: Cause) -> bool:
    tables = {place.split(".")[0] for cause in (first, second) for place in members(cause.at)}
    if not EFFECTS[first.kind].shareable or (first.kind, first.keys) != (second.kind, second.keys) or len(tables) > 1:
        return False
    sizes = np.array([[hypothesis.fit.values[cause.names()[key]] for key in cause.keys] for cause in (first, second)])
    small, large = np.sort(np.abs(sizes), axis=0)
    return bool((np.sign(sizes[0]) == np.sign(sizes[1])).all() and (large <= ALIKE * small).all())


def _joined(hypothesis: Hypothesis, first: Cause, second: Cause) -> Hypothesis | None:
    """The hypothesis with one cause at all places of two, fitted; None where there is none."""
    fit = hypothesis.fit
    model = hypothesis.model.without_cause(hypothesis.causes.index(second), fit)
    kept = set(model.bounds) - set(first.names().values())
    model = replace(
        model, causes=tuple(cause for cause in model.causes if cause != first),
        bounds={name: model.bounds[name] for name in kept}, values={name: model.values[name] for name in kept},
    )  # fmt: skip
    sizes = {key: (fit.values[first.names()[key]] + fit.values[second.names()[key]]) / 2 for key in first.keys}
    place = shared_place((*members(first.at), *members(second.at)))
    model = model.with_cause(first.kind, place, sizes, fit.problem.data.sampling_interval)
    if not compilable([model]):
        return None
    try:
        return Hypothesis(model, fit_extended(model, fit), hypothesis.screened)
    except FIT_ERRORS:
        return None


def _saved(hypothesis: Hypothesis, joined: Hypothesis) -> float:
    """What the sizes that are saved would cost in χ² (Schwarz 1978), no model being better than what it leaves."""
    saved = len(hypothesis.fit.v) - len(joined.fit.v)
    return saved * float(np.log(hypothesis.fit.problem.data.readings_count)) * chi_square_per_reading(hypothesis)
