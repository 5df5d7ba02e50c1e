"""The open files as the page shows them, for a command to read: where something is not saved, copies."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matching.explore.files.document import Keys, edited
from matching.explore.files.workspace import Workspace
from modelling.common.errors import InputError
from modelling.writing.output import write_all

FOLDER = "as_shown"  # of the copies, in the folder of results
ROLES = ("vehicle", "rig")


def case_path(workspace: Workspace) -> Path:
    """Where a command finds the case as it is shown: its own file, or a copy once :func:`write_case` wrote it.

    Raises
    ------
    InputError
        If no case is open.
    """
    if workspace.case is None:
        raise InputError("", "no case file is open", "start with: rigmatch explore CASE")
    files = (workspace.case, *workspace.models.values())
    return workspace.out / FOLDER / "case.toml" if any(file.changed for file in files) else workspace.case.path


def write_case(workspace: Workspace) -> Path:
    """Write the case as it is shown, with its models, and return where; comments and order of the files stay.

    Raises
    ------
    InputError
        If no case is open, or the copy cannot be written.
    """
    path = case_path(workspace)
    if workspace.case is not None and path != workspace.case.path:
        folder, content = workspace.case.path.parent.absolute(), workspace.case.content
        named = {keys: str(folder / name) for keys, name in _named_files(content).items()}
        named |= {(role,): f"{role}.toml" for role in ROLES}
        texts = {f"{role}.toml": workspace.models[role].text for role in ROLES}
        write_all(path.parent, texts | {path.name: edited(workspace.case.text, named)})
    return path


def write_model(workspace: Workspace, role: str) -> Path:
    """Where a command finds a model as it is shown; a copy is written if it has changes that are not saved.

    Raises
    ------
    InputError
        If the copy cannot be written.
    """
    model = workspace.models[role]
    if not model.changed:
        return model.path
    folder = workspace.out / FOLDER
    write_all(folder, {f"{role}.toml": model.text})
    return folder / f"{role}.toml"


def case_tables(workspace: Workspace, content: Mapping[str, Any]) -> dict[str, Any]:
    """The content of the case with its models as they are shown."""
    changed = {role: write_model(workspace, role) for role in ROLES if workspace.models[role].changed}
    return {**content, **{role: str(path.absolute()) for role, path in changed.items()}}


def _named_files(content: Mapping[str, Any]) -> dict[Keys, str]:
    """Files other than the two models that a case names, by where it names them."""
    named: dict[Keys, str] = {}
    if "model" in content.get("residual_vehicle", {}):
        named["residual_vehicle", "model"] = content["residual_vehicle"]["model"]
    for torque, table in content.get("manoeuvre", {}).items():
        if isinstance(table, Mapping) and "file" in table:
            named["manoeuvre", torque, "file"] = table["file"]
    return named
