"""Everything a tuned case is checked by, in one call."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.case.targets import target_modes
from matching.frequency.independent.check import IndependentCheck, check
from matching.frequency.loop.encirclements import Encirclements, encirclements
from matching.frequency.loop.exact_loop import ExactLoop
from matching.frequency.loop.loop_modes import LoopMode, feed_forward_modes, feedback_modes, match_mode
from matching.frequency.loop.pade import phase_error
from matching.frequency.loop.parts import Parts, parts_of
from matching.frequency.loop.poles import (
    BELIEVED,
    Approximation,
    approximations,
    neutral_motions,
    orders_for,
    resting_and_right,
    sampled_poles,
)
from matching.frequency.response.response_error import ErrorFigures, error_figures
from matching.frequency.response.responses import ComparedBed
from matching.frequency.verification.peaks import Violation, peaks_of, violations_of
from matching.frequency.verification.reading import (
    IdentifiedMode,
    identified_modes,
    manoeuvre_torques,
    of_the_targets_modes,
)
from matching.frequency.verification.robustness import Deviation, robustness
from matching.frequency.verification.simulation import Traces, simulate_case
from modelling.bed.feed_forward import FeedForward
from modelling.bed.residual_vehicle import cut
from modelling.linear.reference_motion import is_linear
from modelling.model.system import System
from modelling.simulation.result import SimulationError

COMPARED_FREQUENCIES = 20  # over the band, at which both methods have to give the same responses


class ReachedTarget(NamedTuple):
    """Number of a target mode of the vehicle, the mode that it became, None without one, and their MAC."""

    vehicle_mode: int
    mode: LoopMode | None
    mac: float


@dataclass(frozen=True)
class Verification:
    """A tuned case, checked.

    Poles, encirclements and responses are those of :mod:`matching.frequency.loop`, which the search uses as well to
    accept an end. What shares nothing with it is ``independent``: the closed loop by dynamic stiffness, straight from
    the model files; the simulation shares the models and nothing of the loop's algebra.

    Attributes
    ----------
    stable : bool
        Poles, encirclements, poles of the sampled loop, the feed-forward's poles and the simulation all say so.
    checks : dict of str to bool
        Each of them.
    spectral_abscissa : float
        1/s, largest real part of all poles: feedback loop (highest order) and feed-forward. A rigid motion that drag
        alone slows counts with its slow decay.
    modulus_margin, margin_frequency : float
        Least singular value of I + L, and where, Hz.
    margin_from : float
        Hz, from where on it counts; 0 for all frequencies.
    winding : Encirclements or None
        None where the controller has no law in the Laplace domain.
    independent : IndependentCheck
        Unstable poles, margin and responses by dynamic stiffness.
    disagreements : tuple of str
        Where it differs from what stands here; a match with any is no match.
    approximations : tuple of Approximation
        Poles of the feedback loop by order of the dead time's approximation.
    sampled : ndarray
        Poles z of the feedback loop as it is sampled.
    feed_forward_poles : ndarray
        rad/s; empty without a model-based feed-forward. Measured torques do not go round the feedback and the feedback
        does not reach the feed-forward, so the poles of both together are the poles of each.
    modes : tuple of LoopMode
        Of the feed-forward, then of the feedback loop.
    targets : tuple of ReachedTarget
        The mode that each target became: with a feed-forward among its modes.
    least_damping : tuple of (damping ratio, Hz)
        The smallest of all modes.
    identified : tuple of IdentifiedMode
        Read off the simulation.
    peaks : dict of str to float
        Largest magnitudes over the manoeuvre, by trace name of the matched rig.
    violations : tuple of Violation
        Limits of the case that are broken.
    errors : ErrorFigures
    robustness : tuple of Deviation
        Worst first.
    traces : Traces or None
        None where the loop grows out of bounds.
    notes : tuple of str
        What the user should know.
    """

    stable: bool
    checks: dict[str, bool]
    spectral_abscissa: float
    modulus_margin: float
    margin_frequency: float
    margin_from: float
    winding: Encirclements | None
    independent: IndependentCheck
    disagreements: tuple[str, ...]
    approximations: tuple[Approximation, ...]
    sampled: np.ndarray = field(repr=False)
    feed_forward_poles: np.ndarray = field(repr=False)
    modes: tuple[LoopMode, ...] = field(repr=False)
    targets: tuple[ReachedTarget, ...]
    least_damping: tuple[float, float]
    identified: tuple[IdentifiedMode, ...]
    peaks: dict[str, float]
    violations: tuple[Violation, ...]
    errors: ErrorFigures
    robustness: tuple[Deviation, ...]
    traces: Traces | None = field(repr=False)
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain values; traces are left out."""
        return {
            "stable": self.stable,
            "checks": dict(self.checks),
            "spectral_abscissa": self.spectral_abscissa,
            "modulus_margin": self.modulus_margin,
            "margin_frequency": self.margin_frequency,
            "modulus_margin_from": self.margin_from,
            "nyquist": None if self.winding is None else {
                "unstable_poles": self.winding.unstable, "open_loop_unstable_poles": self.winding.open_loop_unstable,
                "remainder": self.winding.remainder, "frequencies": len(self.winding.frequencies),
            },
            "independent": self.independent.to_dict() | {"disagreements": list(self.disagreements)},
            "poles": [
                {
                    "pade_order": approximation.order, "spectral_abscissa": approximation.abscissa,
                    "phase_error_deg": float(np.degrees(approximation.phase_error)),
                    "good_up_to": approximation.good_up_to if np.isfinite(approximation.good_up_to) else None,
                }
                for approximation in self.approximations
            ],
            "largest_sampled_pole": float(np.abs(self.sampled).max()),
            "feed_forward_spectral_abscissa": max(self.feed_forward_poles.real.tolist(), default=None),
            "least_damping": {"damping_ratio": self.least_damping[0], "frequency": self.least_damping[1]},
            "targets": [
                {
                    "vehicle_mode": target.vehicle_mode,
                    "mode": None if target.mode is None else target.mode.to_dict(),
                    "mac": target.mac,
                }
                for target in self.targets
            ],
            "identified": [mode.to_dict() for mode in self.identified],
            "peaks": dict(self.peaks),
            "violations": [violation.to_dict() for violation in self.violations],
            "robustness": [deviation.to_dict() for deviation in self.robustness],
            "notes": list(self.notes),
        }  # fmt: skip


