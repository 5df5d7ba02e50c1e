"""`rigmatch tolerance`: how tolerances of the bed spread a match."""

import argparse
from typing import Any

HELP = """Draw the rig's quantities from the ranges in its file (and of --tolerance), keep the controller as it is,
and give the spread of modulus margin, loop modes and response error, the yield, and which quantities cause the
spread. CASE is the case.toml that a match wrote: its [move] start values are taken as tuned. Writes tolerance.json,
report.html and tolerance.svg; finished parts are kept in tolerance.partial.jsonl until the end: a study that was
stopped continues from them."""
PAGE = "report.html"  # in the folder of --out
EXAMPLES = (
    "rigmatch match examples/road_to_rig/case.toml --out out/match",
    'rigmatch tolerance out/match/case.toml -n 10000 --tolerance "rig.*.stiffness=0.05" --out out/tolerance',
    'rigmatch tolerance out/match/case.toml --tolerance "rig.inertias.*.J=0.02" --tolerance loop.dead_time=0.1 '
    "--out out/tolerance",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Case file, place to write to, what varies, and how many draws."""
    from matching.arguments import completed, count, scale_out

    parser.add_argument("case", metavar="CASE", help="case file (TOML), as a match wrote it")
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")
    parser.add_argument("-n", "--draws", metavar="N", type=count(100), default=10_000, help="draws (default: 10000)")
    added = parser.add_argument(
        "--tolerance", metavar="NAME=SHARE", action="append", default=[],
        help="a further quantity of rig or loop and its relative tolerance, e.g. loop.dead_time=0.2, or many by "
        'a quoted pattern, e.g. "rig.*.stiffness=0.05"; repeatable',
    )  # fmt: skip
    completed(added, _quantities)
    parser.add_argument("--seed", metavar="N", type=count(0), default=0, help="seed of the draws (default: 0)")
    scale_out(parser)


def _quantities(arguments: argparse.Namespace) -> list[str]:
    """Quantities of rig and loop that may vary, as the command line names them."""
    from matching.completion import quantities_of_case

    return [f"{name}=" for name in quantities_of_case(arguments.case) if name.startswith(("rig.", "loop."))]


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Study and write; the result object is the content of ``tolerance.json``.

    Raises
    ------
    InputError
        One line that names option, file or key.
    """
    from pathlib import Path

    from matching.arguments import progress
    from matching.executors import executor_of
    from matching.frequency.case.load import load_case
    from matching.frequency.studies.tolerance import tolerance
    from matching.report.common.provenance import provenance
    from matching.report.common.style import image
    from matching.report.tolerance.page import page
    from matching.report.tolerance.view import plot
    from modelling.common.cores import cores
    from modelling.writing.output import write_results

    case = load_case(arguments.case)
    added = dict(_tolerance(text) for text in arguments.tolerance)
    record = Path(arguments.out) / "tolerance.partial.jsonl"
    with (
        executor_of(arguments.workers or cores(), arguments.scheduler) as executor,
        progress("tolerance") as advance,
    ):
        study = tolerance(
            case, arguments.draws, executor, seed=arguments.seed, added=added, record=record, progress=advance
        )
    result = study.to_dict()
    drawn = plot(study)
    picture = image(drawn)
    report = page(study, drawn, picture, provenance(case, arguments.seed))
    written = write_results(arguments.out, "tolerance.json", result, {"tolerance.svg": picture, "report.html": report})
    record.unlink(missing_ok=True)
    return written


def checked(arguments: argparse.Namespace) -> dict[str, str]:
    """For ``--check``: whether the study covers the case, and what varies exists; names no further file.

    Raises
    ------
    InputError
        As the command itself would.
    """
    from matching.frequency.case.load import load_case
    from matching.frequency.studies.tolerance import what_varies

    what_varies(load_case(arguments.case), dict(_tolerance(text) for text in arguments.tolerance))
    return {}


def summary(result: dict[str, Any]) -> str:
    """Spread, yield and drivers in a few lines."""
    from matching.report.tolerance.view import summary as lines

    return lines(result)


def _tolerance(assignment: str) -> tuple[str, float]:
    from modelling.common.errors import InputError

    name, _, share = assignment.partition("=")
    try:
        return name.strip(), float(share)
    except ValueError:
        raise InputError("--tolerance", f"{assignment!r} is no NAME=SHARE", "write e.g. loop.dead_time=0.2") from None
