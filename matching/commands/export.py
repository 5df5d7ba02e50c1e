"""`rigmatch export`: the tuned residual vehicle, the whole controller, or any model, as an FMU."""

import argparse
from typing import Any

HELP = """Write the tuned residual vehicle as an FMU for co-simulation: C by CasADi, compiled for this platform where
there is a C compiler, with its sources for others. RESULT is the directory that rigmatch match wrote, its result.json,
or a case file (then with the start values of its [move]); a model file is written as it is. Every quantity is a
parameter that can be set, named and in SI as in the model.

With --controller the whole controller is written instead: residual vehicle, feed-forward, observer, prediction, limits,
speed hold and watchdogs, sampled as it was tuned. Its C sources (controller.h, controller.c, controller_data.h) run on
a real-time system without FMI."""

VERSIONS = ("2.0", "3.0")
EXAMPLES = (
    "rigmatch export out/road_to_rig --fmu out/residual_vehicle.fmu",
    "rigmatch export out/road_to_rig --controller out/controller.fmu",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What to export, where to, and which version of FMI."""
    parser.add_argument(
        "result", metavar="RESULT", help="directory or result.json of a match, case file, or model file"
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--fmu", metavar="FILE", help="FMU of the residual vehicle or model to write, NAME.fmu")
    what.add_argument("--controller", metavar="FILE", help="FMU of the whole controller to write, NAME.fmu")
    parser.add_argument("--fmi", choices=VERSIONS, default=VERSIONS[0], help="version of FMI (default: 2.0)")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Write the FMU; the result object tells what is in it."""
    from matching.fmu.write import write, write_controller

    if arguments.controller:
        return write_controller(arguments.result, arguments.controller, arguments.fmi).to_dict()
    return write(arguments.result, arguments.fmu, arguments.fmi).to_dict()


def summary(result: dict[str, Any]) -> str:
    """What was written, in a few lines."""
    tuned = [parameter for parameter in result["parameters"] if parameter["tuned"]]
    where = f"binary for {result['platform']} and sources" if result["platform"] else "sources only"
    steps = (
        f"sample time {1e3 * result['communication_step']:.4g} ms, {result['states']} states, "
        f"{result['memory_bytes']} bytes"
        if result["of"] == "controller"
        else f"internal steps of at most {1e3 / result['steps_per_second']:.4g} ms"
    )
    lines = [
        f"{result['fmu']}: {result['title']}",
        f"FMI {result['fmi']} for co-simulation, {where}; {steps}",
        f"inputs: {', '.join(result['inputs']) or 'none'}",
        f"outputs: {', '.join(result['outputs']) or 'none'}",
        f"{len(result['parameters'])} parameters, {len(tuned)} of them tuned"
        + "".join(f"\n  {parameter['name']} = {parameter['value']:.6g} {parameter['unit']}" for parameter in tuned),
    ]
    return "\n".join(lines + [f"note: {note}" for note in result["notes"]])
