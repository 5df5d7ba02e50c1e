"""What the search moves, and the controllers and beds that belong to a point of it."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Generic, TypeVar

import numpy as np

from matching.match.beds import Planned
from matching.match.case import Case, Move, apply, scaled, unscaled
from matching.match.loop import (
    Bed,
    BedSet,
    SampledBeds,
    SampledController,
    beds_of,
    controller_on,
    feed_forward_of,
    linear_bed,
    side_by_side,
    without_limits,
)
from matching.match.opened import CLOSED, Opened
from matching.match.targets import change_weight
from modelling.bed.observer import (
    Ahead,
    Feedback,
    Filter,
    ObserverModel,
    assembled,
    feedback_on_all,
    feedback_slopes,
    filter_of,
    filter_slopes,
    observer_model,
    predicted,
    runs_ahead,
)

# --- What the search works with.


@dataclass(frozen=True)
class SearchSettings:
    """Numbers of the search. Where no source is given, a number was chosen by trial on the reference and drawn cases.

    Attributes
    ----------
    drawn : int
        Beds whose response errors are the cost.
    pool : int
        Beds that have to stay damped; of these the search sees the least damped ones.
    active : int
        Beds of the pool that are added to the active set at a time: twice as many come to the same ends and take a
        sixth more time.
    rounds, steps, most_steps : int
        Rounds of SQP at most, steps of each, and steps of all rounds together from one start.
    joint_rounds : int
        Rounds in which residual vehicle and adapters move together with the controller.
    restarts : int
        Times that the search of a feedback law begins again from its end, as long as that is worth a round.
    opened : bool
        Whether beds with opened cut shafts have to stay stable, where the case asks for it.
    play_is_worth : float
        Relative increase of an error beyond its tolerance at which a controller that keeps beds with free play at rest
        is delivered rather than one that does not.
    less_noise, noise_step : float
        Where beds with free play are not kept: times less noise of the sensors from which the search comes back, and by
        which factor from step to step. On drawn beds with encoders of 512 to 4096 counts steps of 1.4 stayed in the
        valley.
    scenarios : int
        Times that the least damped beds of the whole box are added to the pool.
    blind : int
        Settings scattered about the best end (Sobol 1967) where every start of an observer's search misses a
        requirement or a tolerance; without any a feedback law's gains are not spread over their bounds either.
    followed : int
        The best of these, which are followed. On a drawn bed that three starts left with an error of 0.39, 11 of the 16
        best of four scatters came to 0.30.
    decides : bool
        The search of a feedback law ends with the first controller that keeps every requirement and tolerance: whether
        a changed case can be matched is decided then. A search that goes on delivers nothing that costs more. An
        observer that keeps no free play is not looked for: with it the case is not matched.
    remedies : bool
        Whether what may help a limited case is tried, by solving it again, and said.
    starts : int
        Starts that are followed; an observer's search stops at the first one that keeps every requirement.
    emulated : float
        s that the exported controller runs at rest and at speed before a match is called one; 0 leaves it out.
    fresh : int
        Beds that judge the result; none of them is seen by the search.
    weight_planned : float
        Weight of the bed as planned, next to the mean of the drawn beds.
    weight_change : float
        Cost of a quantity that moves over its whole range and holds all energy of a target mode; what holds less costs
        more, by Eqs. 6 to 8.
    reserve, damping_reserve : float
        Relative, by which requirements are drawn in: the search works on coarser grids than the judge, and the least
        damping over beds has a long tail.
    error_reserve : float
        The same for the tolerances of the errors, which search and judge work out alike to this.
    penalty : float
        Cost of a requirement missed by all of it, by which points are compared.
    error_penalty : float
        The same of a tolerance that an error misses: less, since a controller that is not robust cannot be run, and one
        whose error is too large can.
    stable_share : float
        Of the damping that drawn beds need, for beds that only have to be stable.
    largest_room : float
        Relative constraint margin above which a requirement does not steer the search.
    worst : float
        Largest squared error over its scale that counts, and the cost of a setting without a controller.
    furthest : float
        Decades of a weight, or share of a range, that a round may go.
    worth_a_round : float
        Relative gain of a round below which no other follows.
    worth_at_all : float
        The same, absolute: thousandths of the squared scale of an error.
    settled : float
        Change of the cost at which a round ends.
    points_a_step : int
        Points that a round may judge for each step: where line searches come to nothing, it ends.
    kept : float
        Relative constraint margin from which a requirement counts as met: within its reserve.
    hopeless : float
        Merit after a round above which no other follows, and cost above which no adapter is worth ordering for.
    calmer : tuple of float
        Shares of the controller's quantities above their lower bounds that are tried where the end is not stable.
    difference : float
        Half the step of central differences, decades or share of a range: error of the sixth digit.
    inset : float
        Share of a range by which bounds are drawn in: at a bound of 0 a lead or an integrator would lose its state.
    """

    drawn: int = 24
    pool: int = 160
    active: int = 6
    rounds: int = 6
    steps: int = 20
    most_steps: int = 200
    joint_rounds: int = 3
    restarts: int = 3
    opened: bool = True
    play_is_worth: float = 0.05
    less_noise: float = 8.0
    noise_step: float = 1.4
    scenarios: int = 2
    blind: int = 64
    followed: int = 4
    decides: bool = False
    remedies: bool = True
    starts: int = 4
    fresh: int = 200
    emulated: float = 60.0
    weight_planned: float = 0.1
    weight_change: float = 1e-3
    reserve: float = 0.03
    damping_reserve: float = 0.1
    error_reserve: float = 0.005
    penalty: float = 10.0
    error_penalty: float = 1.0
    stable_share: float = 0.1
    largest_room: float = 1.0
    worst: float = 1e3
    furthest: float = 1.0
    worth_a_round: float = 0.01
    worth_at_all: float = 1e-3
    settled: float = 1e-4
    points_a_step: int = 4
    kept: float = -2e-3
    hopeless: float = 50.0
    calmer: tuple[float, ...] = (1.0, 0.9, 0.7, 0.5, 0.35, 0.25, 0.12, 0.06, 0.0)
    difference: float = 1e-4
    inset: float = 5e-4


CONTROLLER, RESIDUAL, RIG = "loop.", "residual_vehicle.", "rig."  # the names of quantities begin so
REGULATOR = "command_weight", "command_change_weight"  # of the observer's state feedback; the others are the filter's


@dataclass(frozen=True)
class Variable:
    """A quantity that the search moves; its coordinate runs from 0 to ``span``: decades of a weight, else 1."""

    move: Move
    span: float
    weight: float

    @property
    def name(self) -> str:
        """As under ``[move]``."""
        return self.move.name

    def at(self, value: float) -> float:
        """Coordinate of a value, SI."""
        return self.span * scaled(float(np.clip(value, self.move.lower, self.move.upper)), self.move)

    def value(self, x: float) -> float:
        """Value, SI, at a coordinate."""
        return float(unscaled(x / self.span, self.move))


def variables_of(case: Case, moves: Sequence[Move], shares: Mapping[str, float]) -> tuple[Variable, ...]:
    """The weights of an observer, unless it is fixed, then what may move.

    ``shares`` are those of the target modes' energy by name.
    """
    made = []
    if case.loop.tunes_observer:
        for name, known in case.loop.structure.quantities.items():
            move = Move(
                f"{CONTROLLER}{name}", (f"{CONTROLLER}{name}",), case.loop[name], known.lower, known.upper, known.unit,
                case.loop[name],
            )  # fmt: skip
            made.append(Variable(move, float(np.log10(known.upper / known.lower)), 0.0))
    for move in moves:
        if move.name.startswith(CONTROLLER):
            if not case.loop.tunes_observer:
                made.append(Variable(move, 1.0, 0.0))
        else:
            made.append(Variable(move, 1.0, change_weight(shares.get(move.name, 1.0))))
    return tuple(made)


# --- The controller and the beds at a point of the search. Beds depend on the quantities of the rig alone.

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")


class Recent(Generic[Key, Value]):
    """The one cache of the search: the values that were asked for last, each worked out once.

    Parameters
    ----------
    most : int
        How many are kept; the one that was not asked for longest goes first.
    """

    def __init__(self, most: int):
        self._most = most
        self._kept: dict[Key, Value] = {}

    def at(self, key: Key, made: Callable[[], Value]) -> Value:
        """The value of a key, worked out if it is not there."""
        value = self._kept.pop(key) if key in self._kept else made()
        self._kept[key] = value
        if len(self._kept) > self._most:
            del self._kept[next(iter(self._kept))]
        return value

    def __contains__(self, key: Key) -> bool:
        return key in self._kept

    def clear(self) -> None:
        """Forget all."""
        self._kept.clear()


DESIGNS, BEDS, SETS, POINTS = 40, 4000, 6, 6  # kept: designs of a kind, single beds, sets of beds, points


class Controllers:
    """The controllers of a case by values (SI): models and gains that were worked out lately are kept."""

    def __init__(self, case: Case):
        self.case = case
        self._designs: Recent[tuple[Any, ...], Any] = Recent(4 * DESIGNS)  # of four kinds

    def at(self, values: Mapping[str, float]) -> SampledController:
        """The controller with quantities at other values than the case's."""
        case = apply(self.case, values)
        of_bed = tuple(value for name, value in values.items() if not name.startswith(CONTROLLER))
        if not case.loop.structure.is_observer:
            of_rig = tuple(value for name, value in values.items() if name.startswith(RIG))
            bed = self._kept("bed", of_bed, lambda: linear_bed(case))
            feed_forward = self._kept("feed-forward", of_rig, lambda: feed_forward_of(case))
            return controller_on(replace(bed, case=case), feed_forward)
        model, ahead, feedback, estimate = self._observer(case, of_bed)
        gains = predicted(model, feedback.F, feedback.of_torques)
        return without_limits(assembled(model, ahead, gains, estimate.correction))

    def weight_slopes(self, values: Mapping[str, float], names: Sequence[str]) -> list[np.ndarray]:
        """What a decade of each of some weights of an observer changes of the controller's matrices."""
        case = apply(self.case, values)
        of_bed = tuple(value for name, value in values.items() if not name.startswith(CONTROLLER))
        model, ahead, feedback, estimate = self._observer(case, of_bed)
        gains, correction = predicted(model, feedback.F, feedback.of_torques), estimate.correction
        of_filter = [name for name in names if name not in REGULATOR]
        loop = case.loop.values
        slopes = feedback_slopes(model, feedback, *(loop[name] for name in REGULATOR))
        by_gains = dict(zip(REGULATOR, slopes, strict=True))
        by_correction = dict(zip(of_filter, filter_slopes(model, estimate, loop, of_filter), strict=True))

        def ended(of_gains: np.ndarray | float, of_correction: np.ndarray | float) -> np.ndarray:
            return block(without_limits(assembled(model, ahead, gains + of_gains, correction + of_correction)))

        here = ended(0.0, 0.0)  # the matrices are linear in the gains
        return [ended(by_gains.get(name, 0.0), by_correction.get(name, 0.0)) - here for name in names]

    def _observer(self, case: Case, of_bed: tuple[float, ...]) -> tuple[ObserverModel, Ahead, Feedback, Filter]:
        loop = case.loop.values
        model, ahead = self._kept("model", of_bed, lambda: self._model(case))
        regulator = tuple(loop[name] for name in REGULATOR)
        of_filter = tuple(loop[name] for name in case.loop.structure.quantities if name not in REGULATOR)
        feedback = self._kept("feedback", (*of_bed, *regulator), lambda: feedback_on_all(model, *regulator))
        return model, ahead, feedback, self._kept("filter", (*of_bed, *of_filter), lambda: filter_of(model, loop))

    def _model(self, case: Case) -> tuple[ObserverModel, Ahead]:
        model = observer_model(case.rig, case.residual_vehicle, case.loop)
        return model, runs_ahead(model)

    def _kept(self, kind: str, key: tuple[float, ...], design: Callable[[], Value]) -> Value:
        made: Value = self._designs.at((kind, *key), design)
        return made


