"""A mode as a moving drawing: every inertia a disc whose pointer swings by its share of the mode shape, much slowed.

The drawing is an SVG that moves by itself (SMIL): no script, no other file; printed, it shows the pointers at rest. In
a damped mode inertias swing out of step: each pointer is ahead of the largest by its phase. The decay is left out.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matching.report.common.environment import environment
from matching.report.common.style import LIMIT, VEHICLE, figure, styled
from modelling.common import display
from modelling.common.display import Displayed
from modelling.modal.modes import Mode

SWING = 70.0  # degrees of the largest amplitude
PERIOD = 2.0  # s, of whatever frequency
WIDTH, HEIGHT, RADIUS = 96, 122, 26  # of a disc's place and of the disc that holds all kinetic energy, px
A_ROW = 9
IN_STEP = math.radians(0.5)  # a phase this near to 0 or 180° is that


@dataclass(frozen=True)
class ModeAnimation(Displayed):
    """A mode of a chain, to be shown in a notebook or saved."""

    mode: Mode
    colour: str = VEHICLE
    of: str = ""

    @property
    def svg(self) -> str:
        """The drawing, to stand in a page."""
        mode = self.mode
        largest = max(mode.shape.values(), key=abs, default=1.0) or 1.0
        discs = []
        for place, (name, own) in enumerate(mode.shape.items()):
            turn, phase = relative(own, largest)
            said = f"{turn:.2f}, {math.degrees(phase):+.0f}°" if phase else f"{round(turn, 2) + 0.0:+.2f}"
            row, column = divmod(place, A_ROW)
            share = mode.kinetic.get(name, 0.0)
            discs.append(
                {
                    "x": round(WIDTH * (column + 0.5), 1), "y": 26 + RADIUS + HEIGHT * row, "radius": RADIUS,
                    "opacity": round(0.08 + 0.8 * share, 3), "angle": round(SWING * turn, 2),
                    "begin": round(-PERIOD * (phase % math.tau) / math.tau, 3),
                    "words": name.rpartition(".")[2].split("_"),
                    "amplitude": said,
                }
            )  # fmt: skip
        rows = (len(discs) + A_ROW - 1) // A_ROW
        damping = f", damping ratio {mode.damping_ratio:.3g}" if mode.damping_ratio else ""
        if abs(mode.damping_ratio) == 1:
            damping += " (creeps, does not swing)"
        title = f"mode {mode.number}: {mode.frequency:.4g} Hz{damping}, slowed; darker holds more kinetic energy"
        title = f"{self.of}, {title}" if self.of else title
        height, width = 30 + HEIGHT * rows, max(WIDTH * min(len(discs), A_ROW), 560)
        template = environment().get_template("mode_animation.svg")
        return template.render(discs=discs, width=width, height=height, title=title, period=PERIOD, colour=self.colour)

    def save(self, path: str | Path) -> None:
        """Write the drawing to a file; any browser shows it."""
        alone = self.svg.replace(
            "<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1
        )  # inside a page it goes without
        Path(path).write_text(alone, encoding="utf-8")


@display.text.register
def said(animation: ModeAnimation) -> str:
    """What it is."""
    return f"mode {animation.mode.number} at {animation.mode.frequency:.4g} Hz as a moving drawing: .save(PATH)"


@display.html.register
def html(animation: ModeAnimation) -> str:
    """The drawing itself."""
    return animation.svg


@display.animation.register
def animated(mode: Mode) -> ModeAnimation:
    """A mode as a moving drawing."""
    return ModeAnimation(mode)


def relative(own: complex, largest: complex) -> tuple[float, float]:
    """Amplitude over the largest, signed, and 0; where it swings out of step its size and phase ahead in rad."""
    turn = complex(own / largest)
    phase = cmath.phase(turn)
    if abs(turn) < 0.005 or abs(phase) < IN_STEP or abs(phase) > math.pi - IN_STEP:
        return turn.real, 0.0
    return abs(turn), phase


@display.plot.register
def plot(animation: ModeAnimation) -> Any:
    """The amplitudes as bars, for where nothing moves, and the phases of a damped mode (Matplotlib figure)."""
    mode = animation.mode
    largest = max(mode.shape.values(), key=abs, default=1.0) or 1.0
    bars = [relative(own, largest) for own in mode.shape.values()]
    phased = any(phase for _, phase in bars)
    with styled():
        drawn = figure(7.0, 3.8 if phased else 2.6)
        grid = drawn.subplots(1 + phased, 1, sharex=True, squeeze=False, height_ratios=[2, 1][: 1 + phased])[:, 0]
        grid[0].bar(range(len(bars)), [turn for turn, _ in bars], color=animation.colour)
        grid[0].axhline(0.0, color="black", linewidth=0.8)
        grid[0].set_ylabel("amplitude of rotation\nover the largest")
        grid[0].set_title(f"{mode.frequency:.4g} Hz", fontsize=9)
        if phased:
            ahead = [math.degrees(phase) if phase else (0.0 if turn >= 0 else 180.0) for turn, phase in bars]
            grid[1].axhline(0.0, color=LIMIT, linewidth=0.8)
            grid[1].plot(ahead, "o", color=animation.colour)
            grid[1].set_ylabel("phase in °")
        names = [name.rpartition(".")[2].replace("_", " ") for name in mode.shape]
        grid[-1].set_xticks(range(len(names)), names, rotation=40, ha="right")
    return drawn
