"""Files that are edited in the browser: values, forms, undo, saving with comments kept."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from matching.explore.places import Places
from matching.match.case import Case
from matching.match.case_file import case_files, case_from_tables, load_case
from matching.match.map import held_at, quantities
from matching.match.requirements import limit_units
from modelling.bed.bed import HARDWARE
from modelling.effects.effect import shared_place
from modelling.errors import InputError, unknown
from modelling.model_file import from_dict
from modelling.recordings.readers import READERS
from modelling.system import TABLES_WITH_QUANTITIES, Quantity
from modelling.toml import kind_of, read_toml
from modelling.units import factor
from modelling.writing import write_all

# --- A TOML file that is edited: values change, comments and order stay, every change can be undone.

Keys = tuple[str | int, ...]  # of tables and places in lists, from the top of the file to a value


class Document:
    """The text of a TOML file with its changes.

    Attributes
    ----------
    path : Path
    text : str
        As it would be saved.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        read_toml(self.path)  # one line that says what is wrong, and the limits of size
        self._texts = [self.path.read_bytes().decode()]

        self._together: list[list[Document]] = [[]]  # documents that each text was changed with
        self._undone: list[tuple[str, list[Document]]] = []  # texts that were taken back, and those with them

    @property
    def text(self) -> str:
        """As it would be saved."""
        return self._texts[-1]

    @property
    def content(self) -> dict[str, Any]:
        """What the text holds, in Python's own types."""
        return _toolkit().parse(self.text).unwrap()

    @property
    def changed(self) -> bool:
        """Whether something is not saved."""
        return self.text != self._texts[0]

    @property
    def unsaved(self) -> int:
        """How many changes are not saved."""
        return len(self._texts) - 1 if self.changed else 0

    @property
    def was_undone(self) -> bool:
        """Whether there is a change to make again."""
        return bool(self._undone)

    def value(self, keys: Keys) -> Any:
        """The value at a place, as the file writes it (number, text with unit, table)."""
        return _at(self.content, keys)

    def replaced(self, keys: Keys, value: Any) -> str:
        """The text with another value at a place; the value's comment stays. A missing last key is added."""
        return edited(self.text, {keys: value})

    def without(self, keys: Keys) -> str:
        """The text without a value."""
        document = _toolkit().parse(self.text)
        del _at(document, keys[:-1])[keys[-1]]
        return _toolkit().dumps(document)

    def change(self, keys: Keys, value: Any) -> None:
        """Put another value at a place."""
        self.change_text(self.replaced(keys, value))

    def change_text(self, text: str, together: list[Document] | None = None) -> None:
        """Take a whole text as a change; ``together``: a list of the documents that are undone with this one."""
        if text != self.text:
            self._texts.append(text)
            self._together.append([] if together is None else together)
            self._undone = []

    def undo(self) -> bool:
        """Take the last change back, that of other documents made together with it, too; whether there was one."""
        if len(self._texts) == 1:
            return False
        together = self._together[-1]
        for document in together or [self]:
            if document is self or (together and document._together[-1] is together):
                document._undone.append((document._texts.pop(), document._together.pop()))
                document.read_again()
        return True

    def redo(self) -> bool:
        """Make the change again that was taken back last, in other documents too; whether there was one."""
        if not self._undone:
            return False
        together = self._undone[-1][1]
        for document in together or [self]:
            if document._undone and (document is self or document._undone[-1][1] is together):
                text, others = document._undone.pop()
                document._texts.append(text)
                document._together.append(others)
                document.read_again()
        return True

    def drop_last(self) -> None:
        """Forget the last change, as if it had not been made: what it made could not be read."""
        self._texts.pop()
        self._together.pop()
        self.read_again()

    def read_again(self) -> None:
        """Follow the text after it was taken back."""

    def save(self) -> None:
        """Write the file; it is whole at every moment."""
        if self.path.read_bytes().decode() != self._texts[0]:
            raise InputError(str(self.path), "was changed by another program since it was opened", "open it again")
        write_all(self.path.parent, {self.path.name: self.text.encode()})
        self._texts, self._together, self._undone = [self.text], [[]], []


