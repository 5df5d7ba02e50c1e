"""What a campaign's answers are worth: confusion, false alarms, reliability and coverage."""

import datetime
import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np


def right(row: dict[str, Any]) -> bool:
    """Whether the first cause is the hidden one, or one that the recording cannot tell from it."""
    causes, answer = row["found"]["causes"], row["answer"]
    if not causes:
        return False
    return matches(causes[0], answer)


def matches(cause: dict[str, Any], answer: dict[str, Any]) -> bool:
    """Whether a named cause is a hidden one or equivalent to it."""
    good = {(answer["kind"], answer["at"])} | {(one["kind"], one["at"]) for one in answer.get("equivalent_causes", [])}
    good |= {(answer["kind"], at) for at in answer.get("equivalent", [])}
    return (cause["kind"], cause["at"]) in good


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures of a campaign; shares with the number of recordings behind them."""
    made = [row for row in rows if "found" in row]

    def of(category: str, *sizes: Any) -> list[dict[str, Any]]:
        own = [row for row in made if row["order"]["category"] == category]
        return [row for row in own if not sizes or row["order"]["size"] in sizes]

    def share(flags: list[bool]) -> dict[str, Any]:
        return {"share": float(np.mean(flags)) if flags else None, "of": len(flags)}

    def quiet(row: dict[str, Any]) -> bool:
        sure = [cause["confidence"] for cause in row["found"]["causes"]]
        return row["found"]["verdict"] == "unexplained" or max(sure, default=0.0) < 0.5

    single, clean, double, outside = (of(name) for name in ("single", "clean", "double", "outside"))
    return {
        "recordings": len(rows),
        "failed": [row["failed"] for row in rows if "failed" in row],
        "plain_right_first": share([right(row) for row in of("single", "plain")]),
        "subtle_right_first": share([right(row) for row in of("single", "subtle")]),
        "false_alarms": share([bool(row["found"]["causes"]) for row in clean]),
        "clean_adequate": share([row["found"]["verdict"] == "adequate" for row in clean]),
        "outside_told": share([quiet(row) for row in outside]),
        "both_found": share([both(row) for row in double]),
        "sure_and_right": share([flag for p, flag in confidences(made) if p >= 0.9]),
        "coverage_causes": share(covered(single, causes=True)),
        "coverage_base": share(covered([row for row in single if right(row)], causes=False)),
        "held_out_within_1.1": share([within(row) for row in single if right(row)]),
        "explained_when_right": share([row["found"]["verdict"] == "explained" for row in single if right(row)]),
        "seconds": {"median": median(made), "most": max((row["seconds"] for row in made), default=None)},
    }


def median(rows: list[dict[str, Any]]) -> float | None:
    return float(np.median([row["seconds"] for row in rows])) if rows else None


def both(row: dict[str, Any]) -> bool:
    """Whether both hidden causes are among the named ones."""
    named = {(cause["kind"], cause["at"]) for cause in row["found"]["causes"]}
    return all((cause["kind"], cause["at"]) in named for cause in row["answer"]["causes"])


def confidences(rows: list[dict[str, Any]]) -> list[tuple[float, bool]]:
    """Confidence of every named cause, and whether it is right."""
    out = []
    for row in rows:
        hidden = (
            {(one["kind"], one["at"]) for one in row["answer"]["causes"]} if not row["answer"]["outside"] else set()
        )
        for cause in row["found"]["causes"]:
            good = (cause["kind"], cause["at"]) in hidden
            if row["order"]["category"] == "single":
                good |= matches(cause, row["answer"])
            out.append((cause["confidence"], good))
    return out


def covered(rows: list[dict[str, Any]], causes: bool) -> list[bool]:
    """Whether 95 % intervals cover the truth: parameters of causes named right, or of the base model."""
    out = []
    for row in rows:
        if causes:
            first = row["found"]["causes"][0] if row["found"]["causes"] else None
            if first and (first["kind"], first["at"]) == (row["answer"]["kind"], row["answer"]["at"]):
                pairs = [(own, row["answer"]["parameters"].get(key)) for key, own in first["parameters"].items()]
            else:
                pairs = []
        else:
            pairs = [(own, row["answer"]["base"].get(key)) for key, own in row["found"]["parameters"].items()]
        for own, truth in pairs:
            if truth is not None and own["standard_uncertainty"] and not own.get("note"):
                out.append(bool(abs(own["value"] - truth) <= 1.96 * own["standard_uncertainty"]))
    return out


def within(row: dict[str, Any]) -> bool:
    """Whether every sensor's held-out error is within 1.1 times the noise."""
    return all((one["after_holdout"] or 0.0) <= 1.1 * one["noise"] for one in row["found"]["errors"].values())