def verify(
    case: Case, untuned: System | None = None, *, deviations: bool = True, margin_from: float = 0.0
) -> Verification:
    """Check a tuned case.

    Parameters
    ----------
    untuned : System, optional
        The rig before it was tuned, which the figures compare with; the case's own unless given.
    deviations : bool
        Whether to work out :attr:`Verification.robustness`, about half of the time.
    margin_from : float
        Hz, from where on the modulus margin counts, that of the deviations too; the winding counts all frequencies.

    Raises
    ------
    InputError
        If a model cannot be made linear or the feed-forward has no solution.
    """
    parts = parts_of(case, untuned=untuned)
    reference = cut(case.emulated_vehicle, case.rig)
    feed_forward = case.loop.structure.feed_forward(case.rig, reference, case.loop)
    neutral = neutral_motions(parts)
    notes: list[str] = []
    winding, sampled, delay = encirclements(parts), sampled_poles(parts), case.loop["dead_time"]
    orders = approximations(parts, orders=orders_for(delay, winding.gain_edge))
    counted = _believed(orders, delay, winding.gain_edge, notes)
    checks = {f"poles, order {mode.order}": mode.unstable(neutral) == 0 for mode in counted}
    checks["Nyquist criterion"] = winding.unstable == 0 and winding.clear and winding.resting <= neutral
    independent = _independent(case, parts)
    if independent.unstable_poles is not None:
        checks["dynamic stiffness"] = independent.unstable_poles == 0
    if independent.not_covered:
        notes.append(f"not checked by the independent method, which does not cover {independent.not_covered}")
    checks["sampled loop"] = inside(sampled, neutral)
    feed_forward_poles = np.zeros(0, complex) if feed_forward is None else feed_forward.poles
    if feed_forward is not None:
        checks["feed-forward poles"] = resting_and_right(feed_forward_poles, neutral)[1] == 0
    traces, identified = _simulated(parts, feed_forward, notes)
    checks["simulation"] = traces is not None
    designed = () if feed_forward is None else feed_forward_modes(parts, feed_forward, reference)
    every = (*designed, *feedback_modes(parts, orders[-1].order))
    swinging = [(mode.damping_ratio, mode.frequency) for mode in every if mode.frequency > 0]
    peaks = {} if traces is None else peaks_of(parts, traces)
    errors, targets = error_figures(case, parts, feed_forward), target_modes_of(case, designed or every)
    least = min(swinging, default=(1.0, 0.0))
    above = encirclements(parts, margin_from=margin_from) if margin_from > 0 else winding
    return Verification(
        all(checks.values()), checks,
        float(max(orders[-1].abscissa, *feed_forward_poles.real) if len(feed_forward_poles) else orders[-1].abscissa),
        above.modulus_margin, above.margin_frequency, margin_from, winding, independent,
        tuple(independent.disagreements(winding.unstable == 0, winding.modulus_margin)),
        orders, sampled, feed_forward_poles, every, targets, least,
        of_the_targets_modes(identified, (target.mode for target in targets), every), peaks,
        violations_of(case, peaks, above.modulus_margin, least), errors,
        robustness(parts, feed_forward, errors.nodes, orders[-1].order, margin_from) if deviations else (), traces,
        (*notes, *remarks_on(case, neutral)),
    )  # fmt: skip