def edited(text: str, values: Mapping[Keys, Any]) -> str:
    """The text of a TOML file with other values at some places; a missing last key is added."""
    document = _toolkit().parse(text)
    for keys, value in values.items():
        _at(document, keys[:-1])[keys[-1]] = value
    return str(_toolkit().dumps(document))


def _at(content: Any, keys: Sequence[str | int]) -> Any:
    for key in keys:
        content = content[key]
    return content


def _toolkit() -> Any:
    try:
        import tomlkit
    except ImportError:
        raise InputError("tomlkit", "is not installed", 'in rigmatch\'s folder: pip install -e ".[explore]"') from None
    return tomlkit


# --- A model file that is edited by the names of its quantities.

DIGITS = 6  # of a value that a slider sets


class ModelDocument(Document):
    """A model file with its system.

    Attributes
    ----------
    system : System
        With all changes, saved or not.
    """

    def __init__(self, path: str | Path):
        super().__init__(path)
        self.system = from_dict(self.content, str(path))
        self._saved = self.system

    @property
    def changes(self) -> dict[str, tuple[float, float]]:
        """Saved and present value (SI) of every quantity that differs, by name."""
        before, after = (system.parameters | system.dimensions for system in (self._saved, self.system))
        both = [name for name in after if name in before]
        return {name: (before[name].value, after[name].value) for name in both if before[name] != after[name]}

    @property
    def other_parts(self) -> tuple[list[str], list[str]]:
        """Parts and effects that were added and removed since the file was saved, as ``shafts.link``."""
        before, after = (
            [*system.places(), *(f"{effect.at}.{effect.kind}" for effect in system.effects)]
            for system in (self._saved, self.system)
        )
        return [name for name in after if name not in before], [name for name in before if name not in after]

    @property
    def unsaved(self) -> int:
        """How many quantities, parts and effects differ from the file; at least one where its text does."""
        return max(len(self.changes) + sum(map(len, self.other_parts)), int(self.changed))

    @property
    def changed_parts(self) -> frozenset[str]:
        """Parts with a changed quantity, as ``shafts.link``."""
        return frozenset(part_of(name) for name in self.changes)

    def written(self, name: str) -> str:
        """A quantity's value as the file writes it, unit included if it has one there."""
        value = self._bare(name)
        return value if isinstance(value, str) else f"{value:g}" if isinstance(value, float) else str(value)

    def set_text(self, name: str, text: str) -> None:
        """Set a quantity to what a user wrote: a number in SI, or a number with a unit."""
        self._set(name, number_or_text(text))

    def set_title(self, text: str) -> None:
        """Give the model another title; an empty one takes it away."""
        bare = text.strip()
        if bare or self.system.title:
            self.take(self.replaced(("title",), bare) if bare else self.without(("title",)))

    def set_value(self, name: str, value: float) -> None:
        """Set a quantity to a value in SI; it is written in the unit that the file has for it."""
        before = self._bare(name)
        unit = before.strip().lstrip("+-0123456789.eE").strip() if isinstance(before, str) else ""
        scale = factor(unit, self.unit_of(name)) if unit else 1.0
        rounded = float(f"{value / scale:.{DIGITS}g}")
        self._set(name, f"{rounded:g} {unit}" if unit else rounded)

    def unit_of(self, name: str) -> str:
        """SI unit of a quantity or dimension."""
        return self.system.units.get(name, "m")

    def values_of(self, part: str) -> dict[str, Quantity]:
        """Quantities of a part that can be set, by name: of a shaft by its drawing no stiffness but dimensions."""
        system = self.system
        known = {name: one for name, one in (system.dimensions | system.parameters).items() if part_of(name) == part}
        return {
            name: one for name, one in known.items()
            if not (name.endswith(".stiffness") and name.replace(".stiffness", ".diameter") in system.dimensions)
        }  # fmt: skip

    def read_again(self) -> None:
        """Follow the text after it was taken back."""
        self.system = from_dict(self.content, str(self.path))

    def take(self, text: str, together: list[Document] | None = None) -> None:
        """Take a whole text as a change; raises ``InputError`` where it is no model; then nothing changed."""
        before = self.text
        self.change_text(text, together)
        try:
            self.read_again()
        except InputError:
            if self.text != before:
                self._texts.pop()
                self._together.pop()
            raise

    def save(self) -> None:
        """Write the file; raises as :meth:`Document.save` does."""
        super().save()
        self._saved = self.system

    def _set(self, name: str, value: Any) -> None:
        keys = self._keys(name)
        if isinstance(self._value_in_file(keys), Mapping):
            keys = (*keys, "value")
        self.take(self.replaced(keys, value))

    def _bare(self, name: str) -> Any:
        value = self._value_in_file(self._keys(name))
        if value is None:
            return (self.system.parameters | self.system.dimensions)[name].value
        return value["value"] if isinstance(value, Mapping) else value

    def _value_in_file(self, keys: Keys) -> Any:
        """None where the file leaves a quantity at its default."""
        try:
            return self.value(keys)
        except KeyError:
            return None

    def _keys(self, name: str) -> Keys:
        """Where a quantity stands in the file."""
        known = self.system.parameters | self.system.dimensions
        if name not in known:
            raise unknown(name, list(known), str(self.path))
        for number, effect in enumerate(self.content.get("effects", ())):
            at = effect["at"]
            place = shared_place(at) if isinstance(at, list) else at
            if name.startswith(f"{place}.{effect['kind']}."):
                return ("effects", number, *_in_lists(effect, name.removeprefix(f"{place}.{effect['kind']}.")))
        table, part, key = name.split(".", 2)
        if table == "gearboxes" and key.startswith("ratio_"):
            return table, part, "ratios", int(key.removeprefix("ratio_")) - 1
        return table, part, key


