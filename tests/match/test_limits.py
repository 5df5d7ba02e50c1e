"""Where it cannot be done, the answer says what binds and by how much to relax it."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from match import drawn
from match.conftest import LITTLE

from matching.match import limits
from matching.match.case import Target
from matching.match.case_file import load_case
from matching.match.demands import BehindCut, CutMotion, Demands, demands
from matching.match.match import match
from matching.match.problem import infeasible_limits, long_sample
from matching.match.requirements import read_limits, requirements
from modelling.bed.controllers import STRUCTURES
from modelling.errors import InputError
from modelling.topology import Joint

OBSERVER = Path(__file__).parents[2] / "examples" / "road_to_rig" / "observer.toml"
FEW = replace(LITTLE, drawn=3, steps=4, blind=8)  # what binds does not depend on more beds


def with_loop(case, structure, **values):
    return replace(case, loop=replace(case.loop, structure=STRUCTURES[structure]).with_values(values))


@pytest.fixture
def small(tmp_path):
    """One dynamometer, model-based, 12 ms: a case that is matched."""
    return load_case(drawn.draw(2, tmp_path))


@pytest.mark.long
def test_dead_time_of_20_ms_with_feedback_alone(small):
    result = match(with_loop(small, "pi", dead_time=0.02), starts=1, settings=FEW)
    assert result.status == "limited"
    told = " ".join(result.limits)
    angle = 360 * 0.02 * result.targets[0].vehicle
    blamed = f"dead time 20 ms leaves {angle:.0f}° at {result.targets[0].vehicle:.2f} Hz" in told
    assert blamed == bool(re.search(r"solved with [\d.]+ ms, every target is met", told))
    assert blamed or "solved with one sample, 0.5 ms, the targets are not met either" in told
    assert result.verification.stable  # what misses its targets can still be run


@pytest.mark.long
def test_bounds_out_of_reach(small):
    """Emulated body far too light and nearly no loop: not matched, each missed target with its figures."""
    body = next(move for move in small.moves if "body" in move.name)
    gain = next(move for move in small.moves if "proportional" in move.name)
    moves = (replace(body, lower=1.0, upper=2.0, start=1.5), replace(gain, lower=1.0, upper=2.0, start=1.0))
    result = match(replace(with_loop(small, "pi"), moves=moves), starts=1, settings=FEW)
    assert result.status == "limited"
    assert f"({result.targets[0].vehicle:.3f} Hz" in " ".join(result.limits)


@pytest.fixture(scope="module")
def too_small(tmp_path_factory):
    """A case whose dynamometer has a tenth of the torque that it needs, and its match."""
    small = load_case(drawn.draw(2, tmp_path_factory.mktemp("too_small")))
    case = replace(small, limits={**small.limits, "dynamometer_torque": 100.0})
    return case, match(case, starts=1, settings=FEW)


def test_dynamometer_too_small(too_small):
    case, result = too_small
    ((_, limit, demand, allowed),) = infeasible_limits(case, case.moves, demands(case))
    assert limit == "dynamometer_torque"
    assert allowed == 100
    adapter = next(move for move in case.moves if "adapter" in move.name)
    for inertia in (adapter.lower, adapter.upper):  # no adapter within the bounds asks for less
        rig = {name: own.value for name, own in case.rig.parameters.items()} | {"inertias.adapter.J": inertia}
        asked = demands(case).broken({f"rig.{name}": value for name, value in rig.items()})
        assert asked[0][2] >= demand * (1 - 1e-6)

    assert result.status == "limited"
    first = result.limits[0]
    assert "a torque at dynamometer dyno" in first
    assert (
        f"solved with {1.02 * demand:.4g} N·m, {1.02 * demand / 100:.2f} times as large, every target is met" in first
    )
    assert "of what it is" not in first  # a smaller manoeuvre was not solved
    assert result.verification.stable

    enough = replace(case, limits={**case.limits, "dynamometer_torque": 1.05 * demand})
    assert infeasible_limits(enough, enough.moves, demands(enough)) == []


def test_the_rest_is_kept_where_the_dynamometer_is_too_small(too_small):
    """A loop with its margin, not where the search began."""
    case, result = too_small
    assert result.verification.modulus_margin >= case.limits["modulus_margin"]


@pytest.mark.parametrize("inertia", [None, 7.0])
def test_what_mechanics_alone_would_take_names_both_ways_or_that_one_is_none(inertia, monkeypatch):
    """A flange of 2000 N·m/rad that would have to be ten times softer under 100 N·m: half a radian."""
    monkeypatch.setattr(limits, "_needed", lambda case, names, *_: 0.1 if names[0].startswith("shafts") else inertia)
    values = {"shafts.flange.stiffness": 2000.0, "inertias.adapter.J": 0.4, "inertias.rotor.J": 0.1}
    parameters = {name: SimpleNamespace(value=value) for name, value in values.items()}
    rig = SimpleNamespace(parameters=parameters, dimensions={})
    motion = CutMotion("adapter", np.array([-100.0, 40.0]), np.zeros(2), np.zeros(2))
    flange = Joint("shafts.flange", ("adapter", "rotor"))
    part = BehindCut(("adapter", "rotor"), (flange,), (motion,), {"left": "rotor"})
    moves, loop = (SimpleNamespace(name="rig.shafts.flange.stiffness"),), SimpleNamespace(tunes_observer=False)
    case = SimpleNamespace(moves=moves, targets=(Target(2),), limits={}, rig=rig, loop=loop)
    question = SimpleNamespace(case=case, on_rig=["mode"], demands=Demands((part,), {}))
    (found,) = limits._mechanics(question, [SimpleNamespace(vehicle_mode=2, vehicle=5.0)])
    said = found.sentence()
    assert "200 N·m/rad in flange, which twists 29° (0.1 turns) at 100 N·m" in said
    assert ("no inertia behind the cuts, however large, does it alone" in said) == (inertia is None)
    assert ("or 7 times the inertia behind each cut, 3.5 kg·m² instead of 0.5" in said) == (inertia is not None)


def test_a_sample_that_is_longer_than_the_shortest_dead_time_is_said():
    case = load_case(OBSERVER)
    assert long_sample(case) == []
    (first, *others), slow = case.loop.dynamometers, case.loop.with_values({"sample_time": 0.002})
    assert long_sample(replace(case, loop=slow)) == []
    fast = replace(slow, dynamometers=(replace(first, dead_time=0.001), *others))
    (said,) = long_sample(replace(case, loop=fast))
    assert "2 ms, is longer than the dead time, 1 ms" in said


def test_opened_shafts_are_asked_for_unless_they_are_waived():
    case = load_case(OBSERVER)
    for stated, asked in (({}, True), ({"opened_shafts": False}, False), ({"opened_shafts": True}, True)):
        limits_read, _ = read_limits({"limits": stated}, case.rig, "case.toml")
        assert requirements(replace(case, limits=limits_read)).opened_shafts == asked
    feedback = replace(case, loop=replace(case.loop, structure=STRUCTURES["pi"]))
    assert not requirements(feedback).opened_shafts
    with pytest.raises(InputError, match=r"no yes or no.*true or false"):
        read_limits({"limits": {"opened_shafts": 1}}, case.rig, "case.toml")
