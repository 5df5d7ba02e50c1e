"""The figures of a match, by file name, and the overview."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.frequency.search.result import MatchResult
from matching.report.beds.figure import beds_figure
from matching.report.drawing.figures import case_figure
from matching.report.drawing.layout import MOST_INERTIAS
from matching.report.match.checks import in_time_signals, signals, wrong_values
from matching.report.match.margin_figure import margin_figure
from matching.report.match.modes_figure import match_modes_figure
from matching.report.match.overview_figure import overview_figure
from matching.report.match.quantity_figure import quantity_figure, trade_figure
from matching.report.match.response_figure import response_figure
from matching.report.match.robustness_figure import robustness_figure
from matching.report.match.trace_figure import trace_figure

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
    "margin": "Distance of the feedback loop from instability, with the exact dead time.",
    "beds": "Drawn beds: share of them whose response error is at most so large; the points are median and 95 %.",
    "quantities": "Tuned quantities between their bounds, and the weight on a change of each.",
    "trade": "What to order: the response error for unmeasured torques over each adapter quantity, the rest as tuned, "
    "and the range in which error and margin are as good within 2 %. Dotted: what the bed as planned reaches.",
    "robustness": "How accurately each quantity must be known: response error when one value is wrong.",
}


def overview(result: MatchResult) -> Figure:
    """The match in one figure, 1200 pixels wide as PNG."""
    return overview_figure(result, signals(result))


def figures(result: MatchResult) -> dict[str, Figure]:
    """All figures of a match; those for which there is nothing to show are left out."""
    modes = [target.vehicle for target in result.targets] + [mode.frequency for mode in result.rig_modes]
    made = {
        "overview": overview(result),
        "modes": match_modes_figure(result),
        "responses": response_figure(result),
    }
    if shown := signals(result):
        made["manoeuvre"] = trace_figure(shown, min(own.at for own in result.case.manoeuvre.values()))
    if shown := in_time_signals(result):
        made["in_time"] = trace_figure(shown, min(own.at for own in result.case.manoeuvre.values()))
    made["margin"] = margin_figure(result.tuned, modes)
    if max(len(system.inertias) for system in (result.case.vehicle, result.case.rig)) <= MOST_INERTIAS:
        made["drivetrain"] = case_figure(result.tuned)
    if result.robust and result.robust.beds.unmeasured:
        made["beds"] = beds_figure(result.robust.beds, result.case.unmeasured_tolerance)
    if result.parameters:
        made["quantities"] = quantity_figure(result)
    if result.adapters:
        made["trade"] = trade_figure(result.adapters)
    if wrong := wrong_values(result):
        made["robustness"] = robustness_figure(wrong, result.response_error.after)
    return made
