"""`rigmatch identify`: a case known from recordings of its vehicle and its bed."""

import argparse
from typing import Any

HELP = """Find out from recordings what vehicle and bed really are, and write the case with these values and, under
[uncertainty], with what is still not known of them. A recording of the vehicle holds the torques that act on it and any
of its sensors (tip-ins, coast-downs); a torque that the road alone gives may be missing. One of the bed is made without
emulation (rigmatch excite plans it) and holds the torque commands and the sensors of the rig. What vehicle and rig
share is the same hardware; its values are taken from the bed first. rigmatch match then tunes the case that is written.
CASE is a case file, or the directory of a match."""
EXAMPLES = (
    "rigmatch identify examples/from_recordings/case.toml --vehicle examples/from_recordings/road.csv "
    "--bed examples/from_recordings/bed.csv --out out/identify",
    "rigmatch identify examples/from_recordings/case.toml --bed examples/from_recordings/bed.csv --out out/bed_alone",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Case, recordings, output directory."""
    from matching.arguments import seconds

    parser.add_argument("case", metavar="CASE", help="case file (TOML), or the directory of a match")
    parser.add_argument("--vehicle", metavar="RECORDING", nargs="+", default=[], help="of the vehicle on the road")
    parser.add_argument("--bed", metavar="RECORDING", nargs="+", default=[], help="of the bed without emulation")
    parser.add_argument(
        "--diagnosis-limit", type=seconds, metavar="SECONDS",
        help="a diagnosis that takes longer ends with the best it has, and says so (default: no limit)",
    )  # fmt: skip
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Identify and write files; the result object is the content of ``identification.json``.

    Raises
    ------
    InputError
        One line that names file, key or column.
    """
    from pathlib import Path

    from matching.arguments import steps
    from matching.commissioning.from_recordings import identify
    from matching.fmu.export_source import tuned_case
    from modelling.writing.output import write_all

    case = tuned_case(arguments.case).tuned
    vehicle, bed = ([Path(name) for name in names] for names in (arguments.vehicle, arguments.bed))
    with steps("identify") as step:
        known = identify(case, vehicle, bed, step, arguments.diagnosis_limit)
    write_all(arguments.out, known.files())
    return known.to_dict()


def checked(arguments: argparse.Namespace) -> dict[str, str]:
    """For ``--check``: what the recordings hold, by file.

    Raises
    ------
    InputError
        As the command itself would.
    """
    from pathlib import Path

    from matching.commissioning.from_recordings import recordings_read
    from matching.fmu.export_source import tuned_case

    vehicle, bed = ([Path(name) for name in names] for names in (arguments.vehicle, arguments.bed))
    return recordings_read(tuned_case(arguments.case).tuned, vehicle, bed)


def summary(result: dict[str, Any]) -> str:
    """What the recordings say, a few lines each."""
    from matching.report.commissioning.text import identification_lines

    return "\n".join(
        f"{name}: {line}" for name, part in result.items() if part is not None for line in identification_lines(part)
    )
