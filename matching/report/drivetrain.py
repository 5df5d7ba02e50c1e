"""A drivetrain on axes, by its layout; texts of files are written as they are, never as formulas."""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Polygon, Rectangle
from matplotlib.transforms import Bbox

from matching.match.case import Case
from matching.report.common import (
    INK,
    LIMIT,
    RIG,
    VEHICLE,
    amount,
    figure,
    image,
    number,
    spaced,
    styled,
    without_head,
)
from matching.report.page import embedded, environment
from modelling import display
from modelling.equations import lagrange
from modelling.equations.lagrange import derive
from modelling.errors import InputError
from modelling.modal.result import Mode
from modelling.system import System, quantities, quantity_unit
from modelling.topology import DIVIDING

# --- Where the inertias of a drivetrain stand on paper: a tree from one end, branches in lanes of their own.
#
# Where branches meet again (two wheels that carry one body), the inertia stands behind all of them and in their middle.

MOST_INERTIAS = 80  # more are no drawing any more


@dataclass(frozen=True)
class Joint:
    """What connects inertias: its table and name, the end nearer to the root, the other ends, and its lane.

    What divides has no lane of its own: it stands in that of its near end.
    """

    table: str
    name: str
    near: str
    far: tuple[str, ...]
    lane: float = 0.0

    @property
    def divides(self) -> bool:
        """Whether it is a differential or a planetary gear."""
        return self.table in DIVIDING


@dataclass(frozen=True)
class Layout:
    """Column and lane of every inertia, from 0, and the joints in the order in which they are met.

    The first child of a branch stands above, the last below; lanes count downwards.
    """

    column: dict[str, int]
    lane: dict[str, float]
    joints: tuple[Joint, ...]

    @property
    def columns(self) -> int:
        """Number of columns."""
        return max(self.column.values()) + 1

    @property
    def lanes(self) -> float:
        """Distance of the first and the last lane, plus one."""
        return max([*self.lane.values(), *(joint.lane for joint in self.joints)]) + 1


class Shift(NamedTuple):
    """Columns to the right and lanes downwards by which an inertia, with all that hangs on it, was moved."""

    right: int
    down: int


def layout(system: System, shifts: Mapping[str, Shift] | None = None) -> Layout:
    """Lay a drivetrain out, from the first inertia in the file that is an end of it; parts that stand apart below.

    ``shifts`` moves inertias from there, by name.
    """
    if len(system.inertias) > MOST_INERTIAS:
        raise InputError(
            "inertias", f"{len(system.inertias)} are too many for a drawing", f"at most {MOST_INERTIAS} are drawn"
        )
    tree = _grown(system)
    _put_behind(tree)
    lane = _lanes(tree.roots, tree.children, tree.order)
    for name, shift in (shifts or {}).items():
        for each in dict.fromkeys(tree.below(name)) if name in tree.column else ():
            tree.column[each] += shift.right
            lane[each] += shift.down
    first, top = min(tree.column.values()), min(lane.values())
    tree.column.update({name: column - first for name, column in tree.column.items()})
    return _with_lanes(tree, {name: own - top for name, own in lane.items()})


@dataclass(frozen=True)
class _Tree:
    """Columns, children and order of the inertias as they were met, from each root; joints, and those met again."""

    roots: list[str]
    column: dict[str, int]
    children: dict[str, list[str]]
    order: list[str]
    joints: list[Joint]
    again: list[Joint]

    def below(self, name: str) -> list[str]:
        """An inertia and all that hang on it."""
        names = [name]
        for each in names:  # grows while it is worked through
            names += self.children[each]
        return names


