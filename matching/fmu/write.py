"""An FMU on disk from whatever a user names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matching.fmu.controller import exported_controller
from matching.fmu.export_source import read_export_source, tuned_case
from modelling.common.errors import InputError
from modelling.common.output import write_all
from modelling.controller.c_source import memory_bytes
from modelling.fmu.controller import contents, controller_fmu
from modelling.fmu.export import Fmu, fmu


def write(source: str, path: str, fmi: str) -> dict[str, Any]:
    """Write the FMU of a match, a case or a model to ``path``; what is in it, as ``--json`` prints it.

    Raises
    ------
    InputError
        If the name does not end in ``.fmu``, or ``source`` is nothing that can be exported.
    """
    target = _target(path, "--fmu")
    wanted = read_export_source(source)
    made = fmu(wanted.block, fmi, wanted.step)
    write_all(target.parent, {target.name: made.content})
    notes = [*wanted.notes, *_lacking(made)]
    block = wanted.block
    return {
        "fmu": str(target),
        "fmi": fmi,
        "of": wanted.kind,
        "title": block.title,
        "identifier": made.identifier,
        "token": made.token,
        "platform": made.platform,
        "communication_step": wanted.step,
        "steps_per_second": block.steps_per_second,
        "inputs": {variable.name: variable.unit for variable in block.inputs},
        "outputs": {variable.name: variable.unit for variable in block.outputs},
        "parameters": [
            {
                "name": parameter.name,
                "value": parameter.start,
                "unit": parameter.unit,
                "tuned": parameter.name in wanted.tuned,
            }
            for parameter in block.parameters
        ],
        "notes": notes,
    }


def write_controller(source: str, path: str, fmi: str) -> dict[str, Any]:
    """Write the FMU of a match's whole controller to ``path``; what is in it, as ``--json`` prints it.

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
    about = contents(controller)
    return {
        "fmu": str(target),
        "fmi": fmi,
        "of": "controller",
        "title": about.title,
        "identifier": made.identifier,
        "token": made.token,
        "platform": made.platform,
        "communication_step": controller.law.sample_time,
        "steps_per_second": 1 / controller.law.sample_time,
        "states": len(controller.law.A),
        "memory_bytes": memory_bytes(controller),
        "inputs": {variable.name: variable.unit for variable in about.inputs},
        "outputs": {variable.name: variable.unit for variable in about.outputs},
        "parameters": [
            {"name": parameter.name, "value": parameter.start, "unit": parameter.unit, "tuned": False}
            for parameter in about.parameters
        ],
        "notes": [*match.notes, *_lacking(made)],
    }


def _target(path: str, option: str) -> Path:
    target = Path(path)
    if target.suffix != ".fmu":
        raise InputError(option, f"{str(target)!r} is no name of an FMU", "let it end in .fmu")
    return target


def _lacking(made: Fmu) -> list[str]:
    if made.platform is not None:
        return []
    return ["no C compiler was found: the FMU holds C sources only, to be compiled where it is used"]
