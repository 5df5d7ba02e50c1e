"""A controller's block diagram as SVG, from the blocks of its structure: one column, readable on a narrow screen."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from matching.report.common.environment import environment
from matching.report.common.wording import number, practical, spaced, unit
from modelling.bed.blocks import OF_BED, ControllerBlock
from modelling.bed.loop import HARDWARE, Loop

WIDTH, LEFT, RIGHT, TOP = 440, 124, 416, 10  # pixels: of the drawing, and where its boxes begin and end
LINE, PAD, GAP = 17, 9, 34  # pixels: a line of text, above and below texts in a box, between boxes
NAME_PX, VALUE_PX = 6.6, 7.6  # of a letter, with room for wide fonts; values are bold
LETTERS_IN_BOX, LETTERS_BESIDE, LETTERS_BETWEEN = 40, 15, 48  # that fit on one line


@dataclass(frozen=True)
class EnteredNumber:
    """A number that somebody enters: name, and value with unit."""

    name: str
    value: str

    @property
    def lines(self) -> int:
        """1, or 2 where name and value need a line each."""
        return 1 if NAME_PX * len(self.name) + VALUE_PX * len(self.value) < RIGHT - LEFT - 30 else 2


@dataclass(frozen=True)
class DrawnBox:
    """One box as drawn; y in pixels."""

    title: tuple[str, ...]
    entries: tuple[EnteredNumber, ...]
    gives: tuple[str, ...]
    takes: tuple[tuple[str, ...], ...]
    on_bed: bool
    y: float
    height: float


def block_diagram(loop: Loop, of_residual_vehicle: Sequence[EnteredNumber]) -> Markup:
    """The controller of one dynamometer and its bed as an SVG element, with every number that is entered.

    Parameters
    ----------
    loop : Loop
        With the tuned values.
    of_residual_vehicle : sequence of EnteredNumber
        The values of the residual vehicle.
    """
    boxes: list[DrawnBox] = []
    y = float(TOP)
    for block in (*loop.structure.blocks, *OF_BED):
        box = _box(block, _entries(block, loop, of_residual_vehicle), block in OF_BED, y)
        boxes.append(box)
        y += box.height + GAP + LINE * (len(box.gives) - 1)
    title = f"ControllerBlock diagram of the controller of each dynamometer, structure {loop.structure.name}"
    values = {
        "boxes": boxes, "title": title, "width": WIDTH, "height": y + 4, "left": LEFT, "right": RIGHT, "line": LINE,
        "pad": PAD, "gap": GAP,
    }  # fmt: skip
    return Markup(environment().get_template("block_diagram.svg").render(values))


def _entries(block: ControllerBlock, loop: Loop, of_residual_vehicle: Sequence[EnteredNumber]) -> list[EnteredNumber]:
    entries = []
    for name in block.quantities:
        if name in HARDWARE:
            entries.append(EnteredNumber(spaced(name), practical(loop[name], HARDWARE[name].unit)))
        else:
            entries.append(
                EnteredNumber(
                    spaced(name), f"{number(loop[name], 5)} {unit(loop.structure.quantities[name].unit)}".rstrip()
                )
            )
    return entries + (list(of_residual_vehicle) if block.holds_residual_vehicle else [])


def _box(block: ControllerBlock, entries: Sequence[EnteredNumber], on_bed: bool, y: float) -> DrawnBox:
    title = tuple(textwrap.wrap(block.title, LETTERS_IN_BOX - 4))
    takes = tuple(tuple(textwrap.wrap(signal, LETTERS_BESIDE)) for signal in block.takes)
    lines = len(title) + sum(entry.lines for entry in entries)
    beside = sum(len(signal) for signal in takes) + 0.5 * len(takes)
    height = 2 * PAD + LINE * max(lines, beside)
    return DrawnBox(title, tuple(entries), tuple(textwrap.wrap(block.gives, LETTERS_BETWEEN)), takes, on_bed, y, height)
