"""Where the inertias of a drivetrain stand on paper: a tree from one end, branches in lanes of their own.

Where branches meet again (two wheels that carry one body), the inertia stands behind all of them and in their middle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from modelling.common.errors import InputError
from modelling.model.system import System

MOST_INERTIAS = 80  # more are no drawing any more


@dataclass(frozen=True)
class Joint:
    """A shaft, gear or differential: its table and name, the end nearer to the root, the other ends, and its lane.

    A differential has no lane of its own: it stands in that of its near end.
    """

    table: str
    name: str
    near: str
    far: tuple[str, ...]
    lane: float = 0.0


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
    tree = _grown(system)
    _put_behind(tree)
    lane = _lanes(tree.roots, tree.children, tree.order)
    return _with_lanes(tree, lane)


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
        its_lane = lane[joint.near if joint.table == "differentials" else joint.far[0]]
        if joint in tree.again and joint.table != "differentials":
            its_lane = lane[joint.near]
            if joint.near in busy:
                its_lane, following = following, following + 1
            busy.add(joint.near)
        elif ends.intersection(joint.far):
            busy.add(joint.near)
        placed.append(replace(joint, lane=its_lane))
    column, lane = dict(tree.column), dict(lane)
    for name in ends:
        arriving = [joint.lane for joint in placed if name in joint.far and joint.table != "differentials"]
        lane[name] = (min(arriving) + max(arriving)) / 2 if arriving else lane[name]
        while any(
            column[name] == column[other] and abs(lane[name] - lane[other]) < 1 for other in lane if other != name
        ):
            column[name] += 1
    return Layout(column, lane, tuple(placed))


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
