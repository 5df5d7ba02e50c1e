"""The figures of a diagnosis by name, with their captions."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from matching.diagnosis.verdict.result import Diagnosis
from matching.report.common.style import image
from matching.report.diagnosis.axes import views
from matching.report.diagnosis.balance_figure import balance_figure
from matching.report.diagnosis.discrepancy_figure import discrepancy_figure
from matching.report.diagnosis.holdout_figure import errors_figure, holdout_figure
from matching.report.diagnosis.residual_figure import spectrum_figure, time_figure, where_figure
from modelling.model.system import System

SENSORS_IN_DETAIL = 3  # with a row each in the figures over motion and frequency
CAPTIONS = {
    "discrepancy": "What no named cause explains: a torque beside the extended model that would take most of it, with "
    "a band of two standard uncertainties. What the model's own parameters can take is not in it.",
    "errors": "Simulation of held-out data, which no fit used. At 1 the error equals the sensor's stated noise.",
    "unseen": "Held-out data. Left: around the largest error of the base model. Right: measured minus simulated over "
    "all held-out data, linear near zero and logarithmic beyond.",
    "time": "Fitted data: measured minus simulated over time (pale) and its running mean.",
    "where": "Measured minus simulated over the motion at the sensor's component; dots are samples, lines the mean of "
    "a bin. A step at zero speed indicates dry friction, a kink over the twist free play or hardening, a wave over "
    "the angle torque ripple.",
    "spectrum": "Amplitude of the residual over frequency and over orders of the rotation. White noise of the stated "
    "size lies at 1.",
    "balance": "Torque that the measurement requires in addition to the base model, for each component alone (smoothed "
    "with the linear model, without differentiation). It shows where to look, not the cause: neighbouring components "
    "share what no sensor separates.",
}


def figures(diagnosis: Diagnosis, system: System) -> dict[str, Figure]:
    """All figures by name: errors and traces of held-out data, residuals over time, motion and frequency, balance."""
    plot_data = diagnosis.plot_data
    sensor_views = views(system, plot_data)
    shown = {"discrepancy": discrepancy_figure(diagnosis.discrepancy)} if diagnosis.discrepancy else {}
    return shown | {
        "errors": errors_figure(diagnosis),
        "unseen": holdout_figure(diagnosis, sensor_views),
        "balance": balance_figure(plot_data),
        "time": time_figure(plot_data, sensor_views),
        "where": where_figure(plot_data, sensor_views[:SENSORS_IN_DETAIL]),
        "spectrum": spectrum_figure(plot_data, sensor_views[:SENSORS_IN_DETAIL]),
    }


def svg(drawn: Mapping[str, Figure], name: str) -> bytes:
    """The file of one of :func:`figures`.

    Raises
    ------
    KeyError
        If there is no such figure.
    """
    return image(drawn[name])
