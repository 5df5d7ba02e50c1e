"""Modes for the eye: frequencies and energy shares as in the paper's Fig. 3, and all shares at a glance."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from matching.report.common.style import figure, styled
from modelling.modal.modes import Mode, Modes

_TINTS = (1.0, 0.45, 0.2)  # of the colour, for the first, second and third mode shown


@dataclass(frozen=True)
class Column:
    """One system in a figure: its title, its fixed colour, its modes, and the numbers of up to three modes to show."""

    title: str
    colour: str
    modes: Sequence[Mode] | Modes
    shown: tuple[int, ...] = ()

    @property
    def chosen(self) -> list[Mode]:
        """The modes to show; the first two that are not rigid if none are named."""
        numbers = self.shown or tuple(mode.number for mode in self.modes if mode.frequency > 0)[:2]
        by_number = {mode.number: mode for mode in self.modes}
        return [by_number[number] for number in numbers[: len(_TINTS)]]


def energy_figure(columns: Sequence[Column]) -> Figure:
    """Frequencies on top, kinetic shares in the middle, potential shares at the bottom, one column a system."""
    with styled():
        drawn = figure(min(1.2 + 4.6 * len(columns), 12.4), 7.4)
        rows = drawn.subplots(3, len(columns), squeeze=False)
        top = max(mode.frequency for column in columns for mode in column.modes)
        for (first, middle, last), column in zip(rows.T, columns, strict=True):
            _frequencies(first, column, top)
            _shares(middle, column, "kinetic")
            _shares(last, column, "potential")
        rows[0, 0].set_ylabel("Frequency in Hz")
        rows[1, 0].set_ylabel("Share of kinetic\nenergy in %")
        rows[2, 0].set_ylabel("Share of potential\nenergy in %")
    return drawn


def _frequencies(axes: Any, column: Column, top: float) -> None:
    chosen = {mode.number: tint for mode, tint in zip(column.chosen, _TINTS)}
    floor = 0.3
    for mode in column.modes:
        height = max(mode.frequency, floor)
        colour = _tint(column.colour, chosen[mode.number]) if mode.number in chosen else "#D9D9D9"
        axes.bar(mode.number, height, width=0.7, color=colour, edgecolor="#333333", linewidth=0.6)
        mark = {"symmetric": " s", "antisymmetric": " a"}.get(mode.symmetry, "")
        axes.annotate(
            f"{mode.frequency:.3g}{mark}",
            (mode.number, height),
            (0, 2),
            textcoords="offset points",
            ha="center",
            fontsize=7.5 if len(column.modes) <= 10 else 6.5,
            rotation=0 if len(column.modes) <= 10 else 60,
        )
    axes.set_yscale("log")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylim(floor, 3 * max(top, 1.0))
    axes.set_xticks([mode.number for mode in column.modes])
    axes.grid(False, axis="x")
    axes.set_xlabel("Mode number (s symmetric, a antisymmetric left to right)" if _labelled(column) else "Mode number")
    axes.set_title(column.title)


def _labelled(column: Column) -> bool:
    return any(mode.symmetry != "none" for mode in column.modes)


def _shares(axes: Any, column: Column, energy: str) -> None:
    chosen = column.chosen
    named = _named(chosen or column.modes, energy)
    names = _most([[getattr(mode, energy).get(name, 0.0) for name in named] for mode in chosen], named, 24)
    width = 0.8 / max(len(chosen), 1)
    for i, (mode, tint) in enumerate(zip(chosen, _TINTS)):
        values = 100 * np.array([getattr(mode, energy).get(name, 0.0) for name in names])
        place = np.arange(len(names)) + (i - (len(chosen) - 1) / 2) * width
        label = f"mode {mode.number}, {mode.frequency:.4g} Hz"
        axes.bar(
            place, values, width, color=_tint(column.colour, tint), edgecolor="#333333", linewidth=0.6, label=label
        )
    axes.set_xticks(
        range(len(names)), [_short(name) for name in names], rotation=40, ha="right", rotation_mode="anchor"
    )
    axes.set_ylim(0, 100)
    axes.grid(False, axis="x")
    if chosen:
        axes.legend(fontsize=8, loc="upper right")


def shares_figure(modes: Modes, title: str = "") -> Figure:
    """All energy shares in %: one row a mode, one column a component, kinetic left and potential right.

    Of large models the first 40 modes, and the 30 components that hold most of them.
    """
    with styled():
        rows = min(len(modes), 40)
        kinetic, potential = modes.kinetic[:rows], modes.potential[:rows]
        masses, springs = _most(kinetic, modes.masses, 30), _most(potential, modes.springs, 30)
        drawn = figure(2.6 + 0.42 * (len(masses) + max(len(springs), 3)), 1.9 + 0.3 * rows)
        left, right = drawn.subplots(1, 2, sharey=True, width_ratios=[len(masses), max(len(springs), 3)])
        _map(left, 100 * kinetic[:, [modes.masses.index(name) for name in masses]], masses, "Kinetic energy in %")
        _map(
            right, 100 * potential[:, [modes.springs.index(name) for name in springs]], springs, "Potential energy in %"
        )
        left.set_yticks(range(rows), [f"{number + 1}:  {modes.frequencies[number]:.4g} Hz" for number in range(rows)])
        left.set_ylabel("Mode")
        if title:
            drawn.suptitle(title, fontsize=10)
    return drawn


def _map(axes: Any, shares: np.ndarray, names: Sequence[str], title: str) -> None:
    if shares.size:
        axes.imshow(shares, cmap="Greys", vmin=0, vmax=130, aspect="auto", interpolation="nearest")
    for row, column in np.argwhere(shares >= 0.5):
        value = shares[row, column]
        axes.text(
            column,
            row,
            f"{value:.0f}",
            ha="center",
            va="center",
            fontsize=7.5,
            color="white" if value > 60 else "black",
        )
    axes.set_xticks(
        range(len(names)), [_short(name) for name in names], rotation=40, ha="right", rotation_mode="anchor"
    )
    axes.set_title(title, fontsize=9)
    axes.grid(False)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)


def mode_table(modes: Sequence[dict[str, Any]], most: int = 3) -> list[dict[str, str]]:
    """Rows of the mode table from the entries of ``modes.json``, with where most of the energy sits."""
    return [
        {
            "mode": str(mode["number"]),
            "frequency [Hz]": f"{mode['frequency']:.4g}",
            "damping ratio": f"{mode['damping_ratio']:.4f}",
            "symmetry": mode["symmetry"],
            "kinetic energy": _largest(mode["kinetic"], most),
            "potential energy": _largest(mode["potential"], most),
        }
        for mode in modes
    ]


def table_text(rows: Sequence[dict[str, str]]) -> str:
    """Rows as aligned text."""
    if not rows:
        return ""
    lines = [list(rows[0])] + [list(row.values()) for row in rows]
    widths = [max(len(line[i]) for line in lines) for i in range(len(lines[0]))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip() for line in lines)


def _largest(shares: dict[str, float], most: int) -> str:
    ranked = sorted(shares.items(), key=lambda item: -round(item[1], 6))[:most]  # equal ones in the model's order
    return ", ".join(f"{_short(name)} {100 * share:.0f} %" for name, share in ranked if share >= 0.05) or "–"


def _named(modes: Iterable[Mode], energy: str) -> list[str]:
    """Components that hold any energy of the modes, in the model's order; a rigid mode may know none."""
    return list(dict.fromkeys(name for mode in modes for name in getattr(mode, energy)))


def _most(shares: Any, names: Sequence[str], most: int) -> list[str]:
    """The components with the largest shares (rows of modes), at most so many, in the model's order."""
    if len(names) <= most or not len(shares):
        return list(names)[:most]
    ranked = np.argsort(-np.max(np.asarray(shares), axis=0), kind="stable")[:most]
    return [names[i] for i in sorted(ranked)]


def _short(name: str) -> str:
    return name.rsplit(".", 1)[1].replace("_", " ")


def _tint(colour: str, strength: float) -> tuple[float, ...]:
    return tuple(1 - strength * (1 - part) for part in to_rgb(colour))
