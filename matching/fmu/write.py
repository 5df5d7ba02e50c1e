"""An FMU on disk from whatever a user names."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from matching.fmu.controller import exported_controller
from matching.fmu.export_source import read_export_source, tuned_case
from modelling.common.errors import InputError
from modelling.controller.c_source import memory_bytes
from modelling.controller.exported import ExportedController
from modelling.fmu.controller import contents, controller_fmu
from modelling.fmu.export import Fmu, fmu
from modelling.fmu.variables import Variable
from modelling.writing.output import write_all


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
    """Write the FMU of a match, a case or a model to ``path``.

    Raises
    ------
    InputError
        If the name does not end in ``.fmu``, or ``source`` is nothing that can be exported.
    """
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
    """Write the FMU of a match's whole controller to ``path``.

    Raises
    ------
    InputError
        If the name does not end in ``.fmu``, or ``source`` is no match and no case.
    """
    target = _target(path, "--controller")
    match = tuned_case(source)
    controller = exported_controller(match.tuned)
    made = controller_fmu(controller, fmi)
    write_all(target.parent, {target.name: made.content})
    about, step = contents(controller), controller.law.sample_time
    return WrittenFmu(
        target, fmi, "controller", about.title, made, step, 1 / step,
        _units(about.inputs), _units(about.outputs), _parameters(about.parameters, ()),
        (*match.notes, *_not_noticed(controller), *_lacking(made)), len(controller.law.A), memory_bytes(controller),
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