def _simulated(
    parts: Parts, feed_forward: FeedForward | None, notes: list[str]
) -> tuple[Traces | None, tuple[IdentifiedMode, ...]]:
    """The manoeuvre and the modes identified from it; no traces, and why in the notes, where the loop runs away."""
    try:
        traces = simulate_case(parts, feed_forward, *manoeuvre_torques(parts))
        return traces, identified_modes(parts, feed_forward, traces)
    except SimulationError as fault:
        notes.append(f"simulation: {fault.wrong}")
        return None, tuple(IdentifiedMode(target.mode, None, None, "nothing") for target in parts.case.targets)


def remarks_on(case: Case, neutral: int) -> list[str]:
    """What of case and simulation differs, in sentences; ``neutral`` rigid motions coast."""
    remarks = []
    if not is_linear(case.vehicle) or not all(is_linear(part) for part in case.residual_vehicle.parts):
        remarks.append("the controller's residual vehicle is linear; the simulated vehicle has all its effects")
    if case.loop["dead_time"] < case.loop["sample_time"] / 2:
        remarks.append("the hold of a sample alone takes longer than the dead time: simulated with the hold")
    if neutral:
        rigid = "1 rigid motion stands" if neutral == 1 else f"{neutral} rigid motions stand"
        remarks.append(f"{rigid} at 0 without drag and coast, as in the vehicle")
    return remarks


def _independent(case: Case, parts: Parts) -> IndependentCheck:
    """The vehicle and the feedback loop with continuous control, by dynamic stiffness."""
    frequencies = np.geomspace(*case.band, COMPARED_FREQUENCIES)
    pairs = [(pair.input, pair.sensor) for pair in case.compared]
    inputs, sensors = ([*dict.fromkeys(names)] for names in zip(*pairs, strict=True))
    H = ExactLoop(parts).response(2j * np.pi * frequencies, inputs, sensors)
    controlled = np.stack([H[:, sensors.index(sensor), inputs.index(source)] for source, sensor in pairs], axis=1)
    return check(case, frequencies, ComparedBed(case, parts).of_vehicle(frequencies), controlled)


def inside(z: np.ndarray, neutral: int) -> bool:
    """Whether poles z (x,) are stable, of which ``neutral`` may rest at 1."""
    on = np.abs(z - 1) < 1e-9
    return int(on.sum()) <= neutral and bool(np.all(np.abs(z[~on]) < 1))


def _believed(orders: tuple[Approximation, ...], delay: float, edge: float, notes: list[str]) -> list[Approximation]:
    """The approximations that are good as far as the loop has gain, and the highest order whatever it is."""
    errors = [float(phase_error(delay, order.order, np.array([edge]))[0]) for order in orders]
    poor = [str(order.order) for order, error in zip(orders[:-1], errors[:-1], strict=True) if error > BELIEVED]
    if poor:
        notes.append(
            f"poles with the dead time approximated to order {', '.join(poor)} do not count: "
            f"more than 5° off at {edge:.0f} Hz, where the loop still has gain"
        )
    if errors[-1] > BELIEVED:
        notes.append(f"even order {orders[-1].order} misses {np.degrees(errors[-1]):.0f}° of the dead time there")
    return [order for order, error in zip(orders, errors, strict=True) if error <= BELIEVED or order is orders[-1]]


def target_modes_of(case: Case, candidates: tuple[LoopMode, ...]) -> tuple[ReachedTarget, ...]:
    """For every target the mode that it became."""
    inertia = {f"inertias.{inertia.name}": inertia.J.value for inertia in case.vehicle.inertias}
    reached = []
    for target, (_, wanted) in zip(case.targets, target_modes(case), strict=True):
        best = match_mode(wanted, candidates, inertia)
        reached.append(ReachedTarget(target.mode, *(best or (None, 0.0))))
    return tuple(reached)
