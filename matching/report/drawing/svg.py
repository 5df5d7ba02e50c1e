"""A drivetrain as SVG for a page: parts that can be clicked and reached by Tab, energies as colour, a mode swinging.

The mark on every disc moves as a point of its rim does, seen from the side: up and down with the angle of the inertia.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

from markupsafe import Markup

from matching.report.common.environment import environment
from matching.report.common.style import INK
from matching.report.common.wording import amount, spaced
from matching.report.drawing.picture import Area, DrawnPart, Label, Picture, Stroke
from modelling.modal.result import Mode
from modelling.units import QUANTITY_UNITS

PIXELS_PER_UNIT = 62
FRAMES = 16  # of one period of the swinging mode
LINE_SPACING = 1.1  # of the height of letters
WORDS = {
    "inertias": "inertia", "shafts": "shaft", "gears": "gear", "differentials": "differential",
}  # fmt: skip
LARGEST_OPACITY = 0.6  # of the colour for energy, so that texts on it stay readable
LEAST_SHARE = 0.005  # of the energy, below which a part is not coloured


@dataclass(frozen=True)
class Marks:
    """What is marked in a drawing.

    Attributes
    ----------
    selected : str
        Name of the part that is edited, or empty.
    changed : collection of str
        Names of parts that differ from the file.
    mode : Mode or None
        Its energy shares colour the parts, and its shape swings.
    """

    selected: str = ""
    changed: Collection[str] = field(default_factory=frozenset)
    mode: Mode | None = None


def drivetrain_svg(picture: Picture, marks: Marks | None = None, *, reacts: bool = False, prefix: str = "") -> str:
    """The drawing as an element of a page.

    Parameters
    ----------
    reacts : bool
        Whether parts are buttons: each has ``data-part`` and is reached by Tab.
    prefix : str
        Put before identifiers, so that several drawings fit on one page.
    """
    marks = marks or Marks()
    left, lower, right, upper = picture.extent
    system = picture.drawing.system
    return environment().get_template("drivetrain.svg").render(
        left=left, top=-upper, width=round(right - left, 3), height=round(upper - lower, 3), scale=PIXELS_PER_UNIT,
        title=f"Drivetrain {system.title}".strip(), reacts=reacts, prefix=prefix,
        parts=[_part(picture, part, marks, prefix) for part in picture.parts],
        swing=[] if marks.mode is None else _swing(picture, marks.mode),
    )  # fmt: skip


def _part(picture: Picture, part: DrawnPart, marks: Marks, prefix: str) -> dict[str, Any]:
    left, lower, right, upper = part.box
    share = 0.0 if marks.mode is None else _energy(marks.mode, part.name)
    return {
        "name": part.name, "words": _words(picture, part.name, share), "changed": part.name in marks.changed,
        "selected": part.name == marks.selected, "x": round(left - 0.1, 3), "y": round(-upper - 0.08, 3),
        "width": round(right - left + 0.2, 3), "height": round(upper - lower + 0.16, 3),
        "heat": f"rgba(230,159,0,{min(LARGEST_OPACITY, 0.1 + share):.2f})" if share > LEAST_SHARE else "transparent",
        "shapes": _markup(part, prefix),
    }  # fmt: skip


@functools.lru_cache(maxsize=2048)
def _markup(part: DrawnPart, prefix: str) -> Markup:
    """The shapes of a part, which stay while a slider moves."""
    shapes = [_shape(shape) for shape in part.shapes]
    return Markup(environment().get_template("drivetrain_part.svg").render(shapes=shapes, prefix=prefix))


def _energy(mode: Mode, part: str) -> float:
    """Share of a part in the kinetic or potential energy of a mode, those of its effects included."""
    shares = mode.kinetic if part.startswith("inertias.") else mode.potential
    return sum(share for name, share in shares.items() if name == part or name.startswith(f"{part}."))


def _words(picture: Picture, name: str, share: float) -> str:
    """What a reader who does not see the drawing is told of a part."""
    table, _, part = name.partition(".")
    component = picture.drawing.system[name]
    quantities = [(key, getattr(component, key, None), unit) for key, unit in QUANTITY_UNITS.items()]
    amounts = [f"{key} {amount(quantity.value, unit)}" for key, quantity, unit in quantities if quantity is not None]
    energy = [f"{100 * share:.0f} % of the energy"] if share > LEAST_SHARE else []
    return ", ".join([f"{WORDS[table]} {spaced(part)}", *amounts, *energy])


def _shape(shape: Stroke | Area | Label) -> dict[str, Any]:
    if isinstance(shape, Stroke):
        values: dict[str, Any] = {"kind": "stroke", "points": _points(shape.points), "dashed": shape.dashed}
        return values | {"colour": shape.colour, "width": round(shape.width, 4)}
    if isinstance(shape, Area):
        values = {"kind": "area", "points": _points(shape.corners), "fill": shape.fill, "hatched": shape.hatched}
        return values | {"colour": shape.colour, "width": round(shape.width, 4)}
    step = LINE_SPACING * shape.height
    first = -shape.y + (0.8 * shape.height if shape.below else -step * (len(shape.lines) - 1))
    lines = [
        {"x": round(shape.x, 3), "y": round(first + step * place, 3), "text": text}
        for place, text in enumerate(shape.lines)
    ]
    return {"kind": "text", "lines": lines, "bold": shape.bold, "colour": INK, "height": shape.height}


def _points(points: tuple[tuple[float, float], ...]) -> str:
    return " ".join(f"{x:g},{-y:g}" for x, y in points)


def _swing(picture: Picture, mode: Mode) -> list[dict[str, Any]]:
    largest = max((abs(amplitude) for amplitude in mode.shape.values()), default=0.0) or 1.0
    discs = []
    for part in picture.drawing.system.inertias:
        amplitude = complex(mode.shape.get(f"inertias.{part.name}", 0.0)) / largest
        (x, y), half = picture.drawing.place(part.name), picture.drawing.half(part.name)
        turns = (math.tau * frame / FRAMES for frame in range(FRAMES + 1))
        heights = (-y - half * (amplitude.real * math.cos(turn) - amplitude.imag * math.sin(turn)) for turn in turns)
        size = f"{abs(amplitude):.2f}" if abs(amplitude.imag) > 1e-9 else f"{round(amplitude.real, 2) + 0.0:+.2f}"
        values = ";".join(f"{height:.3f}" for height in heights)
        discs.append({"x": x, "y": -y, "half": round(half, 3), "heights": values, "amplitude": size})
    return discs
