"""Views of models and modes: energy shares, mode table, moving drawing, equations."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from matching.match.loop_modes import LoopMode
from matching.report.common import ABSENT, LIMIT, VEHICLE, figure, image, spaced, styled
from matching.report.page import environment, register_table
from modelling import display, escape
from modelling.display import Displayed
from modelling.equations import lagrange
from modelling.equations.lagrange import Equations
from modelling.modal.result import Mode, Modes

# --- A mode as a moving drawing: every inertia a disc whose pointer swings by its amplitude in the mode shape, slowed.
#
# The drawing is an SVG with SMIL animation: no script, no other file; printed, it shows the pointers at rest. In a
# damped mode each pointer leads the one with the largest amplitude by its phase. The decay is not drawn.

LARGEST_SWING_DEG = 70.0  # of the pointer with the largest amplitude
PERIOD_S = 2.0  # of the drawing, whatever the mode's frequency
CELL_WIDTH_PX, CELL_HEIGHT_PX, RADIUS_PX = 96, 122, 26
LEAST_WIDTH_PX = 560  # of the drawing, so that its title has room
TITLE_HEIGHT_PX = 46
LETTER_WIDTH_PX = 8  # of the title, at most on average
MEANING = "slowed; the darker, the more kinetic energy"
DISCS_PER_ROW = 9
IN_PHASE_RAD = math.radians(0.5)  # a phase this near to 0 or 180° counts as 0 or 180°
LEAST_AMPLITUDE = 0.005  # relative; below, a phase means nothing


@dataclass(frozen=True)
class ModeAnimation(Displayed):
    """A mode as a drawing to show in a notebook or save.

    Attributes
    ----------
    mode : Mode
    colour : str
    system : str
        Name of what swings, for the title; may be empty.
    """

    mode: Mode
    colour: str = VEHICLE
    system: str = ""

    @property
    def svg(self) -> str:
        """The drawing as an element of a page."""
        mode = self.mode
        largest = max(mode.shape.values(), key=abs, default=1.0) or 1.0
        discs = []
        for place, (name, amplitude) in enumerate(mode.shape.items()):
            size, phase = relative(amplitude, largest)
            label = f"{size:.2f}, {math.degrees(phase):+.0f}°" if phase else f"{round(size, 2) + 0.0:+.2f}"
            row, column = divmod(place, DISCS_PER_ROW)
            share = mode.kinetic.get(name, 0.0)
            discs.append(
                {
                    "x": round(CELL_WIDTH_PX * (column + 0.5), 1),
                    "y": TITLE_HEIGHT_PX - 4 + RADIUS_PX + CELL_HEIGHT_PX * row,
                    "radius": RADIUS_PX,
                    "opacity": round(0.08 + 0.8 * share, 3), "angle": round(LARGEST_SWING_DEG * size, 2),
                    "begin": round(-PERIOD_S * (phase % math.tau) / math.tau, 3),
                    "words": name.rpartition(".")[2].split("_"),
                    "amplitude": label,
                }
            )  # fmt: skip
        rows = -(-len(discs) // DISCS_PER_ROW)
        damping = f", damping ratio {mode.damping_ratio:.3g}" if mode.damping_ratio else ""
        if abs(mode.damping_ratio) == 1:
            damping += " (overdamped, does not oscillate)"
        title = f"mode {mode.number}: {mode.frequency:.4g} Hz{damping}"
        title = f"{self.system}, {title}" if self.system else title
        height = TITLE_HEIGHT_PX + CELL_HEIGHT_PX * rows
        width = max(CELL_WIDTH_PX * min(len(discs), DISCS_PER_ROW), LEAST_WIDTH_PX, LETTER_WIDTH_PX * len(title))
        template = environment().get_template("mode_animation.svg")
        return template.render(
            discs=discs, width=width, height=height, title=title, meaning=MEANING, period=PERIOD_S, colour=self.colour
        )

    def save(self, path: str | Path) -> Path:
        """Write the drawing to a file; any browser shows it."""
        standalone = self.svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)  # a page needs none
        Path(path).write_text(standalone, encoding="utf-8")
        return Path(path)


@display.text.register
def animation_text(animation: ModeAnimation) -> str:
    """Number and frequency of the mode, and how to save the drawing."""
    return f"mode {animation.mode.number} at {animation.mode.frequency:.4g} Hz as a moving drawing: .save(PATH)"


@display.html.register
def animation_html(animation: ModeAnimation) -> str:
    """The drawing itself."""
    return animation.svg


@display.animation.register
def animated(mode: Mode) -> ModeAnimation:
    """A mode as a moving drawing."""
    return ModeAnimation(mode)


def relative(amplitude: complex, largest: complex) -> tuple[float, float]:
    """Signed ratio to the largest amplitude and 0 if in phase or in antiphase, else size and phase lead in rad."""
    ratio = complex(amplitude / largest)
    phase = cmath.phase(ratio)
    if abs(ratio) < LEAST_AMPLITUDE or abs(phase) < IN_PHASE_RAD or abs(phase) > math.pi - IN_PHASE_RAD:
        return ratio.real, 0.0
    return abs(ratio), phase


@display.plot.register
def plot_animation(animation: ModeAnimation) -> Any:
    """Amplitudes as bars and, of a damped mode, phases as points (Matplotlib figure)."""
    mode = animation.mode
    largest = max(mode.shape.values(), key=abs, default=1.0) or 1.0
    bars = [relative(amplitude, largest) for amplitude in mode.shape.values()]
    phased = any(phase for _, phase in bars)
    with styled():
        fig = figure(7.0, 3.8 if phased else 2.6)
        grid = fig.subplots(1 + phased, 1, sharex=True, squeeze=False, height_ratios=[2, 1][: 1 + phased])[:, 0]
        grid[0].bar(range(len(bars)), [size for size, _ in bars], color=animation.colour)
        grid[0].axhline(0.0, color="black", linewidth=0.8)
        grid[0].set_ylabel("amplitude of rotation\nover the largest")
        grid[0].set_title(f"{mode.frequency:.4g} Hz", fontsize=9)
        if phased:
            lead = [math.degrees(phase) if phase else (0.0 if size >= 0 else 180.0) for size, phase in bars]
            grid[1].axhline(0.0, color=LIMIT, linewidth=0.8)
            grid[1].plot(lead, "o", color=animation.colour)
            grid[1].set_ylabel("phase in °")
        names = [spaced(name.rpartition(".")[2]) for name in mode.shape]
        grid[-1].set_xticks(range(len(names)), names, rotation=40, ha="right")
    return fig


# --- Views of a model and of its equations in a notebook: energies and equations of motion.


@display.html.register
def equations_html(equations: Equations) -> str:
    """Energies and equations of motion."""
    return lagrange.html(equations)


# --- The mode table: frequency, damping, symmetry and where most of the energy sits.


def mode_table(modes: Sequence[dict[str, Any]], components: int = 3) -> list[dict[str, str]]:
    """Rows of the mode table from the entries of ``modes.json``, with the components that hold most of the energy.

    Damped modes have two frequencies: the one at which they ring, and the natural one.
    """
    damped = any(mode["damping_ratio"] is not None for mode in modes)
    return [
        {
            "mode": str(mode["number"]),
            **({"rings at [Hz]": _rings(mode)} if damped else {}),
            "natural frequency [Hz]" if damped else "undamped [Hz]": f"{mode['frequency']:.4g}",
            **({"damping ratio": f"{mode['damping_ratio']:.4f}"} if damped else {}),
            "symmetry": mode["symmetry"],
            "kinetic energy": _largest(mode["kinetic"], components),
            "potential energy": _largest(mode["potential"], components),
        }
        for mode in modes
    ]


def _rings(mode: dict[str, Any]) -> str:
    """Frequency at which a damped mode rings; nothing for one that does not."""
    ratio = mode["damping_ratio"]
    return ABSENT if abs(ratio) >= 1 or not mode["frequency"] else f"{mode['frequency'] * math.sqrt(1 - ratio**2):.4g}"


def _largest(shares: dict[str, float], count: int) -> str:
    ranked = sorted(shares.items(), key=lambda item: -round(item[1], 6))[:count]  # equal ones in the model's order
    return ", ".join(f"{short_name(name)} {100 * share:.0f} %" for name, share in ranked if share >= 0.05) or ABSENT


def short_name(name: str) -> str:
    """A component's name without its table, for a figure or a table."""
    return spaced(name.rsplit(".", 1)[1])


