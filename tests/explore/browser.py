"""A page of the explorer in the machine's own browser, for tests; none where there is no browser."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from processes import started
from structure.imports import ROOT

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
WAIT_MS = 60_000  # at most, for anything on the page: the machine may be busy


def browser_path() -> str:
    """The browser; skips the test where there is none."""
    pytest.importorskip("panel", reason="the packages of the explorer are not installed")
    pytest.importorskip("playwright", reason="playwright is not installed")
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip("no Chromium on this machine: apt-get install chromium")
    return path


@contextmanager
def served(arguments: Iterable[str], out: Path) -> Iterator[str]:
    """Address of the page, see :func:`serving`."""
    with serving(arguments, out) as (_, address):
        yield address


@contextmanager
def serving(arguments: Iterable[str], out: Path) -> Iterator[tuple[subprocess.Popen, str]]:
    """Process and address of the page that Python serves with such arguments and, as the last, the results' folder.

    `rigmatch explore` is begun by a user whose own pages of Bokeh come from the internet.
    """
    command = [sys.executable, *arguments, str(out)]
    environment = (
        os.environ | {"PYTHONPATH": str(ROOT)} | ({"BOKEH_RESOURCES": "cdn"} if "explore" in arguments else {})
    )
    with started(command, stderr=subprocess.PIPE, text=True, env=environment, cwd=out.parent) as process:
        address = next((found[0] for line in process.stderr if (found := re.search(r"http://\S+", line))), "")
        assert address, "the server did not start"
        yield process, address


def explored(*files: Path) -> tuple[str, ...]:
    """Arguments with which Python does what `rigmatch explore` does."""
    return ("-m", "matching", "explore", *map(str, files), "--no-browser", "--out")


def complaint(message) -> str:
    """What the console says, and of which address."""
    return f"{message.text} {(message.location or {}).get('url', '')}".strip()


@contextmanager
def opened_page(address: str, width: int = 1366) -> Iterator[tuple]:
    """The page in the browser, and what its console complains of."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=browser_path(), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": width, "height": 900})
        page.set_default_timeout(WAIT_MS)
        complaints: list[str] = []
        page.on("console", lambda message: message.type == "error" and complaints.append(complaint(message)))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(address)
        page.get_by_role("heading", level=1).first.wait_for()
        try:
            yield page, complaints
        finally:
            browser.close()


def step(page, name: str) -> None:
    """Open a step; on a narrow screen the steps are behind a button."""
    if page.viewport_size["width"] < 900:
        page.get_by_role("button", name="Open drawer").click()
    page.get_by_role("tab", name=re.compile(f"^{name}")).click()  # its state may name a file
