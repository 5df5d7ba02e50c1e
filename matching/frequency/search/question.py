"""What a match is asked for, worked out once from its case, and what the search may spend on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.case.demands import Demands, demands
from matching.frequency.case.targets import target_modes
from matching.frequency.case.weights import counterparts, shares_of
from matching.frequency.solver.task import Near
from modelling.modal.modes import modes
from modelling.modal.result import Mode

SAME_VALUE = 1e-9  # relative: so near two values of a file are one

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Question:
    """A case with what follows from it.

    Attributes
    ----------
    targets : list of (Mode, Mode)
        Each target mode of the vehicle, undamped and damped.
    on_rig : sequence of Mode or None
        The rig's mode that corresponds to each.
    shares : ndarray (moves,)
        Largest share of each move in the energy of a target mode.
    demands : Demands
        What the vehicle's manoeuvre asks of adapters and dynamometers.
    """

    case: Case
    targets: list[tuple[Mode, Mode]]
    on_rig: Sequence[Mode | None]
    shares: np.ndarray
    demands: Demands


@dataclass(frozen=True)
class SearchEffort:
    """Seed of the random starts, most of them, processes, whom to tell, and solutions to start from instead.

    With ``ordering`` adapters that gain nothing stay as planned.
    """

    seed: int
    starts: int
    workers: int
    tell: Progress
    near: Near | None
    ordering: bool


def question_of(case: Case) -> Question:
    """Work out targets, weights and demands.

    Raises
    ------
    InputError
        If the case cannot be worked on as it stands.
    """
    on_rig = counterparts(case)
    return Question(case, target_modes(case), on_rig, shares_of(case, modes(case.vehicle), on_rig), demands(case))


def differing_components(case: Case) -> list[str]:
    """A sentence for every shared quantity whose values differ, largest ratio first."""
    vehicle, rig = case.vehicle.parameters, case.rig.parameters
    differing = []
    for name in rig:
        if name not in vehicle:
            continue
        here, there = rig[name].value, vehicle[name].value
        off = abs(here - there) / max(abs(here), abs(there), 1e-300)
        if off > SAME_VALUE:
            unit = case.rig.units[name]
            words = (
                f"{name} is {there:g} {unit} in the vehicle and {here:g} {unit} on the rig: "
                "a component that both have under one name is the same hardware, so the two should agree"
            )
            differing.append((-off, words))
    return [words for _, words in sorted(differing)]
