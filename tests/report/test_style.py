"""Figures as file content."""

import io

import numpy as np

from matching.report.common import DOTS_PER_INCH, figure, image, styled


def _drawn():
    with styled():
        drawn = figure(5, 3)
        left, right = drawn.subplots(1, 2)
        left.plot(np.geomspace(1, 1e3, 50), np.linspace(-3, 7, 50), label="a curve")
        left.set(xscale="log", ylabel="A long label\nin two lines")
        right.plot(np.arange(3000) % 17, rasterized=True)
        drawn.legend(loc="outside upper center")
    return drawn


def test_a_figure_is_written_as_matplotlib_itself_writes_it_and_left_as_it_was() -> None:
    buffer, drawn = io.BytesIO(), _drawn()
    with styled():
        _drawn().savefig(buffer, format="svg", dpi=DOTS_PER_INCH, metadata={"Date": None})
    before = drawn.canvas, drawn.dpi, type(drawn.get_layout_engine())
    assert image(drawn) == buffer.getvalue()
    assert (drawn.canvas, drawn.dpi, type(drawn.get_layout_engine())) == before


def test_a_figure_without_a_layout_of_its_own_is_written_too() -> None:
    drawn = _drawn()
    drawn.set_layout_engine("none")
    assert image(drawn).startswith(b"<?xml")
    assert drawn.get_layout_engine() is None or type(drawn.get_layout_engine()).__name__ == "PlaceHolderLayoutEngine"


def test_dollars_of_a_user_are_letters_and_numbers_at_logarithmic_axes_stay_numbers() -> None:
    with styled():
        drawn = figure(4, 3)
        axes = drawn.add_subplot()
        axes.barh(["a$b", "$c"], [10, 1000])
        axes.set(xscale="log", title="costs $5 \\frac{$")
    drawing = image(drawn).decode()
    for written in ("costs $5 \\frac{$", "a$b", "$c"):
        assert f">{written}</text>" in drawing
    assert ">10²</text>" in drawing
