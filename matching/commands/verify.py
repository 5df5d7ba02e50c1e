"""`rigmatch verify`: judge recordings of the controlled bed."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matching.arguments import seconds
from modelling.common.errors import InputError

if TYPE_CHECKING:
    from matching.frequency.case.case import Case
    from modelling.measurement.channels import Channel

HELP = """Judge recordings of the controlled bed: frequency responses with their uncertainty, the response error,
frequency and damping of the target modes, and R_XiL, each beside vehicle and prediction. The answer is as_predicted,
short or undetermined. CASE is the directory that rigmatch match wrote, or a case file. A recording holds the compared
torques and sensors by name, and lasts four periods of the lowest frequency of the band or more. Where the bed falls
short and the recording holds the torque commands as well, a diagnosis of it says why."""
EXAMPLES = (
    "rigmatch export examples/from_recordings/bed.toml --fmu out/bed.fmu",
    "rigmatch commission examples/from_recordings/case.toml --bed out/bed.fmu --rounds 1 --out out/commissioned",
    "rigmatch verify out/commissioned/1_match out/commissioned/1_verify/recording.csv --out out/verify",
    "rigmatch verify out/commissioned/1_match out/commissioned/1_verify/recording.csv --follow 10 --out out/followed",
)
PAGE = "report.html"  # in the folder of --out


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Match or case, recordings, output directory."""
    parser.add_argument("case", metavar="CASE", help="directory or result.json of a match, or a case file (TOML)")
    parser.add_argument(
        "recordings", metavar="RECORDING", nargs="+", help="recordings of the controlled bed (CSV, MDF, .mat, Parquet)"
    )
    parser.add_argument("--channels", metavar="FILE", help="what the signals are called in the recordings (TOML)")
    parser.add_argument(
        "--follow",
        type=seconds,
        metavar="SECONDS",
        help="judge again while the recordings grow, until none has grown for so long",
    )
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Judge and write files; the result object is the content of ``verification.json``."""
    from matching.fmu.export_source import tuned_case
    from modelling.measurement.channels import read_channels

    case = tuned_case(arguments.case).tuned
    channels = read_channels(arguments.channels) if arguments.channels else None
    if arguments.follow is None:
        return _judged(arguments, case, channels, arguments.recordings)
    return _followed(arguments, case, channels)


def _judged(
    arguments: argparse.Namespace, case: Case, channels: Mapping[str, Channel] | None, recordings: Sequence[str | Path]
) -> dict[str, Any]:
    """Judge recordings, or copies of those on the command line, and write files; diagnose them where they are short."""
    from matching.arguments import steps
    from matching.bed_test.judge import judge
    from matching.bed_test.recorded import read_recordings
    from matching.commissioning.why_short import why_short
    from matching.report.bed_test.curve_data import curve_data
    from matching.report.bed_test.figures import responses
    from matching.report.bed_test.page import page
    from matching.report.common.provenance import made_from, with_recordings
    from matching.report.common.style import image
    from matching.report.curves.acting_axes import acting
    from modelling.writing.output import write_results

    verification = judge(case, read_recordings(recordings, case, channels, arguments.recordings))
    result = verification.to_dict()
    if arguments.follow is None:  # nobody at the bed waits for minutes
        with steps("verify") as tell:
            reason = why_short(case, verification, recordings, channels, tell)
        result["diagnosis"] = None if reason is None else reason.to_dict()
    figure = responses(verification)
    drawn = {"responses": image(figure)}
    made = made_from(case.path, None, ("vehicle", "rig"))
    made = with_recordings(made, zip(arguments.recordings, recordings, strict=True))
    data = {"responses": curve_data(verification.curves)}
    files: dict[str, str | bytes] = {PAGE: page(result, drawn, acting({"responses": figure}), made, data)}
    files |= {f"figures/{name}.svg": content for name, content in drawn.items()}
    return write_results(arguments.out, "verification.json", result, files)


def _followed(arguments: argparse.Namespace, case: Case, channels: Mapping[str, Channel] | None) -> dict[str, Any]:
    """Judge growing recordings again and again; a line each time says how far the answer is."""
    from tempfile import TemporaryDirectory

    from matching.bed_test.growing import snapshots
    from matching.report.bed_test.text import interim

    result: dict[str, Any] | None = None
    wrong: InputError | None = None
    with TemporaryDirectory(prefix="rigmatch-") as folder:
        for copies in snapshots([Path(name) for name in arguments.recordings], arguments.follow, Path(folder)):
            try:
                result, wrong = _judged(arguments, case, channels, copies), None
                print(interim(result), file=sys.stderr, flush=True)
            except InputError as error:
                where = error.where
                for copy, name in zip(copies, arguments.recordings, strict=True):
                    where = where.replace(str(copy), name)
                wrong = InputError(where, error.wrong, error.right)
                print(f"not yet: {wrong}", file=sys.stderr, flush=True)
    if wrong is not None and result is not None:  # an answer that the files as they are do not give
        before = f"{arguments.out} holds what was judged before"
        raise InputError(wrong.where, wrong.wrong, "; ".join(filter(None, (wrong.right, before))))
    if result is None:
        raise wrong or InputError(arguments.recordings[0], "was never judged")
    return result


def summary(result: dict[str, Any]) -> str:
    """The answer, errors, modes and fidelity in a few lines."""
    from matching.report.bed_test.text import summary as words

    return words(result)