def _in_lists(effect: Mapping[str, Any], key: str) -> Keys:
    """Where a parameter of an effect stands in its table: ``torque_2_3`` in the third place of the second row."""
    for name, value in effect.items():
        numbers = key.removeprefix(f"{name}_").split("_")
        if isinstance(value, list) and key.startswith(f"{name}_") and all(each.isdecimal() for each in numbers):
            return (name, *(int(each) - 1 for each in numbers))
    return (key,)


def part_of(name: str) -> str:
    """The part that a quantity belongs to: ``shafts.link`` of ``shafts.link.backlash.gap``."""
    table, _, rest = name.partition(".")
    return f"{table}.{rest.partition('.')[0]}" if table in (*TABLES_WITH_QUANTITIES, "inputs", "sensors") else name


_COMMA = re.compile(r"([-+]?\d+),(\d+)(\s*[^\s,]*)")


def number_or_text(text: str) -> float | int | str:
    """What a user wrote as TOML has it: a number where it is one, else text with a unit; a decimal comma is a point.

    Three digits after a comma may be thousands: such a text stays as it is, and the reader refuses it.
    """
    bare = text.strip()
    if (comma := _COMMA.fullmatch(bare)) and (len(comma[2]) != 3 or comma[1].lstrip("+-") == "0"):
        bare = f"{comma[1]}.{comma[2]}{comma[3]}"
    for kind in (int, float):
        try:
            return kind(bare)
        except ValueError:
            continue
    return bare


# --- The files that are open: what each is, and what is changed in it.


