"""A mode as a moving drawing: every inertia a disc whose pointer swings by its share of the mode shape, much slowed.

The drawing is an SVG that moves by itself (SMIL): no script, no other file; printed, it shows the pointers at rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matching.report.environment import environment
from matching.report.style import VEHICLE
from modelling.modes import Mode
from modelling.shown import Shown

SWING = 70.0  # degrees of the largest amplitude
PERIOD = 2.0  # s, of whatever frequency
WIDTH, HEIGHT, RADIUS = 96, 122, 26  # of a disc's place and of the disc that holds all kinetic energy, px
A_ROW = 9


@dataclass(frozen=True)
class ModeAnimation(Shown):
    """A mode of a chain, to be shown in a notebook or saved."""

    mode: Mode
    colour: str = VEHICLE
    of: str = ""

    _view = "matching.report.mode_animation"

    @property
    def svg(self) -> str:
        """The drawing, to stand in a page."""
        mode = self.mode
        largest = max(mode.shape.values(), key=abs, default=1.0) or 1.0
        discs = []
        for place, (name, own) in enumerate(mode.shape.items()):
            turn = complex(own / largest).real  # of damped modes what swings in step with the largest
            row, column = divmod(place, A_ROW)
            share = mode.kinetic.get(name, 0.0)
            discs.append(
                {
                    "x": round(WIDTH * (column + 0.5), 1), "y": 26 + RADIUS + HEIGHT * row, "radius": RADIUS,
                    "opacity": round(0.08 + 0.8 * share, 3), "angle": round(SWING * turn, 2),
                    "words": name.rpartition(".")[2].split("_"), "amplitude": f"{round(turn, 2) + 0.0:+.2f}",
                }
            )  # fmt: skip
        rows = (len(discs) + A_ROW - 1) // A_ROW
        damping = f", damping ratio {mode.damping_ratio:.3g}" if mode.damping_ratio else ""
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


def html(animation: ModeAnimation) -> str:
    """The drawing itself."""
    return animation.svg


def plot(animation: ModeAnimation) -> Any:
    """The amplitudes as bars, for where nothing moves (Matplotlib figure)."""
    from matching.report.style import figure, styled

    with styled():
        drawn = figure(7.0, 2.6)
        axes = drawn.subplots()
        names = [name.rpartition(".")[2] for name in animation.mode.shape]
        axes.bar(range(len(names)), list(animation.mode.shape.values()), color=animation.colour)
        axes.axhline(0.0, color="black", linewidth=0.8)
        axes.set_xticks(range(len(names)), [name.replace("_", " ") for name in names], rotation=40, ha="right")
        axes.set_ylabel("amplitude of rotation\nover the largest")
        axes.set_title(f"{animation.mode.frequency:.4g} Hz", fontsize=9)
    return drawn
