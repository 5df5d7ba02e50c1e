"""Drawings of the open models; those of a case with what the case says of them."""

from __future__ import annotations

from matching.explore.files.workspace import Workspace
from matching.report.drawing.drivetrain import drawing
from matching.report.drawing.figures import case_drawings
from matching.report.drawing.picture import Picture, picture


def pictures(workspace: Workspace) -> dict[str, Picture]:
    """Picture of every open model, by its role; values as edited, dynamometers and cut as the saved case has them."""
    systems = {role: document.system for role, document in workspace.models.items()}
    if workspace.case is None:
        return {role: picture(drawing(system)) for role, system in systems.items()}
    drawn = dict(zip(("vehicle", "rig"), case_drawings(workspace.load_case()), strict=True))
    largest = max(part.J.value for system in systems.values() for part in system.inertias)
    return {role: picture(drawing(system, drawn[role].emphasis, largest)) for role, system in systems.items()}
