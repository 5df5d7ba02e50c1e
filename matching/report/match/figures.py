"""The figures of a match, by file name, and the overview."""

from __future__ import annotations

from collections.abc import Callable

from matplotlib.figure import Figure

from matching.frequency.search.result import MatchResult
from matching.report.beds.figure import beds_figure
from matching.report.common.style import image
from matching.report.controller.margin_figure import margin_figure
from matching.report.controller.sensitivity_figure import sensitivity, sensitivity_figure
from matching.report.drawing.figures import case_figure
from matching.report.drawing.layout import MOST_INERTIAS
from matching.report.match.checks import in_time_signals, signals, wrong_values
from matching.report.match.modes_figure import match_modes_figure
from matching.report.match.overview_figure import overview_figure
from matching.report.match.quantity_figure import quantity_figure, trade_figure
from matching.report.match.robustness_figure import robustness_figure
from matching.report.match.trace_figure import trace_figure
from matching.report.responses.error_figure import error_figure
from matching.report.responses.response_figure import response_figure

CAPTIONS = {
    "drivetrain": "Vehicle and rig. Dashed: the cut; hatched: the residual vehicle, which the dynamometers emulate.",
    "overview": "Response, manoeuvre and target modes at a glance.",
    "modes": "Modes and their energy. In colour: the target modes, and on the rig without control those of the same "
    "symmetry. s symmetric, a antisymmetric left to right.",
    "responses": "Frequency responses. The line of the matched rig should run inside the broad line of the vehicle; "
    "the grey band is the matched band. Dotted: the matched rig when the controller does not measure the torque.",
    "manoeuvre": "The manoeuvre, simulated with a delay line and a sampled controller.",
    "in_time": "A bed with everything wrong at once, the worst of those drawn, beside the nonlinear vehicle with the "
    "same specimen. Dotted: the controller does not measure the torque.",
    "errors": "Response error of every compared function. Dashed: what the case allows.",
    "sensitivity": "Sensitivity S and complementary sensitivity T of the feedback loop on the bed as planned. Grey: "
    "the limits, each from the frequency on from which it counts.",
    "margin": "Distance of the feedback loop from instability, with the exact dead time; grey: too near.",
    "beds": "Drawn beds: share of them whose response error is at most so large; the points are median and 95 %.",
    "quantities": "Tuned quantities between their bounds, on a logarithmic scale where these are four decades apart or "
    "more, and the weight on a change of each where one was set.",
    "trade": "What to order: the response error for unmeasured torques over each adapter quantity, the rest tuned for "
    "each value, and the range that is as good within 2 %. Dotted: what the bed as planned reaches.",
    "robustness": "How accurately each quantity must be known: response error when one value is wrong.",
}


def overview(result: MatchResult) -> Figure:
    """The match in one figure, 1200 pixels wide as PNG."""
    return overview_figure(result, signals(result))


def drawn_modes(result: MatchResult) -> list[float]:
    """Frequencies in Hz around which curves of the loop need a dense grid."""
    return [target.vehicle for target in result.targets] + [mode.frequency for mode in result.rig_modes]


def drawers(result: MatchResult) -> dict[str, Callable[[], Figure]]:
    """What draws each figure of a match, by name; those for which there is nothing to show are left out."""
    case, tuned = result.case, result.tuned
    made: dict[str, Callable[[], Figure]] = {
        "overview": lambda: overview(result),
        "modes": lambda: match_modes_figure(result),
        "responses": lambda: response_figure(result),
        "errors": lambda: error_figure(result),
    }
    begins = min((torque.at for torque in case.manoeuvre.values()), default=0.0)
    if of_manoeuvre := signals(result):
        made["manoeuvre"] = lambda: trace_figure(of_manoeuvre, begins)
    if of_worst_bed := in_time_signals(result):
        made["in_time"] = lambda: trace_figure(of_worst_bed, begins)
    frequencies = drawn_modes(result)
    required = result.robust.required if result.robust else None
    margin_from = required.margin_from if required else 0.0
    made["sensitivity"] = lambda: sensitivity_figure(sensitivity(tuned, frequencies, required))
    made["margin"] = lambda: margin_figure(tuned, frequencies, margin_from)
    if max(len(system.inertias) for system in (case.vehicle, case.rig)) <= MOST_INERTIAS:
        made["drivetrain"] = lambda: case_figure(tuned)
    if result.robust and result.robust.beds.unmeasured:
        beds = result.robust.beds
        made["beds"] = lambda: beds_figure(beds, case.unmeasured_tolerance)
    if result.parameters:
        made["quantities"] = lambda: quantity_figure(result)
    if result.adapters:
        made["trade"] = lambda: trade_figure(result.adapters)
    if wrong := wrong_values(result):
        made["robustness"] = lambda: robustness_figure(wrong, result.response_error.after)
    return made


def figures(result: MatchResult) -> dict[str, Figure]:
    """All figures of a match by name."""
    return {name: draw() for name, draw in drawers(result).items()}


def svg(result: MatchResult, name: str) -> bytes:
    """The file of one figure.

    Raises
    ------
    KeyError
        If the match has no such figure.
    """
    return image(drawers(result)[name]())
