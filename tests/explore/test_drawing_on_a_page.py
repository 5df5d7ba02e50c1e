"""The drawing whose parts react: every part once, in words too, marks and energies, texts of files as texts."""

import xml.etree.ElementTree as ElementTree

import pytest

import rigmatch as rm
from matching.report.drivetrain import Label, Marks, drawing, drivetrain_svg, picture
from modelling.model_file import from_dict

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def system():
    return from_dict({
        "title": 'A <script>"drive" & more',
        "inertias": {"a": {"J": 1.0}, "b": {"J": 2.0}, "c": {"J": 3.0}},
        "shafts": {"link": {"between": ["a", "b"], "stiffness": 100.0, "damping": 1.0}},
        "gears": {"pair": {"between": ["b", "c"], "ratio": 2.0}},
        "sensors": {"w": {"measures": "speed", "of": "a"}},
    })  # fmt: skip


def groups(svg):
    root = ElementTree.fromstring(svg)
    return {group.get("data-part"): group for group in root.iter(f"{SVG}g") if group.get("data-part")}


def test_every_part_is_a_button_with_its_values_in_words(system):
    found = groups(drivetrain_svg(picture(drawing(system)), Marks(), reacts=True))
    assert set(found) == {"inertias.a", "inertias.b", "inertias.c", "shafts.link", "gears.pair"}
    assert {group.get("role") for group in found.values()} == {"button"}
    assert {group.get("tabindex") for group in found.values()} == {"0"}
    link = found["shafts.link"].get("aria-label")
    assert link.startswith("shaft link, stiffness 100 N·m/rad")
    assert "damping 1 N·m·s/rad" in link


def test_marks_and_energies_stand_on_their_parts(system):
    mode = rm.modes(system)[1]
    svg = drivetrain_svg(picture(drawing(system)), Marks("inertias.a", {"shafts.link"}, mode), reacts=True)
    found = groups(svg)
    assert "selected" in found["inertias.a"].get("class")
    assert "changed" in found["shafts.link"].get("class")
    assert "100 % of the energy" in found["shafts.link"].get("aria-label")
    swinging = ElementTree.fromstring(svg).findall(f".//{SVG}animate")
    assert len(swinging) == 3
    heights = [[float(value) for value in each.get("values").split(";")] for each in swinging]
    assert max(heights[0]) - min(heights[0]) == pytest.approx(2 * drawing(system).half("a"), abs=0.01)
    first, second = heights[0][0] - heights[0][4], heights[1][0] - heights[1][4]
    assert first * second < 0  # motor and load swing against each other


def test_texts_of_files_are_texts(system):
    svg = drivetrain_svg(picture(drawing(system)))
    assert "<script>" not in svg
    assert ElementTree.fromstring(svg).get("aria-label") == 'Drivetrain A <script>"drive" & more'
    assert not groups(svg)


def test_a_part_is_labelled_line_by_line_by_name_value_and_sensor(system):
    labels = [
        shape.lines for part in picture(drawing(system)).parts for shape in part.shapes if isinstance(shape, Label)
    ]
    assert ("a",) in labels
    assert ("1 kg·m²", "ω: w") in labels
    assert ("100 N·m/rad",) in labels
