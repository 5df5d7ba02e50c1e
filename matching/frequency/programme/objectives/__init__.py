"""Objectives of the match, one a file; a new one is registered by its line here and its name in the case room."""

from matching.frequency.programme.objective import Objective
from matching.frequency.programme.objectives.fidelity import FidelityObjective
from matching.frequency.programme.objectives.response_error import ResponseErrorObjective

REGISTERED: dict[str, type[Objective]] = {kind.name: kind for kind in (ResponseErrorObjective, FidelityObjective)}
