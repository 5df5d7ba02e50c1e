"""What `rigmatch export` writes: a residual vehicle, a model or a controller as an FMU with its C sources."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from matching.match.case import Case, apply
from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from modelling.bed.vehicle import Interface, ResidualVehicle, cut
from modelling.controller.c_source import memory_bytes
from modelling.controller.law import ExportedController
from modelling.errors import InputError, unknown
from modelling.fmu.export import Block, Fmu, Variable, block, contents, controller_fmu, fmu
from modelling.model_file import from_dict
from modelling.system import Sensor, System
from modelling.toml import finite, read_toml
from modelling.writing import write_all

# --- What a user names for export → an FMU's block: a match's directory or result, a case, or a model.

LARGEST_RESULT = 50_000_000  # bytes
STEP = 1e-3  # s, suggested for a model, which has no loop


@dataclass(frozen=True)
class ExportSource:
    """What to export: ``kind`` is ``residual vehicle`` or ``model``, ``step`` (s) the communication step to suggest."""

    block: Block
    kind: str
    step: float
    tuned: tuple[str, ...]
    notes: tuple[str, ...]


def read_export_source(path: str | Path) -> ExportSource:
    """Read what is to be exported: of a match the tuned residual vehicle, of a case that with its start values.

    Parameters
    ----------
    path : str or Path
        Directory that ``rigmatch match`` wrote, its ``result.json``, a case file or a model file.
    """
    path = Path(path)
    if path.is_dir():
        return _residual_vehicle(path / "result.json")
    if path.suffix == ".json":
        return _residual_vehicle(path)
    data = read_toml(path)
    if "inertias" in data or not {"vehicle", "rig"} & set(data):
        system = from_dict(data, str(path))
        notes = [
            f"gearboxes.{box.name}: its clutches carry what their inputs say, {', '.join(box.capacities)} (N*m)"
            for box in system.gearboxes
        ]
        block = _block([system], system.title or path.stem, path.stem, path)
        return ExportSource(block, "model", STEP, (), tuple(notes))
    return _residual_vehicle(path)


@dataclass(frozen=True)
class TunedCase:
    """A case with the values of its moves (SI), by name, and what has to be said of them."""

    case: Case
    values: dict[str, float]
    notes: tuple[str, ...]

    @property
    def tuned(self) -> Case:
        """The case at these values."""
        moves = {move.name: move for move in self.case.moves}
        return apply(self.case, {name: value for key, value in self.values.items() for name in moves[key].together})


def tuned_case(path: str | Path) -> TunedCase:
    """The case of a match with the values that its result states, or a case file with its start values."""
    path = Path(path)
    if path.is_dir():
        path = path / "result.json"
    if path.suffix != ".json":
        case = load_case(path)
        note = "a case, not a match: everything stands at its start value"
        return TunedCase(case, {move.name: move.start for move in case.moves}, (note,))
    result = _json(path)
    case_file = path.with_name("case.toml")
    if not case_file.exists():
        raise InputError(str(case_file), "does not exist", "leave result.json beside the files that the match wrote")
    case = load_case(case_file)
    known = [move.name for move in case.moves]
    values = {}
    for number, row in enumerate(result["parameters"]):
        name, value = (row.get(key) if isinstance(row, dict) else None for key in ("name", "tuned"))
        if name not in known and str(name).removeprefix("loop.") in case.loop.quantities:
            continue  # weights of an observer are tuned without being asked for: the case file holds them as tuned
        if name not in known:
            raise unknown(str(name), known, f"{path}: parameters[{number}].name")
        tuned = finite(value)
        if tuned is None:
            raise InputError(
                f"{path}: parameters[{number}].tuned", "is no finite number", "leave it as the match wrote it"
            )
        values[name] = tuned
    notes = []
    if result.get("status") != "matched":
        notes.append(f"the match is {str(result.get('status'))!r}, not 'matched': see its limits in {path}")
    return TunedCase(case, values, tuple(notes))


def _residual_vehicle(path: Path) -> ExportSource:
    """The residual vehicle of a match or a case."""
    match = tuned_case(path)
    return _residual(match.case, match.values, match.notes)


def _json(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:  # what is no regular file has no size, so at most so much is read
            content = file.read(LARGEST_RESULT + 1)
        if len(content) > LARGEST_RESULT:
            raise InputError(str(path), "is too large for the result of a match", "at most 50 MB are read")
        result = json.loads(content.decode("utf-8"))
    except FileNotFoundError:
        raise InputError(str(path), "does not exist", "give a directory that rigmatch match wrote") from None
    except OSError as fault:
        raise InputError(str(path), fault.strerror or "cannot be read", "name a readable file") from None
    except (ValueError, RecursionError) as fault:
        raise InputError(str(path), f"is not JSON: {fault}", "give the result.json of a match") from None
    if not isinstance(result, dict) or not isinstance(result.get("parameters"), list):
        raise InputError(str(path), "holds no result of a match", "give the result.json of a match")
    return result


def _residual(case: Case, values: dict[str, float], notes: tuple[str, ...]) -> ExportSource:
    moves = {move.name: move for move in case.moves}
    spread = {name: value for key, value in values.items() for name in moves[key].together}
    tuned = apply(case, spread)
    mine = {name.removeprefix("residual_vehicle."): move for move in moves.values() for name in move.together}
    mine = {name: move for name, move in mine.items() if move.name.startswith("residual_vehicle.")}
    bounds = {name: (move.lower, move.upper) for name, move in mine.items()}
    about = {name: f"tuned within {move.lower:g} … {move.upper:g} {move.unit}" for name, move in mine.items()}
    for interface in tuned.residual_vehicle.interfaces:
        about[interface.torque] = f"what the shaft {interface.shaft} brings in on the rig" + (
            "" if interface.factor == 1 else f", {interface.factor:g} times what its sensor reads"
        )
        about[interface.speed] = "what the dynamometer has to follow"
        about[acceleration(interface)] = "for the feed-forward of the dynamometer"
    parts = [_with_accelerations(part, tuned.residual_vehicle) for part in tuned.residual_vehicle.parts]
    title = f"Residual vehicle: {case.title}" if case.title else parts[0].title
    made = _block(parts, title, "residual_vehicle", Path(case.path), about, bounds)
    return ExportSource(made, "residual vehicle", case.loop["sample_time"], tuple(mine), (*notes, *_apart(tuned, mine)))


def _apart(tuned: Case, names: Collection[str]) -> list[str]:
    """A note where the feed-forward reproduces another residual vehicle than the exported one of the feedback."""
    if not tuned.loop.structure.has_feed_forward:
        return []
    exported, reproduced = (
        {name: quantity.value for part in parts for name, quantity in part.parameters.items()}
        for parts in (tuned.residual_vehicle.parts, cut(tuned.emulated_vehicle, tuned.rig).parts)
    )
    apart = [
        f"{name} {exported[name]:.6g} (vehicle {reproduced[name]:.6g})"
        for name in names
        if exported[name] != reproduced[name]
    ]
    if not apart:
        return []
    structure = tuned.loop.structure.name
    return [
        f"this is the residual vehicle of the feedback, as tuned: {', '.join(apart)}; the feed-forward of "
        f"{structure!r} reproduces the vehicle's own values, and both are in export --controller"
    ]


def acceleration(cut: Interface) -> str:
    """Name of the output with the acceleration behind a cut, which a feed-forward needs."""
    return f"{cut.vehicle_end}_interface_acceleration"


def _with_accelerations(part: System, residual: ResidualVehicle) -> System:
    cuts = [cut for cut in residual.interfaces if residual.part_of(cut) == part]
    more = tuple(Sensor(acceleration(cut), "acceleration", cut.vehicle_end) for cut in cuts)
    return replace(part, sensors=(*part.sensors, *more))


def _block(
    systems: list[System],
    title: str,
    name: str,
    path: Path,
    notes: dict[str, str] | None = None,
    bounds: dict[str, tuple[float, float]] | None = None,
) -> Block:
    try:
        return block(systems, title, name, notes, bounds)
    except InputError as fault:
        raise InputError(f"{path}: {fault.where}", fault.wrong, fault.right) from None


# --- Write


@dataclass(frozen=True)
class ParameterOfFmu:
    """A parameter that can be set in the FMU, SI; ``tuned`` says whether the match tuned it."""

    name: str
    value: float
    unit: str
    tuned: bool


@dataclass(frozen=True)
class WrittenFmu:
    """What stands in an FMU that was written.

    Attributes
    ----------
    path : Path
    fmi : str
        Version of the standard.
    of : str
        What it is of: ``residual vehicle``, ``model`` or ``controller``.
    title : str
    build : Fmu
        Identifier, token and platform.
    communication_step, steps_per_second : float
        s, and internal steps in 1/s.
    inputs, outputs : dict of str to str
        Units by name.
    parameters : tuple of ParameterOfFmu
    notes : tuple of str
        What the user should know.
    states, memory_bytes : int or None
        Of a controller.
    """

    path: Path
    fmi: str
    of: str
    title: str
    build: Fmu = field(repr=False)
    communication_step: float
    steps_per_second: float
    inputs: dict[str, str]
    outputs: dict[str, str]
    parameters: tuple[ParameterOfFmu, ...]
    notes: tuple[str, ...]
    states: int | None = None
    memory_bytes: int | None = None

    def to_dict(self) -> dict[str, Any]:
        """As ``--json`` prints it."""
        of_controller = {} if self.states is None else {"states": self.states, "memory_bytes": self.memory_bytes}
        return {
            "fmu": str(self.path), "fmi": self.fmi, "of": self.of, "title": self.title,
            "identifier": self.build.identifier, "token": self.build.token, "platform": self.build.platform,
            "communication_step": self.communication_step, "steps_per_second": self.steps_per_second, **of_controller,
            "inputs": self.inputs, "outputs": self.outputs,
            "parameters": [asdict(parameter) for parameter in self.parameters], "notes": list(self.notes),
        }  # fmt: skip


def write(source: str, path: str, fmi: str) -> WrittenFmu:
    """Write the FMU of a match, a case or a model to ``path``."""
    target = _target(path, "--fmu")
    wanted = read_export_source(source)
    made = fmu(wanted.block, fmi, wanted.step)
    write_all(target.parent, {target.name: made.content})
    block = wanted.block
    return WrittenFmu(
        target, fmi, wanted.kind, block.title, made, wanted.step, block.steps_per_second,
        _units(block.inputs), _units(block.outputs), _parameters(block.parameters, wanted.tuned),
        (*wanted.notes, *_lacking(made)),
    )  # fmt: skip


def write_controller(source: str, path: str, fmi: str) -> WrittenFmu:
    """Write the FMU of a match's whole controller to ``path``."""
    target = _target(path, "--controller")
    match = tuned_case(source)
    controller = exported_controller(match.tuned)
    made = controller_fmu(controller, fmi)
    write_all(target.parent, {target.name: made.content})
    about, step = contents(controller), controller.law.sample_time
    return WrittenFmu(
        target, fmi, "controller", about.title, made, step, 1 / step,
        _units(about.inputs), _units(about.outputs), _parameters(about.parameters, ()),
        (*match.notes, *_not_noticed(controller), *_lacking(made)), controller.law.states, memory_bytes(controller),
    )  # fmt: skip


def _not_noticed(controller: ExportedController) -> list[str]:
    """A note on every shaft whose opening the controller does not notice within five samples."""
    return [f"if a shaft opens: {shaft.words}" for shaft in controller.shafts if not shaft.noticed_by]


def _units(variables: Iterable[Variable]) -> dict[str, str]:
    return {variable.name: variable.unit for variable in variables}


def _parameters(variables: Iterable[Variable], tuned: Collection[str]) -> tuple[ParameterOfFmu, ...]:
    return tuple(ParameterOfFmu(each.name, each.start, each.unit, each.name in tuned) for each in variables)


def _target(path: str, option: str) -> Path:
    target = Path(path)
    if target.suffix != ".fmu":
        raise InputError(option, f"{str(target)!r} is no name of an FMU", "let it end in .fmu")
    return target


def _lacking(made: Fmu) -> list[str]:
    if made.platform is not None:
        return []
    return ["no C compiler was found: the FMU holds C sources only, to be compiled where it is used"]