def _grown(system: System) -> _Tree:
    """The tree of shortest paths from the first inertia that is an end, and so on for parts that stand apart."""
    connections = _connections(system)
    meeting: dict[str, list[int]] = {part.name: [] for part in system.inertias}
    for number, (_, _, ends) in enumerate(connections):
        for end in ends:
            meeting[end].append(number)
    tree = _Tree([], {}, {}, [], [], [])
    drawn: set[int] = set()
    while len(tree.column) < len(system.inertias):
        left = [part.name for part in system.inertias if part.name not in tree.column]
        root = next((name for name in left if len(meeting[name]) <= 1), left[0])
        tree.roots.append(root)
        tree.column[root], tree.children[root] = 0, []
        reached = [root]
        for name in reached:  # grows while it is worked through
            for number in meeting[name]:
                if number not in drawn:
                    drawn.add(number)
                    table, joint, ends = connections[number]
                    reached += _reach(tree, Joint(table, joint, name, tuple(end for end in ends if end != name)))
        tree.order.extend(reached)
    return tree


def _reach(tree: _Tree, joint: Joint) -> list[str]:
    """Enter a joint; the inertias that are met for the first time."""
    tree.joints.append(joint)
    fresh = [end for end in joint.far if end not in tree.column]
    for end in fresh:
        tree.column[end], tree.children[end] = tree.column[joint.near] + 1, []
    tree.children[joint.near] += fresh
    if not fresh:
        tree.again.append(joint)
    return fresh


def _put_behind(tree: _Tree) -> None:
    """Move every inertia that is met again, with all that hangs on it, behind the inertias from which it is met."""
    for _ in tree.again:  # a move may make another one necessary
        for joint in tree.again:
            for end in joint.far:
                behind = tree.column[joint.near] + 1 - tree.column[end]
                below = tree.below(end)
                if behind > 0 and joint.near not in below:
                    for name in below:
                        tree.column[name] += behind


def _with_lanes(tree: _Tree, lane: dict[str, float]) -> Layout:
    """Joints in the lane of their far end; those that close a circle in that of their near end, or below all.

    An inertia in which branches end together stands in the middle of them.
    """
    ends = {end for joint in tree.again for end in joint.far if not tree.children[end]}
    busy = {name for name, below in tree.children.items() if not ends.issuperset(below)}
    following, placed = max(lane.values()) + 1, list[Joint]()
    for joint in tree.joints:
        its_lane = lane[joint.near if joint.divides else joint.far[0]]
        if joint in tree.again and not joint.divides:
            its_lane = lane[joint.near]
            if joint.near in busy:
                its_lane, following = following, following + 1
            busy.add(joint.near)
        elif ends.intersection(joint.far):
            busy.add(joint.near)
        placed.append(replace(joint, lane=its_lane))
    column, lane = dict(tree.column), dict(lane)
    for name in ends:
        arriving = [joint.lane for joint in placed if name in joint.far and not joint.divides]
        lane[name] = (min(arriving) + max(arriving)) / 2 if arriving else lane[name]
        while any(
            column[name] == column[other] and abs(lane[name] - lane[other]) < 1 for other in lane if other != name
        ):
            column[name] += 1
    return Layout(column, lane, tuple(placed))


def _connections(system: System) -> list[tuple[str, str, tuple[str, ...]]]:
    connections = [("shafts", part.name, tuple(part.between)) for part in system.shafts]
    connections += [("gears", part.name, tuple(part.between)) for part in system.gears]
    connections += [("gearboxes", part.name, tuple(part.between)) for part in system.gearboxes]
    return connections + [(table, part.name, part.ends) for table in DIVIDING for part in getattr(system, table)]


def _lanes(roots: list[str], children: dict[str, list[str]], order: list[str]) -> dict[str, float]:
    """Ends of branches one below the other, every other inertia in the middle of what hangs on it."""
    lane: dict[str, float] = {}
    waiting, following = list(reversed(roots)), 0
    while waiting:
        name = waiting.pop()
        if not children[name]:
            lane[name] = float(following)
            following += 1
        waiting.extend(reversed(children[name]))
    for name in reversed(order):
        if children[name]:
            lane[name] = (lane[children[name][0]] + lane[children[name][-1]]) / 2
    return lane


