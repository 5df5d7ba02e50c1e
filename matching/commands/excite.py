"""`rigmatch excite`: plan the recording that identifies what a match depends on most."""

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matching.excitation.plan import ExcitationOrder

HELP = """Plan a recording of the bed without emulation that tells what the match depends on most: a multisine whose
spectrum makes the most of it (Fisher information), a chirp and steps on dynamometers and motor, as large as the case's
limits leave it with a margin, on the model and on beds drawn from [uncertainty]. States the standard uncertainties that
are expected. CASE is the directory that rigmatch match wrote, or a case file. Add the torques of excitation.csv to
those of a slow speed hold, and record the torque commands (speed hold included) and every sensor of the rig."""
EXAMPLES = (
    "rigmatch excite out/road_to_rig --out out/excite",
    "rigmatch excite examples/from_recordings/case.toml --duration 30 --speed 40 --limit motor_torque=60 "
    "--out out/excite",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Case, duration, margin, speed, limits, output directory."""
    from matching.arguments import count

    parser.add_argument("case", metavar="CASE", help="directory or result.json of a match, or a case file (TOML)")
    parser.add_argument("--duration", metavar="S", type=float, default=20.0, help="length in s (default: 20)")
    parser.add_argument(
        "--margin", metavar="X", type=float, default=0.2, help="share of every limit left (default: 0.2)"
    )
    parser.add_argument(
        "--speed", metavar="RAD_S", type=float, help="steady rotor speed (default: a quarter of the limit)"
    )
    parser.add_argument(
        "--limit", metavar="INPUT=TORQUE", action="append", default=[],
        help="largest torque of an input that is no dynamometer's, N·m (default: that of the case's manoeuvre)",
    )  # fmt: skip
    parser.add_argument(
        "--beds", metavar="N", type=count(0), default=20, help="beds drawn that the limits hold on (default: 20)"
    )
    parser.add_argument("--seed", metavar="N", type=count(0), default=0, help="seed of phases and beds (default: 0)")
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Plan and write files; the result object is the content of ``excite.json``.

    Raises
    ------
    InputError
        If the case lacks limits, nothing is uncertain, or a wish cannot be met.
    """
    from matching.excitation.plan import plan_excitation
    from matching.excitation.result import excitation_csv
    from matching.fmu.export_source import tuned_case
    from matching.report.common.style import image
    from matching.report.excitation.figures import excitation
    from modelling.writing.output import strict_json, write_all

    case = tuned_case(arguments.case).tuned
    plan = plan_excitation(case, _order(arguments))
    result = plan.to_dict()
    files: dict[str, str | bytes] = {
        "excite.json": strict_json(result), "excitation.csv": excitation_csv(plan),
        "figures/excitation.svg": image(excitation(plan)),
    }  # fmt: skip
    write_all(arguments.out, files)
    return result


def checked(arguments: argparse.Namespace) -> dict[str, str]:
    """For ``--check``: whether the wishes can be met; names no further file.

    Raises
    ------
    InputError
        As the command itself would.
    """
    from matching.excitation.plan import check_order
    from matching.fmu.export_source import tuned_case

    check_order(tuned_case(arguments.case).tuned, _order(arguments))
    return {}


def _order(arguments: argparse.Namespace) -> "ExcitationOrder":
    from matching.excitation.plan import ExcitationOrder

    return ExcitationOrder(
        arguments.duration, arguments.margin, arguments.speed, _limits(arguments.limit), arguments.beds, arguments.seed
    )


def _limits(entries: list[str]) -> dict[str, float]:
    from modelling.common.errors import InputError
    from modelling.units import to_si

    limits = {}
    for entry in entries:
        name, equals, value = entry.partition("=")
        if not equals:
            raise InputError(f"--limit {entry}", "is no pair", "write INPUT=TORQUE, e.g. motor_torque=150")
        try:
            limits[name] = float(value)
        except ValueError:
            limits[name] = to_si(value, "N*m", f"--limit {entry}")
        if not limits[name] > 0:
            raise InputError(f"--limit {entry}", "is not possible", "a torque greater than 0 is needed")
    return limits


def summary(result: dict[str, Any]) -> str:
    """What is expected of the recording, in a few lines."""
    from matching.report.excitation.text import summary as words

    return words(result)
