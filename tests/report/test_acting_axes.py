"""Figures that act: the curves of a drawn figure, their peaks kept, and nothing where there is no curve."""

import json
import re

import numpy as np
import pytest
from matplotlib.ticker import FixedLocator, StrMethodFormatter

from matching.report.common import decimated, figure, styled
from matching.report.curves import acting

bokeh_figure = pytest.importorskip("bokeh.plotting").figure


def draw():
    with styled():
        fig = figure(6, 4)
        curves, dots, bars = fig.subplots(1, 3)
        x = np.geomspace(1, 100, 40)
        curves.loglog(x, x**2, label="vehicle")
        curves.fill_between(x, x, x**3, alpha=0.3, label="about 95 %")
        curves.axvline(10)
        curves.set_xlabel("Frequency in Hz")
        curves.set_title("motor → <speed>")
        dots.plot(x, -x, "o", label="measured")
        bars.bar([1, 2], [3, 4])
        bars.axvline(1.5)  # a mark is no curve
    return fig


@pytest.fixture(scope="module")
def drawn():
    return draw()


def test_curves_of_axes_become_panels(drawn):
    made = acting({"responses": drawn})
    assert set(made) == {"library", "script", "responses"}
    text = made["script"]
    assert text.count('"name":"Figure"') == 3
    for words in ("vehicle", "about 95 %", "measured", "Frequency in Hz", "motor "):
        assert words in text
    assert text.count('"name":"LogScale"') == 2
    assert not re.search(r"[0-9a-f]{8}-[0-9a-f]{4}-", made["script"] + made["responses"])  # no random names
    assert '"acting-' in made["responses"]
    assert re.search(r'id="(acting-\d+)"', made["responses"])[1] in text
    assert "http" not in re.sub(r"xmlns\S*", "", made["responses"])


def test_every_curve_reads_columns_that_its_data_have(drawn):
    from matching.report.curves import _drawn_line as _curve

    for axes in drawn.axes[:2]:
        fig = bokeh_figure(x_axis_type="log", y_axis_type="log")
        for line in axes.get_lines():
            _curve(fig, line)
        for made in fig.renderers:
            asked = {made.glyph.x, made.glyph.y}
            assert asked == {"x", "y"}
            assert asked <= made.data_source.data.keys()
        assert len(fig.renderers) == 1


def test_a_figure_without_curves_or_bars_stays_a_picture():
    with styled():
        fig = figure()
        fig.subplots().axvline(1.5)
    assert acting({"mark": fig}) == {}


def test_bars_and_histograms_say_names_and_values():
    with styled():
        fig = figure()
        named, counted = fig.subplots(1, 2)
        named.barh(["flange", "shaft"], [3.0, 0.25], color="#0072B2", label="share")
        named.barh([0], [1.5], left=[3.0], color="#D55E00", hatch="///")
        counted.stairs([2, 0, 5], [0.0, 1.0, 2.0, 3.0], fill=True)
        counted.axvline(1.2, linestyle="--", label="required")
    text = acting({"bars": fig})["script"]
    for words in ('"flange, share"', '"shaft, share"', '"0.25"', '"0 to 1: 2"', '"2 to 3: 5"', "required"):
        assert words in text
    assert "1 to 2" not in text  # nothing was counted there
    assert "right_diagonal_line" in text
    assert text.count('"type":"map","entries":[[0.0,"flange"],[1.0,"shaft"]]') == 1


def test_bars_on_a_logarithmic_axis_begin_at_its_end_and_say_their_whole_length():
    with styled():
        fig = figure()
        axes = fig.subplots()
        axes.barh([0, 1], [1.25, 40.0], color="#0072B2")
        axes.set_xscale("log")
        axes.set_xlim(0.5, 100)
    text = acting({"bars": fig})["script"]
    assert re.search(r'\["left",\[0\.5,0\.5\]\],\["right",\[1\.25,40\.0\]\]', text)
    assert '"1.25"' in text


def test_an_axis_linear_near_zero_is_drawn_with_its_ticks_its_band_and_its_values():
    with styled():
        fig = figure()
        beside, axes = fig.subplots(1, 2)
        beside.plot([0.0, 1.0], [0.0, 1.0])
        axes.plot([0.0, 1.0, 2.0], [0.0, 10.0, 1000.0], label="residual")
        axes.axhspan(-2, 2, label="95 % of noise")
        axes.set_yscale("symlog", linthresh=10)
        axes.set_ylim(-10, 1000)
        axes.yaxis.set_major_locator(FixedLocator([0, 10, 1000]))
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    text = acting({"residual": fig})["script"]
    beyond = 1 / (1 - 1 / 10)  # Matplotlib: linear to 10 over 1/(1 - 1/base) decades, then a decade a decade
    labels = re.search(r'"major_label_overrides":\{"type":"map","entries":(\[\[.*?\]\])', text)[1]
    places = [place for place, _ in json.loads(labels)]
    assert places == pytest.approx([0.0, 10 * beyond, 10 * (beyond + 2)])
    assert '"1000"' in text
    assert "@value" in text
    assert "95 % of noise" in text


def test_a_long_curve_keeps_its_peaks_and_gaps():
    x = np.arange(1e5)
    y = np.sin(x / 300)
    y[54321], y[20_000:30_000] = 40.0, np.nan
    few, values = decimated(x, y, 400)
    assert len(few) <= 401
    assert np.nanmax(values) == 40
    assert few[np.nanargmax(values)] == 54321
    assert np.isnan(values).any()
    assert (np.diff(few) > 0).all()
    assert decimated(x[:300], y[:300], 400)[0].tolist() == x[:300].tolist()
