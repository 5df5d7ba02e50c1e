"""The programme of a case, as a match sets it up."""

from matching.frequency.case.case import Case
from matching.frequency.case.weights import released_moves
from matching.frequency.search.question import question_of
from matching.frequency.search.solve_and_verify import task_of
from matching.frequency.solver.task import TuningTask


def programme_of(case: Case) -> TuningTask:
    """With fixed parameters fixed, and none released."""
    question = question_of(case)
    return task_of(question, released_moves(case, question.shares))