# --- Figures of modes: frequencies and energy shares as in the paper's Fig. 3, and all shares in one table.

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
    modes: Sequence[Mode | LoopMode] | Modes
    emphasised: tuple[int, ...] = ()

    @property
    def chosen(self) -> list[Mode | LoopMode]:
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
        mark = {"symmetric": "\nsym", "antisymmetric": "\nanti"}.get(mode.symmetry, "")
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
    axes.set_ylim(FLOOR_HZ, 5 * max(top, 1.0))
    axes.set_xticks([mode.number for mode in column.modes])
    axes.grid(False, axis="x")
    sides = " (sym, anti: symmetric, antisymmetric left to right)" if _labelled(column) else ""
    axes.set_xlabel(f"Mode number{sides}")
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


def _components(modes: Iterable[Mode | LoopMode], energy: str) -> list[str]:
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


# --- Views of modes: energy shares as a figure, the mode table.


@display.plot.register
def plot_modes(modes: Modes) -> Figure:
    """Energy shares of all modes, %."""
    return shares_figure(modes)


@display.files.register
def modes_files(modes: Modes, folder: str = "", made: Any = None, title: str = "") -> display.ResultFiles:
    """``modes.json`` and figures."""
    others: dict[str, str | bytes] = {
        "modes.svg": image(energy_figure([Column(title, VEHICLE, modes)])),
        "energy_shares.svg": image(shares_figure(modes, title)),
    }
    return "modes.json", modes.to_dict(), others


register_table(Modes, lambda modes: mode_table(modes.to_dict()["modes"]))
