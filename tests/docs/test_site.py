"""The documentation site: built without a warning, nothing from elsewhere, every link and example command right."""

import re
import shlex
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import rigmatch as rm
from matching.cli import build_parser

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
GENERATED = ROOT / "docs" / "reference"


@pytest.mark.long
def test_the_site_builds_without_a_warning_and_loads_nothing_from_elsewhere(tmp_path):
    """One test, so that one process builds it: pages of reference are written into the folder docs/reference."""
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", "-d", tmp_path / "trees"]
    done = subprocess.run([*command, ROOT / "docs", tmp_path / "html"], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    pages = sorted((tmp_path / "html").rglob("*.html"))
    assert len(pages) > 20
    start = (tmp_path / "html" / "index.html").read_text(encoding="utf-8")
    assert start.count('role="heading" aria-level="2"') == start.count('role="heading"') > 2
    for page in pages:  # no script, style, font or picture of theirs has an address on the internet; links may
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r"<(?:script|img|link|iframe|source)\b[^>]*?(?:src|href)=\"((?:https?:)?//[^\"]*)", text)
        assert loaded == [], page.name
    for style in (tmp_path / "html").rglob("*.css"):
        text = style.read_text(encoding="utf-8")
        assert not re.search(r"(?:@import|url\()\s*['\"]?(?:https?:)?//", text), style.name
    assert (tmp_path / "html" / "equations.html").read_text(encoding="utf-8").count("<math") > 20
    gallery = (tmp_path / "html" / "reference" / "gallery.html").read_text(encoding="utf-8")
    results = set(re.findall(r"_images/card_(\w+)\.svg", gallery))
    assert results >= {"road_to_rig", "compact_bev", "diagnosis", "drive_away", "engine", "fidelity", "sensors"}
    for name, verdict in {"match": "matched", "diagnosis": "explained", "commissioning": "as predicted"}.items():
        assert f'href="../report_{name}.html"' in gallery
        assert f"_images/report_{name}.png" in gallery
        report = (tmp_path / "html" / f"report_{name}.html").read_text(encoding="utf-8")
        assert verdict in re.findall(r'<span class="status[^"]*">([^<]*)', report)
        assert "<svg" in report


@pytest.mark.parametrize("page", [p for p in PAGES if GENERATED not in p.parents], ids=lambda page: page.name)
def test_commands_in_pages_can_be_called(page):
    """Every ``rigmatch …`` of a page's code blocks parses; placeholders in capitals stand for files and names."""
    for line in shell_lines(page.read_text(encoding="utf-8")):
        if line.startswith("rigmatch "):
            words = shlex.split(line, comments=True)[1:]
            build_parser(words).parse_args(words)


def shell_lines(text: str) -> list[str]:
    """Lines of the code blocks that name no language, continued lines joined."""
    blocks = re.findall(r"^ *```([a-z{}]*)[^\n]*\n(.*?)^ *```$", text, flags=re.S | re.M)
    shell = "".join(block for language, block in blocks if language in ("", "bash", "console"))
    return [line.strip() for line in shell.replace("\\\n", " ").splitlines()]


def test_the_budget_of_the_how_to_is_one(tmp_path):
    """The file that the page shows is read and evaluated: 1500 N·m, u = √((0.5/√3)² + (0.25/√3·10)²) to first order."""
    page = (ROOT / "docs" / "howto" / "budget.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^ *```toml\n(.*?)^ *```", page, flags=re.S | re.M)
    (tmp_path / "budget.toml").write_text(textwrap.dedent(block), encoding="utf-8")
    result = rm.uncertainty(tmp_path / "budget.toml", draws=1000).measurands[0].propagation
    assert result.value == pytest.approx(1500)
    assert result.first_order == pytest.approx(((0.5**2 + 2.5**2) / 3) ** 0.5)
