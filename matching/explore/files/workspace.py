"""The files that are open: what each is, and what is changed in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from matching.explore.files.document import Document
from matching.explore.files.model_document import ModelDocument
from matching.frequency.case.case import Case
from matching.frequency.case.load import is_case, load_case
from modelling.common.errors import InputError
from modelling.common.tables import read_toml
from modelling.fidelity.fidelity import DYNAMIC_DOMAINS, MEASUREMENT_DOMAIN
from modelling.measurement.readers import READERS
from modelling.writing.output import write_all


@dataclass
class Workspace:
    """Open files.

    Attributes
    ----------
    out : Path
        Folder for results.
    models : dict of str to ModelDocument
        ``vehicle`` and ``rig`` of a case, or ``model``.
    case : Document or None
    recordings : list of Path
    budget, fidelity : Document or None
    """

    out: Path
    models: dict[str, ModelDocument] = field(default_factory=dict)
    case: Document | None = None
    recordings: list[Path] = field(default_factory=list)
    budget: Document | None = None
    fidelity: Document | None = None

    @property
    def unsaved(self) -> list[Path]:
        """Files with changes that are not saved."""
        return [each.path for each in self.documents if each.changed]

    @property
    def documents(self) -> list[Document]:
        """Everything that can be edited."""
        others = (self.case, self.budget, self.fidelity)
        return [*self.models.values(), *(each for each in others if each is not None)]

    def load_case(self) -> Case:
        """The case as it is saved.

        Raises
        ------
        InputError
            If there is none, it is wrong, or one of its files has changes that are not saved.
        """
        if self.case is None:
            raise InputError("", "no case file is open", "start with: rigmatch explore CASE")
        return load_case(self.case.path)


def opened(paths: Sequence[str | Path], out: str | Path) -> Workspace:
    """The workspace of some files: models, cases, recordings, budgets, fidelity cases.

    Raises
    ------
    InputError
        If one cannot be read, or two of one kind are given.
    """
    workspace = Workspace(Path(out))
    for file in map(Path, paths):
        if file.suffix.lower() in READERS:
            if not file.is_file():
                raise InputError(str(file), "does not exist", "name an existing file")
            workspace.recordings.append(file)
        else:
            _open_table(workspace, file)
    return workspace


def required_packages() -> None:
    """Check that the packages of the page are installed.

    Raises
    ------
    InputError
        If one is missing.
    """
    if missing := [name for name in ("panel", "bokeh", "tomlkit") if find_spec(name) is None]:
        raise InputError(", ".join(missing), "is not installed", 'in rigmatch\'s folder: pip install -e ".[explore]"')


def starter(out: Path) -> Path:
    """The starter case in a folder ``case`` there; it is written where it is not yet."""
    folder = out / "case"
    if not (folder / "case.toml").exists():
        parts = files("matching").joinpath("starter").iterdir()
        write_all(folder, {part.name: part.read_text(encoding="utf-8") for part in parts})
    return folder / "case.toml"


def _open_table(workspace: Workspace, file: Path) -> None:
    content = read_toml(file)
    if not content.keys().isdisjoint({"measurand", "measurands"}):
        _only_one(workspace.budget, file, "budget")
        workspace.budget = Document(file)
    elif not content.keys().isdisjoint({*DYNAMIC_DOMAINS, MEASUREMENT_DOMAIN}):
        _only_one(workspace.fidelity, file, "fidelity case")
        workspace.fidelity = Document(file)
    elif is_case(content):
        _only_one(workspace.case or next(iter(workspace.models.values()), None), file, "case or model")
        load_case(file)
        workspace.case = Document(file)
        workspace.models = {role: ModelDocument(file.parent / content[role]) for role in ("vehicle", "rig")}
    else:
        _only_one(workspace.case or next(iter(workspace.models.values()), None), file, "case or model")
        workspace.models = {"model": ModelDocument(file)}


def _only_one(present: Document | None, file: Path, kind: str) -> None:
    if present is not None:
        raise InputError(str(file), f"is a second {kind}", "open one of each kind")
