"""Several causes, one after another, until the rest is noise; what later turns out unneeded is dropped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from matching.diagnosis.candidates.candidates import Cause, Trial, fitted, without_cause
from matching.diagnosis.candidates.noise_threshold import offer, threshold
from matching.diagnosis.candidates.screening import Screen, Screened
from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.search.compare import MANY, Budget, Named, at_noise, refit, sharpest, taken, unique
from modelling.model.system import System

MOST = 3  # causes
FURTHER, ASIDE = 9, 5  # candidates refitted from the best fit with causes, and from each of its rivals
BEAM = 3  # fits with one cause from which a second is sought
SLIGHT = 0.1  # of the misfit beyond noise: what takes less is no cause of it, what is missing is not in the vocabulary


@dataclass
class Search:
    """The state of a search: the best fit so far and what else was tried.

    Attributes
    ----------
    base : Named
        The fit without causes.
    best : Named
    rivals : list of list of Named
        For each cause of ``best``: fits with another cause in its place, itself included, best first.
    null : float
        Decrease of χ² that the best of all candidates reaches in pure noise, seldom.
    screen : Screen
        Seen from the base fit.
    single : list of Named
        Fits with one cause, best first.
    """

    base: Named
    best: Named
    screen: Screen
    null: float
    rivals: list[list[Named]] = field(default_factory=list)
    single: list[Named] = field(default_factory=list)


def search(system: System, base_fit: Fit, tell: Callable[[str], None] = lambda _: None) -> Search:
    """Find the causes that bring a base fit's residual to the noise, as far as the vocabulary can."""
    base = Named(Trial(system, (), dict(base_fit.problem.bounds), base_fit.values), base_fit)
    screen = Screen(base_fit)
    offer(screen)
    found = unique(list(screen.candidates()))
    null = threshold(screen)
    state = Search(base, base, screen, null)
    budget = Budget()
    beam = [base]
    screens: dict[tuple[Cause, ...], tuple[Screen, list[Screened]]] = {(): (screen, found)}
    while (len(state.best.causes) < MOST and not at_noise(state.best)) or state.best is base:
        grown: list[Named] = []
        for node in beam:
            key = node.causes
            if key not in screens:
                own = Screen(node.fit)
                screens[key] = (own, unique(list(own.candidates(node.trial.extended()))))
            own, options = screens[key]
            options = [one for one in options if one.reduction > null and not _repeats(node, one.kind, one.at)]
            if not options:
                continue
            first = node is beam[0]
            most = FURTHER if node.causes else MANY
            windows = first and len(node.causes) < 2
            grown += refit(system, node, options, own, budget, tell, most if first else ASIDE, windows)
            if any(at_noise(one) for one in grown[:1]):
                break
        grown = _distinct(sorted(grown, key=lambda own: own.cost))
        if not grown:
            break
        least = max(null, _price(grown[0]) - _price(state.best))
        if grown[0].fit.cost > state.best.fit.cost - least * _inflation(grown[0]):
            break
        if taken(state.best, grown[0]) < SLIGHT:
            break
        state.best = grown[0]
        wide = BEAM if len(state.best.causes) == 1 else 1
        beam = [one for one in grown[:wide] if one.fit.cost < 2 * grown[0].fit.cost]
        if len(state.best.causes) == 1:
            state.single = grown
            state.rivals = [grown]
    _prune_and_swap(system, state, budget, tell)
    return state


def _repeats(node: Named, kind: str, at: str) -> bool:
    return any(cause.kind == kind and cause.at == at for cause in node.causes)


def _price(named: Named) -> float:
    """What parameters and states of a fit cost in χ² (Schwarz 1978): a refit finds more in noise than a screening."""
    problem = named.fit.problem
    return (len(problem.free) + len(problem.model.states)) * float(np.log(problem.data.samples.sum()))


def _inflation(named: Named) -> float:
    """How much larger than 1 the mean square of the residual is: no gain counts that is small beside what remains."""
    return max(1.0, named.fit.cost / max(float(named.fit.problem.data.samples.sum()), 1.0))


def _distinct(named: list[Named]) -> list[Named]:
    """Without those that name the same causes in another order or with fewer or more parameters."""
    out: dict[frozenset, Named] = {}
    for one in named:
        out.setdefault(frozenset((cause.kind, cause.at) for cause in one.causes), one)
    return list(out.values())


def _prune_and_swap(system: System, state: Search, budget: Budget, tell: Callable[[str], None]) -> None:
    """Drop causes that the others make unneeded, and put a better one in the place of any."""
    for _ in range(2):
        rivals, changed = [], False
        for index in range(len(state.best.causes)):
            if len(state.best.causes) == 1:
                if not state.rivals:
                    state.rivals = [[state.best]]
                return
            trial = without_cause(state.best.trial, index, state.best.fit)
            try:
                rest = sharpest(Named(trial, fitted(trial, state.best.fit)))
            except (FloatingPointError, np.linalg.LinAlgError):  # it does not even simulate without this cause
                rivals.append([state.best])
                continue
            if rest.fit.cost < state.best.fit.cost + state.null * _inflation(state.best):
                state.best, changed = rest, True
                break
            own = Screen(rest.fit)
            options = unique(list(own.candidates(trial.extended())))
            options = [one for one in options if not _repeats(rest, one.kind, one.at)]
            named = refit(system, rest, options, own, budget, tell, 4, windows=at_noise(state.best))
            here = state.best.causes[index]
            same = [one for one in named if (one.causes[-1].kind, one.causes[-1].at) == (here.kind, here.at)]
            others = [one for one in named if one not in same]
            if others and others[0].cost < min(state.best.cost, *(one.cost for one in same), np.inf):
                state.best, changed = others[0], True
                break
            rivals.append(_distinct(sorted([state.best, *others], key=lambda one: one.cost)))
        if not changed:
            state.rivals = rivals
            return
    state.rivals = [[state.best] for _ in state.best.causes]
