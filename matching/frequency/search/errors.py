"""The response errors of a match with the lower bounds that the dead time sets."""

from __future__ import annotations

import dataclasses

from matching.frequency.case.case import Case
from matching.frequency.loop.parts import parts_of
from matching.frequency.response.response_error import ErrorFigures, held_error
from matching.frequency.search.result import ResponseError
from modelling.bed.feed_forward_design import dead_time_lower_bound
from modelling.bed.residual_vehicle import cut
from modelling.bed.structures.model_based import ModelBased

UNSAMPLED_REFINEMENT = 8  # samples in place of one, where sampling is to cost next to nothing


def errors_with_bounds(tuned: Case, figures: ErrorFigures) -> ResponseError:
    """Response errors of a tuned case, with the lower bounds set by its dead time."""
    return ResponseError(
        band=figures.band,
        before=figures.before,
        after=figures.after,
        after_like_before=figures.after_like_before,
        unmeasured=figures.unmeasured,
        after_held=figures.after_held,
        sampling=figures.sampling,
        bound=lower_bound(tuned, 1),
        bound_unsampled=lower_bound(tuned, UNSAMPLED_REFINEMENT),
        functions=figures.functions,
    )


def lower_bound(case: Case, refinement: int) -> float:
    """Response error of the best causal controller at a sample time that is so many times shorter.

    Torques are held between samples, for the vehicle as well. See
    :func:`modelling.bed.feed_forward_design.dead_time_lower_bound`.
    """
    reference = cut(case.vehicle, case.rig)
    ideal = dead_time_lower_bound(case.rig, reference, case.loop, refinement)
    driven = {dynamometer.torque_input for dynamometer in case.loop.dynamometers}
    on_rig = tuple(part.name for part in case.rig.inputs if part.name not in driven)
    loop = dataclasses.replace(case.loop, structure=ModelBased(), measured=on_rig)
    all_measured = dataclasses.replace(case, loop=loop)
    return held_error(all_measured, parts_of(all_measured), ideal)
