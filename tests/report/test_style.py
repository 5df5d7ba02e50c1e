"""Figures as file content."""

from matching.report.common import figure, image, styled


def test_dollars_of_a_user_are_letters_and_numbers_at_logarithmic_axes_stay_numbers() -> None:
    with styled():
        drawn = figure(4, 3)
        axes = drawn.add_subplot()
        axes.barh(["a$b", "$c"], [10, 1000])
        axes.set(xscale="log", title="costs $5 \\frac{$")
    drawing = image(drawn).decode()
    for written in ("costs $5 \\frac{$", "a$b", "$c"):
        assert f">{written}</text>" in drawing
    assert ">100</text>" in drawing
