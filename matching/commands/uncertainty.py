"""`rigmatch uncertainty BUDGET`: the budget, its result by propagation and by Monte Carlo, table and figures."""

import argparse
from typing import Any

HELP = (
    "Evaluate a measurement uncertainty budget after the GUM: first and second order, degrees of freedom, Monte Carlo "
    "(JCGM 101) and the check of one by the other; write uncertainty.json, the budget table, figures and the page "
    "uncertainty.html."
)
EXAMPLES = (
    "rigmatch uncertainty examples/sensors/torque_M2.toml --out out/torque",
    'rigmatch uncertainty examples/sensors/torque_M2.toml --wanted "0.5 N*m" --out out/torque',
)
PAGE = "uncertainty.html"  # in the folder of --out


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("budget", metavar="BUDGET", help="budget file (TOML)")
    parser.add_argument("--out", default=".", metavar="DIR", help="where files go (default: here)")
    parser.add_argument(
        "--wanted",
        metavar="U",
        help='wanted expanded uncertainty, such as 0.5 or "0.5 N*m": tells which input must improve, and to what',
    )
    parser.add_argument("--seed", type=int, default=1, help="seed of the Monte Carlo method (default: 1)")
    parser.add_argument("--draws", type=int, help="number of draws (default: until the result is stable)")
    parser.add_argument(
        "--digits",
        type=int,
        default=2,
        choices=(1, 2, 3),
        help="significant digits of the uncertainty that must be stable (default: 2)",
    )


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Evaluate and write; returns the object of ``uncertainty.json``.

    Raises
    ------
    InputError
        One line that names option, file or key.
    """
    from matching.report.common import style
    from matching.report.common.provenance import made_from
    from matching.report.uncertainty import figures as uncertainty_figures
    from matching.report.uncertainty.page import page
    from matching.validity.budget.budget_file import read_budget
    from matching.validity.uncertainty.evaluate import evaluate
    from modelling.common.errors import InputError
    from modelling.writing.output import file_stem, write_results

    if arguments.draws is not None and not 1000 <= arguments.draws <= 10**9:
        raise InputError("--draws", f"{arguments.draws} is out of range", "give a number in 1000 ... 1e9")
    if arguments.seed < 0:
        raise InputError("--seed", f"{arguments.seed} is negative", "give 0 or more")
    budget = read_budget(arguments.budget)
    uncertainty = evaluate(
        budget, seed=arguments.seed, draws=arguments.draws, digits=arguments.digits, wanted=arguments.wanted
    )
    answer = uncertainty.to_dict()
    files: dict[str, str | bytes] = {"uncertainty.txt": summary(answer)}
    prefixes: list[str] = []
    figures = {}
    for result in uncertainty.measurands:
        prefix = f"{file_stem(result.measurand.name)}_" if len(uncertainty.measurands) > 1 else ""
        if prefix in prefixes:
            prefix = f"{prefix}{len(prefixes) + 1}_"
        prefixes.append(prefix)
        figures[f"{prefix}contributions"] = uncertainty_figures.contributions(result)
        figures[f"{prefix}ishikawa"] = uncertainty_figures.ishikawa(result)
    images = {name: style.image(figure) for name, figure in figures.items()}
    files |= {f"{name}.svg": content for name, content in images.items()}
    files["uncertainty.html"] = page(uncertainty, figures, images, made_from(arguments.budget, arguments.seed))
    return write_results(arguments.out, "uncertainty.json", answer, files)


def checked(arguments: argparse.Namespace) -> dict[str, str]:
    """For ``--check``: whether the wanted uncertainty is one of the measurands'; names no further file.

    Raises
    ------
    InputError
        As the command itself would.
    """
    from matching.validity.budget.budget_file import read_budget
    from matching.validity.uncertainty.inverse import wanted_uncertainty

    budget = read_budget(arguments.budget)
    if arguments.wanted is not None:
        for measurand in budget.measurands:
            wanted_uncertainty(arguments.wanted, measurand, budget.where)
    return {}


def summary(answer: dict[str, Any]) -> str:
    """The answer for a reader, see :func:`matching.report.uncertainty.text.summary`."""
    from matching.report.uncertainty.text import summary

    return summary(answer)
