"""Drawings of drivetrains: where parts stand, what is marked, and that texts of files stay texts."""

import dataclasses
from itertools import combinations, pairwise
from xml.etree import ElementTree

import pytest
from matplotlib.patches import FancyBboxPatch
from structure.imports import ROOT

import rigmatch as rm
from matching.cli import main
from matching.report.common import image
from matching.report.drivetrain import MOST_INERTIAS, case_drawings, case_figure, drawing, layout, model_figure, sketch
from modelling.errors import InputError
from modelling.model_file import from_dict

REFERENCE = ROOT / "examples" / "road_to_rig"


def chain(names, **more):
    shafts = {f"{a}_{b}": {"between": [a, b], "stiffness": 1.0} for a, b in pairwise(names)}
    return from_dict({"inertias": {name: {"J": 1.0} for name in names}, "shafts": shafts} | more)


@pytest.fixture(scope="module")
def case():
    return rm.load_case(REFERENCE / "case.toml")


def texts(figure):
    return [text.get_text() for axes in figure.axes for text in axes.texts]


def test_a_chain_stands_in_one_row_from_one_of_its_ends():
    placed = layout(from_dict({
        "inertias": {name: {"J": 1.0} for name in ("middle", "first", "last")},
        "shafts": {"a": {"between": ["first", "middle"], "stiffness": 1.0},
                   "b": {"between": ["middle", "last"], "stiffness": 1.0}},
    }))  # fmt: skip
    assert placed.column == {"first": 0, "middle": 1, "last": 2}
    assert set(placed.lane.values()) == {0.0}


def shafts(*pairs):
    ends = [pair.split("-") for pair in pairs]
    names = dict.fromkeys(name for pair in ends for name in pair)
    between = {f"s{place}": {"between": pair, "stiffness": 1.0} for place, pair in enumerate(ends)}
    return from_dict({"inertias": {name: {"J": 1.0} for name in names}, "shafts": between})


def drawings():
    yield from case_drawings(rm.load_case(ROOT / "examples" / "compact_bev" / "case.toml"))
    yield from case_drawings(rm.load_case(ROOT / "examples" / "four_wheel" / "case.toml"))
    yield from case_drawings(rm.load_case(REFERENCE / "case.toml"))
    yield drawing(shafts("a-b", "a-b", "a-b", "b-c"))  # shafts beside each other
    yield drawing(shafts("a-b", "b-c", "c-d", "d-a"))
    yield drawing(shafts("a-b", "a-c", "b-d", "c-d", "d-e", "b-f"))
    yield drawing(shafts("x-a", "a-b", "b-c", "c-d", "d-a", "a-c", "b-d"))


def test_no_part_stands_on_another_even_where_branches_meet_again():
    for drawn in drawings():
        boxes = [(name, *box) for name, box in sketch(drawn).boxes.items()]
        for (name, left, upper, right, lower), (other, *ends) in combinations(boxes, 2):
            apart = right <= ends[0] or ends[2] <= left or lower <= ends[1] or ends[3] <= upper
            assert apart, f"{name} and {other} overlap in {drawn.system.title}"


def test_the_cut_the_dynamometers_and_what_is_emulated_are_marked(case):
    figure = case_figure(case)
    vehicle, rig = figure.axes
    cuts = [
        [line for line in axes.lines if not isinstance(line.get_linestyle(), str) or line.get_linestyle() == "--"]
        for axes in (vehicle, rig)
    ]
    assert [len(found) for found in cuts] == [2, 2]
    behind, before = layout(case.vehicle).column["wheel_left"], layout(case.vehicle).column["differential"]
    column = case_drawings(case)[0].column
    place = cuts[0][0].get_xdata()[0] / column
    assert before + 0.5 < place < behind
    hatched = [patch for patch in vehicle.patches if patch.get_hatch()]
    assert len(hatched) == len(case.vehicle.inertias) - 3
    assert not any(patch.get_hatch() for patch in rig.patches)
    assert "rotor left\n(dynamometer left)" in texts(figure)
    housings = [patch.get_bbox() for patch in rig.patches if isinstance(patch, FancyBboxPatch)]
    rotors = {column * layout(case.rig).column[f"rotor_{side}"] for side in ("left", "right")}
    assert len(housings) == 2
    assert {round((box.x0 + box.x1) / 2, 6) for box in housings} == {round(place, 6) for place in rotors}
    assert not any(isinstance(patch, FancyBboxPatch) for patch in vehicle.patches)
    assert any("10920 N·m/rad" in text for text in texts(figure))


def test_texts_of_files_are_neither_formulas_nor_markup():
    system = chain(["a", "b"], title="<b>$\\frac{1}{0}$ & ]]>", sensors={"n": {"measures": "speed", "of": "a"}})
    figure = model_figure(system)
    root = ElementTree.fromstring(image(figure, "svg"))
    assert root.tag.endswith("svg")
    assert figure.axes[0].get_title(loc="left") == "<b>$\\frac{1}{0}$ & ]]>"
    assert image(figure, "png").startswith(b"\x89PNG")


def test_models_and_cases_draw_themselves_in_a_notebook(case):
    assert case._repr_html_().startswith(f"<p><img alt='{case.title}' src='data:image/svg+xml;base64,")
    assert case.rig._repr_html_().index("<img") < case.rig._repr_html_().index("\\\\")  # the equations below
    name = "<script>'"
    hostile = chain(["a", "b"], title=name)
    assert "<script>" not in hostile._repr_html_()
    assert "<script>" not in dataclasses.replace(case, title=name)._repr_html_()
    long = chain([f"i{i}" for i in range(MOST_INERTIAS + 1)])
    assert "<img" not in long._repr_html_()
    assert "<img" not in dataclasses.replace(case, rig=long)._repr_html_()


def test_too_many_inertias_are_one_line():
    with pytest.raises(InputError, match=f"at most {MOST_INERTIAS}"):
        model_figure(chain([f"i{i}" for i in range(MOST_INERTIAS + 1)]))


@pytest.mark.parametrize(("name", "said"), [("case.toml", "rig: 7 inertias"), ("vehicle.toml", "model: 9 inertias")])
def test_the_command_draws_models_and_cases(name, said, tmp_path, capsys):
    assert main(["show", str(REFERENCE / name), "--out", str(tmp_path)]) == 0
    assert said in capsys.readouterr().out
    assert (tmp_path / "drivetrain.png").read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in (tmp_path / "drivetrain.svg").read_bytes()
