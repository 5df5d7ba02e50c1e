"""One graph of a drivetrain: its joints, connected parts, ratios between inertias, paths, and the sides of a cut.

Everything that walks over shafts, gears and differentials asks this module. It reads the tables of a drivetrain only,
so that :mod:`modelling.system` can ask it as well.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

DIVIDING = ("differentials", "planetary_gears")  # tables of what divides a motion between two others
JOINTS = ("gears", *DIVIDING, "shafts")  # tables of what makes inertias turn together


class Tables(Protocol):
    """What is asked of a drivetrain: its tables of joints."""

    @property
    def shafts(self) -> Sequence[Any]:
        """With name, between and ratio, which may be None."""

    @property
    def gears(self) -> Sequence[Any]:
        """With name, between and ratio."""

    @property
    def differentials(self) -> Sequence[Any]:
        """With name and ends: cage, left and right."""

    @property
    def planetary_gears(self) -> Sequence[Any]:
        """With name and ends: carrier, sun and ring."""


@dataclass(frozen=True)
class Joint:
    """A shaft, a gear, a differential or a planetary gear.

    Attributes
    ----------
    place : str
        ``shafts.link``.
    ends : tuple of str
        First and second inertia; of a differential cage, left and right, of a planetary gear carrier, sun and ring.
    ratio : float
        Speed of the first end over that of every other end, where no shaft is twisted and no differential or planetary
        gear turns its members against each other.
    """

    place: str
    ends: tuple[str, ...]
    ratio: float = 1.0

    @property
    def rigid(self) -> bool:
        """Whether it couples speeds exactly: no shaft."""
        return not self.place.startswith("shafts.")

    @property
    def divides(self) -> bool:
        """Whether it divides a motion: a differential or a planetary gear."""
        return self.place.partition(".")[0] in DIVIDING

    def speed_per_speed(self, of: str, by: str) -> float:
        """Speed of one end where another turns by 1."""
        own, other = (1.0 if end == self.ends[0] else 1 / self.ratio for end in (of, by))
        return own / other


def joints(system: Tables, *tables: str, without: Collection[str] = ()) -> list[Joint]:
    """Joints of a drivetrain, of the ``tables`` named or of all; ``without`` are places that are left out."""
    every = [Joint(f"gears.{part.name}", part.between, part.ratio.value) for part in system.gears]
    every += [Joint(f"{table}.{part.name}", part.ends) for table in DIVIDING for part in getattr(system, table)]
    every += [
        Joint(f"shafts.{part.name}", part.between, 1.0 if part.ratio is None else part.ratio.value)
        for part in system.shafts
    ]
    return [
        joint for joint in every if joint.place.partition(".")[0] in (tables or JOINTS) and joint.place not in without
    ]


def connected_parts(inertias: Iterable[str], of: Iterable[Joint]) -> list[list[str]]:
    """Inertias in groups that joints connect, in the order given; other inertias connect nothing."""
    names = list(inertias)
    at = _joints_by_end(names, of)
    parts, found = [], set[str]()
    for name in names:
        if name not in found:
            part = _reached(name, at)
            found |= part
            parts.append([other for other in names if other in part] if len(part) > 1 else [name])
    return parts


def side(inertia: str, of: Iterable[Joint]) -> set[str]:
    """All inertias that joints connect to one, itself included: with a joint left out one side of the cut."""
    return _reached(inertia, _joints_by_end(None, of))


def speed_ratios(inertia: str, of: Iterable[Joint]) -> dict[str, float]:
    """Speed of every connected inertia where one turns by 1, no shaft twisted, differentials straight.

    Where several ways lead to an inertia and contradict each other, rigid joints come before shafts.
    """
    at = _joints_by_end(None, of)
    ratios: dict[str, float] = {}
    waiting = deque([(inertia, 1.0)])
    while waiting:
        name, ratio = waiting.popleft()
        if name in ratios:
            continue
        ratios[name] = ratio
        for joint in at.get(name, ()):
            found = [(end, ratio * joint.speed_per_speed(end, name)) for end in joint.ends if end not in ratios]
            (waiting.extendleft if joint.rigid else waiting.extend)(found)
    return ratios


def path(start: str, end: str, of: Iterable[Joint]) -> list[Joint] | None:
    """The joints on a shortest way from one inertia to another; None where nothing connects them."""
    at = _joints_by_end(None, of)
    ways: dict[str, list[Joint]] = {start: []}
    waiting = deque([start])
    while waiting:
        name = waiting.popleft()
        if name == end:
            return ways[name]
        for joint in at.get(name, ()):
            for other in joint.ends:
                if other not in ways:
                    ways[other] = [*ways[name], joint]
                    waiting.append(other)
    return None


def _joints_by_end(names: Iterable[str] | None, of: Iterable[Joint]) -> dict[str, list[Joint]]:
    """Joints at every inertia; with ``names`` only those inertias, with the ends among them."""
    known = None if names is None else set(names)
    at: dict[str, list[Joint]] = {}
    for joint in of:
        ends = joint.ends if known is None else tuple(end for end in joint.ends if end in known)
        inside = joint if len(ends) == len(joint.ends) else Joint(joint.place, ends)
        for end in ends:
            at.setdefault(end, []).append(inside)
    return at


def _reached(start: str, at: Mapping[str, list[Joint]]) -> set[str]:
    reached, todo = {start}, [start]
    while todo:
        new = {end for joint in at.get(todo.pop(), ()) for end in joint.ends} - reached
        reached |= new
        todo.extend(new)
    return reached
