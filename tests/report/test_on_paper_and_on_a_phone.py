"""Pages in the machine's browser: titles on a narrow screen, tables and links on paper."""

import io

import numpy as np
import pytest
import sympy as sm
from explore.browser import browser_path
from matplotlib.figure import Figure

from matching.report.common import PageFigures, PageTable, StudyPage, _Printer, embedded, image, is_wide, study_page
from matching.report.curves import acting

TITLE = "Fidelity of a delay over the largest relevant frequency of the signals (Eqs. 19, 20)"


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    """A page with an acting figure of a long title, its data, a short and a long table."""
    browser_path()
    fig = Figure(figsize=(6, 3))
    axes = fig.subplots()
    axes.plot([0, 1, 2], [1, 2, 3], label="curve")
    axes.set_title(TITLE)
    rows = [{"row": str(n), "value": f"{n}.5"} for n in range(30)]
    tables = [PageTable("Short", rows[:5]), PageTable("Long", rows)]
    words = StudyPage('A "title" \\ </style>', "word", "Answer.", False, {}, {"a": "Caption."}, tables)
    figures = PageFigures({"a": image(fig)}, acting({"a": fig}), {"a": "x,y\n1,2\n"})
    path = tmp_path_factory.mktemp("page") / "page.html"
    path.write_text(study_page(words, figures), encoding="utf-8")
    return path


@pytest.fixture
def browser():
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=browser_path(), args=["--no-sandbox"])
        yield started
        started.close()


def test_a_long_title_is_whole_on_a_narrow_screen(page_file, browser):
    """No letter touches the upper edge of the figure, and none was lost."""
    from PIL import Image

    page = browser.new_page(viewport={"width": 400, "height": 900})
    page.goto(page_file.as_uri())
    titles = (
        "() => Bokeh.documents.flatMap(d => [...d.all_models]).filter(m => m.type === 'Figure').map(m => m.title.text)"
    )
    page.wait_for_function(f"({titles})().some(text => text.includes('\\n'))")
    page.wait_for_timeout(500)  # the layout after the title
    (title,) = page.evaluate(titles)
    assert title.split() == TITLE.split()
    picture = Image.open(io.BytesIO(page.locator("#figure-a .moving").screenshot())).convert("L")
    dark = np.asarray(picture) < 200
    lines = dark[:, 60:300].any(axis=1)
    assert lines[:150].any()
    assert not lines[:2].any()
    starts = np.flatnonzero(np.diff(lines[:150].astype(int)) == 1)  # the lines of the title, then the frame
    assert len(starts) >= len(title.splitlines())


def test_on_paper_short_tables_stay_whole_and_links_to_data_are_left_out(page_file, browser):
    page = browser.new_page()
    page.goto(page_file.as_uri())
    link = page.locator("a[download]")
    assert link.is_visible()
    page.emulate_media(media="print")
    assert not link.is_visible()
    breaks = page.eval_on_selector_all("table", "each => each.map(table => getComputedStyle(table).breakInside)")
    assert breaks == ["avoid", "auto"]
    header = "() => [...document.styleSheets[0].cssRules].find(rule => rule.type === 6).cssText"
    assert "rigmatch: A " in page.evaluate(header)
    assert page.locator("h1").inner_text() == 'A "title" \\ </style>'


def test_what_repeats_is_left_out_on_paper_and_said(page_file, browser):
    """Equations of a residual vehicle that are the vehicle's own; on the screen they stay."""
    page = browser.new_page()
    page.goto(page_file.as_uri())
    page.evaluate("document.body.insertAdjacentHTML('beforeend', '<p class=repeated>a</p><p class=instead>b</p>')")
    repeated, instead = page.locator("p.repeated"), page.locator("p.instead")
    assert (repeated.is_visible(), instead.is_visible()) == (True, False)
    page.emulate_media(media="print")
    assert (repeated.is_visible(), instead.is_visible()) == (False, True)


def test_factors_of_an_equation_stand_apart(browser):
    """A subscript ran into the next factor: i_reduction d_shaft was read as one word."""
    factors = sm.symbols("a b")
    apart = _Printer({}).doprint(sm.Mul(*factors))
    together = apart.replace("rspace", "data-rspace")
    assert apart != together
    page = browser.new_page()
    page.set_content(f"<math><mrow>{together}</mrow></math><br><math><mrow>{apart}</mrow></math>")
    widths = page.eval_on_selector_all("math", "each => each.map(math => math.getBoundingClientRect().width)")
    assert widths[1] > widths[0] + 1


def test_a_name_beside_a_long_meaning_keeps_its_width_on_a_narrow_screen(page_file, browser):
    """A table without a head, as that of the hardware: its names once stood in columns three letters wide."""
    page = browser.new_page(viewport={"width": 400, "height": 900})
    page.goto(page_file.as_uri())
    row = f"<tr><td><code>loop.torque_sensor_lag</code></td><td>{'first-order lag of the torque flange ' * 5}</td></tr>"
    page.evaluate("rows => document.querySelector('table').innerHTML = rows", row)
    assert page.locator("td:has(> code)").bounding_box()["width"] > 100
    assert page.evaluate("document.documentElement.scrollWidth") == 400


def lettered(width, height, points):
    """A figure in inches with letters of a size in points."""
    fig = Figure(figsize=(width, height))
    fig.text(0.5, 0.5, "text", fontsize=points)
    return image(fig)


def test_wide_figures_are_printed_across_and_narrow_screens_keep_their_size(tmp_path, browser):
    """Text of a figure 12 inches wide would be 4 points high on upright paper, and 2 in the width of a telephone."""
    drawn = {"wide": lettered(12, 5, 7), "upright": lettered(6, 3, 7)}
    words = StudyPage("Title", "word", "Answer.", False, {}, {"wide": "Caption.", "upright": "Caption."})
    path = tmp_path / "page.html"
    path.write_text(study_page(words, PageFigures(drawn)), encoding="utf-8")
    page = browser.new_page(viewport={"width": 400, "height": 900})
    page.goto(path.as_uri())
    picture = page.locator("#figure-wide img")
    assert picture.bounding_box()["width"] == pytest.approx(12 * 96, abs=1)
    assert page.evaluate("document.documentElement.scrollWidth") == 400
    page.locator("#figure-wide input").check()
    assert picture.bounding_box()["width"] < 400
    page.emulate_media(media="print")
    paper = "figure => getComputedStyle(figure).page"
    assert page.locator("#figure-wide").evaluate(paper) == "across"
    assert page.locator("#figure-upright").evaluate(paper) == "auto"


@pytest.mark.parametrize(
    ("width", "height", "points", "expected"),
    [(12, 5, 7, True), (12, 5, 9, False), (12, 12, 7, False), (7.5, 3, 4, False), (5, 12, 4, False)],
)
def test_a_figure_is_laid_across_where_its_letters_are_too_small_upright(width, height, points, expected):
    assert is_wide(embedded(lettered(width, height, points))) is expected


def test_what_has_no_letters_or_no_size_in_points_is_not_laid_across():
    assert not is_wide(embedded(image(Figure(figsize=(12, 5)))))
    assert not is_wide(embedded(image(Figure(figsize=(12, 5)), "png")))
    assert not is_wide(embedded(b"<svg></svg>"))
    assert not is_wide("")
