"""Figures, page and text of a match."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sm
from result_schema import check_schema

from matching.match.case_file import case_files, load_case
from matching.report.common import equations, image
from matching.report.match import (
    CAPTIONS,
    checks,
    content,
    figures,
    frequencies_around,
    nearest,
    needs,
    page,
    return_difference,
    signals,
    summary,
)
from matching.report.match import MODES_HIGHEST_HZ as HIGHEST_HZ
from modelling.model_file import from_dict
from modelling.writing import strict_json

VOID = {"meta", "img", "br", "link", "input", "hr"}


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
    assert all(source.startswith(("data:image/", "#")) for source in tags.sources)
    assert "http" not in html
    assert "<script" not in html
    assert sum(source.startswith("data:") for source in tags.sources) == len(drawn)
    assert set(drawn) == set(CAPTIONS) - {"beds", "trade"}  # no observer, and nothing was weighed for an order


def test_page_says_what_to_order_enter_and_know(html, hand_made):
    for target in hand_made.targets:
        assert f"{target.matched:#.4g} Hz" in html
    for name, value in hand_made.tuned.loop.values.items():
        assert f"<code>loop.{name}</code>" in html, value
    for own in hand_made.parameters:
        assert own.name.removeprefix("residual_vehicle.") in html
    assert "Set by hand" in html
    assert html.count("<math") > 50
    assert "nan" not in re.sub(r"data:image[^\"]*", "", html).lower().replace("dominan", "")


def test_files_do_not_depend_on_how_long_the_search_took(html, drawn, hand_made):
    later = replace(hand_made, seconds=hand_made.seconds + 7.0)
    assert content(later) | {"made_by": None} == content(hand_made) | {"made_by": None}
    assert page(later, drawn) == html


def test_json_has_the_agreed_shape(hand_made):
    result = json.loads(strict_json(content(hand_made)))
    assert result["status"] in ("matched", "limited")
    assert result["asked"]["modulus_margin"] == 0.5
    check_schema("match", result)


def test_margin_figure_agrees_with_the_verification(hand_made):
    f = frequencies_around([target.vehicle for target in hand_made.targets])
    f = f[f >= hand_made.verification.margin_from]
    least = np.linalg.svd(return_difference(hand_made.tuned, f), compute_uv=False)[:, -1].min()
    assert least == pytest.approx(hand_made.verification.modulus_margin, rel=2e-3)


def test_needs_and_checks(hand_made):
    peaks = {need.what: need for need in needs(hand_made)}
    left = peaks["dynamometers.left.torque"]
    trace = next(own for own in signals(hand_made) if own.title == "Dynamometer left, torque")
    assert left.peak == pytest.approx(np.abs(trace.curves["matched"]).max())
    assert left.limit == hand_made.case.limits["dynamometer_torque"]
    assert peaks["shafts.flange_left.twist"].limit == pytest.approx(np.pi / 180)
    assert all(own.holds for own in checks(hand_made))
    stricter = replace(hand_made, case=replace(hand_made.case, limits={**hand_made.case.limits, "modulus_margin": 0.9}))
    assert [own.what for own in checks(stricter) if not own.holds] == ["Modulus margin of the feedback loop"]


def test_a_motion_that_ran_away_still_gives_a_page(hand_made):
    fallen = replace(hand_made.verification, traces=None, peaks={}, robustness=(), stable=False)
    result = replace(hand_made, verification=fallen, parameters=(), objective=float("nan"))
    assert json.loads(strict_json(content(result)))["objective"] is None
    shown = figures(result)
    assert {"manoeuvre", "robustness", "quantities"}.isdisjoint(shown)
    assert "NOT STABLE" in summary(content(result))
    assert page(result, {"overview": image(shown["overview"])}).count("data:image") == 1


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