def block(controller: SampledController) -> np.ndarray:
    """[A B; C D] (x + k, x + y + w)."""
    return np.block([[controller.A, controller.B], [controller.C, controller.D]])


@dataclass(frozen=True)
class Hardware:
    """The beds with certain adapters: as planned, those whose errors are the cost, and others by their places."""

    case: Case
    plan: Planned
    beds: BedSet
    others: Recent[tuple[bytes, Opened], Bed] = field(default_factory=lambda: Recent(BEDS))
    sets: Recent[tuple[bytes, tuple[Opened, ...]], SampledBeds] = field(default_factory=lambda: Recent(SETS))

    def beds_at(self, positions: np.ndarray, opened: Sequence[Opened] = ()) -> SampledBeds:
        """Beds at positions (b, p) of the case's box, cut shafts closed or each with its own opening.

        Each, and each set, is worked out once.
        """
        ways = tuple(opened) or (CLOSED,) * len(positions)

        def made() -> SampledBeds:
            keys = [(position.tobytes(), way) for position, way in zip(positions, ways, strict=True)]
            new = [i for i, key in enumerate(keys) if key not in self.others]
            values = [ways[i].values(self.case, self.case.uncertainty.at(positions[i])) for i in new]
            found = dict(zip(new, beds_of(self.case, values), strict=True))
            return side_by_side([self.others.at(key, partial(found.__getitem__, i)) for i, key in enumerate(keys)])

        return self.sets.at((positions.tobytes(), ways), made)
