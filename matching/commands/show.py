"""`rigmatch show`: the drivetrain of a model, or vehicle and rig of a case, as a drawing."""

import argparse
from typing import Any

HELP = """Draw a drivetrain as engineers do: inertias as discs, shafts as springs with dampers, gears, differentials,
dynamometers and sensors. FILE is a model file, or a case file: then the vehicle is drawn above its rig, with the cut in
both. Writes drivetrain.svg and drivetrain.png."""
EXAMPLES = (
    "rigmatch show examples/road_to_rig/vehicle.toml --out out/drawing",
    "rigmatch show examples/road_to_rig/case.toml --out out/drawing",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Model or case file, place to write to."""
    parser.add_argument("file", metavar="FILE", help="model or case file (TOML)")
    parser.add_argument("--out", metavar="DIR", default=".", help="directory to write to (default: here)")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Draw and write; the result object says what was drawn."""
    from matching.frequency.case.load import is_case, load_case
    from matching.report.common.style import image
    from matching.report.drawing.figures import case_figure, model_figure
    from modelling.common.tables import read_toml
    from modelling.model.files import load
    from modelling.writing.output import write_all

    if is_case(read_toml(arguments.file)):
        case = load_case(arguments.file)
        drawn, systems = case_figure(case), {"vehicle": case.vehicle, "rig": case.rig}
    else:
        system = load(arguments.file)
        drawn, systems = model_figure(system), {"model": system}
    write_all(arguments.out, {f"drivetrain.{kind}": image(drawn, kind) for kind in ("svg", "png")})
    counts = {
        role: {"title": system.title, "inertias": len(system.inertias), "shafts": len(system.shafts)}
        for role, system in systems.items()
    }
    return {"file": arguments.file, "drawn": counts, "files": ["drivetrain.png", "drivetrain.svg"]}


def summary(result: dict[str, Any]) -> str:
    """What was drawn and written."""
    from matching.report.common.wording import counted

    lines = [
        f"{role}: {counted(counts['inertias'], 'inertia')}, {counted(counts['shafts'], 'shaft')}"
        + (f" ({counts['title']})" if counts["title"] else "")
        for role, counts in result["drawn"].items()
    ]
    return "\n".join([*lines, f"written: {', '.join(result['files'])}"])
