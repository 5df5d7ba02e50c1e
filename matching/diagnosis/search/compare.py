"""One candidate at a time: the most promising of a screening are refitted with everything uncertain free."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from matching.diagnosis.candidates.candidates import (
    Cause,
    Trial,
    added,
    compile_all,
    fitted,
    nearer,
    with_cause,
    without_cause,
)
from matching.diagnosis.candidates.screening import Screen, Screened
from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.fitting.statistics import SCALES, Noise, noise_of
from matching.diagnosis.fitting.stick_speed import UTMOST, resolved
from modelling.effects import EFFECTS
from modelling.model.system import System

FEW, MANY = 5, 14  # candidates refitted at once, and at most
MOST_OF_IT = 0.9  # of the misfit beyond noise: no further candidate needs a look
REFITS, WINDOWED = 60, 4  # of a whole search; the latter over short windows, each many times as long
SHARPER, NEAR = 4, 2.0  # fits looked at with sharper friction, and up to how many times the best's χ²
SHARE = 0.4  # of the best reduction that a candidate must promise to be refitted with the first


@dataclass
class Budget:
    """How many refits a search may still make, over all and over windows.

    A count and no clock, so that no answer depends on the machine.
    """

    left: int = REFITS
    windows: int = WINDOWED

    def refit(self) -> bool:
        """Take one refit off; whether there was one."""
        self.left -= 1
        return self.left >= 0

    def window(self) -> bool:
        """Take one refit over windows off; whether there was one."""
        self.windows -= 1
        return self.windows >= 0


@dataclass(frozen=True)
class Named:
    """A fit with the causes it names; ``trial`` is what it began from."""

    trial: Trial
    fit: Fit
    screened: float = field(default=0.0, compare=False)

    @property
    def causes(self) -> tuple[Cause, ...]:
        """The causes, in the order they were found."""
        return self.trial.causes

    @property
    def cost(self) -> float:
        """χ² with the price of its parameters (Schwarz 1978: ln of the number of readings each)."""
        return self.fit.cost + len(self.fit.v) * float(np.log(self.fit.problem.data.samples.sum()))

    def noise(self) -> list[Noise]:
        """How the residual of each sensor compares with white noise."""
        return residual_noise(self.fit)


def residual_noise(fit: Fit) -> list[Noise]:
    """How the residual of each sensor of a fit compares with white noise."""
    out = []
    for j in range(len(fit.problem.data.noise)):
        parts = []
        for own, segment in zip(fit.by_sensor(), fit.problem.data.segments, strict=True):
            parts.append(np.where(segment.counts[:, j], own[:, j], np.nan))
        out.append(noise_of(parts))
    return out


SCORE = 5.0  # standard deviations that count as more than noise
EXCESS = 0.006  # of the noise power, that matters
ROUGH = 0.02  # the same with free play: its misfit is too rough to reach the very bottom


def beyond(fit: Fit, noises: Sequence[Noise]) -> list[np.ndarray]:
    """For each sensor, at which scales (bool) the residual of a fit is more than white noise of the stated
    uncertainty."""
    rough = any(EFFECTS[effect.kind].abrupt for effect in fit.problem.system.effects)
    return [(one.score > SCORE) & (one.excess > (ROUGH if rough else EXCESS)) for one in noises]


def at_noise(named: Named) -> bool:
    """Whether every sensor's residual is white noise of the stated uncertainty, as far as it matters."""
    return not any(own.any() for own in beyond(named.fit, named.noise()))


def where_not_noise(named: Named) -> list[tuple[int, int]]:
    """Sensors (index) that are not at noise, with the number of samples over which that shows most."""
    noises = named.noise()
    out = []
    for j, (one, bad) in enumerate(zip(noises, beyond(named.fit, noises), strict=True)):
        if bad.any():
            out.append((j, SCALES[int(np.argmax(np.where(bad, one.score, 0)))]))
    return out


def unique(found: Sequence[Screened]) -> list[Screened]:
    """The best guess of every kind, place and set of parameters, best first."""
    out: dict[tuple, Screened] = {}
    for one in sorted(found, key=lambda s: -s.reduction):
        out.setdefault((one.kind, one.at, tuple(one.parameters)), one)
    return list(out.values())


def refit(
    system: System,
    parent: Named,
    found: Sequence[Screened],
    screen: Screen,
    budget: Budget,
    tell: Callable[[str], None] = lambda _: None,
    most: int = MANY,
    windows: bool = True,
) -> list[Named]:
    """Refit promising candidates until one brings the residual to the noise and no other promises as much, or the
    budget is spent; best first. With ``windows`` the best few are fitted over short simulations too."""
    done: list[Named] = []
    rest = list(found)
    tried: set[tuple[Cause, ...]] = set()
    simpler: set[tuple[Cause, ...]] = set()
    while rest and len(done) < most and budget.left > 0:
        lead = rest[0].reduction
        count = FEW if not done else 4
        batch = [
            one for i, one in enumerate(rest) if i < count or (not done and one.reduction > 0.9 * lead and i < 2 * FEW)
        ]
        rest = rest[len(batch) :]
        promised = {}
        trials = []
        for one in batch:
            trial = with_cause(system, parent.fit, parent.causes, one.kind, one.at, one.parameters)
            promised[trial.causes] = one.reduction
            trials.append(trial)
        for trial in compile_all(trials):
            if not budget.refit():
                break
            cause = trial.causes[-1]
            tell(f"{cause.kind} at {cause.at}")
            rival = min((one.fit.cost for one in done), default=0.0)
            noise = min((one.fit.cost for one in done if at_noise(one)), default=0.0)
            try:
                fit = fitted(trial, parent.fit, rival=rival, noise=noise)
                done.append(Named(trial, fit, promised[trial.causes]))
            except (FloatingPointError, np.linalg.LinAlgError, ValueError):
                continue
        done = simplified(sharper(done), simpler)
        if windows and done and not at_noise(done[0]):
            done = sharper(closer(parent, done, screen, tried, budget))
        if done and (at_noise(done[0]) or taken(parent, done[0]) > MOST_OF_IT):
            promise = SHARE * max(one.screened for one in done)
            if not rest or rest[0].reduction < promise:
                break
    return done