@dataclass
class Workspace:
    """Open files.

    Attributes
    ----------
    out : Path
        Folder for results.
    home : Path
        The folder in which the page opens and writes files: where it was started.
    models : dict of str to ModelDocument
        ``vehicle`` and ``rig`` of a case, or ``model``.
    case : Document or None
    recordings : list of Path
    budget, fidelity : Document or None
    sketches : dict of str to Sketch
        The models as they were drawn last.
    places : dict of str to Places
        Where parts of the models were moved in their drawings.
    tasks : dict of str to Task
        The commands that run or have ended, in whichever window they were begun.
    matched : list of str
        Texts of case and models when a match was run last.
    leave : callable
        Empties the page that shows these files now: its fields would not hear what a newer page changes.
    """

    out: Path
    models: dict[str, ModelDocument] = field(default_factory=dict)
    case: Document | None = None
    recordings: list[Path] = field(default_factory=list)
    budget: Document | None = None
    fidelity: Document | None = None
    sketches: dict[str, Any] = field(default_factory=dict, repr=False)
    places: dict[str, Places] = field(default_factory=dict, repr=False)
    tasks: dict[str, Any] = field(default_factory=dict, repr=False)
    matched: list[str] = field(default_factory=list, repr=False)
    leave: Callable[[], None] = field(default=lambda: None, repr=False)
    home: Path = field(default_factory=Path.cwd)

    @property
    def documents(self) -> list[Document]:
        """Everything that can be edited."""
        others = (self.case, self.budget, self.fidelity)
        return [*self.models.values(), *(each for each in others if each is not None)]

    @property
    def texts(self) -> list[str]:
        """Of case and models, as they are shown."""
        case = [] if self.case is None else [self.case]
        return [file.text for file in (*case, *self.models.values())]

    def open(self, file: Path) -> None:
        """Open a file beside the others, in place of one of the same kind.

        Raises
        ------
        InputError
            If it cannot be read, or the one that it replaces has changes that are not saved.
        """
        if file.suffix.lower() in READERS:
            if not file.is_file():
                raise InputError(str(file), "does not exist", "name an existing file")
            self.recordings = [file, *(each for each in self.recordings if each != file)]
            return
        kind = kind_of(read_toml(file), str(file))
        replaced = {"budget": [self.budget], "fidelity case": [self.fidelity]}.get(
            kind, [self.case, *self.models.values(), *self.places.values()]
        )
        for document in replaced:
            if document is not None and document.changed:
                raise InputError(str(document.path), "has changes that are not saved", "save them or undo them first")
        if kind == "budget":
            self.budget = Document(file)
        elif kind == "fidelity case":
            self.fidelity = Document(file)
        elif kind == "case":
            load_case(file)
            content = read_toml(file)
            models = {role: ModelDocument(file.parent / content[role]) for role in ROLES}
            self.places = {role: Places(model.path) for role, model in models.items()}
            self.case, self.models = Document(file), models
        elif kind == "model":
            self.places = {"model": Places(file)}
            self.case, self.models = None, {"model": ModelDocument(file)}
        else:
            raise InputError(str(file), f"is a {kind}", "open it in the step Measurement")

    def load_case(self) -> Case:
        """The case as it is saved."""
        if self.case is None:
            raise InputError("", "no case file is open", "start with: rigmatch explore CASE")
        return load_case(self.case.path)


def opened(paths: Sequence[str | Path], out: str | Path) -> Workspace:
    """The workspace of some files: models, cases, recordings, budgets, fidelity cases; of recordings several."""
    workspace = Workspace(Path(out))
    for file in map(Path, paths):
        before = workspace.documents
        workspace.open(file)
        if any(document not in workspace.documents for document in before):
            kind = kind_of(read_toml(file), str(file))
            raise InputError(str(file), f"is a second {kind}", "open one of each kind")
    workspace.recordings.reverse()  # the first one named is shown
    return workspace


def required_packages() -> None:
    """Check that the packages of the page are installed."""
    if missing := [name for name in ("panel", "bokeh", "tomlkit") if find_spec(name) is None]:
        raise InputError(", ".join(missing), "is not installed", 'in rigmatch\'s folder: pip install -e ".[explore]"')


