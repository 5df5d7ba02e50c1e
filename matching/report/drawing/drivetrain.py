"""A drivetrain on axes, by its layout; texts of files are written as they are, never as formulas."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from matplotlib.axes import Axes

from matching.report.common.style import INK, LIMIT, RIG
from matching.report.common.wording import amount, number, spaced
from matching.report.drawing import symbols
from matching.report.drawing.layout import Joint, Layout, layout
from modelling.model.system import System

COLUMN, TALLEST, LEAST_HEIGHT = 3.5, 0.62, 0.12  # units: from disc to disc at least; half the height of discs
LETTER, BETWEEN = 0.08, 0.15  # units: width of a letter on average; between texts
LINE_HEIGHT = 0.2  # units of a line of text
TOP = TALLEST + 0.7  # units above the first lane
LANE = 2.1  # units between lanes, with one line of text below a disc
ELBOW = 0.62  # units behind a disc where a branch turns off
CUT = 0.76  # units between the cut and the inertia behind it
TEXT_POINTS = 6.5
LETTERS = {"angle": "φ", "speed": "ω", "acceleration": "α", "torque": "M"}
HARDWARE, ARROW = "#B8B8B8", "↻"


@dataclass(frozen=True)
class Emphasis:
    """What a case says of a drivetrain.

    Attributes
    ----------
    colours : dict of str to str
        Colour of an inertia by name; grey where none is stated.
    emulated : frozenset of str
        Inertias that software stands in for.
    machines : dict of str to str
        Name of the dynamometer by the inertia of its rotor.
    cuts : dict of str to str
        Inertia behind the cut, by the name of the shaft that it runs through.
    """

    colours: dict[str, str] = field(default_factory=dict)
    emulated: frozenset[str] = frozenset()
    machines: dict[str, str] = field(default_factory=dict)
    cuts: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Drawing:
    """A drivetrain laid out: notes by component, distance of lanes (units), inertia of the tallest disc (kg·m²).

    ``column`` is the distance of columns, units.
    """

    system: System
    layout: Layout
    emphasis: Emphasis
    notes: dict[str, list[str]]
    lane: float
    largest: float
    column: float

    @property
    def width(self) -> float:
        """Units."""
        return self.column * (self.layout.columns - 1) + 2.0

    @property
    def height(self) -> float:
        """Units."""
        return self.lane * self.layout.lanes + TOP - TALLEST - 0.4

    def place(self, inertia: str) -> tuple[float, float]:
        """Centre of an inertia, units."""
        return self.column * self.layout.column[inertia], -self.lane * self.layout.lane[inertia]

    def is_geared(self, shaft: str) -> bool:
        """Whether a shaft has a ratio."""
        return next(part for part in self.system.shafts if part.name == shaft).ratio is not None

    def half(self, inertia: str) -> float:
        """Half the height of a disc: discs of one thickness have J ~ r⁴."""
        part = next(part for part in self.system.inertias if part.name == inertia)
        return max(TALLEST * (part.J.value / self.largest) ** 0.25, LEAST_HEIGHT)


def drawing(system: System, emphasis: Emphasis | None = None, largest: float | None = None) -> Drawing:
    """Lay out a drivetrain to be drawn.

    Parameters
    ----------
    largest : float, optional
        Inertia of the tallest disc, kg·m²; default the system's largest.

    Raises
    ------
    InputError
        If it has too many inertias.
    """
    notes = _notes(system)
    most = max((len(lines) for lines in notes.values()), default=0)
    largest = largest or max(part.J.value for part in system.inertias)
    emphasis = emphasis or Emphasis()
    lane, column = LANE + LINE_HEIGHT * most, _column(system, emphasis, notes)
    return Drawing(system, layout(system), emphasis, notes, lane, largest, column)


def _column(system: System, emphasis: Emphasis, notes: dict[str, list[str]]) -> float:
    """Distance of columns, units, with room for the widest texts of an inertia and of a shaft beside each other."""

    def longest(table: str, names: list[str]) -> int:
        lines = [*names, *(line for part, each in notes.items() if part.startswith(table) for line in each)]
        return max(map(len, lines), default=0)

    machines = [f"(dynamometer {name})" for name in emphasis.machines.values()]
    of_inertia = longest("inertias.", [*(part.name for part in system.inertias), *machines])
    of_shaft = longest("shafts.", [part.name for part in system.shafts])
    return max(COLUMN, LETTER * (of_inertia + of_shaft) + 2 * BETWEEN)


def draw(axes: Axes, drawn: Drawing) -> None:
    """Draw it."""
    for joint in drawn.layout.joints:
        with _labelled(axes, f"{joint.table}.{joint.name}"):
            _joint(axes, drawn, joint)
    for part in drawn.system.inertias:
        with _labelled(axes, f"inertias.{part.name}"):
            _inertia(axes, drawn, part.name)
    axes.set_xlim(-1.0, drawn.width - 1.0)
    axes.set_ylim(TOP - drawn.height, TOP)
    axes.set_aspect("equal")
    axes.set_axis_off()


@contextmanager
def _labelled(axes: Axes, part: str) -> Iterator[None]:
    """What is drawn within has the name of the part as its label; no legend shows it."""
    before = set(axes.get_children())
    yield
    for artist in axes.get_children():
        if artist not in before:
            artist.set_label(part)


def _notes(system: System) -> dict[str, list[str]]:
    """Lines below every component: torques that act, sensors, effects."""
    notes: dict[str, list[str]] = {}
    for source in system.inputs:
        notes.setdefault(f"inertias.{source.on}", []).append(f"{ARROW} {spaced(source.name)}")
    for sensor in system.sensors:
        table = "shafts" if sensor.measures == "torque" else "inertias"
        notes.setdefault(f"{table}.{sensor.of}", []).append(f"{LETTERS[sensor.measures]}: {spaced(sensor.name)}")
    on_what = {f"inputs.{part.name}": f"inertias.{part.on}" for part in system.inputs} | {
        f"sensors.{part.name}": f"{'shafts' if part.measures == 'torque' else 'inertias'}.{part.of}"
        for part in system.sensors
    }
    for effect in system.effects:
        notes.setdefault(on_what.get(effect.at, effect.at), []).append(f"+ {spaced(effect.kind)}")
    return notes


def _inertia(axes: Axes, drawn: Drawing, name: str) -> None:
    x, y = drawn.place(name)
    half, emphasis = drawn.half(name), drawn.emphasis
    part = next(part for part in drawn.system.inertias if part.name == name)
    if name in emphasis.machines:
        symbols.machine(axes, x, y, half, RIG)
    symbols.disc(axes, x, y, half, emphasis.colours.get(name, HARDWARE), emulated=name in emphasis.emulated)
    above = spaced(name)
    if name in emphasis.machines:
        machine = spaced(emphasis.machines[name])
        above += f"\n({machine})" if "dynamometer" in machine else f"\n(dynamometer {machine})"
    _text(axes, x, y + half + 0.18, above, va="bottom", weight="bold")
    lines = [amount(part.J.value, "kg*m^2"), *drawn.notes.get(f"inertias.{name}", [])]
    _text(axes, x, y - half - 0.18, "\n".join(lines), va="top")


def _joint(axes: Axes, drawn: Drawing, joint: Joint) -> None:
    x, y = drawn.place(joint.near)
    if joint.table == "differentials":
        middle = x + ELBOW + 0.3
        symbols.line(axes, (x, y), (middle, y))
        for end in joint.far:
            to_x, to_y = drawn.place(end)
            symbols.line(axes, (middle, y), (middle, to_y), (to_x, to_y))
        symbols.differential(axes, middle, y)
        beside = middle + 0.3 + LETTER * len(joint.name) / 2  # between the branches
        _text(axes, beside, y - 0.07, spaced(joint.name), va="bottom")
        return
    (end,) = joint.far
    (to_x, to_y), across = drawn.place(end), -drawn.lane * joint.lane
    geared = joint.table == "shafts" and drawn.is_geared(joint.name)
    centre = x + drawn.column / 2 + (0.25 if geared else 0.12 if y != to_y else 0.0)
    reach = symbols.ELEMENT / 2 if joint.table == "shafts" else 0.0
    turn = x + ELBOW
    symbols.line(axes, (x, y), (turn, y), (turn, across), (centre - reach, across))
    back = [] if across == to_y else [(to_x - ELBOW, across), (to_x - ELBOW, to_y)]
    symbols.line(axes, (centre + reach, across), *back, (to_x, to_y))
    (_shaft if joint.table == "shafts" else _gear)(axes, drawn, joint.name, centre, across)
    if joint.name in drawn.emphasis.cuts and joint.table == "shafts":
        behind = drawn.place(drawn.emphasis.cuts[joint.name])[0]
        symbols.cut(axes, behind + (-CUT if behind >= to_x else CUT), across, RIG)


def _shaft(axes: Axes, drawn: Drawing, name: str, x: float, y: float) -> None:
    part = next(part for part in drawn.system.shafts if part.name == name)
    symbols.spring_and_damper(axes, x, y, damped=part.damping.value > 0)
    if drawn.is_geared(name):
        symbols.gear_pair(axes, x - symbols.ELEMENT / 2 - 0.28, y)
    _text(axes, x, y + 0.32, spaced(name), va="bottom")
    lines = [amount(part.stiffness.value, "N*m/rad")]
    lines += [] if part.ratio is None else [f"i = {number(part.ratio.value)}"]
    _text(axes, x, y - 0.32, "\n".join([*lines, *drawn.notes.get(f"shafts.{name}", [])]), va="top")


def _gear(axes: Axes, drawn: Drawing, name: str, x: float, y: float) -> None:
    part = next(part for part in drawn.system.gears if part.name == name)
    symbols.gear_pair(axes, x, y)
    _text(axes, x, y + 0.32, spaced(name), va="bottom")
    _text(axes, x, y - 0.32, f"i = {number(part.ratio.value)}", va="top")


def _text(axes: Axes, x: float, y: float, text: str, va: str, weight: str = "normal") -> None:
    colour = INK if weight == "bold" else LIMIT
    axes.text(
        x, y, text, ha="center", va=va, fontsize=TEXT_POINTS, color=colour, weight=weight, linespacing=1.1,
        parse_math=False, zorder=6,
    )  # fmt: skip