def confusion(rows: list[dict[str, Any]]) -> tuple[list[str], list[str], np.ndarray]:
    """Counts (hidden, named) over single and clean recordings and those with effects outside the vocabulary."""
    cells: dict[tuple[str, str], int] = {}
    for row in rows:
        if "found" not in row or row["order"]["category"] == "double":
            continue
        hidden = row["order"]["effects"][0] if row["order"]["effects"] else "nothing"
        if row["order"]["category"] == "outside":
            hidden = "outside: " + hidden
        causes = row["found"]["causes"]
        named = causes[0]["kind"] if causes else row["found"]["verdict"]
        if causes and row["found"]["verdict"] == "unexplained" and row["order"]["category"] == "outside":
            named = "unexplained"
        if named == "lag":
            named = ("input" if causes[0]["at"].startswith("inputs") else "sensor") + "_lag"
        if row["order"]["category"] == "single" and causes and named == hidden and not right(row):
            named = "right kind, wrong place"
        cells[hidden, named] = cells.get((hidden, named), 0) + 1
    rows_ = sorted({h for h, _ in cells}, key=lambda h: (h.startswith("outside"), h == "nothing", h))
    order = [h for h in rows_ if not h.startswith("outside") and h != "nothing"]
    columns = order + sorted({n for _, n in cells} - set(order))
    return rows_, columns, np.array([[cells.get((h, n), 0) for n in columns] for h in rows_])


def report(rows: list[dict[str, Any]], out: Path, seed: int, planned: int, seconds: float) -> None:
    """Write ``campaign.json`` and ``campaign.png``."""
    figures = summary(rows) | {"seed": seed, "date": datetime.date.today().isoformat()}
    (out / "campaign.json").write_text(json.dumps(figures, indent=1) + "\n")
    picture(rows, figures, out / "campaign.png")
    print(json.dumps(figures, indent=1))


def picture(rows: list[dict[str, Any]], figures: dict[str, Any], path: Path) -> None:
    """Confusion matrix, reliability and the figures in words."""
    from matplotlib.figure import Figure

    hidden, named, counts = confusion(rows)
    figure = Figure(figsize=(13, 9), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(3, 1))
    axes = figure.add_subplot(grid[:, 0])
    axes.imshow(counts / np.maximum(counts.sum(axis=1, keepdims=True), 1), cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for (i, j), count in np.ndenumerate(counts):
        if count:
            dark = count > 0.6 * counts[i].sum()
            axes.text(j, i, str(count), ha="center", va="center", fontsize=7, color="white" if dark else "black")
    axes.set_xticks(range(len(named)), [name.replace("_", " ") for name in named], rotation=90, fontsize=8)
    axes.set_yticks(range(len(hidden)), [name.replace("_", " ") for name in hidden], fontsize=8)
    axes.set_xlabel("named first")
    axes.set_ylabel("hidden")
    made = [row for row in rows if "found" in row]
    axes.set_title(f"{len(made)} recordings of the truth plant, seed {figures['seed']}, {figures['date']}", fontsize=10)
    reliability(figure.add_subplot(grid[0, 1]), confidences(made))
    words = figure.add_subplot(grid[1, 1])
    words.axis("off")
    lines = [
        f"{key.replace('_', ' ')}: {one['share']:.1%} of {one['of']}"
        for key, one in figures.items()
        if isinstance(one, dict) and one.get("share") is not None
    ]
    words.text(0, 1, "\n".join(lines), va="top", fontsize=9)
    figure.savefig(path, dpi=120)


def reliability(axes: Any, pairs: list[tuple[float, bool]]) -> None:
    """How often causes are right, by the confidence they were given with."""
    edges = np.array([0.0, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0001])
    for low, high in pairwise(edges):
        own = [(p, good) for p, good in pairs if low <= p < high]
        if own:
            p, good = np.mean([one[0] for one in own]), np.mean([one[1] for one in own])
            axes.plot(p, good, "o", color="#0072B2", markersize=3 + 2 * np.sqrt(len(own)) / 2)
            axes.annotate(str(len(own)), (p, good), textcoords="offset points", xytext=(5, -9), fontsize=7)
    axes.plot([0, 1], [0, 1], color="#666666", linewidth=0.8)
    axes.set_xlabel("confidence given")
    axes.set_ylabel("share that is right")
    axes.set_xlim(-0.03, 1.08)
    axes.set_ylim(-0.03, 1.08)
