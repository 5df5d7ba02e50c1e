"""Whether targets are met: in the closed loop and in the simulation, in frequency and in damping."""

from __future__ import annotations

from matching.frequency.search.question import Question
from matching.frequency.search.result import TargetResult
from matching.frequency.verification.verify import Verification
from modelling.modal.result import Mode

SIMULATED_FREQUENCY_TOLERANCE = 0.02  # relative, between the vehicle's frequency and what the simulated rig shows


def reached(
    frequency: float, damping_ratio: float, wanted: Mode, frequency_tolerance: float, damping_tolerance: float
) -> bool:
    """Whether a mode at a frequency (Hz) is within the tolerances: relative in frequency, absolute in damping ratio."""
    return (
        abs(frequency / wanted.frequency - 1) <= frequency_tolerance
        and abs(damping_ratio - wanted.damping_ratio) <= damping_tolerance
    )


def target_results(question: Question, checked: Verification) -> tuple[TargetResult, ...]:
    """Every target with what the closed loop and the simulation show of it."""
    return tuple(_target(question, checked, number) for number in range(len(question.targets)))


def _target(question: Question, checked: Verification, number: int) -> TargetResult:
    wanted, target = question.targets[number][1], question.case.targets[number]
    mode, on_rig = checked.targets[number].mode, question.on_rig[number]
    simulated = checked.identified[number].matched
    met = (
        mode is not None and simulated is not None
        and reached(mode.frequency, mode.damping_ratio, wanted, target.frequency_tolerance, target.damping_tolerance)
        and reached(
            simulated.frequency, simulated.damping_ratio, wanted,
            SIMULATED_FREQUENCY_TOLERANCE, target.damping_tolerance,
        )
    )  # fmt: skip
    return TargetResult(
        vehicle_mode=target.mode,
        symmetry=wanted.symmetry,
        vehicle=wanted.frequency,
        vehicle_damping=wanted.damping_ratio,
        rig=None if on_rig is None else on_rig.frequency,
        matched=None if mode is None else mode.frequency,
        matched_damping=None if mode is None else mode.damping_ratio,
        identified=None if simulated is None else simulated.frequency,
        identified_damping=None if simulated is None else simulated.damping_ratio,
        met=met,
    )
