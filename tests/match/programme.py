"""The programme of a case, as a match sets it up."""

from matching.match.attempt import question_of, task_of
from matching.match.case import Case, released_moves
from matching.match.solve import TuningTask


def programme_of(case: Case) -> TuningTask:
    """With fixed parameters fixed, and none released."""
    question = question_of(case)
    return task_of(question, released_moves(case, question.shares))
