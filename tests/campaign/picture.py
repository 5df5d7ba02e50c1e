"""A campaign in one picture: confusion matrix, reliability of confidences, coverage of uncertainties, criteria."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm

from tests.campaign.score import confidences, confusion, deviations, judged, right

BLUE, VERMILLION, GREY = "#0072B2", "#D55E00", "#666666"


def picture(rows: list[dict[str, Any]], figures: dict[str, Any], path: Path) -> None:
    """Write the picture."""
    from matplotlib.figure import Figure

    made = [row for row in rows if "found" in row]
    figure = Figure(figsize=(16, 11), layout="constrained")
    figure.suptitle(
        f"Diagnosis of {len(made)} recordings of the truth plant, of {figures['planned']} planned "
        f"({figures['seconds_each']:g} s each, seed {figures['seed']}, {figures['date']}, commit {figures['commit']})"
    )
    grid = figure.add_gridspec(3, 2, width_ratios=(1.25, 1), height_ratios=(1, 1, 0.8))
    confusion_axes(figure.add_subplot(grid[:, 0]), rows)
    reliability_axes(figure.add_subplot(grid[0, 1]), confidences(made))
    _coverage(figure.add_subplot(grid[1, 1]), [row for row in made if row["order"]["category"] == "single"])
    _criteria(figure.add_subplot(grid[2, 1]), figures)
    figure.savefig(path, dpi=90)


def confusion_axes(axes: Any, rows: list[dict[str, Any]]) -> None:
    """Counts of what was hidden against what was named first."""
    hidden, named, counts = confusion(rows)
    axes.imshow(counts / np.maximum(counts.sum(axis=1, keepdims=True), 1), cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for (i, j), count in np.ndenumerate(counts):
        if count:
            dark = count > 0.6 * counts[i].sum()
            axes.text(j, i, str(count), ha="center", va="center", fontsize=8, color="white" if dark else "black")
    axes.set_xticks(range(len(named)), [name.replace("_", " ") for name in named], rotation=90, fontsize=8)
    axes.set_yticks(range(len(hidden)), [name.replace("_", " ") for name in hidden], fontsize=8)
    axes.set_xlabel("named first")
    axes.set_ylabel("hidden")
    axes.set_title("Kind named first (two hidden effects: see the criteria)", fontsize=10)


def reliability_axes(axes: Any, pairs: list[tuple[float, bool]]) -> None:
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
    axes.set_xlabel("confidence given")
    axes.set_ylabel("share that is right")
    axes.set_xlim(-0.05, 1.05)
    axes.set_ylim(-0.05, 1.05)
    axes.set_title("Reliability of confidences (number of causes beside)", fontsize=10)


def _coverage(axes: Any, rows: list[dict[str, Any]]) -> None:
    """Share of estimates within so many standard uncertainties of the truth."""
    k = np.linspace(0, 6, 121)
    good = [row for row in rows if right(row)]
    for name, own, color, line in (
        ("parameters of causes", deviations(rows, True), BLUE, "-"),
        ("base parameters", deviations(good, False), VERMILLION, "--"),
    ):
        if own:
            share = [np.mean(np.abs(own) <= one) for one in k]
            axes.plot(k, share, line, color=color, label=f"{name} ({len(own)})")
    axes.plot(k, 2 * norm.cdf(k) - 1, color=GREY, linewidth=0.8, label="normal distribution")
    axes.axvline(1.96, color=GREY, linewidth=0.6, linestyle=":")
    axes.set_xlabel("error in standard uncertainties")
    axes.set_ylabel("share of estimates within")
    axes.set_ylim(0, 1.02)
    axes.legend(fontsize=8, loc="lower right")
    axes.set_title("Coverage of uncertainties", fontsize=10)


def _criteria(axes: Any, figures: dict[str, Any]) -> None:
    """Every criterion, met or not."""
    axes.axis("off")
    lines = [(got, asked, words, met) for words, got, asked, met in judged(figures)]
    for i, (got, asked, words, met) in enumerate(lines):
        y = 1 - (i + 0.5) / (len(lines) + 2)
        word, color = ("met", "black") if met else ("", GREY) if met is None else ("missed", VERMILLION)
        axes.text(0, y, word, fontsize=8.5, color=color, weight="bold", transform=axes.transAxes)
        axes.text(0.1, y, words, fontsize=8.5, color=color, transform=axes.transAxes)
        axes.text(0.75, y, f"{got} (asked {asked})", fontsize=8.5, color=color, transform=axes.transAxes)
    time = figures["seconds"]
    text = f"not answered: {len(figures['failed'])} of {figures['recordings']}"
    if time["median"] is not None:
        text += f"; time for one: median {time['median']:.0f} s, at most {time['most']:.0f} s"
    axes.text(0, 1 - (len(lines) + 0.8) / (len(lines) + 2), text, fontsize=8.5, transform=axes.transAxes)