# --- The symbols of a drivetrain drawing, each drawn on axes at a place; lengths in units of the drawing.

LINE: dict[str, Any] = {"color": INK, "linewidth": 1.1, "solid_capstyle": "round"}
DISC_WIDTH = 0.26
ELEMENT = 0.75  # length of spring and damper
APART = 0.15  # of spring and damper from the shaft's axis
GEAR_RADIUS = 0.13


def line(axes: Axes, *points: tuple[float, float]) -> None:
    """A shaft without twist."""
    x, y = zip(*points, strict=True)
    axes.plot(x, y, **LINE)


def disc(axes: Axes, x: float, y: float, half: float, colour: str, *, emulated: bool) -> None:
    """An inertia seen from the side; hatched where software stands in for it."""
    axes.add_patch(
        Rectangle(
            (x - DISC_WIDTH / 2, y - half), DISC_WIDTH, 2 * half, facecolor=colour, edgecolor=INK, linewidth=1.1,
            hatch="////" if emulated else None, zorder=3,
        )
    )  # fmt: skip


def spring_and_damper(axes: Axes, x: float, y: float, *, damped: bool) -> None:
    """A torsion spring, in parallel with a damper where there is one, centred at x."""
    left, right = x - ELEMENT / 2, x + ELEMENT / 2
    up = y + APART if damped else y
    t = np.linspace(0, 1, 10)
    across = np.array([0, 0, 1, -1, 1, -1, 1, -1, 0, 0]) * 0.09
    axes.plot(left + ELEMENT * t, up + across, **LINE)
    if not damped:
        return
    down, cup = y - APART, x + 0.1
    for end in (left, right):
        line(axes, (end, up), (end, down))
    line(axes, (left, down), (x - 0.02, down))
    line(axes, (x - 0.02, down - 0.07), (x - 0.02, down + 0.07))  # piston
    line(axes, (x - 0.14, down + 0.1), (cup, down + 0.1), (cup, down - 0.1), (x - 0.14, down - 0.1))
    line(axes, (cup, down), (right, down))


def gear_pair(axes: Axes, x: float, y: float) -> None:
    """Two wheels in mesh."""
    for side in (1, -1):
        place = (x, y + side * GEAR_RADIUS)
        axes.add_patch(Circle(place, GEAR_RADIUS, facecolor="white", edgecolor=INK, linewidth=1.1, zorder=3))
        axes.add_patch(Circle(place, 0.02, color=INK, zorder=4))


def clutch(axes: Axes, x: float, y: float) -> None:
    """Two plates with a gap, the shaft interrupted between them."""
    axes.add_patch(Rectangle((x - 0.04, y - 0.16), 0.08, 0.32, facecolor="white", edgecolor="none", zorder=2))
    for plate in (x - 0.04, x + 0.04):
        axes.plot((plate, plate), (y - 0.16, y + 0.16), **{**LINE, "linewidth": 2.0}, zorder=3)


def differential(axes: Axes, x: float, y: float) -> None:
    """The cage of an open differential."""
    corners = [(x - 0.22, y), (x, y + 0.22), (x + 0.22, y), (x, y - 0.22)]
    axes.add_patch(Polygon(corners, closed=True, facecolor="white", edgecolor=INK, linewidth=1.1, zorder=3))
    for corner, other in (((-1, -1), (1, 1)), ((-1, 1), (1, -1))):
        axes.plot(
            [x + 0.09 * corner[0], x + 0.09 * other[0]], [y + 0.09 * corner[1], y + 0.09 * other[1]], zorder=4, **LINE
        )


