"""Figure of the response error when one value is wrong: how accurately each must be known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from matching.report.common.style import LIMIT, MATCHED, RIG, figure, styled
from matching.report.common.wording import number


@dataclass(frozen=True)
class Wrong:
    """A wrong value: its name, its deviation, the response error it causes (None: unknown), stability, margin."""

    name: str
    off: str
    error: float | None
    stable: bool
    margin: float | None = None


def robustness_figure(rows: Sequence[Wrong], error: float, most: int = 14) -> Figure:
    """Bars from the error as matched to the error with one value wrong, the largest on top; unstable ones hatched."""
    names = list(dict.fromkeys(row.name for row in rows))
    worst = {name: max(_rank(row, error) for row in rows if row.name == name) for name in names}
    names = sorted(names, key=lambda name: -worst[name])[:most]
    with styled():
        fig = figure(12.4, 1.3 + 0.34 * max(len(names), 1))
        axes = fig.subplots()
        top = max([error, *(row.error for row in rows if row.error is not None and row.stable)]) * 1.25
        for place, name in enumerate(names):
            pair = sorted((row for row in rows if row.name == name), key=lambda row: row.off.startswith("+"))
            step = 0.8 / len(pair)
            for k, row in enumerate(pair):
                at = place + (k - (len(pair) - 1) / 2) * step
                unusable = not row.stable or row.error is None
                reach = top if unusable or row.error is None else min(row.error, top)
                axes.barh(
                    at, reach - error, left=error, height=0.9 * step,
                    color="white" if unusable else _TINTS[k % len(_TINTS)],
                    edgecolor=RIG if unusable else "#333333", linewidth=0.7, hatch="////" if unusable else None,
                )  # fmt: skip
                said = f"{row.off}: {'unstable' if not row.stable else number(row.error, 2)}"
                axes.annotate(said, (reach, at), (4, 0), textcoords="offset points", va="center", fontsize=8)
        axes.axvline(error, color=LIMIT, linestyle="--", linewidth=1.2)
        axes.set_yticks(range(len(names)), names, fontsize=8)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.set_xlim(0, top * 1.12)
        axes.grid(False, axis="y")
        axes.set_xlabel(f"Response error with one value wrong (dashed: as matched, {number(error, 2)})")
    return fig


_TINTS = (MATCHED, "#99D8C7")


def _rank(row: Wrong, error: float) -> float:
    return float("inf") if not row.stable or row.error is None else abs(row.error - error)
