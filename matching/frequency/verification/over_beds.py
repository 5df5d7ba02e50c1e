"""The gains of a feedback law tuned over drawn beds, and the end judged on fresh ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from matching.frequency.beds.requirements import requirements
from matching.frequency.case.case import Case, Move
from matching.frequency.case.tuned import apply
from matching.frequency.verification.drawn_beds import on_drawn_beds
from matching.frequency.verification.feedback_gains import DrawnBeds, drawn_beds, tuned_over_beds
from matching.frequency.verification.observed import RobustVerification
from matching.frequency.verification.peaks import Violation
from matching.frequency.verification.verify import Verification, verify
from modelling.bed.loop import HARDWARE
from modelling.common.errors import InputError
from modelling.model.system import System

MIDDLE = 0.6  # of every gain's scaled range: one of the points from which is searched
MARGIN = "modulus_margin"


@dataclass(frozen=True)
class TunedOverBeds:
    """A case whose gains were tuned over beds.

    ``values`` are those of the moves by name, SI, ``as_cut`` whether the residual vehicle is as cut from the vehicle.
    """

    tuned: Case
    values: Mapping[str, float]
    as_cut: bool
    robust: RobustVerification

    def sentence(self) -> str:
        """For the notes of a match."""
        kept = "the residual vehicle stays as it is cut from the vehicle" if self.as_cut else "the rest stays as found"
        return (
            f"the gains were tuned over drawn beds, with the modulus margin counted from "
            f"{self.robust.required.margin_from:.3g} Hz on, above the emulated modes; {kept}; "
            "what to order, its errors and the objective are those of the gains before that"
        )


def over_beds(
    tuned: Case, untuned: System, moves: Sequence[Move], count: int, seed: int
) -> TunedOverBeds | None:  # fmt: skip
    """Tune the gains over beds, from those of a case and from the middle, and judge the end on fresh beds.

    Parameters
    ----------
    tuned : Case
        As the programme left it; its adapters stay.
    untuned : System
        The rig before it was tuned.
    moves : sequence of Move
        What may move; without a gain among them there is no answer.
    count, seed : int
        Of the fresh beds.
    """
    gains = [move for move in moves if move.name.startswith("loop.")]
    residual = [move for move in moves if move.name.startswith("residual_vehicle.")]
    if not gains or tuned.loop.torqueless:
        return None
    planned = {name: move.planned for move in residual for name in move.together}
    middle = {move.name: _middle(move) for move in gains}
    begins = [({}, not residual), (planned, True), ({**planned, **middle}, True)]
    known: dict[tuple[float, ...], DrawnBeds] = {}
    ends = []
    for values, as_cut in begins:
        case = apply(tuned, values)
        hardware = tuple(case.loop[name] for name in HARDWARE)  # beside the rig all that the beds depend on
        try:
            if hardware not in known:
                known[hardware] = drawn_beds(case)
            of_gains, judged = tuned_over_beds(case, gains, known[hardware])
        except InputError:
            continue
        ends.append((judged.merit, {**values, **of_gains}, as_cut))
    if not ends:
        return None
    _, values, as_cut = min(ends, key=lambda end: end[0])
    case = apply(tuned, values)
    checked = verify(case, untuned, margin_from=requirements(case).margin_from)
    robust = on_drawn_beds(case, checked, count, seed)
    return TunedOverBeds(case, values, as_cut, replace(robust, verification=_margin_above(case, robust)))


def _middle(move: Move) -> float:
    """Evenly in the logarithm where the bounds have one."""
    if move.lower > 0:
        return float(move.lower * (move.upper / move.lower) ** MIDDLE)
    return move.lower + MIDDLE * (move.upper - move.lower)


def _margin_above(case: Case, robust: RobustVerification) -> Verification:
    """The verification with the margin of the controller as it runs."""
    checked, loop, allowed = robust.verification, robust.loop, case.limits[MARGIN]
    violations = tuple(violation for violation in checked.violations if violation.limit != MARGIN)
    if loop.modulus_margin < allowed:
        violations = (Violation(MARGIN, "feedback loop", loop.modulus_margin, allowed), *violations)
    return replace(
        checked, modulus_margin=loop.modulus_margin, margin_frequency=loop.margin_at, violations=violations
    )  # fmt: skip
