"""Table and figure of the campaign of beds."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from matching.report.common import figure, styled

BETTER, NEAR, NAMED = 3.0, 1.5, 0.9  # the median error falls by so much, ends so near to the truth, so many are named


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures over the beds that came to an end."""
    made = [row for row in rows if "failed" not in row and None not in ends(row)]
    first, last, true = (np.array(values) for values in zip(*map(ends, made), strict=True))
    over_true = last[true > 0] / true[true > 0]  # an error that noise hides is 0
    unsure = np.array([best_of(row)["standard_uncertainty"] for row in made])
    mattering = [one for row in made for one in row["hidden"] if one["matters"]]
    return {
        "beds": len(rows), "failed": [row["failed"] for row in rows if "failed" in row],
        "median_first": float(np.median(first)), "median_last": float(np.median(last)),
        "median_true": float(np.median(true)),
        "factor": float(np.median(first) / np.median(last)) if np.median(last) > 0 else None,
        "factor_at_least": float(np.median(first) / np.median(last + 2 * unsure)),
        "near_truth": float(np.mean(last <= NEAR * true)),
        "last_over_true": float(np.median(over_true)) if len(over_true) else None,
        "worse_than_before": [row["number"] for row, a, b in zip(made, first, last, strict=True) if b > a],
        "named": [sum(one["named"] for one in mattering), len(mattering)],
        "largest_limit_used": max(row["limits_used"] for row in made),
        "processor_time": float(np.median([row["processor_time"] for row in made])),
    }  # fmt: skip


def ends(row: dict[str, Any]) -> tuple[float | None, float | None, float | None]:
    """Errors of the first match, of the best controller, and of a match with the true values."""
    if "failed" in row:
        return None, None, None
    return row["rounds"][0]["error"], best_of(row)["error"], row["true"]["error"]


def best_of(row: dict[str, Any]) -> dict[str, float]:
    """Error of the best controller of a bed, with its standard uncertainty."""
    return row["rounds"][(row["best_round"] or len(row["rounds"])) - 1]


def report(rows: list[dict[str, Any]], out: Path) -> None:
    """Print the table; write ``summary.json`` and ``beds.png``."""
    for row in rows:
        print(row["number"], line(row))
    found = summary(rows)
    (out / "summary.json").write_text(json.dumps(found, indent=1), encoding="utf-8")
    print(json.dumps(found, indent=1))
    with styled():
        drawn = figure(6, 3.2)
        axes = drawn.subplots()
        for row in rows:
            if "failed" not in row:
                axes.plot([0, 1, 2], ends(row), "o-", color="0.5", markersize=3)
        axes.set_yscale("log")
        axes.set_xticks([0, 1, 2], ["first match", "best controller", "match with\ntrue values"])
        axes.set_ylabel("response error on the bed")
        drawn.savefig(out / "beds.png", dpi=110)


def line(row: dict[str, Any]) -> str:
    """One bed in words."""
    if "failed" in row:
        return f"failed: {row['failed']}"
    errors = " → ".join("?" if one["error"] is None else f"{one['error']:.4f}" for one in row["rounds"])
    hidden = ", ".join(
        f"{one['kind']} {one['size']:.3g} (changes {one['change']:.1%}, {'named' if one['named'] else 'not named'})"
        for one in row["hidden"]
    )
    true = row["true"]["error"]
    return f"{errors}, true values {'?' if true is None else f'{true:.4f}'}: {hidden}; {row['status']}"
