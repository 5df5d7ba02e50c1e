"""Lower bounds that the dead time sets to the response errors of a match, and its curves for drawing."""

from __future__ import annotations

import dataclasses

import numpy as np

from matching.match.case import Case, whole_loop
from matching.match.loop import without_limits
from matching.match.responses import ComparedBed, ResponseError, Responses, error_figures, figures_of
from modelling.bed.controllers import ModelBased
from modelling.bed.observer import FREE_COMMAND_WEIGHT, Observer, design, observer_model
from modelling.bed.specimen import KNOWN
from modelling.bed.vehicle import cut
from modelling.errors import NoDesign
from modelling.system import Sensor

# --- The response errors of a match with the lower bounds that the dead time sets, and its curves for drawing.

CURVE_POINTS = 400
UNSAMPLED_REFINEMENT = 8  # samples in place of one, where sampling is to cost next to nothing
PROMPT = 0.1  # of such a sample: a lag that costs nothing either


def errors_with_bounds(tuned: Case, figures: ResponseError) -> ResponseError:
    """Response errors of a tuned case, with the lower bounds set by its dead time; these emulate the whole vehicle."""
    whole = emulating_the_whole(tuned)
    return dataclasses.replace(
        figures, bound=lower_bound(whole, 1), bound_unsampled=lower_bound(whole, UNSAMPLED_REFINEMENT),
        unmeasured_bound=estimator_bound(whole),
    )  # fmt: skip


def emulating_the_whole(case: Case) -> Case:
    """The case with the residual vehicle that is cut from the vehicle, in place of the user's own."""
    if case.simple_vehicle is None:
        return case
    return dataclasses.replace(case, simple_vehicle=None, residual_vehicle=cut(case.vehicle, case.rig))


def lower_bound(case: Case, refinement: int) -> float:
    """Response error of the H2-optimal controller at a sample time that is so many times shorter.

    Every torque is measured and every state known, so whatever a controller does with less, it responds later or
    worse. It is the optimum for torques that step at unforeseeable moments, over all frequencies; over a finite band
    a controller may do a little better, at the cost of what lies outside.
    """
    case = _with_flanges(case)
    driven = {dynamometer.torque_input for dynamometer in case.loop.dynamometers}
    on_rig = tuple(part.name for part in case.rig.inputs if part.name not in driven)
    structure = ModelBased()
    start = {name: quantity.start for name, quantity in structure.quantities.items()}
    values = {**start, **case.loop.values, "sample_time": case.loop["sample_time"] / refinement}
    finer = dataclasses.replace(
        case.loop, structure=structure, measured=on_rig, values=values, specimen=KNOWN, beyond=()
    )
    return error_figures(dataclasses.replace(case, loop=finer)).after


def prompt_bound(case: Case) -> float:
    """The smallest response error of a loop without dead time and lags: it comes from the specimen, not from the loop.

    Dead times, lags and the sample time are as short as the design takes them, an eighth of a sample and less.
    """
    step, loop = case.loop["sample_time"] / UNSAMPLED_REFINEMENT, case.loop
    alike = tuple(
        dataclasses.replace(one, dead_time=None, inverter_lag=None, torque_sensor_lag=None) for one in loop.dynamometers
    )
    values = {**loop.values, "dead_time": step / 2, "inverter_lag": PROMPT * step, "torque_sensor_lag": PROMPT * step}
    prompt = dataclasses.replace(loop, dynamometers=alike, values=values)
    return lower_bound(dataclasses.replace(case, loop=prompt), UNSAMPLED_REFINEMENT)


def _with_flanges(case: Case) -> Case:
    """The case with a torque sensor in the cut shaft for every dynamometer without a torque flange."""
    without = [one for one in case.loop.dynamometers if one.torque_sensor is None]
    added = tuple(Sensor(f"cut_torque_{one.follows}", "torque", one.follows) for one in without)
    dynamometers = tuple(
        dataclasses.replace(one, torque_sensor=f"cut_torque_{one.follows}") if one in without else one
        for one in case.loop.dynamometers
    )
    rig = dataclasses.replace(case.rig, sensors=(*case.rig.sensors, *added))
    return dataclasses.replace(case, rig=rig, loop=dataclasses.replace(case.loop, dynamometers=dynamometers))


def estimator_bound(case: Case) -> float | None:
    """Response error to unmeasured torques of the optimal causal estimator, with the bed's sensors and their noise.

    A Kalman filter for torques that may change by as much as the manoeuvre does within half a period of the band's
    upper edge, with the noise that the sensors' uncertainties state, dynamometers that do exactly what they are told,
    and commands that cost nothing; no bed but the one as planned counts. None where the design has no solution.
    """
    on_rig = {part.name for part in case.rig.inputs}
    ranges = {
        name: float(np.ptp(case.torque_made(name, torque.torque(torque.time()))))
        for name, torque in case.manoeuvre.items()
    }
    driving = [size for name, size in ranges.items() if name in on_rig]
    structure, size = Observer(), max(driving or ranges.values())
    weights = {name: quantity.lower for name, quantity in structure.quantities.items()}
    weights |= {name: 1.0 for name in weights if name.endswith(("sensor_noise", "speed_noise"))}
    weights |= {"torque_drift": size * np.sqrt(2 * case.band[1]), "command_weight": FREE_COMMAND_WEIGHT}
    loop = dataclasses.replace(whole_loop(case), structure=structure, values={**case.loop.values, **weights})
    ideal = dataclasses.replace(case, loop=loop)
    try:
        controller = design(observer_model(case.rig, cut(case.emulated_vehicle, case.rig), loop), weights)
        return figures_of(ComparedBed(ideal, controller=without_limits(controller))).unmeasured
    except NoDesign:
        return None


def curves_of(bed: ComparedBed) -> Responses:
    """Responses for drawing, from half the lower to three times the upper edge of the band."""
    case = bed.case
    top = min(3 * case.band[1], 0.45 / case.loop["sample_time"])
    f = np.geomspace(case.band[0] / 2, max(top, case.band[1]), CURVE_POINTS)
    return bed.at(f)
