"""Where the inertias of a drivetrain stand on paper: a tree from one end, branches in lanes of their own."""

from __future__ import annotations

from dataclasses import dataclass

from modelling.common.errors import InputError
from modelling.model.system import System

MOST_INERTIAS = 80  # more are no drawing any more


@dataclass(frozen=True)
class Joint:
    """A shaft, gear or differential: its table and name, the end nearer to the root, and the other ends."""

    table: str
    name: str
    near: str
    far: tuple[str, ...]


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
        return max(self.lane.values()) + 1


def layout(system: System) -> Layout:
    """Lay a drivetrain out, from the first inertia in the file that is an end of it; parts that stand apart below.

    Raises
    ------
    InputError
        If it has too many inertias to be drawn.
    """
    if len(system.inertias) > MOST_INERTIAS:
        raise InputError(
            "inertias", f"{len(system.inertias)} are too many for a drawing", f"at most {MOST_INERTIAS} are drawn"
        )
    connections = _connections(system)
    meeting: dict[str, list[int]] = {part.name: [] for part in system.inertias}
    for number, (_, _, ends) in enumerate(connections):
        for end in ends:
            meeting[end].append(number)
    column, children, order, joints = dict[str, int](), dict[str, list[str]](), list[str](), list[Joint]()
    roots: list[str] = []
    while len(column) < len(system.inertias):
        left = [part.name for part in system.inertias if part.name not in column]
        root = next((name for name in left if len(meeting[name]) <= 1), left[0])
        roots.append(root)
        column[root], children[root] = 0, []
        drawn: set[int] = set()
        reached = [root]
        for name in reached:  # grows while it is worked through
            for number in meeting[name]:
                if number in drawn:
                    continue
                drawn.add(number)
                table, joint, ends = connections[number]
                far = tuple(end for end in ends if end != name)
                joints.append(Joint(table, joint, name, far))
                for end in far:
                    if end not in column:
                        column[end], children[end] = column[name] + 1, []
                        children[name].append(end)
                        reached.append(end)
        order += reached
    return Layout(column, _lanes(roots, children, order), tuple(joints))


def _connections(system: System) -> list[tuple[str, str, tuple[str, ...]]]:
    connections = [("shafts", part.name, tuple(part.between)) for part in system.shafts]
    connections += [("gears", part.name, tuple(part.between)) for part in system.gears]
    return connections + [
        ("differentials", part.name, (part.cage, part.left, part.right)) for part in system.differentials
    ]


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
