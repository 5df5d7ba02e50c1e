"""The block diagram: every number that is entered stands in it once, for every structure, and it is an SVG element."""

from xml.etree import ElementTree

import numpy as np
import pytest

from matching.report.common import number, practical
from matching.report.match import EnteredNumber, _continuous, block_diagram
from modelling.bed.bed import HARDWARE, OF_BED, Loop
from modelling.bed.controllers import STRUCTURES

TEXT = "text"


def loop_of(structure):
    values = {name: known.start for name, known in {**HARDWARE, **structure.quantities}.items()}
    return Loop(structure, (), (), values)


@pytest.mark.parametrize("structure", STRUCTURES.values(), ids=lambda structure: structure.name)
def test_every_number_of_a_structure_stands_in_one_block(structure):
    of_controller = [name for block in structure.blocks for name in block.quantities]
    assert sorted(of_controller) == sorted(structure.quantities)
    assert sum(block.holds_residual_vehicle for block in structure.blocks) == 1
    assert sorted(name for block in OF_BED for name in block.quantities) == sorted(HARDWARE)


@pytest.mark.parametrize("structure", STRUCTURES.values(), ids=lambda structure: structure.name)
def test_the_drawing_holds_values_and_signals(structure):
    loop = loop_of(structure)
    drawing = ElementTree.fromstring(block_diagram(loop, [EnteredNumber("wheel left, J", "0.7 kg·m²")]))
    texts = [text.text for text in drawing.iter(TEXT)]
    for name, known in structure.quantities.items():
        assert any(text.startswith(number(loop[name], 5)) for text in texts), name
        assert texts.count(name.replace("_", " ")) == 1, known
    for name, known in HARDWARE.items():
        assert practical(loop[name], known.unit) in texts
    assert texts.count("0.7 kg·m²") == 1
    boxes = list(drawing.iter(TEXT.replace("text", "rect")))
    assert len(boxes) == len(structure.blocks) + len(OF_BED)
    ends = [float(box.get("y")) + float(box.get("height")) for box in boxes]
    assert all(end < float(box.get("y")) for end, box in zip(ends, boxes[1:], strict=False))  # none covers another


def test_names_of_files_are_text_not_markup():
    structure = STRUCTURES["pi"]
    drawing = block_diagram(loop_of(structure), [EnteredNumber("<script>", "1 & 2")])
    assert "<script>" not in drawing
    assert "&lt;script&gt;" in drawing


def test_loci_that_cross_are_drawn_as_continuous_curves():
    """Two circles passed at different speeds, sorted by magnitude at each frequency as eigenvalues may come."""
    t = np.linspace(0, 2, 200)
    curves = np.stack([np.exp(-1j * t) * (1 - 0.4 * t), 0.4 * np.exp(1j * t) * (1 + 0.5 * t)], axis=1)
    mixed = np.take_along_axis(curves, np.argsort(np.abs(curves), axis=1), axis=1)
    drawn = _continuous(mixed)
    assert np.abs(mixed - mixed[:, ::-1])[:, 0].min() < 0.9  # they come near, so the order matters
    first = 0 if drawn[0, 0] == curves[0, 0] else 1
    np.testing.assert_array_equal(drawn[:, [first, 1 - first]], curves)