def sharper(named: Sequence[Named]) -> list[Named]:
    """Fits, best first, those near the best with dry friction as sharp as it takes to tell them apart."""
    out = sorted(named, key=lambda one: one.cost)
    near = [i for i, one in enumerate(out[:SHARPER]) if one.cost < NEAR * out[0].cost]
    for i in near:
        out[i] = replace(out[i], fit=resolved(out[i].fit))
    out.sort(key=lambda one: one.cost)
    out[:1] = [sharpest(one) for one in out[:1]]
    return sorted(out, key=lambda one: one.cost)


def sharpest(named: Named) -> Named:
    """A fit that is not at the noise with its friction as sharp as ever pays: no further cause is to be sought for what
    smooth friction leaves."""
    return named if at_noise(named) else replace(named, fit=resolved(named.fit, UTMOST))


def simplified(named: Sequence[Named], tried: set[tuple[Cause, ...]]) -> list[Named]:
    """Fits, best first, with those of the simpler kinds that the best and those near it may pass for."""
    out = {one.causes: one for one in named}
    near = [one for one in named[:SHARPER] if one.cost < NEAR * named[0].cost and one.causes not in tried]
    for one in near:
        tried.add(one.causes)
        for trial in _simpler(one):
            try:
                fit = fitted(trial, one.fit)
            except (FloatingPointError, np.linalg.LinAlgError, ValueError):
                continue
            if trial.causes not in out or fit.cost < out[trial.causes].fit.cost:
                out[trial.causes] = Named(trial, fit, one.screened)
    return sorted(out.values(), key=lambda one: one.cost)


def _simpler(named: Named) -> Iterator[Trial]:
    """Trials of a fit with simpler kinds in the place of its last cause."""
    cause, fit, system = named.causes[-1], named.fit, named.trial.system
    value = dict(zip(fit.problem.model.parameters, (float(x) for x in fit.problem.unpack(fit.v)[0]), strict=True))
    parameters = {key: fit.values[name] for key, name in cause.names().items()}
    rest = without_cause(named.trial, len(named.causes) - 1, fit)
    there = {(other.kind, other.at) for other in rest.causes}
    for kind, at, own in EFFECTS[cause.kind].simpler(cause.at, parameters, value, system):
        if (kind, at) not in there and not (EFFECTS[kind].replaces_quantity and system.parameters[at].uncertain):
            yield added(rest, fit, kind, at, own)


def taken(parent: Named, child: Named) -> float:
    """Share of the misfit beyond noise that a further cause takes; 1 where there is hardly any misfit."""
    count = float(parent.fit.problem.data.samples.sum())
    excess = parent.fit.cost - count
    gain = parent.fit.cost - child.fit.cost
    return min(gain / excess, 1.0) if excess > max(gain, 0.0) else float(gain > 0)


def closer(
    parent: Named,
    named: Sequence[Named],
    screen: Screen,
    tried: set[tuple[Cause, ...]],
    budget: Budget,
    most: int = 2,
) -> list[Named]:
    """Fit the best few again from short simulations, for those whose long one may have slipped into a false minimum."""
    motion = np.concatenate(parent.fit.problem.states(parent.fit.v))
    motion = screen.leftover.added_to(parent.fit.problem.model.states, motion)
    out = list(named)
    for i, one in enumerate(named[:most]):
        if one.causes in tried or one.fit.cost > 3 * named[0].fit.cost:
            continue
        if not budget.window():
            break
        tried.add(one.causes)
        try:
            short = nearer(one.trial, parent.fit, motion)
            if short.cost > 0.9 * one.fit.cost:
                continue  # a long simulation does as well: no false minimum
            trial = replace(one.trial, values=one.trial.values | short.values, starts=(short.starts[0],))
            if len(parent.fit.problem.data.segments) > 1:
                trial = replace(trial, starts=())
            again = fitted(trial, parent.fit, 15)
        except (FloatingPointError, np.linalg.LinAlgError, ValueError):
            continue
        if any(EFFECTS[cause.kind].abrupt for cause in one.causes) and short.cost < 0.8 * again.cost:
            again = short  # free play: the long simulation is not reproducible, the windows are what can be judged
        if again.cost < one.fit.cost:
            out[i] = replace(one, trial=trial, fit=again)
    return sorted(out, key=lambda own: own.cost)