def starter(out: Path) -> list[Path]:
    """Case, budget and fidelity case of `rigmatch new` in a folder ``case`` there; made where it is not yet."""
    from matching.schemas import write_starter

    folder = out / "case"
    if not (folder / "case.toml").exists():
        write_starter(folder)
    return [folder / f"{kind}.toml" for kind in ("case", "budget", "fidelity")]


# --- New files, files to open and copies, all within the folder that the page was started in.

MOST_LISTED = 300  # files that are offered: a longer list is not read; a path can be typed
TEMPLATES = {"case": "case.toml", "model": "vehicle.toml", "budget": "budget.toml", "fidelity case": "fidelity.toml"}
EMPTY = "empty model"  # to draw from the first inertia on
EMPTY_MODEL = """[inertias.motor]
J = 0.1                                 # kg·m²

[inputs.motor_torque]
on = "motor"

[sensors.motor_speed]
measures = "speed"
of = "motor"
"""


def within(home: Path, name: str) -> Path:
    """A path below the folder, from a name relative to it; raises ``InputError`` for one that leads out of it."""
    path = (home / name.strip()).resolve()
    if not name.strip() or not path.is_relative_to(home.resolve()) or path == home.resolve():
        raise InputError(name or "name", "lies outside the folder that the page was started in", "name a file in it")
    return path


def listed(home: Path) -> list[str]:
    """Files below the folder that can be opened, relative to it, nearest first; hidden folders are left out."""
    found: list[str] = []
    for folder, folders, names in os.walk(home):
        folders[:] = sorted(name for name in folders if not name.startswith((".", "__")))
        paths = [Path(folder, name) for name in sorted(names)]
        found += [str(path.relative_to(home)) for path in paths if path.suffix.lower() in (".toml", *READERS)]
        if len(found) > MOST_LISTED:
            break
    return sorted(found[:MOST_LISTED], key=lambda name: (name.count(os.sep), name))


def new_file(home: Path, kind: str, name: str) -> Path:
    """Write a new case (a folder of that name with its models), model, budget or fidelity case; its file to open."""
    from matching.schemas import write_starter

    place = within(home, name)
    if kind == "case":
        write_starter(place)
        return place / TEMPLATES[kind]
    place = place.with_suffix(".toml")
    _check_new(place)
    if kind == EMPTY:
        text = EMPTY_MODEL
    else:  # without the line that names a schema beside it
        text = files("matching").joinpath("starter", TEMPLATES[kind]).read_text(encoding="utf-8").partition("\n")[2]
    write_all(place.parent, {place.name: text})
    return place


def save_as(workspace: Workspace, kind: str, name: str) -> Path:
    """Write a copy of what is open, as it is shown: of a case a folder with all that it names; what is to be opened."""
    place = within(workspace.home, name)
    if kind == "case":
        if workspace.case is None:
            raise InputError("", "no case file is open", "open one")
        if place.exists():
            raise InputError(str(place), "exists", "name a new folder")
        folder, content = workspace.case.path.parent, workspace.case.content
        names = _named_files(content)
        moved = {keys: Path(file).name for keys, file in names.items()} | {(role,): f"{role}.toml" for role in ROLES}
        texts: dict[str, str | bytes] = {f"{role}.toml": workspace.models[role].text for role in ROLES}
        texts |= {Path(file).name: (folder / file).read_bytes() for file in names.values()}
        write_all(place, texts | {"case.toml": edited(workspace.case.text, moved)})
        return place / "case.toml"
    place = place.with_suffix(".toml")
    _check_new(place)
    known = {"budget": workspace.budget, "fidelity case": workspace.fidelity}
    document = known[kind] if kind in known else workspace.models.get("model")
    if document is None:
        raise InputError("", f"no {kind} is open", "open one")
    write_all(place.parent, {place.name: document.text})
    return place


def _check_new(place: Path) -> None:
    if place.exists():
        raise InputError(str(place), "exists", "give another name")


