"""Every page of the site and its live reports in a browser: nothing serious for axe, nothing wider than the page."""

import subprocess
import sys
from pathlib import Path

import pytest
from explore.browser import browser_path
from structure.imports import ROOT

pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]
LOOKS = (("light", 1280), ("dark", 400))  # colours and width, px: each colour scheme and each width once


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    browser_path()
    folder = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-q",
        "-b",
        "html",
        "-d",
        folder / "trees",
        ROOT / "docs",
        folder / "html",
    ]
    subprocess.run(command, check=True, cwd=ROOT)
    return folder / "html"


@pytest.mark.parametrize(("scheme", "width"), LOOKS)
def test_no_page_is_hard_to_read_or_wider_than_its_screen(site, scheme, width):
    import axe_core_python
    from playwright.sync_api import sync_playwright

    axe = (Path(axe_core_python.__file__).parent / "axe.min.js").read_text()
    pages = sorted(path for path in site.rglob("*.html") if "_static" not in path.parts)
    assert {f"report_{name}.html" for name in ("match", "diagnosis", "commissioning")} <= {path.name for path in pages}
    wrong = []
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=browser_path(), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
        for path in pages:
            page.goto(path.as_uri())
            page.evaluate(axe)
            wrong += [
                (path.name, found["id"], found["nodes"][0]["html"])
                for found in page.evaluate("axe.run(document, { resultTypes: ['violations'] })")["violations"]
                if found["impact"] in ("serious", "critical")
            ]
            if page.evaluate("document.documentElement.scrollWidth") > width:
                wrong.append((path.name, "wider than the screen", ""))
        browser.close()
    assert wrong == [], "\n".join(map(str, wrong))
