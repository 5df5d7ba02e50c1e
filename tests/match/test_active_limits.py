"""Quantities with little energy in the targets are released where a limit needs them; a case at its optimum says so."""

from dataclasses import replace

import pytest
from match import drawn

from matching.match.attempt import needed_for_more, needed_to_keep
from matching.match.case import apply, demands
from matching.match.case_file import load_case
from matching.match.in_time import TruthInTime
from matching.match.match import NOTHING_MOVED, match
from matching.report.match import content

FLANGE = "rig.shafts.flange.stiffness"
TWIST = "shafts.flange.twist"
STIFF = 4e6  # N·m/rad: next to no energy in the flange
NOT_ASKED = TruthInTime(not_simulated="not asked here")
MATCHED = {  # where a match of the case below ends, rounded
    "loop.proportional_gain": 43.0, "loop.integral_gain": 1.0, "loop.torque_feed_forward": 0.5495,
    "loop.acceleration_feed_forward": 0.0, "residual_vehicle.inertias.body.J": 65.0, "rig.inertias.adapter.J": 0.15,
}  # fmt: skip


@pytest.fixture
def stiff(tmp_path):
    """One dynamometer on a stiff flange, and its largest twist over the manoeuvre, rad."""
    drawn.draw(2, tmp_path)
    rig, case = tmp_path / "rig.toml", tmp_path / "case.toml"
    head, flange = rig.read_text().split("[shafts.flange]")
    lines = [f"stiffness = {STIFF:g}" if line.startswith("stiffness") else line for line in flange.splitlines()]
    rig.write_text("\n".join([f"{head}[shafts.flange]", *lines]))
    case.write_text(case.read_text() + f'"{FLANGE}" = {{ lower = 1e6, upper = 8e6 }}\n')
    own = load_case(case)
    (chain,) = demands(own).chains
    before = sum(own.rig.parameters[f"inertias.{name}.J"].value for name in chain.shafts[0][1])
    return own, chain.peak(chain.shafts[0][1], before) / STIFF


def limited_to(case, twist):
    return replace(case, limits={**case.limits, TWIST: twist})


@pytest.mark.long
def test_a_limit_that_binds_releases_a_quantity(stiff):
    """Adapter inertia changes the flange's torque by some percent; 0.7 of the twist takes a stiffer flange."""
    case, twist = stiff
    tight = limited_to(case, 0.7 * twist)
    result = match(tight, starts=1)
    assert result.status == "matched"
    assert NOTHING_MOVED not in result.notes
    (own,) = (part for part in result.parameters if part.name == FLANGE)
    assert own.share < 0.01
    assert not own.fixed
    assert own.tuned > 1.3 * STIFF
    assert (
        demands(tight).broken({f"rig.{name}": part.value for name, part in result.tuned.rig.parameters.items()}) == []
    )
    assert any(FLANGE in note and TWIST in note for note in result.notes)
    (body,) = (part for part in result.parameters if part.name == "residual_vehicle.inertias.body.J")
    named = f"is a compensation, not the car: inertias.body.J {body.tuned / body.start - 1:+.1%} "
    assert any(named in note for note in result.notes)

    held = replace(tight, moves=tuple(move for move in tight.moves if move.name != FLANGE))
    beyond = match(held, starts=1)
    assert beyond.status == "limited"
    assert "a twist in flange" in beyond.limits[0]


def test_what_is_released(stiff):
    case, twist = stiff
    free = [move for move in case.moves if move.name != FLANGE]
    rest = [move for move in free if not move.name.startswith("rig.")]
    for part, loose, bound in ((0.5, [FLANGE], [FLANGE]), (1.0005, [], [FLANGE]), (1.01, [], [])):
        own = limited_to(case, part * twist)
        assert list(needed_to_keep(own, free, demands(own))) == loose
        assert list(needed_for_more(own, free, demands(own), own)) == bound
    own = limited_to(case, 0.9 * twist)
    assert FLANGE in needed_to_keep(own, rest, demands(own))  # nothing free that the limit depends on


def test_nothing_had_to_move(stiff):
    case, _ = stiff
    (flange,) = (move for move in case.moves if move.name == FLANGE)
    result = match(replace(apply(case, MATCHED), moves=(flange,)), starts=1)
    assert result.status == "matched"
    assert result.notes[0] == NOTHING_MOVED
    assert NOTHING_MOVED in content(replace(result, simulated_in_time=NOT_ASKED))["notes"]
