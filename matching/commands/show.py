"""`rigmatch show`: a model, or vehicle and rig of a case, as a drawing; the channels of a recording as a list."""

import argparse
from pathlib import Path
from typing import Any

HELP = """Draw a drivetrain as engineers do: inertias as discs, shafts as springs with dampers, gears, differentials,
dynamometers and sensors. FILE is a model file, or a case file: then the vehicle is drawn above its rig, with the cut in
both. Writes drivetrain.svg and drivetrain.png. Of a recording, its channels are listed with units, samples and ranges;
with --model, a channel file that fits the model is written, to be checked before use."""
EXAMPLES = (
    "rigmatch show examples/road_to_rig/vehicle.toml --out out/drawing",
    "rigmatch show examples/road_to_rig/case.toml --out out/drawing",
    "rigmatch show examples/from_recordings/road.csv --model examples/from_recordings/vehicle.toml --out out/channels",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Model, case or measurement file, a model for the channels, place to write to."""
    parser.add_argument("file", metavar="FILE", help="model or case file (TOML), or a recording")
    parser.add_argument("--model", metavar="MODEL", help="of a recording: write a channel file for this model")
    parser.add_argument("--out", metavar="DIR", default=".", help="directory to write to (default: here)")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Draw and write, or list; the result object says what was drawn, or which channels there are."""
    from modelling.common.errors import InputError
    from modelling.measurement.readers import READERS

    if Path(arguments.file).suffix.lower() in READERS:
        return _listed(arguments)
    if arguments.model:
        raise InputError("--model", f"{arguments.file} is no recording", f"one ends in {', '.join(READERS)}")
    return _drawn(arguments)


def _listed(arguments: argparse.Namespace) -> dict[str, Any]:
    from matching.explore.signals.channel_list import channel_list
    from modelling.common.escape import file_name
    from modelling.model.files import load
    from modelling.writing.output import write_all

    listed = channel_list(arguments.file, load(arguments.model) if arguments.model else None)
    files = []
    if arguments.model:
        files = [f"{file_name(Path(arguments.file).stem)}_channels.toml"]
        write_all(arguments.out, {files[0]: listed["channel_file"]})
    return {"file": arguments.file, **listed, "files": files}


def _drawn(arguments: argparse.Namespace) -> dict[str, Any]:
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
    """What was drawn or listed, and what was written."""
    from matching.report.common.table import aligned
    from matching.report.common.wording import counted

    written = [f"written: {', '.join(result['files'])}"] if result["files"] else []
    if "channels" in result:
        rows = [{head: _cell(value) for head, value in row.items()} for row in result["channels"]]
        notes = [f"note: {note}" for note in result["notes"]]
        parts = [aligned(rows), *notes, *([result["channel_file"].rstrip()] if result["channel_file"] else [])]
        return "\n".join([*parts, *written])

    lines = [
        f"{role}: {counted(counts['inertias'], 'inertia')}, {counted(counts['shafts'], 'shaft')}"
        + (f" ({counts['title']})" if counts["title"] else "")
        for role, counts in result["drawn"].items()
    ]
    return "\n".join([*lines, *written])


def _cell(value: str | float | None) -> str:
    return "-" if value is None or value == "" else f"{value:.6g}" if isinstance(value, float) else str(value)
