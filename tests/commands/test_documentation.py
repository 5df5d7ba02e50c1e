"""README and docs: short where they should be, links lead somewhere, lists are complete."""

import re
from pathlib import Path

import pytest

from matching.commands import COMMANDS

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    path
    for path in (
        *ROOT.glob("*.md"),
        *(ROOT / "docs").glob("*.md"),
        *(ROOT / "docs" / "howto").glob("*.md"),
        *(ROOT / "examples").glob("*/README.md"),
    )
    if path.is_file()
)
WRITTEN = ("commands", "effects", "functions", "gallery", "keys", "results")  # by `make docs`, from the program


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    links = re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8"))
    missing = {link for link in links if "://" not in link and not (page.parent / link).exists()}
    written = {f"{up}reference/{name}.md" for up in ("", "../") for name in WRITTEN}
    assert missing <= written


def test_every_command_stands_in_the_readme_and_in_the_docs():
    for page, place in (("README.md", r"`rigmatch (\w+)`"), ("docs/commands.md", r"^\| `rigmatch (\w+)")):
        named = set(re.findall(place, (ROOT / page).read_text(encoding="utf-8"), re.MULTILINE))
        assert named == set(COMMANDS)
