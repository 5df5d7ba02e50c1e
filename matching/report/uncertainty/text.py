"""An uncertainty budget in words and columns, from the content of ``uncertainty.json``."""

from __future__ import annotations

from typing import Any

from matching.validity.uncertainty.rounding import written


def summary(answer: dict[str, Any]) -> str:
    """Statement of every measurand, then its budget table, checks and correlations; last what would have to improve."""
    measurands = answer["measurands"]
    lines = [answer["title"], *(measurand["statement"] for measurand in measurands)]
    for measurand in measurands:
        notes = (f"note: {line}" for line in measurand["warnings"])
        heading = [f"{measurand['name']}:"] if len(measurands) > 1 else []
        lines += ["", *heading, *_table(measurand), "", *_checks(measurand), *notes]
    names = [measurand["name"] for measurand in measurands]
    for i, first in enumerate(names):
        lines += [
            f"r({first}, {second}) = {answer['correlation'][i][j]:+.3f}" for j, second in enumerate(names) if j > i
        ]
    for wish in answer.get("inverse", []):
        lines += ["", *_improvements(wish)]
    return "\n".join(lines) + "\n"


def _table(measurand: dict[str, Any]) -> list[str]:
    head = (
        f"{'input':24} {'value':>14} {'u(x)':>11} {'unit':10} {'distribution':13} {'ν':>5} {'|c|·u':>11} {'share':>8}"
    )
    lines = [head, "-" * len(head)]
    for row in measurand["budget"]:
        freedom = "∞" if row["degrees_of_freedom"] is None else f"{row['degrees_of_freedom']:.3g}"
        lines.append(
            f"{row['name']:24} {row['value']:14.8g} {row['standard_uncertainty']:11.4g} {row['unit']:10} "
            f"{row['distribution']:13} {freedom:>5} {row['contribution']:11.4g} {100 * row['share']:7.2f}%"
        )
    return lines


def _checks(measurand: dict[str, Any]) -> list[str]:
    unit = "" if measurand["unit"] == "1" else f" {measurand['unit']}"
    freedom = measurand["degrees_of_freedom"]
    second = measurand["standard_uncertainty_second_order"]
    refused = measurand["degrees_of_freedom_refused"]
    effective = "refused" if refused else "∞" if freedom is None else f"{freedom:.1f}"
    lines = [
        f"standard uncertainty {measurand['standard_uncertainty']:.4g}{unit} (first order), "
        f"{'none' if second is None else f'{second:.4g}{unit}'} (second order), "
        f"effective degrees of freedom {effective}"
    ]
    if "monte_carlo" in measurand:
        sampled, check = measurand["monte_carlo"], measurand["first_order_check"]
        low, high = (written(end, sampled["standard_uncertainty"])[0] for end in sampled["shortest_interval"])
        lines += [
            f"Monte Carlo: u = {sampled['standard_uncertainty']:.4g}{unit}, "
            f"shortest {100 * measurand['coverage']:.4g} % interval "
            f"{low} ... {high}{unit}, {sampled['draws']} draws",
            f"first order against Monte Carlo (JCGM 101, 8): {check['verdict']} "
            f"(d = {check['distances'][0]:.2g}, {check['distances'][1]:.2g}; δ = {check['tolerance']:.2g}{unit})",
        ]
    return lines


def _improvements(wish: dict[str, Any]) -> list[str]:
    if wish["present"] <= wish["wanted"]:
        return [
            f"{wish['name']}: U = {wish['present']:.4g} {wish['unit']} "
            f"is already within the wanted {wish['wanted']:.4g}"
        ]
    lines = [f"{wish['name']}: from U = {wish['present']:.4g} to {wish['wanted']:.4g} {wish['unit']}"]
    lines += [
        f"  either {name} alone to u = {item['needed']:.4g} {item['unit']} ({100 * item['ratio']:.3g} % of today)"
        for step in wish["alone"]
        for name, item in step.items()
    ]
    if not wish["alone"]:
        lines.append("  no improvement of a single input is enough")
    needed = [f"{name} to u = {item['needed']:.4g} {item['unit']}" for name, item in wish["together"].items()]
    return [*lines, f"  or all of these together, the largest contributions reduced to one level: {', '.join(needed)}"]
