"""An FMU on disk from whatever a user names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matching.fmu.given import given
from modelling.common.errors import InputError
from modelling.common.output import write_all
from modelling.fmu.export import fmu


def write(source: str, path: str, fmi: str) -> dict[str, Any]:
    """Write the FMU of a match, a case or a model to ``path``; what is in it, as ``--json`` prints it.

    Raises
    ------
    InputError
        If the name does not end in ``.fmu``, or ``source`` is nothing that can be exported.
    """
    target = Path(path)
    if target.suffix != ".fmu":
        raise InputError("--fmu", f"{str(target)!r} is no name of an FMU", "let it end in .fmu")
    wanted = given(source)
    made = fmu(wanted.block, fmi, wanted.step)
    write_all(target.parent, {target.name: made.content})
    notes = list(wanted.notes)
    if made.platform is None:
        notes.append(f"{made.lacking}: the FMU holds C sources only, to be compiled where it is used")
    own = wanted.block
    return {
        "fmu": str(target),
        "fmi": fmi,
        "of": wanted.kind,
        "title": own.title,
        "identifier": made.identifier,
        "token": made.token,
        "platform": made.platform,
        "communication_step": wanted.step,
        "steps_per_second": own.steps_per_second,
        "inputs": {one.name: one.unit for one in own.inputs},
        "outputs": {one.name: one.unit for one in own.outputs},
        "parameters": [
            {"name": one.name, "value": one.start, "unit": one.unit, "tuned": one.name in wanted.tuned}
            for one in own.parameters
        ],
        "notes": notes,
    }