# --- The open files as the page shows them, for a command to read: where something is not saved, copies.

FOLDER = "as_shown"  # of the copies, in the folder of results
ROLES = ("vehicle", "rig")


def case_path(workspace: Workspace) -> Path:
    """Where a command finds the case as it is shown: its own file, or a copy once :func:`write_case` wrote it."""
    if workspace.case is None:
        raise InputError("", "no case file is open", "start with: rigmatch explore CASE")
    files = (workspace.case, *workspace.models.values())
    return workspace.out / FOLDER / "case.toml" if any(file.changed for file in files) else workspace.case.path


def write_case(workspace: Workspace) -> Path:
    """Write the case as it is shown, with its models, and return where; comments and order of the files stay."""
    path = case_path(workspace)
    if workspace.case is not None and path != workspace.case.path:
        folder, content = workspace.case.path.parent.absolute(), workspace.case.content
        named = {keys: str(folder / name) for keys, name in _named_files(content).items()}
        named |= {(role,): f"{role}.toml" for role in ROLES}
        texts = {f"{role}.toml": workspace.models[role].text for role in ROLES}
        write_all(path.parent, texts | {path.name: edited(workspace.case.text, named)})
    return path


def write_model(workspace: Workspace, role: str) -> Path:
    """Where a command finds a model as it is shown; a copy is written if it has changes that are not saved."""
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


# --- The values of a file as fields of a form: which there are, and setting one with the file checked as a whole.

ENDS = ("from", "to")  # of a pair of quantities, a range
HIDDEN_TEXTS = ("vehicle", "rig", "formula")  # changed in the file, where more than one value belongs together


@dataclass(frozen=True)
class Field:
    """A value of a file that can be written: its table and key for a reader, and where it stands."""

    table: str
    key: str
    keys: Keys
    text: str


def fields(document: Document, tables: Mapping[str, Any] | None = None, above: Keys = ()) -> list[Field]:
    """Every single value of a file, in its order; lists of tables by their number."""
    form: list[Field] = []
    for key, value in (document.content if tables is None else tables).items():
        keys = (*above, key)
        if isinstance(value, Mapping):
            form += fields(document, value, keys)
        elif isinstance(value, list) and value and all(isinstance(each, Mapping) for each in value):
            for number, each in enumerate(value):
                form += fields(document, each, (*keys, number))
        elif isinstance(value, list) and len(value) == len(ENDS) and all(_is_quantity(str(each)) for each in value):
            table = _in_words(above)
            form += [Field(table, f"{key}, {end}", (*keys, n), str(value[n])) for n, end in enumerate(ENDS)]
        elif isinstance(value, int | float | str) and not isinstance(value, bool) and key not in HIDDEN_TEXTS:
            written = f"{value:.10g}" if isinstance(value, float) else str(value)
            form.append(Field(_in_words(above), key, keys, written))
    return form


def _in_words(keys: Keys) -> str:
    return " ".join(str(part + 1) if isinstance(part, int) else part for part in keys)


def set_field(document: Document, keys: Keys, text: str, check: Callable[[dict[str, Any]], Any]) -> Any:
    """Write a value, and return what the file then holds.

    Parameters
    ----------
    check : callable
        Reads the content of the file; what it returns is returned.
    """
    value = number_or_text(text)
    before = document.value(keys)
    if isinstance(before, float) and isinstance(value, int):
        value = float(value)
    if isinstance(before, str) and isinstance(value, str) is False and not _is_quantity(before):
        raise InputError(".".join(map(str, keys)), f"{text!r} is a number", "write a text")
    before_change = document.text
    document.change(keys, value)
    try:
        return check(document.content)
    except InputError:
        if document.text != before_change:
            document.drop_last()
        raise


def _is_quantity(text: str) -> bool:
    return text.strip()[:1] in "+-.0123456789" and bool(text.strip())


# --- A case as a form: what may move within which bounds, what is held; the case beside it at other values.

