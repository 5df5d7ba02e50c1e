"""`rigmatch export`: the tuned residual vehicle, or any model, as an FMU."""

import argparse
from typing import Any

HELP = """Write the tuned residual vehicle as an FMU for co-simulation: C by CasADi, compiled for this platform where
there is a C compiler, with its sources for others. RESULT is the directory that rigmatch match wrote, its result.json,
or a case file (then with the start values of its [move]); a model file is written as it is. Every quantity is a
parameter that can be set, named and in SI as in the model."""

VERSIONS = ("2.0", "3.0")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What to export, where to, and which version of FMI."""
    parser.add_argument(
        "result", metavar="RESULT", help="directory or result.json of a match, case file, or model file"
    )
    parser.add_argument("--fmu", metavar="FILE", required=True, help="FMU to write, NAME.fmu")
    parser.add_argument("--fmi", choices=VERSIONS, default=VERSIONS[0], help="version of FMI (default: 2.0)")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Write the FMU; the result object tells what is in it."""
    from pathlib import Path

    from matching.fmu.given import given
    from modelling.common.errors import InputError
    from modelling.common.output import write_all
    from modelling.fmu.export import fmu

    target = Path(arguments.fmu)
    if target.suffix != ".fmu":
        raise InputError("--fmu", f"{str(target)!r} is no name of an FMU", "let it end in .fmu")
    wanted = given(arguments.result)
    made = fmu(wanted.block, arguments.fmi, wanted.step)
    write_all(target.parent, {target.name: made.content})
    notes = list(wanted.notes)
    if made.platform is None:
        notes.append(f"{made.lacking}: the FMU holds C sources only, to be compiled where it is used")
    own = wanted.block
    return {
        "fmu": str(target),
        "fmi": arguments.fmi,
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


def summary(result: dict[str, Any]) -> str:
    """What was written, in a few lines."""
    tuned = [one for one in result["parameters"] if one["tuned"]]
    where = f"binary for {result['platform']} and sources" if result["platform"] else "sources only"
    lines = [
        f"{result['fmu']}: {result['title']}",
        f"FMI {result['fmi']} for co-simulation, {where}; internal steps of at most "
        f"{1e3 / result['steps_per_second']:.4g} ms",
        f"inputs: {', '.join(result['inputs']) or 'none'}",
        f"outputs: {', '.join(result['outputs']) or 'none'}",
        f"{len(result['parameters'])} parameters, {len(tuned)} of them tuned"
        + "".join(f"\n  {one['name']} = {one['value']:.6g} {one['unit']}" for one in tuned),
    ]
    return "\n".join(lines + [f"note: {note}" for note in result["notes"]])
