"""`rigmatch verify`: judge recordings of the controlled bed."""

import argparse
from typing import Any

HELP = """Judge recordings of the controlled bed: frequency responses with their uncertainty, the response error,
frequency and damping of the target modes, and R_XiL, each beside vehicle and prediction. The answer is as_predicted,
short or undetermined. CASE is the directory that rigmatch match wrote, or a case file. A recording holds the compared
torques and sensors by name, and lasts four periods of the lowest frequency of the band or more."""
EXAMPLES = (
    "rigmatch verify out/road_to_rig sweep.mf4 --out out/verify",
    "rigmatch verify case.toml motor.csv road.csv --channels channels.toml --out out/verify",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Match or case, recordings, output directory."""
    parser.add_argument("case", metavar="CASE", help="directory or result.json of a match, or a case file (TOML)")
    parser.add_argument(
        "recordings", metavar="RECORDING", nargs="+", help="recordings of the controlled bed (CSV, MDF, .mat, Parquet)"
    )
    parser.add_argument("--channels", metavar="FILE", help="what the signals are called in the recordings (TOML)")
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Judge and write files; the result object is the content of ``verification.json``."""
    from matching.bed_test.judge import judge
    from matching.bed_test.recorded import read_recordings
    from matching.fmu.export_source import tuned_case
    from matching.report.bed_test.figures import responses
    from matching.report.bed_test.page import page
    from matching.report.common.style import image
    from modelling.common.output import write_results
    from modelling.measurement.channels import read_channels

    case = tuned_case(arguments.case).tuned
    channels = read_channels(arguments.channels) if arguments.channels else None
    found = judge(case, read_recordings(arguments.recordings, case, channels))
    result = found.to_dict()
    drawn = {"responses": image(responses(found))}
    files: dict[str, str | bytes] = {"report.html": page(result, drawn)}
    files |= {f"figures/{name}.svg": content for name, content in drawn.items()}
    return write_results(arguments.out, "verification.json", result, files)


def summary(result: dict[str, Any]) -> str:
    """The answer, errors, modes and fidelity in a few lines."""
    from matching.report.bed_test.text import summary as words

    return words(result)
