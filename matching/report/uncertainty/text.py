"""An uncertainty budget in words and columns, from the content of ``uncertainty.json``."""

from __future__ import annotations

from typing import Any


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
