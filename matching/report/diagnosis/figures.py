"""The figures of a diagnosis by name, with their captions."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.diagnosis.verdict.result import Diagnosis
from matching.report.diagnosis.axes import views
from matching.report.diagnosis.balance_figure import balance_figure
from matching.report.diagnosis.holdout_figure import errors_figure, unseen_figure
from matching.report.diagnosis.residual_figure import spectrum_figure, time_figure, where_figure
from modelling.model.system import System

CAPTIONS = {
    "errors": "Free simulation on data that no fit saw. At 1 nothing but the sensor's stated noise is left.",
    "unseen": "Unseen data. Left: the moment at which the model as given is off most. Right: measured minus simulated "
    "over all unseen data, linear near zero and logarithmic beyond.",
    "time": "Fitted data: measured minus simulated over time, pale, and its running mean.",
    "where": "Measured minus simulated over the motion at the sensor's place; dots are samples, lines the mean of a "
    "bin. A step at zero speed speaks for dry friction, a bend in the twist for free play or hardening, a wave over "
    "the angle for torque ripple.",
    "spectrum": "Amplitude of what is left over frequency and over orders of the turn. White noise of the stated size "
    "lies at 1.",
    "balance": "The torque that the measurement asks for beyond the model as given, each component by itself (smoothed "
    "with the linear model, nothing differentiated). It says where to look, not yet why: neighbours share what "
    "no sensor tells apart.",
}


def figures(found: Diagnosis, system: System) -> dict[str, Figure]:
    """All figures: errors and traces on unseen data, residuals over time, motion and frequency, torque balance."""
    plot_data = found.plot_data
    shown = views(system, plot_data)
    return {
        "errors": errors_figure(found),
        "unseen": unseen_figure(found, shown),
        "balance": balance_figure(plot_data),
        "time": time_figure(plot_data, shown),
        "where": where_figure(plot_data, shown[:3]),
        "spectrum": spectrum_figure(plot_data, shown[:3]),
    }
