"""`rigmatch commission`: the whole way onto the bed, stoppable at every step."""

import argparse
import sys
from typing import Any

HELP = """The whole way onto the bed: match, export, run and verify; then excite, record, diagnose, match again with the
values and uncertainties that the diagnosis found, export, run, verify, as long as a further round would gain. BED is an
FMU of the bed (FMI 2.0, inputs and outputs named as in the rig file), stepped with the exported controller's FMU, or a
folder that recordings are put into: then the command stops and says what to record and where to put it. Called again
it goes on where it stopped; steps that are done are not repeated. CASE is a case file, or the directory of a match."""
EXAMPLES = (
    "rigmatch commission examples/from_recordings/case.toml --bed out/bed_recordings --out out/by_hand",
    "rigmatch export examples/from_recordings/bed.toml --fmu out/bed.fmu",
    "rigmatch commission examples/from_recordings/case.toml --bed out/bed.fmu --rounds 2 --out out/commission",
    "rigmatch commission examples/from_recordings/case.toml --vehicle-recording examples/from_recordings/road.csv "
    "--bed out/bed.fmu --out out/known_vehicle",
)
PAGE = "report.html"  # in the folder of --out


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Case, bed, rounds, excitation, output directory."""
    from matching.arguments import count, seconds

    parser.add_argument("case", metavar="CASE", help="case file (TOML), or the directory of a match")
    parser.add_argument("--bed", metavar="BED", required=True, help="FMU of the bed, or a folder for its recordings")
    parser.add_argument(
        "--vehicle-recording", metavar="RECORDING", nargs="+", default=[],
        help="of the vehicle on the road: its model is diagnosed on them before the first match",
    )  # fmt: skip
    parser.add_argument("--rounds", metavar="N", type=count(1), default=3, help="rounds at most (default: 3)")
    parser.add_argument("--duration", metavar="S", type=float, default=12.0, help="of the excitation, s (default: 12)")
    parser.add_argument("--speed", metavar="RAD_S", type=float, help="rotor speed (default: a quarter of the limit)")
    parser.add_argument(
        "--diagnosis-limit", type=seconds, default=600.0, metavar="SECONDS",
        help="a diagnosis that takes longer ends with the best it has, and says so (default: 600)",
    )  # fmt: skip
    parser.add_argument("--seed", metavar="N", type=count(0), default=0, help="seed of the matches (default: 0)")
    parser.add_argument("--workers", metavar="N", type=count(1), help="processes (default: one a core)")
    parser.add_argument(
        "--follow", type=seconds, metavar="SECONDS",
        help="with a folder: wait for each recording, and follow it until it has not grown for so long",
    )  # fmt: skip
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Go round and write files; the result object is the content of ``commission.json``.

    Raises
    ------
    InputError
        One line that names what of case, bed or recording is not as it has to be.
    """
    from pathlib import Path

    from matching.arguments import steps
    from matching.commissioning.circle import Circle, CommissionOrder
    from matching.excitation.plan import ExcitationOrder
    from matching.report.commissioning.page import page
    from matching.report.common.provenance import made_from
    from modelling.common.cores import cores
    from modelling.writing.output import strict_json, write_all

    excitation = ExcitationOrder(duration=arguments.duration, speed=arguments.speed)
    order = CommissionOrder(
        arguments.rounds, excitation, arguments.seed, arguments.workers or cores(), arguments.follow,
        tuple(Path(name) for name in arguments.vehicle_recording), arguments.diagnosis_limit,
    )  # fmt: skip
    with steps("commission") as step:
        tell = step if arguments.follow is None else _said
        result = Circle(Path(arguments.out), Path(arguments.bed), order, tell).run(Path(arguments.case)).to_dict()
    case = Path(arguments.case)
    made = made_from(case / "case.toml" if case.is_dir() else case, arguments.seed, ("vehicle", "rig"))
    write_all(arguments.out, {"commission.json": strict_json(result), "report.html": page(result, made)})
    return result


def checked(arguments: argparse.Namespace) -> dict[str, str]:
    """For ``--check``: what the bed is, and what the vehicle's recordings hold, by file.

    Raises
    ------
    InputError
        As the command itself would.
    """
    from pathlib import Path

    from matching.commissioning.fmu_bed import FmuBed, check_bed
    from matching.commissioning.from_recordings import recordings_read
    from matching.excitation.plan import ExcitationOrder, check_order
    from matching.fmu.export_source import tuned_case

    case, bed = tuned_case(arguments.case).tuned, Path(arguments.bed)
    check_order(case, ExcitationOrder(duration=arguments.duration, speed=arguments.speed))
    check_bed(bed)
    contents = {arguments.bed: "a folder for recordings of the bed"}
    if bed.is_file():
        with FmuBed(bed, [part.name for part in case.rig.inputs], [part.name for part in case.rig.sensors]):
            contents[arguments.bed] = "an FMU with the rig's inputs and sensors"
    recordings = [Path(name) for name in arguments.vehicle_recording]
    return contents | (recordings_read(case, recordings, []) if recordings else {})


def _said(what: str) -> None:
    """For a person at the bed, a line each."""
    print(what, file=sys.stderr, flush=True)


def summary(result: dict[str, Any]) -> str:
    """The answer, then a few lines a round."""
    from matching.report.commissioning.text import summary as words

    return words(result)
