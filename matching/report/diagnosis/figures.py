"""The figures of a diagnosis by name, with their captions."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.diagnosis.verdict.result import Pictured
from matching.report.common.style import image
from matching.report.curves.acting_axes import acting
from matching.report.diagnosis.axes import views
from matching.report.diagnosis.balance_figure import balance_figure
from matching.report.diagnosis.discrepancy_figure import discrepancy_figure
from matching.report.diagnosis.holdout_figure import errors_figure, holdout_figure
from matching.report.diagnosis.residual_figure import spectrum_figure, time_figure, where_figure
from modelling.model.system import System

SENSORS_IN_DETAIL = 3  # with a row each in the figures over motion and frequency


def figures(shown: Pictured, system: System) -> dict[str, Figure]:
    """All figures by name: errors and traces of held-out data, residuals over time, motion and frequency, balance."""
    plot_data = shown.plot_data
    sensor_views = views(system, plot_data)
    rest = {"discrepancy": discrepancy_figure(shown.discrepancy)} if shown.discrepancy else {}
    return rest | {
        "errors": errors_figure(shown.errors),
        "unseen": holdout_figure(plot_data.holdout, sensor_views),
        "balance": balance_figure(plot_data),
        "time": time_figure(plot_data, sensor_views),
        "where": where_figure(plot_data, sensor_views[:SENSORS_IN_DETAIL]),
        "spectrum": spectrum_figure(plot_data, sensor_views[:SENSORS_IN_DETAIL]),
    }


def pictures(shown: Pictured, system: System) -> dict[str, bytes]:
    """The files of :func:`figures` (SVG), by name."""
    return {name: image(drawn) for name, drawn in figures(shown, system).items()}


def acting_figures(shown: Pictured, system: System) -> dict[str, str]:
    """The same to act in the browser, as :func:`matching.report.curves.acting_axes.acting` has them."""
    return acting(figures(shown, system))
