"""The graph of a drivetrain: ratios against the kinematic equations, parts, paths and sides on drawn structures."""

import numpy as np
import pytest

from modelling.system import Differential, Gear, Inertia, Input, Quantity, Shaft, System
from modelling.topology import connected_parts, joints, path, side, speed_ratios


def drawn_tree(seed):
    """A tree of shafts, gears and differentials under names in a drawn order, with drawn ratios of either sign."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(4, 14))
    names = [f"i{k}" for k in rng.permutation(count + 2)]
    shafts, gears, differentials, known = [], [], [], [names.pop()]
    while names:
        at, ratio = known[rng.integers(len(known))], float(rng.choice([-1, 1]) * rng.uniform(0.3, 9.0))
        kind = rng.integers(3) if len(names) > 1 else rng.integers(2)
        new = names.pop()
        ends = (at, new) if rng.random() < 0.5 else (new, at)
        known.append(new)
        if kind == 0:
            ratio = Quantity(ratio) if rng.random() < 0.5 else None
            shafts.append(Shaft(f"s{len(shafts)}", ends, Quantity(1e3), ratio=ratio))
        elif kind == 1:
            gears.append(Gear(f"g{len(gears)}", ends, Quantity(ratio)))
        else:
            known.append(names.pop())
            cage, left, right = rng.permutation([at, new, known[-1]]).tolist()
            differentials.append(Differential(f"d{len(differentials)}", cage, left, right))
    inertias = tuple(Inertia(name, Quantity(1.0)) for name in known)
    return System(inertias, tuple(shafts), tuple(gears), tuple(differentials), (Input("t", known[0]),))


@pytest.mark.parametrize("seed", range(20))
def test_untwisted_motion_meets_every_equation_of_the_joints(seed):
    system = drawn_tree(seed)
    root = system.inertias[np.random.default_rng(seed).integers(len(system.inertias))].name
    speed = speed_ratios(root, joints(system))
    assert set(speed) == {part.name for part in system.inertias}
    assert speed[root] == 1
    for shaft in system.shafts:  # twist = angle(first)/ratio − angle(second)
        ratio = shaft.ratio.value if shaft.ratio else 1.0
        assert speed[shaft.between[0]] / ratio == pytest.approx(speed[shaft.between[1]], rel=1e-12)
    for gear in system.gears:
        assert speed[gear.between[0]] == pytest.approx(gear.ratio.value * speed[gear.between[1]], rel=1e-12)
    for part in system.differentials:
        assert speed[part.left] == pytest.approx(speed[part.right], rel=1e-12)
        assert 2 * speed[part.cage] == pytest.approx(speed[part.left] + speed[part.right], rel=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_a_joint_of_a_tree_divides_it_and_every_path_crosses_the_joints_between_its_sides(seed):
    system = drawn_tree(seed)
    every, names = joints(system), [part.name for part in system.inertias]
    assert [set(part) for part in connected_parts(names, every)] == [set(names)]
    for joint in every:
        rest = joints(system, without=(joint.place,))
        sides = [side(end, rest) for end in joint.ends]
        assert set().union(*sides) == set(names)
        assert sum(map(len, sides)) == len(names)
        assert sorted(map(sorted, sides)) == sorted(map(sorted, connected_parts(names, rest)))
        assert path(joint.ends[0], joint.ends[1], rest) is None
        way = path(names[0], names[-1], every)
        crosses = not any({names[0], names[-1]} <= one for one in sides)
        assert (joint in way) == crosses


def test_rigid_joints_decide_where_a_shaft_contradicts_them():
    system = System(
        tuple(Inertia(name, Quantity(1.0)) for name in ("a", "b", "c")),
        shafts=(Shaft("short_cut", ("a", "c"), Quantity(1e3)),),
        gears=(Gear("first", ("a", "b"), Quantity(2.0)), Gear("second", ("b", "c"), Quantity(3.0))),
    )
    assert speed_ratios("a", joints(system)) == {"a": 1.0, "b": 0.5, "c": pytest.approx(1 / 6)}


def test_inertias_outside_a_group_connect_nothing_in_it():
    system = System(
        tuple(Inertia(name, Quantity(1.0)) for name in ("a", "b", "c")),
        shafts=(Shaft("one", ("a", "b"), Quantity(1e3)), Shaft("two", ("b", "c"), Quantity(1e3))),
    )
    assert connected_parts(["c", "a"], joints(system)) == [["c"], ["a"]]