def planetary_gear(axes: Axes, x: float, y: float) -> None:
    """Ring, sun and three planets."""
    axes.add_patch(Circle((x, y), 0.24, facecolor="white", edgecolor=INK, linewidth=1.1, zorder=3))
    axes.add_patch(Circle((x, y), 0.08, facecolor="white", edgecolor=INK, linewidth=1.1, zorder=4))
    for turn in (0.25, 0.25 + 1 / 3, 0.25 + 2 / 3):
        planet = (x + 0.16 * np.cos(2 * np.pi * turn), y + 0.16 * np.sin(2 * np.pi * turn))
        axes.add_patch(Circle(planet, 0.08, facecolor="white", edgecolor=INK, linewidth=1.1, zorder=4))


def dynamometer_symbol(axes: Axes, x: float, y: float, half: float, colour: str) -> None:
    """The housing of a dynamometer round its rotor."""
    wide, high = DISC_WIDTH / 2 + 0.2, half + 0.12
    axes.add_patch(
        FancyBboxPatch(
            (x - wide, y - high), 2 * wide, 2 * high, boxstyle="round,pad=0.02,rounding_size=0.1",
            facecolor="white", edgecolor=colour, linewidth=1.6, zorder=1,
        )
    )  # fmt: skip


def cut(axes: Axes, x: float, y: float, colour: str) -> None:
    """The cut through a shaft."""
    axes.plot([x, x], [y - 0.36, y + 0.36], color=colour, linewidth=1.8, linestyle=(0, (4, 2)), zorder=5)


# --- Drivetrain

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


def drawing(
    system: System, emphasis: Emphasis | None = None, largest: float | None = None,
    lines: Mapping[str, Sequence[str]] | None = None, shifts: Mapping[str, Shift] | None = None,
) -> Drawing:  # fmt: skip
    """Lay out a drivetrain to be drawn.

    Parameters
    ----------
    largest : float, optional
        Inertia of the tallest disc, kg·m²; default the system's largest.
    lines : mapping, optional
        Further lines below parts.
    shifts : mapping, optional
        By how much inertias were moved.
    """
    notes = _notes(system)
    for part, more in (lines or {}).items():
        notes[part] = [*more, *notes.get(part, [])]
    most = max((len(lines) for lines in notes.values()), default=0)
    largest = largest or max(part.J.value for part in system.inertias)
    emphasis = emphasis or Emphasis()
    lane, column = LANE + LINE_HEIGHT * most, _column(system, emphasis, notes)
    return Drawing(system, layout(system, shifts), emphasis, notes, lane, largest, column)


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
        with _as_part(axes, f"{joint.table}.{joint.name}"):
            _joint(axes, drawn, joint)
    for part in drawn.system.inertias:
        with _as_part(axes, f"inertias.{part.name}"):
            _inertia(axes, drawn, part.name)
    axes.set_xlim(-1.0, drawn.width - 1.0)
    axes.set_ylim(TOP - drawn.height, TOP)
    axes.set_aspect("equal")
    axes.set_axis_off()


@contextmanager
def _as_part(axes: Axes, part: str) -> Iterator[None]:
    """What is drawn within is a group of this name in an SVG."""
    before = set(axes.get_children())
    yield
    for artist in set(axes.get_children()) - before:
        artist.set_gid(part)


