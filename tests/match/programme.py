"""The programme of a case, as a match sets it up."""

from matching.frequency.attempt import task_of
from matching.frequency.case import Case
from matching.frequency.demands import demands
from matching.frequency.goals import target_modes
from matching.frequency.solve import Task
from matching.frequency.weights import counterparts, free, shares_of
from modelling.modes import modes


def programme_of(case: Case) -> Task:
    """With what is frozen frozen, and nothing thawed."""
    shares = shares_of(case, modes(case.vehicle), counterparts(case))
    return task_of(case, shares, free(case, shares), target_modes(case), demands(case))
