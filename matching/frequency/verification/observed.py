"""Checks of a tuned case whose controller is an observer: one sampled loop for measured and unmeasured torques."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matching.frequency.beds.closed_loop import bed_set, closed_matrices, sampled_beds
from matching.frequency.beds.figures import LoopFigures, bed_figures, loop_figures, planned
from matching.frequency.beds.requirements import Requirements, requirements
from matching.frequency.case.case import Case
from matching.frequency.independent.beds_check import BedsCheck, check_beds
from matching.frequency.independent.check import IndependentCheck
from matching.frequency.loop.loop_modes import LoopMode, feed_forward_modes
from matching.frequency.loop.parts import Parts, parts_of
from matching.frequency.loop.poles import neutral_motions, resting_and_right
from matching.frequency.response.observed import ObservedBed
from matching.frequency.response.response_error import figures_of
from matching.frequency.verification.peaks import peaks_of, violations_of
from matching.frequency.verification.reading import (
    IdentifiedMode,
    identified_modes,
    manoeuvre_torques,
    of_the_targets_modes,
)
from matching.frequency.verification.robustness import Deviation
from matching.frequency.verification.simulation import Traces, simulate_case
from matching.frequency.verification.verify import Verification, inside, remarks_on, target_modes_of
from modelling.bed.observer.design import regulator
from modelling.bed.observer.model import observer_model
from modelling.bed.observer_controller import ObserverController
from modelling.bed.residual_vehicle import ResidualVehicle, cut
from modelling.common.errors import InputError
from modelling.controller.law import law_of_observer
from modelling.model.mirror import mirror_image
from modelling.model.system import System
from modelling.simulation.result import SimulationError

JUDGES_BEDS = "the observer on the bed as planned: it judges drawn beds"
FRESH = 1_000_003  # added to the seed: beds that the search has not drawn
RELATIVE_CHANGE, DEAD_TIME_CHANGE = 0.05, 5e-4  # of a stiffness or inertia; s: one quantity wrong at a time


@dataclass(frozen=True)
class RobustVerification:
    """A tuned observer, checked, with what its beds and its loop do.

    Attributes
    ----------
    verification : Verification
    required : Requirements
    loop : LoopFigures
    beds : BedsCheck
        By code that the search does not use.
    """

    verification: Verification
    required: Requirements
    loop: LoopFigures
    beds: BedsCheck
    dynamometers: tuple[str, ...]


def verify_observer(case: Case, untuned: System | None, *, seed: int, beds: int) -> RobustVerification:
    """Check a tuned case with an observer.

    Parameters
    ----------
    untuned : System or None
        The rig before it was tuned, which the figures compare with.
    seed, beds : int
        Of the fresh beds, and how many.

    Raises
    ------
    InputError
        If a model cannot be made linear or the design has no solution.
    """
    parts, reference = parts_of(case, untuned=untuned), cut(case.emulated_vehicle, case.rig)
    model = observer_model(case.rig, reference, case.loop)
    controller = controller_of(case)
    required, neutral = requirements(case), neutral_motions(parts)
    figures = loop_figures(planned(case, model.readings.noise), controller, required)
    poles = np.linalg.eigvals(closed_matrices(sampled_beds(case, [{}]), controller)[0])
    ahead = regulator(model)
    fresh = check_beds(
        case, law_of_observer(controller), required.damping_ratio, beds, seed + FRESH, required.rolled_off_from
    )
    checks = {
        "sampled loop": inside(poles, neutral),
        "feed-forward poles": resting_and_right(ahead.poles, neutral)[1] == 0,
    }
    notes = remarks_on(case, neutral)
    traces, identified = _simulated(parts, controller, checks, notes)
    modes = _modes(case, parts, reference)
    targets = target_modes_of(case, modes)
    swinging = [(mode.damping_ratio, mode.frequency) for mode in modes if mode.frequency > 0]
    peaks = {} if traces is None else peaks_of(parts, traces)
    least = min(swinging, default=(1.0, 0.0))
    verification = Verification(
        all(checks.values()), checks, float(np.log(np.abs(poles).max()) / controller.sample_time),
        figures.modulus_margin, figures.margin_at, required.margin_from, None, IndependentCheck(JUDGES_BEDS),
        (), (), poles, ahead.poles, modes, targets, least,
        of_the_targets_modes(identified, (target.mode for target in targets), modes), peaks,
        violations_of(case, peaks, figures.modulus_margin, least),
        figures_of(ObservedBed(case, parts, controller)), _deviations(case, controller), traces, tuple(notes),
    )  # fmt: skip
    return RobustVerification(verification, required, figures, fresh, controller.dynamometers)


def controller_of(case: Case) -> ObserverController:
    """The controller of a case with an observer.

    Raises
    ------
    InputError
        If the case has another structure or the design has no solution.
    """
    made = case.loop.structure.observer(case.rig, cut(case.emulated_vehicle, case.rig), case.loop)
    if made is None:
        raise InputError(
            f"{case.path}: loop.structure", f"{case.loop.structure.name!r} is no observer", "take 'observer'"
        )
    return made


def _simulated(
    parts: Parts, controller: ObserverController, checks: dict[str, bool], notes: list[str]
) -> tuple[Traces | None, tuple[IdentifiedMode, ...]]:
    """Traces of the manoeuvre and the target modes read off them; the check and its note are added."""
    nothing = tuple(IdentifiedMode(target.mode, None, None, "nothing") for target in parts.case.targets)
    try:
        traces = simulate_case(parts, controller, *manoeuvre_torques(parts))
        identified = identified_modes(parts, controller, traces)
    except SimulationError as fault:
        checks["simulation"] = False
        notes.append(f"simulation: {fault.wrong}")
        return None, nothing
    checks["simulation"] = True
    return traces, identified


def _modes(case: Case, parts: Parts, reference: ResidualVehicle) -> tuple[LoopMode, ...]:
    """Modes of bed and residual vehicle under the state feedback, which every torque shows."""
    model = observer_model(case.rig, reference, case.loop)
    loop = case.loop
    feedback = regulator(model, loop["command_weight"], loop["command_change_weight"])
    return feed_forward_modes(parts, feedback, reference, "feedback")


def _deviations(case: Case, controller: ObserverController) -> tuple[Deviation, ...]:
    """Every stiffness and inertia of the rig 5 % off either way, the dead time 0.5 ms; worst first."""
    rows: list[tuple[str, float, dict[str, float]]] = []
    done: set[str] = set()
    for name, quantity in case.rig.parameters.items():
        if name in done or name.rsplit(".", 1)[1] not in ("J", "stiffness") or name.count(".") != 2:
            continue
        together = {name, mirror_image(name, case.rig)}
        done |= together
        for change in (RELATIVE_CHANGE, -RELATIVE_CHANGE):
            rows.append(
                (f"rig.{name}", change, {f"rig.{member}": quantity.value * (1 + change) for member in together})
            )
    for change in (DEAD_TIME_CHANGE, -DEAD_TIME_CHANGE):
        late = max(case.loop["dead_time"] + change, 0.0)
        if late != case.loop["dead_time"]:
            rows.append(("loop.dead_time", late - case.loop["dead_time"], {"loop.dead_time": late}))
    beds = bed_set(case, [values for _, _, values in rows], np.geomspace(*case.band, 100))
    figures = bed_figures(beds, controller, case.loop.measured)
    abscissa = np.log(figures.largest_pole) / controller.sample_time
    deviations = [
        Deviation(name, change, bool(stable), float(at), None, float(error))
        for (name, change, _), stable, at, error in zip(
            rows, figures.stable(), abscissa, figures.unmeasured, strict=True
        )
    ]
    return tuple(sorted(deviations, key=lambda deviation: (deviation.stable, -deviation.response_error)))
