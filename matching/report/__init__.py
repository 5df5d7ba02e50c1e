"""Figures, pages and texts of results; each room registers the views of its results in its ``view`` module."""

from importlib import import_module

VIEWS = {
    "matching.bed_test.result.BedVerification": "matching.report.bed_test.view",
    "matching.commissioning.rounds.Commissioning": "matching.report.commissioning.view",
    "modelling.modal.result.Mode": "matching.report.modes.animation",
    "matching.excitation.result.ExcitationPlan": "matching.report.excitation.view",
    "matching.diagnosis.verdict.result.Diagnosis": "matching.report.diagnosis.view",
    "matching.frequency.search.result.MatchResult": "matching.report.match.view",
    "matching.frequency.case.case.Case": "matching.report.drawing.view",
    "matching.frequency.studies.map.Map": "matching.report.map.view",
    "matching.frequency.studies.tolerance.Tolerance": "matching.report.tolerance.view",
    "matching.report.modes.animation.ModeAnimation": "matching.report.modes.animation",
    "matching.validity.uncertainty.result.Uncertainty": "matching.report.uncertainty.view",
    "matching.validity.fidelity.result.XilFidelity": "matching.report.fidelity.view",
    "modelling.equations.lagrange.Equations": "matching.report.modes.equations_view",
    "modelling.linear.response.Response": "matching.report.simulation.response_view",
    "modelling.modal.result.Modes": "matching.report.modes.view",
    "modelling.model.system.System": "matching.report.drawing.view",
    "modelling.simulation.result.Simulation": "matching.report.simulation.view",
}


def load_view(result_class: type) -> None:
    """Import the module that registers the views of a class, see :func:`modelling.common.display.register_provider`."""
    module = VIEWS.get(f"{result_class.__module__}.{result_class.__qualname__}")
    if module:
        import_module(module)