def _notes(system: System) -> dict[str, list[str]]:
    """Lines below every component: torques that act, sensors, effects."""
    notes: dict[str, list[str]] = {}
    of_box = {name: f"gearboxes.{box.name}" for box in system.gearboxes for name in box.capacities}
    for source in system.inputs:
        named = spaced(source.name) + (" (pedal)" if source.name in system.pedals else "")
        notes.setdefault(of_box.get(source.name, f"inertias.{source.on}"), []).append(f"{ARROW} {named}")
    for sensor in system.sensors:
        table = "shafts" if sensor.measures == "torque" else "inertias"
        notes.setdefault(f"{table}.{sensor.of}", []).append(f"{LETTERS[sensor.measures]}: {spaced(sensor.name)}")
    on_what = {f"inputs.{part.name}": of_box.get(part.name, f"inertias.{part.on}") for part in system.inputs} | {
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
        dynamometer_symbol(axes, x, y, half, RIG)
    disc(axes, x, y, half, emphasis.colours.get(name, HARDWARE), emulated=name in emphasis.emulated)
    above = spaced(name)
    if name in emphasis.machines:
        machine = spaced(emphasis.machines[name])
        above += f"\n({machine})" if "dynamometer" in machine else f"\n(dynamometer {machine})"
    _text(axes, x, y + half + 0.18, above, va="bottom", weight="bold")
    lines = [amount(part.J.value, "kg*m^2"), *drawn.notes.get(f"inertias.{name}", [])]
    _text(axes, x, y - half - 0.18, "\n".join(lines), va="top")


def _joint(axes: Axes, drawn: Drawing, joint: Joint) -> None:
    x, y = drawn.place(joint.near)
    if joint.divides:
        middle = x + ELBOW + 0.3
        line(axes, (x, y), (middle, y))
        for end in joint.far:
            to_x, to_y = drawn.place(end)
            line(axes, (middle, y), (middle, to_y), (to_x, to_y))
        (differential if joint.table == "differentials" else planetary_gear)(axes, middle, y)
        beside = middle + 0.3 + LETTER * len(joint.name) / 2  # between the branches
        _text(axes, beside, y - 0.07, spaced(joint.name), va="bottom")
        return
    (end,) = joint.far
    (to_x, to_y), across = drawn.place(end), -drawn.lane * joint.lane
    geared = joint.table == "shafts" and drawn.is_geared(joint.name)
    centre = x + drawn.column / 2 + (0.25 if geared else 0.12 if y != to_y else 0.0)
    reach = ELEMENT / 2 if joint.table == "shafts" else 0.0
    turn = x + ELBOW
    line(axes, (x, y), (turn, y), (turn, across), (centre - reach, across))
    back = [] if across == to_y else [(to_x - ELBOW, across), (to_x - ELBOW, to_y)]
    line(axes, (centre + reach, across), *back, (to_x, to_y))
    draw_joint = {"shafts": _shaft, "gears": _gear, "gearboxes": _gearbox}[joint.table]
    draw_joint(axes, drawn, joint.name, centre, across)
    if joint.name in drawn.emphasis.cuts and joint.table == "shafts":
        behind = drawn.place(drawn.emphasis.cuts[joint.name])[0]
        cut(axes, behind + (-CUT if behind >= to_x else CUT), across, RIG)


def _shaft(axes: Axes, drawn: Drawing, name: str, x: float, y: float) -> None:
    part = next(part for part in drawn.system.shafts if part.name == name)
    spring_and_damper(axes, x, y, damped=part.damping.value > 0)
    if drawn.is_geared(name):
        gear_pair(axes, x - ELEMENT / 2 - 0.28, y)
    _text(axes, x, y + 0.32, spaced(name), va="bottom")
    lines = [amount(part.stiffness.value, "N*m/rad")]
    lines += [] if part.ratio is None else [f"i = {number(part.ratio.value)}"]
    _text(axes, x, y - 0.32, "\n".join([*lines, *drawn.notes.get(f"shafts.{name}", [])]), va="top")


def _gear(axes: Axes, drawn: Drawing, name: str, x: float, y: float) -> None:
    part = next(part for part in drawn.system.gears if part.name == name)
    gear_pair(axes, x, y)
    _text(axes, x, y + 0.32, spaced(name), va="bottom")
    _text(axes, x, y - 0.32, f"i = {number(part.ratio.value)}", va="top")


def _gearbox(axes: Axes, drawn: Drawing, name: str, x: float, y: float) -> None:
    part = next(part for part in drawn.system.gearboxes if part.name == name)
    clutch(axes, x - 0.22, y)
    gear_pair(axes, x + 0.14, y)
    _text(axes, x, y + 0.32, spaced(name), va="bottom")
    ratios = "i = " + ", ".join(number(ratio.value) for ratio in part.ratios)
    kind = ["converter"] if part.converter else [] if part.engages_below is None else ["dog clutches"]
    _text(axes, x, y - 0.32, "\n".join([ratios, *kind, *drawn.notes.get(f"gearboxes.{name}", [])]), va="top")


def _text(axes: Axes, x: float, y: float, text: str, va: str, weight: str = "normal") -> None:
    colour = INK if weight == "bold" else LIMIT
    axes.text(
        x, y, text, ha="center", va=va, fontsize=TEXT_POINTS, color=colour, weight=weight, linespacing=1.1,
        parse_math=False, zorder=6,
    )  # fmt: skip


# --- Drawings of a model, and of a case with the vehicle above its rig and the cut marked in both.

INCHES = 0.62  # of a unit of the drawing
NARROWEST_INCHES = 4.5  # with room for the legend
TITLE_POINTS = 9.0
POINTS_AN_INCH = 72.0
LETTER_WIDTH = 0.62  # of the height of a title's letters, on average
LEGEND = "height of a disc ~ J^(1/4), as of discs of one thickness; ↻ torque input; φ ω α M sensor; + effect"

CASE_LEGEND = (
    "dashed: the cut; hatched: residual vehicle, emulated by the dynamometers; grey: hardware that both have; "
)


def model_figure(system: System) -> Figure:
    """The drivetrain of a model."""
    return _figure([(system.title, "#222222", drawing(system))])


def case_figure(case: Case) -> Figure:
    """Vehicle above rig: shared hardware in grey, what only one has in its colour, what is emulated hatched."""
    vehicle, rig = case_drawings(case)
    return _figure(
        [
            (f"Vehicle: {case.vehicle.title}", VEHICLE, vehicle),
            (f"Rig: {case.rig.title}", RIG, rig),
        ],
        CASE_LEGEND,
    )


def noted_figure(case: Case, of_vehicle: Mapping[str, Sequence[str]], of_rig: Mapping[str, Sequence[str]]) -> Figure:
    """Vehicle above rig with lines at their parts, by ``shafts.NAME``; a system without any line is left out."""
    titles = f"Vehicle: {case.vehicle.title}", f"Rig: {case.rig.title}"
    shown = []
    for drawn, notes, title, colour in zip(
        case_drawings(case, of_vehicle, of_rig), (of_vehicle, of_rig), titles, (VEHICLE, RIG), strict=True
    ):
        if notes:
            shown.append((title, colour, drawn))
    return _figure(shown, CASE_LEGEND)


def case_drawings(
    case: Case, of_vehicle: Mapping[str, Sequence[str]] | None = None, of_rig: Mapping[str, Sequence[str]] | None = None
) -> tuple[Drawing, Drawing]:  # fmt: skip
    """Vehicle and rig laid out, with what the case says of them, and with further lines by part."""
    vehicle, rig = ({part.name for part in system.inertias} for system in (case.vehicle, case.rig))
    interfaces = case.residual_vehicle.interfaces
    rotors = {source.name: source.on for source in case.rig.inputs}
    machines = {rotors[machine.torque_input]: machine.name for machine in case.loop.dynamometers}
    vehicle_look = Emphasis(
        dict.fromkeys(vehicle - rig, VEHICLE),
        frozenset(vehicle - rig),
        cuts={interface.shaft: interface.vehicle_end for interface in interfaces},
    )
    rig_look = Emphasis(
        dict.fromkeys(rig - vehicle, RIG),
        machines=machines,
        cuts={interface.shaft: interface.rig_end for interface in interfaces},
    )
    largest = max(part.J.value for system in (case.vehicle, case.rig) for part in system.inertias)
    both = drawing(case.vehicle, vehicle_look, largest, of_vehicle), drawing(case.rig, rig_look, largest, of_rig)
    column = max(drawn.column for drawn in both)  # parts of both stand below each other
    return replace(both[0], column=column), replace(both[1], column=column)


def _figure(drawings: list[tuple[str, str, Drawing]], legend: str | None = "") -> Figure:
    """Drawings with their titles below each other, and a legend unless it is None."""
    width = max(drawn.width for _, _, drawn in drawings)
    heights = [drawn.height for _, _, drawn in drawings]
    with styled():
        inches = max(INCHES * width, NARROWEST_INCHES)
        letters = int(inches * POINTS_AN_INCH / (TITLE_POINTS * LETTER_WIDTH))
        titles = [textwrap.fill(title, letters, break_on_hyphens=False) for title, _, _ in drawings]
        lines = sum(1 + title.count("\n") for title in titles)
        fig = figure(inches, INCHES * (sum(heights) + (0.0 if legend is None else 0.6)) + 0.25 * lines)
        beside = (inches / INCHES - width) / 2  # of a drawing narrower than the figure
        rows = fig.subplots(len(drawings), 1, squeeze=False, height_ratios=heights)[:, 0]
        for axes, title, (_, colour, drawn) in zip(rows, titles, drawings, strict=True):
            draw(axes, drawn)
            axes.set_xlim(-1.0 - beside, width - 1.0 + beside)
            axes.set_title(title, loc="left", color=colour, fontsize=TITLE_POINTS, parse_math=False)
        if legend is not None:
            fig.supxlabel(legend + LEGEND, fontsize=6, color="#555555", parse_math=False, wrap=True)
    return fig


# --- A drawing on a page where its parts react: its SVG, and of every part where it stands and what marks it.

AROUND = 4.0  # points between a part and the frame that marks it
WORDS = {
    "inertias": "inertia", "shafts": "shaft", "gears": "gear", "gearboxes": "gearbox", "differentials": "differential",
    "planetary_gears": "planetary gear",
}  # fmt: skip
LARGEST_OPACITY = 0.6  # of the colour for energy, so that texts on it stay readable
LEAST_SHARE = 0.005  # of the energy, below which a part is not coloured


@dataclass(frozen=True)
class Sketch:
    """A drivetrain as SVG, in which the groups of a part have its name (``shafts.link``) as ``id``.

    Attributes
    ----------
    drawing : Drawing
    svg : str
    boxes : dict of str to tuple
        Left, upper, right and lower end of every part, in points from the upper left corner.
    discs : dict of str to tuple
        Centre x, y and half the height of every inertia, in points.
    """

    drawing: Drawing
    svg: str
    boxes: dict[str, tuple[float, float, float, float]]
    discs: dict[str, tuple[float, float, float]]


def sketch(drawn: Drawing) -> Sketch:
    """Draw a drivetrain for a page."""
    fig = _figure([("", INK, drawn)], None)
    svg = without_head(image(fig))
    (axes,), scale, height = fig.axes, POINTS_AN_INCH / fig.dpi, POINTS_AN_INCH * fig.get_figheight()
    extents, renderer = dict[str, list[Bbox]](), fig.canvas.get_renderer()  # type: ignore[attr-defined]  # of Agg
    for artist in (*axes.patches, *axes.texts):  # lines reach into the neighbours
        if name := artist.get_gid():
            extents.setdefault(name, []).append(artist.get_window_extent(renderer))
    ends = {name: scale * Bbox.union(each).get_points() for name, each in extents.items()}
    boxes = {name: (left, height - high, right, height - low) for name, ((left, low), (right, high)) in ends.items()}
    discs = {}
    for part in drawn.system.inertias:
        x, y = drawn.place(part.name)
        (left, low), (_, high) = axes.transData.transform([(x, y), (x, y + drawn.half(part.name))])
        discs[f"inertias.{part.name}"] = (scale * left, height - scale * low, scale * (high - low))
    return Sketch(drawn, svg, boxes, discs)


def marks(
    drawn: Sketch, selected: str = "", changed: Collection[str] = (), mode: Mode | None = None
) -> dict[str, dict[str, Any]]:
    """How a page marks every part.

    Parameters
    ----------
    drawn : Sketch
    selected : str
        Part that is edited.
    changed : collection of str
        Parts that differ from the file.
    mode : Mode, optional
        Its energy shares colour the parts, and its shape swings.

    Returns
    -------
    dict of str to dict
        By part: ``box`` (x, y, width, height in points), ``words`` for who does not see the drawing, ``class``,
        ``heat`` (a colour), and of an inertia in a mode ``swing`` (x, y, half the height, real and imaginary
        amplitude).
    """
    found: dict[str, dict[str, Any]] = {}
    largest = max(map(abs, mode.shape.values()), default=0.0) or 1.0 if mode else 1.0
    for name, (left, upper, right, lower) in drawn.boxes.items():
        share = _energy(mode, name) if mode else 0.0
        heat = f"rgba(230,159,0,{min(LARGEST_OPACITY, 0.1 + share):.2f})" if share > LEAST_SHARE else "transparent"
        found[name] = {
            "box": [left - AROUND, upper - AROUND, right - left + 2 * AROUND, lower - upper + 2 * AROUND],
            "words": _words(drawn.drawing.system, name, share), "heat": heat,
            "class": " ".join(["part", *["changed"] * (name in changed), *["selected"] * (name == selected)]),
        }  # fmt: skip
        if mode and name in drawn.discs:
            amplitude = complex(mode.shape.get(name, 0.0)) / largest
            found[name]["swing"] = [*drawn.discs[name], amplitude.real, amplitude.imag]
    return found


def _energy(mode: Mode, part: str) -> float:
    """Share of a part in the kinetic or potential energy of a mode, those of its effects included."""
    shares = mode.kinetic if part.startswith("inertias.") else mode.potential
    return sum(share for name, share in shares.items() if name == part or name.startswith(f"{part}."))


def _words(system: System, name: str, share: float) -> str:
    """What a reader who does not see the drawing is told of a part."""
    table, _, part = name.partition(".")
    amounts = [f"{key} {amount(own.value, quantity_unit(key))}" for key, own in quantities(system[name]).items()]
    energy = [f"{100 * share:.0f} % of the energy"] if share > LEAST_SHARE else []
    return ", ".join([f"{WORDS[table]} {spaced(part)}", *amounts, *energy])


# --- Models and cases in a notebook: their drawing; of a model its equations below.

_DRAWING = "<p><img alt='{{ title }}' src='{{ picture }}' style='max-width:100%'></p>"


@display.plot.register
def plot_system(system: System) -> Figure:
    """The drivetrain."""
    return model_figure(system)


@display.plot.register
def plot_case(case: Case) -> Figure:
    """Vehicle above rig with the cut."""
    return case_figure(case)


@display.html.register
def system_html(system: System) -> str:
    """Title, drivetrain and equations; without the drawing where there are too many inertias."""
    equations = lagrange.html(derive(system), system)
    if len(system.inertias) > MOST_INERTIAS:
        return equations
    heading, end, rest = equations.rpartition("</h4>")
    return heading + end + _drawn(model_figure(system), system.title or "drivetrain") + rest


@display.html.register
def case_html(case: Case) -> str:
    """Vehicle above rig; the title where one of them is too long to be drawn."""
    title = case.title or "case"
    if max(len(system.inertias) for system in (case.vehicle, case.rig)) > MOST_INERTIAS:
        return environment().from_string("<p>{{ title }}</p>").render(title=title)
    return _drawn(case_figure(case), title)


def _drawn(figure: Figure, title: str) -> str:
    """Everything of the user's stands in a picture or is escaped."""
    return environment().from_string(_DRAWING).render(title=title, picture=embedded(image(figure)))
