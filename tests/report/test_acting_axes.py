"""Figures that act: axes say their scales, bars and curves their names, and a browser zooms and reads values."""

import html
import json
import re

import numpy as np
import pytest

from matching.report.acting import acting
from matching.report.common import decimated, figure, styled
from matching.report.page import Picture, Report, page


def known_of(fig):
    """What the page is told of the axes, and the picture."""
    _, element = acting(fig)
    return json.loads(html.unescape(re.search(r'data-axes="(.*?)"', element)[1])), str(element)


def test_axes_say_their_scales_and_labels_and_curves_their_names():
    with styled():
        fig = figure(6, 4)
        curves, beside = fig.subplots(1, 2, sharey=True)
        x = np.geomspace(1, 100, 40)
        curves.loglog(x, x**2, label="vehicle & rig")
        curves.axvline(10, label="a mark is no curve")
        curves.set(xlabel="Frequency in Hz", ylabel="Torque\nin N·m", xlim=(1, 100))
        beside.plot(x, -x)
        beside.set_yscale("symlog", linthresh=10)
    known, picture = known_of(fig)
    assert (known[0]["x"]["scale"], known[0]["x"]["ends"], known[0]["x"]["label"]) == (
        "log",
        [1, 100],
        "Frequency in Hz",
    )
    assert known[1]["y"]["label"] == "Torque in N·m"  # shared
    assert (known[1]["y"]["scale"], known[1]["y"]["linear"]) == ("symlog", 10)
    assert known[0]["y"]["names"] == []  # powers of ten are numbers
    assert re.findall(r'id="(curve: [^"]*)"', picture) == ["curve: vehicle &amp; rig", "curve: "]
    assert "http" not in picture


def test_bars_say_names_and_values():
    with styled():
        fig = figure()
        axes = fig.subplots()
        axes.barh(["flange", "shaft"], [3.0, 0.25], label="share")
        axes.barh([0], [1.5], left=[3.0], hatch="///")
    known, picture = known_of(fig)
    assert known[0]["y"]["names"] == [[0.0, "flange"], [1.0, "shaft"]]
    assert re.findall(r'id="bar: ([^"]*)"', picture) == ["flange, share, 3", "shaft, share, 0.25", "flange, 1.5"]


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


@pytest.mark.parametrize("width", [1366, 400])
def test_a_browser_reads_values_and_zooms(width, tmp_path):
    """A curve y = x² on logarithmic axes: the values shown lie on it, before and after the zoom to 10 … 100."""
    from explore.browser import browser_path

    path = browser_path()
    from playwright.sync_api import sync_playwright

    with styled():
        fig = figure(6, 4)
        axes, second = fig.subplots(1, 2)
        x = np.geomspace(1, 100, 201)
        axes.loglog(x, x**2, label="square")
        axes.set(xlim=(1, 100), ylim=(1, 1e4), xlabel="Frequency in Hz")
        second.plot(x, x)
    (tmp_path / "page.html").write_text(
        page(Report("test", "good", "It acts."), {"one": Picture(lambda: fig, "")}, {"one": acting(fig)[1]})
    )
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        sheet = browser.new_page(viewport={"width": width, "height": 900})
        faults = []
        sheet.on("pageerror", lambda error: faults.append(str(error)))
        sheet.goto((tmp_path / "page.html").as_uri())
        box = sheet.locator(".acts rect[fill=transparent]").first.bounding_box()

        def told(right, up):
            sheet.mouse.move(box["x"] + right * box["width"], box["y"] + (1 - up) * box["height"])
            words = sheet.locator(".tip").inner_text()
            assert words.startswith("square")
            numbers = [float(text) for text in re.findall(r": ([\d.]+)", words)]
            assert numbers[1] == pytest.approx(numbers[0] ** 2, rel=0.01)
            return numbers[0]

        assert told(0.5, 0.5) == pytest.approx(10, rel=0.05)
        sheet.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
        sheet.mouse.down()
        sheet.mouse.move(box["x"] + 0.999 * box["width"], box["y"] + 0.001 * box["height"])
        sheet.mouse.up()
        assert told(0.5, 0.5) == pytest.approx(10**1.5, rel=0.05)
        sheet.mouse.dblclick(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
        assert told(0.5, 0.5) == pytest.approx(10, rel=0.05)
        assert faults == []
        browser.close()
