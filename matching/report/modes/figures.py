"""Figures of modes: frequencies and energy shares as in the paper's Fig. 3, and all shares in one table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from matching.report.common.style import figure, styled
from matching.report.modes.mode_table import short_name
from modelling.common import escape
from modelling.modal.result import Mode, Modes

_TINTS = (1.0, 0.45, 0.2)  # strength of the colour of the first, second and third mode in the figure
_NO_TINT = "#D9D9D9"
_EDGE = "#333333"
FLOOR_HZ = 0.3  # lower end of the frequency axis, and height of the bar of a rigid-body mode
COMPONENTS_PER_AXIS = 24  # more names would overlap
TABLE_MODES, TABLE_COMPONENTS = 40, 30  # rows and columns of the table of shares
LEAST_SHARE_PRINTED = 0.005  # 0.5 %, which rounds to 1 %


@dataclass(frozen=True)
class Column:
    """One system in a figure: its title, colour and modes, and the numbers of up to three modes to emphasise."""

    title: str
    colour: str
    modes: Sequence[Mode] | Modes
    emphasised: tuple[int, ...] = ()

    @property
    def chosen(self) -> list[Mode]:
        """The modes to emphasise; the first two that are not rigid-body modes if none are named."""
        numbers = self.emphasised or tuple(mode.number for mode in self.modes if mode.frequency > 0)[:2]
        by_number = {mode.number: mode for mode in self.modes}
        return [by_number[number] for number in numbers[: len(_TINTS)]]


def energy_figure(columns: Sequence[Column]) -> Figure:
    """Frequencies on top, kinetic shares in the middle, potential shares at the bottom, one column a system."""
    with styled():
        fig = figure(min(1.2 + 4.6 * len(columns), 12.4), 7.4)
        rows = fig.subplots(3, len(columns), squeeze=False)
        top = max(mode.frequency for column in columns for mode in column.modes)
        for (first, middle, last), column in zip(rows.T, columns, strict=True):
            _frequencies(first, column, top)
            _shares(middle, column, "kinetic")
            _shares(last, column, "potential")
        rows[0, 0].set_ylabel("Frequency in Hz")
        rows[1, 0].set_ylabel("Share of kinetic\nenergy in %")
        rows[2, 0].set_ylabel("Share of potential\nenergy in %")
    return fig


def _frequencies(axes: Any, column: Column, top: float) -> None:
    chosen = {mode.number: tint for mode, tint in zip(column.chosen, _TINTS)}
    for mode in column.modes:
        height = max(mode.frequency, FLOOR_HZ)
        colour = _tint(column.colour, chosen[mode.number]) if mode.number in chosen else _NO_TINT
        axes.bar(mode.number, height, width=0.7, color=colour, edgecolor=_EDGE, linewidth=0.6)
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
    axes.set_ylim(FLOOR_HZ, 3 * max(top, 1.0))
    axes.set_xticks([mode.number for mode in column.modes])
    axes.grid(False, axis="x")
    axes.set_xlabel("Mode number (s symmetric, a antisymmetric left to right)" if _labelled(column) else "Mode number")
    axes.set_title(escape.figure(column.title))


def _labelled(column: Column) -> bool:
    return any(mode.symmetry != "none" for mode in column.modes)


def _shares(axes: Any, column: Column, energy: str) -> None:
    chosen = column.chosen
    candidates = _components(chosen or column.modes, energy)
    shares = [[getattr(mode, energy).get(name, 0.0) for name in candidates] for mode in chosen]
    names = _largest_shares(shares, candidates, COMPONENTS_PER_AXIS)
    width = 0.8 / max(len(chosen), 1)
    for i, (mode, tint) in enumerate(zip(chosen, _TINTS)):
        values = 100 * np.array([getattr(mode, energy).get(name, 0.0) for name in names])
        place = np.arange(len(names)) + (i - (len(chosen) - 1) / 2) * width
        label = f"mode {mode.number}, {mode.frequency:.4g} Hz"
        axes.bar(place, values, width, color=_tint(column.colour, tint), edgecolor=_EDGE, linewidth=0.6, label=label)
    axes.set_xticks(
        range(len(names)), [short_name(name) for name in names], rotation=40, ha="right", rotation_mode="anchor"
    )
    axes.set_ylim(0, 100)
    axes.grid(False, axis="x")
    if chosen:
        axes.legend(fontsize=8, loc="upper right")


def shares_figure(modes: Modes, title: str = "") -> Figure:
    """All energy shares in %: one row a mode, one column a component, kinetic left and potential right.

    Of large models the first 40 modes, and the 30 components with the largest shares.
    """
    with styled():
        rows = min(len(modes), TABLE_MODES)
        kinetic, potential = modes.kinetic[:rows], modes.potential[:rows]
        masses = _largest_shares(kinetic, modes.masses, TABLE_COMPONENTS)
        springs = _largest_shares(potential, modes.springs, TABLE_COMPONENTS)
        fig = figure(2.6 + 0.42 * (len(masses) + max(len(springs), 3)), 1.9 + 0.3 * rows)
        left, right = fig.subplots(1, 2, sharey=True, width_ratios=[len(masses), max(len(springs), 3)])
        _share_table(
            left, 100 * kinetic[:, [modes.masses.index(name) for name in masses]], masses, "Kinetic energy in %"
        )
        _share_table(
            right, 100 * potential[:, [modes.springs.index(name) for name in springs]], springs, "Potential energy in %"
        )
        left.set_yticks(range(rows), [f"{number + 1}:  {modes.frequencies[number]:.4g} Hz" for number in range(rows)])
        left.set_ylabel("Mode")
        if title:
            fig.suptitle(escape.figure(title), fontsize=10)
    return fig


def _share_table(axes: Any, shares: np.ndarray, names: Sequence[str], title: str) -> None:
    if shares.size:
        axes.imshow(shares, cmap="Greys", vmin=0, vmax=130, aspect="auto", interpolation="nearest")
    for row, column in np.argwhere(shares >= 100 * LEAST_SHARE_PRINTED):
        value = shares[row, column]
        axes.text(
            column,
            row,
            f"{value:.0f}",
            ha="center",
            va="center",
            fontsize=7.5,
            color="white" if value > 60 else "black",
            in_layout=False,  # inside the axes: needs no room, and to measure a thousand texts takes seconds
        )
    axes.set_xticks(
        range(len(names)), [short_name(name) for name in names], rotation=40, ha="right", rotation_mode="anchor"
    )
    axes.set_title(title, fontsize=9)
    axes.grid(False)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)


def _components(modes: Iterable[Mode], energy: str) -> list[str]:
    """Components with energy in the modes, in the model's order; a rigid-body mode may have none."""
    return list(dict.fromkeys(name for mode in modes for name in getattr(mode, energy)))


def _largest_shares(shares: Any, names: Sequence[str], count: int) -> list[str]:
    """The components with the largest shares (m, components), at most so many, in the model's order."""
    if len(names) <= count or not len(shares):
        return list(names)[:count]
    ranked = np.argsort(-np.max(np.asarray(shares), axis=0), kind="stable")[:count]
    return [names[i] for i in sorted(ranked)]


def _tint(colour: str, strength: float) -> tuple[float, ...]:
    return tuple(1 - strength * (1 - part) for part in to_rgb(colour))
