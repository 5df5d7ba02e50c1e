"""A campaign in one picture: what was named first against what was hidden, and the reliability of confidences."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tests.campaign.score import confidences, confusion, place_confidences

BLUE, GREY = "#0072B2", "#666666"


def picture(rows: list[dict[str, Any]], path: Path) -> None:
    """Write the picture."""
    from matplotlib.figure import Figure

    made = [row for row in rows if "found" in row]
    figure = Figure(figsize=(13, 8), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(1.5, 1))
    _confusion(left.subplots(), made)
    kind, place = right.subplots(2, 1, sharex=True)
    _reliability(kind, confidences(made), "kind and place")
    _reliability(place, place_confidences(made), "place alone")
    place.set_xlabel("confidence given")
    figure.savefig(path, dpi=100)


def _confusion(axes: Any, rows: list[dict[str, Any]]) -> None:
    """Counts of what was hidden against what was named first."""
    hidden, named, cells = confusion(rows)
    counts = np.array(cells)
    axes.imshow(counts / np.maximum(counts.sum(axis=1, keepdims=True), 1), cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for (i, j), count in np.ndenumerate(counts):
        if count:
            dark = count > 0.6 * counts[i].sum()
            axes.text(j, i, str(count), ha="center", va="center", fontsize=8, color="white" if dark else "black")
    axes.set_xticks(range(len(named)), [name.replace("_", " ") for name in named], rotation=90, fontsize=8)
    axes.set_yticks(range(len(hidden)), [name.replace("_", " ") for name in hidden], fontsize=8)
    axes.set_xlabel("named first")
    axes.set_ylabel("hidden")
    axes.set_title("Kind named first (one effect, none, or one outside the vocabulary)", fontsize=10)


def _reliability(axes: Any, pairs: list[tuple[float, bool]], what: str) -> None:
    """How often causes are right, by the confidence they were given with, with 95 % intervals (Wilson 1927)."""
    for low, high in pairwise([0.0, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0001]):
        own = [(p, good) for p, good in pairs if low <= p < high]
        if own:
            n, p, share = len(own), np.mean([one[0] for one in own]), np.mean([one[1] for one in own])
            middle = (share + 1.92 / n) / (1 + 3.84 / n)
            half = 1.96 / (1 + 3.84 / n) * np.sqrt(share * (1 - share) / n + 0.96 / n**2)
            axes.plot([p, p], [middle - half, middle + half], color=BLUE, linewidth=1.2)
            axes.plot(p, share, "o", color=BLUE, markersize=5)
            axes.annotate(str(n), (p, share), textcoords="offset points", xytext=(-6, -4), fontsize=8, ha="right")
    axes.plot([0, 1], [0, 1], color=GREY, linewidth=0.8)
    axes.set_ylabel("share that is right")
    axes.set_xlim(-0.05, 1.05)
    axes.set_ylim(-0.05, 1.05)
    axes.set_title(f"Confidence in {what} (number of causes beside)", fontsize=10)
