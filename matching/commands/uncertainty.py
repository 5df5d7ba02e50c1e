"""`rigmatch uncertainty BUDGET`: the budget, its result by propagation and by Monte Carlo, table and figures."""

import argparse
from typing import Any

HELP = (
    "Evaluate a measurement uncertainty budget after the GUM: first and second order, degrees of freedom, Monte Carlo "
    "(JCGM 101) and the check of one by the other; write uncertainty.json, the budget table and figures."
)


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
    """Evaluate and write; returns the object of ``uncertainty.json``."""
    from matching.report.common import style
    from matching.report.uncertainty import figures as uncertainty_figures
    from matching.validity.uncertainty.evaluate import as_json, evaluate
    from matching.validity.uncertainty.files import read_budget
    from matching.validity.uncertainty.inverse import inverse_as_json
    from modelling.common.errors import InputError
    from modelling.common.output import strict_json, write_all

    if arguments.draws is not None and not 1000 <= arguments.draws <= 10**9:
        raise InputError("--draws", f"{arguments.draws} is out of range", "give a number in 1000 ... 1e9")
    if arguments.seed < 0:
        raise InputError("--seed", f"{arguments.seed} is negative", "give 0 or more")
    budget = read_budget(arguments.budget)
    results, correlation = evaluate(budget, seed=arguments.seed, draws=arguments.draws, digits=arguments.digits)
    answer = as_json(budget, results, correlation)
    if arguments.wanted is not None:
        answer["inverse"] = [inverse_as_json(budget, one, arguments.wanted) for one in budget.measurands]
    files: dict[str, str | bytes] = {"uncertainty.json": strict_json(answer), "uncertainty.txt": summary(answer)}
    for one in answer["measurands"]:
        prefix = f"{one['name']}_" if len(answer["measurands"]) > 1 else ""
        files[f"{prefix}contributions.svg"] = style.image(uncertainty_figures.contributions(one))
        files[f"{prefix}ishikawa.svg"] = style.image(uncertainty_figures.ishikawa(one))
    write_all(arguments.out, files)
    return answer


def summary(answer: dict[str, Any]) -> str:
    """The budget table and what follows from it, for a reader."""
    lines = [answer["title"]]
    for one in answer["measurands"]:
        lines += ["", *_table(one), "", one["statement"], *_checks(one), *(f"note: {line}" for line in one["warnings"])]
    names = [one["name"] for one in answer["measurands"]]
    for i, first in enumerate(names):
        lines += [
            f"r({first}, {second}) = {answer['correlation'][i][j]:+.3f}" for j, second in enumerate(names) if j > i
        ]
    for one in answer.get("inverse", []):
        lines += ["", *_inverse(one)]
    return "\n".join(lines) + "\n"


def _table(one: dict[str, Any]) -> list[str]:
    head = (
        f"{'input':24} {'value':>14} {'u(x)':>11} {'unit':10} {'distribution':13} {'ν':>5} {'|c|·u':>11} {'share':>8}"
    )
    lines = [head, "-" * len(head)]
    for row in one["budget"]:
        freedom = "∞" if row["degrees_of_freedom"] is None else f"{row['degrees_of_freedom']:.3g}"
        lines.append(
            f"{row['name']:24} {row['value']:14.8g} {row['standard_uncertainty']:11.4g} {row['unit']:10} "
            f"{row['distribution']:13} {freedom:>5} {row['contribution']:11.4g} {100 * row['share']:7.2f}%"
        )
    return lines


def _checks(one: dict[str, Any]) -> list[str]:
    unit = "" if one["unit"] == "1" else f" {one['unit']}"
    freedom = one["degrees_of_freedom"]
    second = one["standard_uncertainty_second_order"]
    shown = "refused" if one["degrees_of_freedom_refused"] else "∞" if freedom is None else f"{freedom:.1f}"
    lines = [
        f"standard uncertainty {one['standard_uncertainty']:.4g}{unit} (first order), "
        f"{'none' if second is None else f'{second:.4g}'}{unit} (second order), effective degrees of freedom {shown}"
    ]
    if "monte_carlo" in one:
        drawn, check = one["monte_carlo"], one["first_order_check"]
        low, high = drawn["shortest_interval"]
        lines += [
            f"Monte Carlo: u = {drawn['standard_uncertainty']:.4g}{unit}, shortest {100 * one['coverage']:.4g} % "
            f"interval {low:.8g} ... {high:.8g}{unit}, {drawn['draws']} draws",
            f"first order against Monte Carlo (JCGM 101, 8): {check['verdict']} "
            f"(d = {check['distances'][0]:.2g}, {check['distances'][1]:.2g}; δ = {check['tolerance']:.2g}{unit})",
        ]
    return lines


def _inverse(one: dict[str, Any]) -> list[str]:
    if one["present"] <= one["wanted"]:
        return [
            f"{one['name']}: U = {one['present']:.4g} {one['unit']} is within the wanted {one['wanted']:.4g} already"
        ]
    lines = [f"{one['name']}: from U = {one['present']:.4g} to {one['wanted']:.4g} {one['unit']}"]
    lines += [
        f"  either {name} alone to u = {item['needed']:.4g} {item['unit']} ({100 * item['ratio']:.3g} % of today)"
        for step in one["alone"]
        for name, item in step.items()
    ]
    if not one["alone"]:
        lines.append("  no input alone can do it")
    together = ", ".join(f"{name} to u = {item['needed']:.4g} {item['unit']}" for name, item in one["together"].items())
    return [*lines, f"  or together, largest contributions levelled: {together}"]
