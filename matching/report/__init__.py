"""Figures, pages and texts of results, each loaded when a result is first shown."""

from importlib import import_module
from typing import Any

VIEWS = {
    "matching.saved.SavedResult": "matching.commands",
    "matching.bed.verify.BedVerification": "matching.report.bed",
    "matching.bed.commission.Commissioning": "matching.report.bed",
    "matching.bed.learn.Learned": "matching.report.learn",
    "modelling.modal.result.Mode": "matching.report.modes",
    "matching.bed.identify.FromRecordings": "matching.report.bed",
    "matching.bed.proof.Proof": "matching.report.bed",
    "matching.bed.channels.ChannelCheck": "matching.report.bed",
    "matching.bed.channels.ChannelPlan": "matching.report.bed",
    "matching.bed.excite.ExcitationPlan": "matching.report.bed",
    "matching.diagnosis.result.Diagnosis": "matching.report.diagnosis",
    "matching.match.result.MatchResult": "matching.report.match",
    "matching.match.case.Case": "matching.report.drivetrain",
    "matching.match.map.Map": "matching.report.studies",
    "matching.match.tolerance.Tolerance": "matching.report.studies",
    "matching.report.modes.ModeAnimation": "matching.report.modes",
    "matching.uncertainty.result.Uncertainty": "matching.report.evidence",
    "matching.fidelity.XilFidelity": "matching.report.evidence",
    "modelling.equations.lagrange.Equations": "matching.report.modes",
    "modelling.linear.state_space.Response": "matching.report.motions",
    "modelling.modal.orders.Campbell": "matching.report.orders",
    "modelling.modal.forced.OrderResponse": "matching.report.orders",
    "modelling.modal.result.Modes": "matching.report.modes",
    "modelling.system.System": "matching.report.drivetrain",
    "modelling.simulation.stepping.Simulation": "matching.report.motions",
}
RESULTS = {  # by the name of a result's file: the command that writes it, and the module with its view
    "result.json": ("match", "match"), "map.json": ("map", "studies"), "tolerance.json": ("tolerance", "studies"),
    "diagnosis.json": ("diagnose", "diagnosis"), "modes.json": ("modes", "modes"),
    "uncertainty.json": ("uncertainty", "evidence"), "fidelity.json": ("fidelity", "evidence"),
    "campbell.json": ("campbell", "orders"), "response.json": ("response", "orders"),
    "channels_plan.json": ("excite", "bed"), "channels.json": ("verify", "bed"),
    "excite.json": ("excite", "bed"), "proof.json": ("excite", "bed"),
    "identification.json": ("identify", "bed"),
    "verification.json": ("verify", "bed"), "commission.json": ("commission", "bed"),
    "learned.json": ("learn", "learn"),
}  # fmt: skip


def view_of(file: str) -> Any:
    """The view of the results in a file (:class:`matching.report.page.View`)."""
    import_module(f"matching.report.{RESULTS[file][1]}")
    from matching.report.page import VIEWS_OF_FILES

    return VIEWS_OF_FILES[file]


def load_view(result_class: type) -> None:
    """Import the module that registers the views of a class, see :func:`modelling.display.register_provider`."""
    module = VIEWS.get(f"{result_class.__module__}.{result_class.__qualname__}")
    if module:
        import_module(module)
