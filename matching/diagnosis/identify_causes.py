"""From a base fit to named causes with their rivals; over long data by way of a stretch of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from matching.diagnosis.candidates.candidates import fitted, without_cause
from matching.diagnosis.candidates.screening import Screen
from matching.diagnosis.data.segments import Data
from matching.diagnosis.fitting.fit import Fit, base_problem, solve
from matching.diagnosis.fitting.holdout import Ahead, elsewhere
from matching.diagnosis.search.compare import Named, at_noise, sharpest
from matching.diagnosis.search.greedy_search import Search, search
from matching.diagnosis.search.search_window import head, stretch
from matching.diagnosis.verdict.verdict import Rated, held_out, polished, rated, spread
from modelling.model.system import System

Foretell = Callable[[Named], list[Ahead]]


def walk(
    system: System, base: Fit, ahead: Foretell, rest: Data, tell: Callable[[str], None]
) -> tuple[Search, list[list[Rated]]]:
    """The causes that a base fit lacks, and for each its rivals, itself included.

    Where the data are long, causes are sought on the stretch of them where the base model is furthest off, and what is
    found is fitted to all. If that is not at the noise though the stretch is, they are sought on all.

    Parameters
    ----------
    ahead : callable
        Simulations of unseen data by a fit of all that ``base`` saw.
    rest : Data
        Unseen data.
    """
    part = stretch(base)
    if part is not None:
        tell(f"a stretch of {sum(np.ptp(one.time) for one in part.segments):.3g} s")
        own, unseen = solve(*base_problem(system, part)), head(rest)
        state, rivals = _searched(system, own, lambda named: elsewhere(named.fit, unseen), tell)
        tell("all data")
        best = _lifted(state.best, base)
        if at_noise(best) or not at_noise(state.best):
            state.best, state.base, state.screen = best, replace(state.base, fit=base), Screen(base)
            return state, rivals
    return _searched(system, base, ahead, tell)


def _searched(
    system: System, base: Fit, ahead: Foretell, tell: Callable[[str], None]
) -> tuple[Search, list[list[Rated]]]:
    state = search(system, base, tell)
    tell("final fit")
    if not at_noise(state.best):
        _drop_overfitted(state, ahead)
    state.best = polished(state.best)
    _drop_idle(state)
    rivals = []
    for index in range(len(state.best.causes)):
        tell("rivals")
        rivals.append(rated(state, index, ahead))
    return state, rivals


def _lifted(named: Named, base: Fit) -> Named:
    """A fit of a stretch carried over to all that the base fit saw."""
    trial = replace(
        named.trial, bounds=named.fit.problem.bounds, values=named.trial.values | named.fit.values, starts=()
    )
    return polished(Named(trial, fitted(trial, base, exact=True) if named.causes else base))


def _drop_overfitted(state: Search, ahead: Callable[[Named], list[Ahead]]) -> None:
    """Drop the causes found last while unseen data are met better without: they fitted what does not come again."""
    while state.best.causes:
        last = len(state.best.causes) - 1
        rest = without(state, last)
        if held_out(rest, ahead) >= held_out(state.best, ahead):
            break
        state.best = rest
        state.rivals = state.rivals[:last]
    if len(state.best.causes) == 1 and state.best is not state.single[0]:
        here = {(cause.kind, cause.at) for cause in state.best.causes}
        others = [one for one in state.single if {(cause.kind, cause.at) for cause in one.causes} != here]
        state.rivals = [[state.best, *others]]


def _drop_idle(state: Search) -> None:
    """Drop causes of several without which the polished fit is as good, e.g. free play of no width."""
    index = 0
    while len(state.best.causes) > 1 and index < len(state.best.causes):
        rest = polished(without(state, index))
        price = len(state.best.causes[index].keys) * float(np.log(state.best.fit.problem.data.samples.sum()))
        if rest.fit.cost < state.best.fit.cost + max(state.null, price) * spread(state.best):
            state.best = rest
            del state.rivals[index : index + 1]
        else:
            index += 1


def without(state: Search, index: int) -> Named:
    """The best fit without one of its causes."""
    if len(state.best.causes) == 1:
        return state.base
    trial = without_cause(state.best.trial, index, state.best.fit)
    return sharpest(Named(trial, fitted(trial, state.best.fit)))
