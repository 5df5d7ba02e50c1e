"""Figures, page and text of a match."""

import csv
import hashlib
import io
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sm
from result_schema import check_schema

from matching.cli import _fitted
from matching.match.case_file import case_files, load_case
from matching.report.acting import acting
from matching.report.common import component, equations, hertz
from matching.report.match import (
    CAPTIONS,
    checks,
    content,
    curve_data,
    key_figures,
    nearest,
    needs,
    pictures,
    report,
    signals,
    summary,
)
from matching.report.match import MODES_HIGHEST_HZ as HIGHEST_HZ
from matching.report.page import page as page_of
from matching.report.page import provenance
from modelling.model_file import from_dict
from modelling.writing import strict_json

LARGEST_PAGE = 5_000_000  # bytes, as asked
VOID = {"meta", "img", "br", "link", "input", "hr"}


def page(result, images, folder="RESULT"):
    """The page of a match with the pictures that are given."""
    return page_of(report(content(result), folder, None, result), pictures(result), images)


@pytest.fixture(scope="session")
def html(hand_made, drawn):
    return page(hand_made, drawn)


class Tags(HTMLParser):
    """Checks that every tag is closed in order, and keeps what pages load."""

    def __init__(self):
        super().__init__()
        self.open, self.sources, self.titles = [], [], []

    def handle_starttag(self, tag, attrs):
        self.sources += [value for key, value in attrs if key in ("src", "href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "title":
            self.titles.append(data)


def test_page_is_whole_and_needs_nothing_from_outside(html, drawn, hand_made):
    tags = Tags()
    tags.feed(html)
    assert not tags.open
    assert tags.titles == [hand_made.case.title]
    assert all(source.startswith(("data:", "#")) for source in tags.sources)
    assert "http" not in html.replace('"http" + ', "")
    assert html.count("<svg") >= len(drawn)
    assert set(drawn) == (
        set(CAPTIONS) - {"beds", "trade", "drives", "over_speed"}
    )  # no beds drawn, nothing weighed for an order, no range of speeds


def test_the_first_screen_says_what_to_do_with_the_command_that_does_it(hand_made):
    text = page(replace(hand_made, findings=()), {}, folder="out/here")
    first = text.split("<details")[0]
    assert "Order the adapters as planned" in first
    assert '<pre class="command">rigmatch export out/here --controller controller.fmu</pre>' in first
    limited = page(hand_made, {}).split("<details")[0]
    assert "Change what stands in the way: Set by hand: nothing was tuned" in limited
    assert "rigmatch map " in limited
    assert "loop." not in first  # values are entered by the export, not by hand


def test_figures_act_and_the_page_stays_small(html, drawn):
    assert len(html.encode()) < LARGEST_PAGE
    assert html.count('class="acts"') == len(drawn)


def test_saved_curves_are_those_of_the_figures(hand_made):
    data = curve_data(hand_made)
    head, *rows = csv.reader(io.StringIO(data["responses"]))
    numbers = np.array(rows, float)
    assert numbers[:, 0] == pytest.approx(hand_made.curves.frequencies, rel=1e-6)
    pair = hand_made.case.compared[1]
    column = next(k for k, name in enumerate(head) if name.startswith(f"{pair.sensor} / {pair.input} matched modulus"))
    values = numbers[:, column] * np.exp(1j * np.radians(numbers[:, column + 1]))
    assert values == pytest.approx(hand_made.curves.matched[:, 1], rel=1e-5)
    head, *rows = csv.reader(io.StringIO(data["manoeuvre"]))
    column = next(number for number, name in enumerate(head) if name.startswith("Motor speed vehicle ["))
    vehicle = hand_made.verification.traces.vehicle["motor_speed"]
    assert np.array(rows, float)[:, column] == pytest.approx(vehicle, rel=1e-6, abs=1e-9)


def test_a_result_names_its_files_with_checksums_and_its_day(case, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    made = provenance(case, 7).to_dict()
    assert (made["date"], made["seed"]) == ("1970-01-02", 7)
    assert [entry["file"].rpartition("/")[2] for entry in made["files"]] == ["case.toml", "vehicle.toml", "rig.toml"]
    for entry in made["files"]:
        with open(entry["file"], "rb") as file:
            assert entry["sha256"] == hashlib.sha256(file.read()).hexdigest()


def test_the_terminal_has_the_verdict_and_few_lines(hand_made):
    result = content(hand_made)
    many = [dict(result["parameters"][-1], name=f"rig.a.b{n}.J", start=1.0, tuned=2.0) for n in range(30)]
    crowded = summary(result | {"parameters": many})
    assert crowded.splitlines()[0].startswith("LIMITED")
    assert len(crowded.splitlines()) <= 20
    rows = {row[0]: row[1:] for row in key_figures(result)}
    target = hand_made.targets[0]
    assert rows[f"target mode {target.vehicle_mode}, damped (antisymmetric)"][0] == f"{hertz(target.vehicle)} Hz"
    wrapped = _fitted(crowded, 60)
    assert max(map(len, wrapped.splitlines())) <= 60


def test_page_says_what_to_order_enter_and_know(html, hand_made):
    for target in hand_made.targets:
        assert f"{target.matched:#.4g} Hz" in html
    for name, value in hand_made.tuned.loop.values.items():
        assert f"<td>loop.{name}</td>" in html.replace(' class="n"', ""), value
    for own in hand_made.parameters:
        assert component(own.name) in re.sub("</?abbr[^>]*>", "", html)
    assert "Set by hand" in html
    assert html.count("<math") > 50
    assert "nan" not in re.sub(r"<svg.*?</svg>|<script.*?</script>", "", html, flags=re.DOTALL).lower().replace(
        "dominan", ""
    )


def test_files_do_not_depend_on_how_long_the_search_took(html, drawn, hand_made):
    later = replace(hand_made, seconds=hand_made.seconds + 7.0)
    assert content(later) | {"made_by": None} == content(hand_made) | {"made_by": None}
    assert page(later, drawn) == html


def test_json_has_the_agreed_shape(hand_made):
    result = json.loads(strict_json(content(hand_made)))
    assert result["status"] in ("matched", "limited")
    assert result["asked"]["modulus_margin"] == 0.5
    check_schema("match", result)


def test_needs_and_checks(hand_made):
    peaks = {need["what"]: need for need in needs(hand_made)}
    left = peaks["dynamometers.left.torque"]
    trace = next(own for own in signals(hand_made) if own.title == "Dynamometer left, torque")
    assert left["peak"] == pytest.approx(np.abs(trace.curves["matched"]).max())
    assert left["limit"] == hand_made.case.limits["dynamometer_torque"]
    assert peaks["shafts.flange_left.twist"]["limit"] == pytest.approx(np.pi / 180)
    assert all(holds for *_, holds in checks(hand_made))
    stricter = replace(hand_made, case=replace(hand_made.case, limits={**hand_made.case.limits, "modulus_margin": 0.9}))
    assert [what for what, _, holds in checks(stricter) if not holds] == ["Modulus margin of the feedback loop"]


def test_a_motion_that_ran_away_still_gives_a_page(hand_made):
    fallen = replace(hand_made.verification, traces=None, peaks={}, robustness=(), stable=False)
    result = replace(hand_made, verification=fallen, parameters=(), objective=float("nan"))
    assert json.loads(strict_json(content(result)))["objective"] is None
    shown = pictures(result)
    assert {"manoeuvre", "robustness"}.isdisjoint(shown)
    assert page(result, {"overview": acting(shown["overview"].draw())[1]}).count('class="acts"') == 1


def test_a_tuned_case_can_be_read_again(hand_made, tmp_path):
    files = case_files(hand_made.tuned)
    assert set(files) == {"case.toml", "vehicle.toml", "rig.toml", "residual_vehicle_1.toml", "residual_vehicle_2.toml"}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    again = load_case(tmp_path / "case.toml")
    assert again.loop == hand_made.tuned.loop
    assert replace(again, moves=()) == replace(hand_made.tuned, moves=())
    starts = {move.name: move.start for move in again.moves}
    assert starts["loop.proportional_gain"] == 60.0
    assert starts["rig.shafts.flange_left.stiffness"] == 2e5


def test_equations_keep_their_signs():
    system = from_dict(
        {
            "inertias": {"a": {"J": 1.0}, "b": {"J": 2.0, "drag": 0.1}},
            "shafts": {"s": {"between": ["a", "b"], "stiffness": 3.0}},
            "inputs": {"m": {"on": "a"}},
        }
    )
    lines = [re.sub(r"<[^>]+>|&nbsp;|\s", "", line) for line in equations(system)["motion"]]
    symbols = {name: sm.Symbol(name) for name in ("bb", "cs", "xa", "xb", "va", "vb", "Mm")}
    s = symbols
    right = [s["cs"] * (s["xb"] - s["xa"]) + s["Mm"], s["cs"] * (s["xa"] - s["xb"]) - s["bb"] * s["vb"]]
    for line, wanted in zip(lines, right, strict=True):
        side = line.split("=")[1]
        for old, new in (("−", "-"), ("&InvisibleTimes;", "*"), ("φ\u0308", "w"), ("φ\u0307", "v"), ("φ", "x")):
            side = side.replace(old, new)
        assert sm.expand(sm.parse_expr(side, local_dict=symbols) - wanted) == 0, line


def test_the_mode_nearest_to_a_target_has_its_symmetry_and_kinetic_energy():
    def mode(number, frequency, symmetry="symmetric", kinetic=True):
        return SimpleNamespace(number=number, frequency=frequency, symmetry=symmetry, kinetic=kinetic)

    modes = [mode(1, 0.0), mode(2, 9.9, "antisymmetric"), mode(3, 10.1, kinetic=False), mode(4, 8.0), mode(5, 13.0)]
    assert nearest(modes, 10.0, "symmetric").number == 4
    assert nearest(modes, 12.0, "symmetric").number == 5
    assert nearest(modes, 10.0, "none") is None
    assert nearest([mode(1, 0.0), mode(2, 1.1 * HIGHEST_HZ)], HIGHEST_HZ, "symmetric") is None
