"""Tuning of an observer's weights over drawn beds: least squares of the beds' errors, with what has to be kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares

from matching.frequency.beds.closed_loop import BedSet, bed_set
from matching.frequency.beds.figures import BED_POINTS, Planned, bed_figures, loop_figures, planned
from matching.frequency.beds.requirements import Requirements, requirements
from matching.frequency.case.case import Case
from modelling.bed.observer_design import Ahead, assembled, correction, runs_ahead, state_feedback
from modelling.bed.observer_model import ObserverModel, observer_model
from modelling.bed.residual_vehicle import cut
from modelling.bed.sampled_controller import SampledController
from modelling.common.errors import InputError

DRAWN = 24  # beds that the weights are tuned over
RESERVE = 0.05  # relative, by which requirements are drawn in: least squares ends a little beyond what it must keep
DAMPING_RESERVE = 0.15  # the same for the least damping, whose tail over beds is long
STIFF = 30.0  # how much a relative excess of a requirement weighs against a relative error of a bed
STEP = 0.02  # decades, of finite differences
FURTHEST = 2.0  # decades from the start
EVALUATIONS = 14  # gradients at most
SETTLED = 1e-3  # relative change of cost or weights at which the search ends
REGULATOR = ("command_weight", "command_change_weight")


@dataclass
class Tuner:
    """Cost of an observer's weights on a set of beds.

    Attributes
    ----------
    names : tuple of str
        Of the weights, in the order of the search's variables, which are their decimal logarithms.
    """

    case: Case
    model: ObserverModel
    required: Requirements
    plan: Planned
    beds: BedSet
    names: tuple[str, ...]
    ahead: Ahead
    _feedback: dict[tuple[float, ...], np.ndarray] = field(default_factory=dict)
    _corrected: dict[tuple[float, ...], np.ndarray] = field(default_factory=dict)

    def controller(self, logarithms: np.ndarray) -> SampledController:
        """The controller at a point of the search; gains that were worked out lately are kept."""
        weights = dict(zip(self.names, 10.0**logarithms, strict=True))
        of_regulator = tuple(weights[name] for name in REGULATOR)
        of_filter = tuple(weight for name, weight in weights.items() if name not in REGULATOR)
        F = _kept(self._feedback, of_regulator, lambda: state_feedback(self.model, *of_regulator))
        L = _kept(self._corrected, of_filter, lambda: correction(self.model, weights))
        return assembled(self.model, self.ahead, F, L)

    def residuals(self, logarithms: np.ndarray) -> np.ndarray:
        """What least squares makes small: errors of beds, squared so that the worst count, and relative excesses."""
        try:
            controller = self.controller(logarithms)
        except InputError:
            return np.full(len(self.beds.A) * 3 + 5, 1e3)
        told, required = self.case.loop.measured, self.required
        own = loop_figures(self.plan, controller, required)
        drawn = bed_figures(self.beds, controller, told)
        plan = bed_figures(self.plan.band, controller, told)
        tolerance, count = self.case.unmeasured_tolerance, len(self.beds.A)
        errors = 3 * np.minimum(drawn.unmeasured / tolerance, 1e3) / np.sqrt(count)
        least = required.damping_ratio * (1 + DAMPING_RESERVE)
        excess = [
            *np.maximum(1 - drawn.damping_ratio / least, 0.0),
            *np.maximum((drawn.largest_pole - 1) * 1e3, 0.0),
            _over(own.command_noise, required.command_noise),
            _over(own.largest_rolled_off, 0.5),
            max(required.modulus_margin * (1 + RESERVE) / max(own.modulus_margin, 1e-3) - 1, 0.0),
            max((plan.largest_pole[0] - 1) * 1e3, 0.0),
        ]
        return np.concatenate([errors, [plan.unmeasured[0] / tolerance], STIFF * np.array(excess)])


def _over(value: float, allowed: float | None) -> float:
    return 0.0 if allowed is None else min(max(value / allowed * (1 + RESERVE) - 1, 0.0), 1e2)


def _kept(
    store: dict[tuple[float, ...], np.ndarray], key: tuple[float, ...], make: Callable[[], np.ndarray]
) -> np.ndarray:
    if key not in store:
        if len(store) > 20:
            store.clear()
        store[key] = make()
    return store[key]


def tuner(case: Case, seed: int = 0, further: Sequence[Mapping[str, float]] = ()) -> Tuner:
    """Prepare the search: beds drawn from the case's box, and ``further`` ones by their values."""
    model = observer_model(case.rig, cut(case.vehicle, case.rig), case.loop)
    required = requirements(case)
    values = [case.uncertainty.at(position) for position in case.uncertainty.draw(DRAWN, seed)]
    beds = bed_set(case, [*values, *map(dict, further)], np.geomspace(*case.band, BED_POINTS))
    return Tuner(
        case, model, required, planned(case, required, model.readings.noise), beds,
        tuple(case.loop.structure.quantities), runs_ahead(model),
    )  # fmt: skip


def tuned_weights(search: Tuner, start: Mapping[str, float] | None = None) -> dict[str, float]:
    """Weights by name."""
    quantities = search.case.loop.structure.quantities
    begin = search.case.loop.values if start is None else start
    x = np.log10([begin[name] for name in search.names])
    bounds = [np.log10([getattr(quantities[name], side) for name in search.names]) for side in ("lower", "upper")]
    within = np.maximum(bounds[0], x - FURTHEST), np.minimum(bounds[1], x + FURTHEST)
    found = least_squares(
        search.residuals, x, jac=lambda at: _slopes(search.residuals, at), bounds=within,
        max_nfev=EVALUATIONS, ftol=SETTLED, xtol=SETTLED,
    )  # fmt: skip
    return dict(zip(search.names, (10.0**found.x).tolist(), strict=True))


def _slopes(residuals: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """Forward differences (residuals, weights)."""
    here = residuals(at)
    return np.stack([(residuals(at + STEP * unit) - here) / STEP for unit in np.eye(len(at))], axis=1)
