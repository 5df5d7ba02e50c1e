"""A mode as a moving drawing: every inertia a disc whose pointer swings by its amplitude in the mode shape, slowed.

The drawing is an SVG with SMIL animation: no script, no other file; printed, it shows the pointers at rest. In a damped
mode each pointer leads the one with the largest amplitude by its phase. The decay is not drawn.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matching.report.common.environment import environment
from matching.report.common.style import LIMIT, VEHICLE, figure, styled
from matching.report.common.wording import spaced
from modelling.common import display
from modelling.common.display import Displayed
from modelling.modal.result import Mode

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

    def save(self, path: str | Path) -> None:
        """Write the drawing to a file; any browser shows it."""
        standalone = self.svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)  # a page needs none
        Path(path).write_text(standalone, encoding="utf-8")


@display.text.register
def as_text(animation: ModeAnimation) -> str:
    """Number and frequency of the mode, and how to save the drawing."""
    return f"mode {animation.mode.number} at {animation.mode.frequency:.4g} Hz as a moving drawing: .save(PATH)"


@display.html.register
def as_html(animation: ModeAnimation) -> str:
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
def plot(animation: ModeAnimation) -> Any:
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
