"""The drawing whose parts react: every part once, in words too, marks and energies."""

import xml.etree.ElementTree as ElementTree

import pytest

import rigmatch as rm
from matching.report.drivetrain import drawing, marks, sketch
from modelling.model_file import from_dict

PARTS = {"inertias.a", "inertias.b", "inertias.c", "shafts.link", "gears.pair"}


@pytest.fixture(scope="module")
def drawn():
    return sketch(drawing(from_dict({
        "inertias": {"a": {"J": 1.0}, "b": {"J": 2.0}, "c": {"J": 3.0}},
        "shafts": {"link": {"between": ["a", "b"], "stiffness": 100.0, "damping": 1.0}},
        "gears": {"pair": {"between": ["b", "c"], "ratio": 2.0}},
        "sensors": {"w": {"measures": "speed", "of": "a"}},
    })))  # fmt: skip


def test_every_part_has_its_groups_and_its_values_in_words(drawn):
    found = {group.get("id") for group in ElementTree.fromstring(drawn.svg.replace("xlink:", "")).iter("g")}
    assert {name for name in found if name and "." in name} == PARTS
    words = {name: own["words"] for name, own in marks(drawn).items()}
    assert words.keys() == PARTS
    assert words["shafts.link"] == "shaft link, stiffness 100 N·m/rad, damping 1 N·m·s/rad"


def test_marks_energies_and_the_swing_stand_on_their_parts(drawn):
    found = marks(drawn, "inertias.a", {"shafts.link"}, rm.modes(drawn.drawing.system)[1])
    assert found["inertias.a"]["class"] == "part selected"
    assert found["shafts.link"]["class"] == "part changed"
    assert "100 % of the energy" in found["shafts.link"]["words"]
    assert found["gears.pair"]["heat"] == "transparent"
    amplitudes = {name: own["swing"][3] for name, own in found.items() if "swing" in own}
    assert amplitudes.keys() == {"inertias.a", "inertias.b", "inertias.c"}
    assert amplitudes["inertias.a"] * amplitudes["inertias.b"] < 0  # they swing against each other
    left, upper, right, lower = drawn.boxes["inertias.a"]
    x, y, half, *_ = found["inertias.a"]["swing"]
    assert left < x < right
    assert upper < y - half < y + half < lower
