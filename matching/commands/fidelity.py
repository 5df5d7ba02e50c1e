"""`rigmatch fidelity CASE`: partial and total XiL fidelity, its uncertainty and its causes."""

import argparse
from typing import Any

HELP = (
    "Judge how faithfully a test bed reproduces a manoeuvre: partial fidelities of system dynamics, residual vehicle "
    "model and measurement, their total R_XiL with its uncertainty, and which causes reduce it; write fidelity.json, "
    "the table, figures and the page fidelity.html. Recordings that the case names may be CSV, MDF, .mat or Parquet."
)
EXAMPLES = (
    "rigmatch fidelity examples/fidelity/tab2.toml --out out/fidelity",
    "rigmatch fidelity examples/fidelity/tab2.toml --arithmetic published --out out/fidelity",
)
PAGE = "fidelity.html"  # in the folder of --out


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("case", metavar="CASE", help="fidelity case (TOML)")
    parser.add_argument("--channels", metavar="FILE", help="what the signals are called in the recordings (TOML)")
    parser.add_argument("--out", default=".", metavar="DIR", help="where files go (default: here)")
    parser.add_argument(
        "--arithmetic",
        choices=("definition", "published"),
        help="how partial fidelities combine (default: as the case says, else definition)",
    )
    parser.add_argument("--nrmse", choices=("definition", "literal"), help="form of Eq. 18 (default: as the case says)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the Monte Carlo uncertainty (default: 1)")
    parser.add_argument("--draws", type=int, default=20_000, help="number of its draws (default: 20000)")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Judge and write; returns the object of ``fidelity.json``.

    Raises
    ------
    InputError
        One line that names option, file or key.
    """
    from matching.report.common import style
    from matching.report.common.provenance import made_from
    from matching.report.fidelity import figures as fidelity_figures
    from matching.report.fidelity import text
    from matching.report.fidelity.page import page
    from matching.validity.fidelity.case_file import read_case
    from matching.validity.fidelity.result import xil_fidelity
    from modelling.common.errors import InputError
    from modelling.measurement.channels import read_channels
    from modelling.writing.output import write_results

    if not 100 <= arguments.draws <= 10**7:
        raise InputError("--draws", f"{arguments.draws} is out of range", "give a number in 100 ... 1e7")
    if arguments.seed < 0:
        raise InputError("--seed", f"{arguments.seed} is negative", "give 0 or more")
    channels = read_channels(arguments.channels) if arguments.channels else None
    judged = read_case(arguments.case, arguments.arithmetic, arguments.nrmse, channels)
    fidelity = xil_fidelity(*judged, arguments.draws, arguments.seed)
    answer = fidelity.to_dict()
    figures = {"delay": fidelity_figures.delay_curve(fidelity)}
    if fidelity.attribution is not None:
        figures["attribution"] = fidelity_figures.attribution_figure(fidelity)
    if fidelity.bands:
        figures["bands"] = fidelity_figures.bands_figure(fidelity)
    images = {name: style.image(figure) for name, figure in figures.items()}
    files: dict[str, str | bytes] = {f"{name}.svg": content for name, content in images.items()}
    files["fidelity.txt"] = text.summary(answer)
    files["fidelity.html"] = page(fidelity, figures, images, made_from(arguments.case, arguments.seed))
    return write_results(arguments.out, "fidelity.json", answer, files)


def summary(answer: dict[str, Any]) -> str:
    """The answer for a reader, see :func:`matching.report.fidelity.text.summary`."""
    from matching.report.fidelity.text import summary

    return summary(answer)
