"""Maps of the achievable error: axes, figure, command, and a small map of the reference case."""

import json
import math
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from match import drawn
from result_schema import check_schema

from matching.cli import main
from matching.match.case_file import load_case
from matching.match.findings import Finding
from matching.match.map import Axis, Map, Point, axis, held_at, improved_at, map_case, match_at, quantities
from matching.report.common import image
from matching.report.studies import map_figure
from modelling.errors import InputError

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "case.toml"
OBSERVER = CASE.with_name("observer.toml")
STIFFNESS = "rig.shafts.flange_left.stiffness"


@pytest.fixture(scope="module")
def case():
    return load_case(CASE)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """One dynamometer with feed-forward; only the two gains of the feedback move."""
    own = load_case(drawn.draw(2, tmp_path_factory.mktemp("drawn")))
    return replace(own, moves=tuple(move for move in own.moves if move.name.endswith("l_gain")))


def test_axes_take_bounds_units_and_numbers_of_values(case):
    given = axis(case, "loop.dead_time=1 ms:8 ms:4")
    np.testing.assert_allclose(given.values, [1e-3, 2e-3, 4e-3, 8e-3])  # so far apart, spread by ratio
    assert (given.here, given.unit) == (3e-3, "s")
    np.testing.assert_allclose(axis(case, "loop.dead_time=0.001:0.002:3").values, [1e-3, 1.5e-3, 2e-3])
    listed = axis(case, "loop.dead_time=0.5 ms,0.001,2 ms,3 ms,4 ms")
    assert listed.values == pytest.approx((5e-4, 1e-3, 2e-3, 3e-3, 4e-3))
    assert not listed.by_ratio  # as even as they come
    assert axis(case, f"{STIFFNESS}=2e4:2e6:9").by_ratio
    moved = axis(case, STIFFNESS)  # bounds of [move]
    assert (moved.values[0], moved.values[-1]) == pytest.approx((1e5, 4e5))
    other = axis(case, "rig.inertias.rotor_left.J")  # does not move: about what it is
    assert (other.values[0], other.values[-1]) == pytest.approx((0.895 / 3, 0.895 * 3))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("loop.dead_tim", "did you mean 'loop.dead_time'"),
        ("loop.dead_time=5 ms:2 ms", "empty range"),
        ("loop.dead_time=1e-3", "is no range"),
        ("loop.dead_time=1e-3:2e-3:1", "no number of values"),
        ("loop.dead_time=1e-3:2e-3:many", "no number of values"),
        ("loop.dead_time=1 ms,3 ms,2 ms", "no row of rising values"),
        ("loop.dead_time=1 ms,1 ms", "no row of rising values"),
        ("loop.dead_time=1 ms,", "is no quantity"),
        ("loop.dead_time=nan:1", "is not finite"),
        ("loop.dead_time=1 kg:2 kg", "does not fit"),
        ("loop.dead_time=-1:0.1", "not possible"),
        ("rig.inertias.adapter_left.J=0:1", "not possible"),
        ("rig.shafts.side_left.stiffness", "does not exist"),
    ],
)
def test_a_wrong_axis_is_one_line_and_nothing_is_written(text, says, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["map", str(CASE), "--x", text, "--y", STIFFNESS, "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "--x" in error
    assert says in error
    assert not out.exists()


def test_mirror_images_are_set_alike_and_stay(case):
    moved = held_at(case, STIFFNESS, 3e5)
    assert moved.rig.parameters["shafts.flange_right.stiffness"].value == 3e5
    assert STIFFNESS not in [move.name for move in moved.moves]
    assert len(moved.moves) == len(case.moves) - 1
    changed = held_at(held_at(case, "residual_vehicle.inertias.body_left.J", 80.0), "loop.dead_time", 0.005)
    assert [quantities(changed)[f"residual_vehicle.inertias.body_{side}.J"][0] for side in ("left", "right")] == [
        80,
        80,
    ]
    assert changed.vehicle == case.vehicle  # what the rig has to answer like does not move
    assert changed.loop["dead_time"] == 0.005
    with pytest.raises(InputError, match="does not exist"):
        held_at(case, "rig.inertias.motor.J", 1.0)
    only = replace(case, moves=tuple(move for move in case.moves if move.name == STIFFNESS))
    with pytest.raises(InputError, match="all that may move"):
        held_at(only, STIFFNESS, 2e5)


def test_beds_vary_about_the_values_of_the_map():
    """An observer needs no [move]; its beds are drawn about what the map holds, as if the files said so."""
    observed = load_case(OBSERVER)
    assert observed.moves == ()
    held = held_at(held_at(observed, STIFFNESS, 1e5), "loop.dead_time", 0.008)
    before, box = ({own.name: own for own in each.uncertainty.uncertain} for each in (observed, held))
    for side in ("left", "right"):
        flange = box[f"rig.shafts.flange_{side}.stiffness"]
        assert (flange.value, flange.half_width) == pytest.approx((1e5, 5e3))
    assert (box["loop.dead_time"].value, box["loop.dead_time"].half_width) == pytest.approx((0.008, 5e-4))
    moved = {"rig.shafts.flange_left.stiffness", "rig.shafts.flange_right.stiffness", "loop.dead_time"}
    assert {name for name in box if box[name] != before[name]} == moved


def test_the_share_of_stable_beds_has_a_panel_where_beds_judge(case):
    plain = drawn_up(case, (1e-3, 8e-3), (1e5, 2e5), lambda i, j: 0)
    shares = ((1.0, 0.995), (0.5, None))
    rows = zip(plain.points, shares, strict=True)
    judged = [[replace(p, stable_beds=s) for p, s in zip(*row, strict=True)] for row in rows]
    drawn = map_figure(replace(plain, points=tuple(map(tuple, judged))))
    panels = [own for own in drawn.axes if own.get_xlabel()]
    assert len(panels) == 3
    assert [text.get_text() for text in panels[2].texts] == ["100", "99.5", "50"]
    assert len([own for own in map_figure(plain).axes if own.get_xlabel()]) == 2


def test_a_point_of_an_observer_says_what_its_beds_do_not_keep(monkeypatch):
    """The match is made up; none of it is solved again from a neighbour, since its search has one start."""
    observed = load_case(OBSERVER)
    error = SimpleNamespace(after=0.02, unmeasured=0.4, bound=0.01)
    worst = SimpleNamespace(damping_ratio=0.01)
    beds = SimpleNamespace(stable=150, drawn=200, holds=False, worst=worst, measured=(0.05, 0.07), unmeasured=(0.3,),
                           opened={}, opened_alone={})  # fmt: skip
    verification = SimpleNamespace(stable=True, modulus_margin=0.5, violations=(), beds=beds)
    made = SimpleNamespace(
        case=observed, tuned=observed, status="limited", response_error=error, verification=verification, targets=(),
        robust=SimpleNamespace(beds=beds, required=SimpleNamespace(opened_shafts=True)), limits=("so",), objective=1.0,
        parameters=(), pairs=(),
        findings=(Finding("response_error", 0.4, 0.3), Finding("beds_not_stable", beds=(50, 200)),
                  Finding("worst_bed", 0.01, 0.02, limits=False)),
    )  # fmt: skip
    monkeypatch.setattr("matching.match.map.match", lambda *given, **options: made)
    places = ("loop.dead_time", 5e-3), (STIFFNESS, 1e5)
    point = match_at(observed, *places, 0, 1)
    assert (point.stable_beds, point.limited_by) == (0.75, ("response_error", "beds"))
    assert point.bed_error == pytest.approx(np.sqrt((0.6**2 + 1.0**2) / 2))  # medians over 0.1 and 0.3
    assert improved_at(observed, *places, None) is None
    beds.stable, beds.holds, error.unmeasured, made.findings = 200, True, 0.01, ()
    point = match_at(observed, *places, 0, 1)
    assert (point.stable_beds, point.limited_by) == (1.0, ())
    made.findings = (Finding("free_play", 9.0, 1.0, beds=(3, 30)),)
    assert match_at(observed, *places, 0, 1).limited_by == ("opened_shafts",)


def test_a_quantity_is_on_one_axis_only(case):
    with pytest.raises(InputError, match="both axes"):
        map_case(case, STIFFNESS, "rig.shafts.flange_right.stiffness")


KINDS = [
    ("matched", 0.01, ()),
    ("limited", 0.2, ("shafts.flange_left.twist", "targets")),
    ("limited", 2.0, ("stability",)),
]


def drawn_up(case, x, y, kind):
    """A map whose points are KINDS by a function of the place."""
    rows = []
    for i, b in enumerate(y):
        row = []
        for j, a in enumerate(x):
            status, error, names = KINDS[kind(i, j)]
            stable = names != ("stability",)
            row.append(Point(a, b, status, error * (1 + 0.1 * j), 3 * error, 0.01, stable, 0.5, (), limited_by=names))
        rows.append(tuple(row))
    axes = Axis("loop.dead_time", "s", tuple(x), case.loop["dead_time"]), Axis(STIFFNESS, "N*m/rad", tuple(y), 2e5)
    return Map("drawn up", (0.5, 30.0), *axes, tuple(rows))


def test_a_map_shows_its_errors_and_hatches_what_is_limited(case):
    found = drawn_up(case, (1e-3, 8e-3), (1e5, 2e5), lambda i, j: (i + j) % 3)
    drawn = map_figure(found)
    axes, other = (own for own in drawn.axes if own.get_xlabel())
    assert [patch.get_hatch() for patch in axes.patches] == ["//"] * 3
    assert [text.get_text() for text in axes.texts] == ["0.01", "0.22", "0.2", "2.2"]
    assert [text.get_text() for text in other.texts] == ["0.03", "0.6", "0.6", "6"]
    assert axes.get_xlabel() == "dead time in ms"
    assert axes.get_ylabel() == "flange left, stiffness in N·m/rad"
    assert [text.get_text() for text in drawn.legends[0].get_texts()] == ["limited", "the case as it is"]
    none = Point(1e-3, 1e5, "impossible", None, None, None, False, None, ("so",))
    nothing = replace(found, points=((none, none), (none, none)))
    assert image(map_figure(nothing), "png").startswith(b"\x89PNG")


@contextmanager
def in_this_process(workers=None, scheduler=None):
    """Instead of processes, which tests/studies has: their start takes longer than this map."""
    with ThreadPoolExecutor(1) as executor:
        yield executor


def test_command_draws_a_map(tmp_path, capsys, monkeypatch):
    """The points are made up here; real ones follow below and in tests/match/test_map_passes.py."""
    asked = []

    def match_at(case, x, y, seed, starts):
        asked.append((x, y, seed, starts))
        return Point(
            x[1], y[1], "matched", x[1] * y[1], 3.0, 0.01, True, 0.5, (), objective=1.0, first=1.0, stable_beds=1.0
        )

    monkeypatch.setattr("matching.worker_pool.executor_of", in_this_process)
    monkeypatch.setattr("matching.match.map.match_at", match_at)
    monkeypatch.setattr("matching.match.map.improved_at", lambda *given: None)
    out = tmp_path / "out"
    words = ["map", str(CASE), "--x", "loop.dead_time=0.001:0.003:2", "--y", f"{STIFFNESS}=1.5e5:2e5:2"]
    assert main([*words, "--starts", "3", "--seed", "7", "--workers", "2", "--json", "--out", str(out)]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert (out / "report.html").read_text().startswith("<!doctype html>")
    assert printed == json.loads((out / "map.json").read_text())
    assert (out / "map.svg").read_bytes().startswith(b"<?xml")
    assert (out / "map.png").read_bytes().startswith(b"\x89PNG")
    assert not (out / "map.partial.jsonl").exists()
    places = [(x, y) for y in (1.5e5, 2e5) for x in (0.001, 0.003)]
    assert sorted(asked) == sorted((("loop.dead_time", x), (STIFFNESS, y), 7, 3) for x, y in places)
    assert [(own["x"], own["y"], own["error"]) for own in printed["points"]] == [(x, y, x * y) for x, y in places]
    assert printed["y"]["values"] == [1.5e5, 2e5]
    check_schema("map", printed)


@pytest.mark.long
def test_any_executor_will_do_and_dead_time_costs(small):
    told = []
    x, y = Axis("loop.dead_time", "s", (1e-3, 3e-3), 3e-3), Axis("loop.inverter_lag", "s", (1e-3,), 2e-3)
    with ThreadPoolExecutor(1) as executor:
        found = map_case(small, x, y, executor, starts=1, progress=lambda done, total: told.append((done, total)))
    assert told[:2] == [(1, 2), (2, 2)]
    assert found.errors().shape == (1, 2)
    (points,) = found.points
    assert [(point.x, point.y) for point in points] == [(1e-3, 1e-3), (3e-3, 1e-3)]
    for point in points:
        assert point.status == "limited" or (
            point.stable and point.modulus_margin >= small.limits["modulus_margin"] - 1e-3
        )
        assert math.isfinite(point.error)
        assert point.first is None or point.objective <= point.first
        assert bool(point.limited_by) == (point.status == "limited")
    assert points[0].error < points[1].error


@pytest.mark.long
def test_a_sweep_is_a_row_of_a_map(small, tmp_path, capsys):
    """Each point is the match with that quantity held; file, figure and report have one axis."""
    low, high = small.loop["dead_time"], 3 * small.loop["dead_time"]
    values = Axis("loop.dead_time", "s", (low, high), low)
    found = map_case(small, values, None, ThreadPoolExecutor(1), starts=1)
    assert len(found.points) == 1
    assert found.errors().shape == (1, 2)
    alone = match_at(small, ("loop.dead_time", high), None, 0, 1)
    assert found.points[0][1].objective <= alone.objective * (1 + 1e-9)
    assert [point.y for point in found.points[0]] == [None, None]
    found.save(tmp_path)
    content = json.loads((tmp_path / "map.json").read_text())
    assert content["y"] is None
    assert {path.name for path in tmp_path.iterdir()} == {"map.json", "map.png", "map.svg", "report.html"}
    text = str(found)
    assert "Sweep" in text
    assert "dead time" in text
    assert found.to_xarray()["error"].dims == ("loop.dead_time",)


def test_a_case_with_other_values(case):
    changed = case.with_values({"loop.dead_time": "5 ms", STIFFNESS: 2e5})
    assert changed.loop["dead_time"] == pytest.approx(5e-3)
    left = STIFFNESS.removeprefix("rig.")
    assert changed.rig[left].value == changed.rig[left.replace("left", "right")].value == 2e5
    assert case.loop["dead_time"] == 3e-3
    assert changed.moves == case.moves
    with pytest.raises(InputError, match=r"did you mean 'loop\.dead_time'"):
        case.with_values({"loop.dead_tim": 1})
    with pytest.raises(InputError, match="does not fit"):
        case.with_values({"loop.dead_time": "5 kg"})


def test_a_map_needs_no_second_quantity(capsys):
    assert main(["map", str(CASE), "--x", "loop.dead_time=1ms:2ms:2", "--check"]) == 0
