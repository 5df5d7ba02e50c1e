"""The programme of a case, as a match sets it up."""

from matching.frequency.case.case import Case
from matching.frequency.case.demands import demands
from matching.frequency.case.targets import target_modes
from matching.frequency.case.weights import counterparts, released_moves, shares_of
from matching.frequency.search.solve_and_verify import task_of
from matching.frequency.solver.task import Task
from modelling.modal.modes import modes


def programme_of(case: Case) -> Task:
    """With fixed parameters fixed, and none released."""
    shares = shares_of(case, modes(case.vehicle), counterparts(case))
    return task_of(case, shares, released_moves(case, shares), target_modes(case), demands(case))