FORM_TABLES = (
    "loop", "limits", "response", "move", "targets", "manoeuvre", "operating_point", "operating_range", "drives",
    "uncertainty",
)  # fmt: skip
SPREAD = 2.0  # a quantity that begins to move may do so by this factor up and down


class CaseForm:
    """An open case file with its fields.

    Parameters
    ----------
    document : Document
    with_models : callable, optional
        The content of the case with its models as they are edited; as they are saved without it.

    Attributes
    ----------
    case : Case
        With all changes, saved or not.
    """

    def __init__(self, document: Document, with_models: Callable[[dict[str, Any]], dict[str, Any]] = dict):
        self.document, self._with_models = document, with_models
        self.case: Case = self._read(document.content)

    @property
    def fields(self) -> dict[str, list[Field]]:
        """Fields by table of the file."""
        by_table: dict[str, list[Field]] = {}
        for field in fields(self.document):
            if field.keys[0] in FORM_TABLES:
                by_table.setdefault(str(field.keys[0]), []).append(field)
        return by_table

    @property
    def addable(self) -> list[str]:
        """Quantities that might move and do not yet."""
        moving = {name for move in self.case.moves for name in move.together}
        fixed = moving | {f"loop.{name}" for name in HARDWARE}  # what the bed has is no choice of the match
        return [name for name in quantities(self.case) if name not in fixed]

    @property
    def statable(self) -> dict[str, str]:
        """Units of limits that the case might state and does not, by their key."""
        stated = self.document.content.get("limits", {})
        return {
            key: si
            for key, si in limit_units(self.case.rig, self.document.content.get("dynamometers", {})).items()
            if key not in stated
        }

    def set(self, keys: Keys, text: str) -> None:
        """Write the field at ``keys``; raises ``InputError`` where the case is wrong with it; then nothing changed."""
        self.case = set_field(self.document, keys, text, self._read)

    def move(self, name: str) -> None:
        """Let a quantity move, by a factor of two up and down to begin with."""
        if name not in self.addable:
            raise unknown(name, self.addable, "move")
        value = quantities(self.case)[name][0]
        bounds = {"lower": value / SPREAD, "upper": value * SPREAD if value else 1.0}
        self._change(("move", name), bounds)

    def limit(self, key: str, text: str) -> None:
        """State a limit; raises ``InputError`` where it is none, or the case is wrong with it."""
        self._change(("limits", key), number_or_text(text))

    def hold(self, name: str) -> None:
        """Let a quantity stay; raises ``InputError`` where the case is wrong without it."""
        text = self.document.without(("move", name))
        self._take(text)

    def undo(self) -> bool:
        """Take the last change back; whether there was one."""
        undone = self.document.undo()
        self.read_again()
        return undone

    def redo(self) -> bool:
        """Make the change again that was taken back last; whether there was one."""
        redone = self.document.redo()
        self.read_again()
        return redone

    def read_again(self) -> None:
        """Take the models as they are by now; raises ``InputError`` where the case is wrong with them."""
        self.case = self._read(self.document.content)

    def _change(self, keys: tuple[str, str], value: Any) -> None:
        table, key = keys
        first = table not in self.document.content
        self._take(self.document.replaced((table,), {key: value}) if first else self.document.replaced(keys, value))

    def _take(self, text: str) -> None:
        before = self.document.text
        self.document.change_text(text)
        try:
            self.case = self._read(self.document.content)
        except BaseException:
            if self.document.text != before:
                self.document.drop_last()
            raise

    def _read(self, content: dict[str, Any]) -> Case:
        return case_from_tables(self._with_models(content), str(self.document.path))


def write_case_at(case: Case, values: Mapping[str, float], folder: Path) -> Path:
    """Write the case with quantities (SI) held at values, all its models beside it; the path of the case file."""
    for name, value in values.items():
        case = held_at(case, name, value)
    write_all(folder, dict(case_files(case)))
    return folder / "case.toml"
