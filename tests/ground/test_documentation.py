"""README and docs: short where they should be, links lead somewhere, lists are complete."""

import re
import runpy
from pathlib import Path

import pytest

from matching.commands import available
from modelling.effects import EFFECTS
from modelling.errors import VERSION

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
WRITTEN = ("commands", "effects", "functions", "keys", "results")  # by `make docs`, from the program
SCREEN = 45  # lines of text that a screen shows
LONGEST_README = 90  # lines: with tables and figure three screens of 1080 px in a browser, in a column of 838 px
OTHER_FILES = {"new"}  # commands without a function: they write files of their own


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    links = re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8"))
    missing = {link for link in links if "://" not in link and not (page.parent / link).exists()}
    written = {f"{up}reference/{name}.md" for up in ("", "../") for name in WRITTEN}
    assert missing <= written


def test_the_readme_is_three_screens_with_a_figure_after_the_first():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    figure = next(number for number, line in enumerate(lines) if line.startswith("!["))
    assert figure <= SCREEN
    assert len(lines) <= LONGEST_README
    assert "import rigmatch as rm" in lines


def test_every_command_stands_in_the_readme_and_in_the_docs():
    for page, place in (("README.md", r"`rigmatch (\w+)`"), ("docs/commands.md", r"^\| `rigmatch (\w+)")):
        named = set(re.findall(place, (ROOT / page).read_text(encoding="utf-8"), re.MULTILINE))
        assert named == set(available())


def test_every_effect_stands_in_the_docs():
    text = (ROOT / "docs" / "files.md").read_text(encoding="utf-8")
    assert [kind for kind in EFFECTS if f"`{kind}`" not in text] == []


def test_every_path_named_in_the_docs_exists():
    for page in (ROOT / "CONTRIBUTING.md", ROOT / "docs" / "structure.md"):
        paths = re.findall(r"`((?:modelling|matching|tests)/[\w./]+)`", page.read_text(encoding="utf-8"))
        missing = [path for path in paths if "NAME" not in path and not (ROOT / path).exists()]
        assert (page.name, missing) == (page.name, [])


def test_where_is_names_files_and_what_stands_in_them():
    """In docs/structure.md: `file.py`, `name` → the file defines that name."""
    files = [str(path.relative_to(ROOT)) for room in ("modelling", "matching") for path in (ROOT / room).rglob("*.py")]
    text = (ROOT / "docs" / "structure.md").read_text(encoding="utf-8")
    for name in re.findall(r"`([\w/]+\.py)`", text):
        assert "NAME" in name or (ROOT / name).exists() or any(f"/{path}".endswith(f"/{name}") for path in files), name
    for file, names in re.findall(r"`([\w/]+\.py)`((?:,? (?:and )?`\w+`)+)", text):
        (path,) = [path for path in files if f"/{path}".endswith(f"/{file}")]
        for name in re.findall(r"`(\w+)`", names):
            assert re.search(rf"^(def|class) {name}\b|^{name} =", (ROOT / path).read_text(encoding="utf-8"), re.M), name


def test_the_changelog_knows_the_version():
    release = VERSION.partition(".dev")[0]
    assert f"## {release}" in (text := (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")) or f"({release})" in text


def test_the_provenance_names_every_generated_file_and_its_commit():
    figures = runpy.run_path(str(ROOT / "docs" / "figures.py"))
    rows = figures["rows"]()
    assert set(rows) == set(figures["generators"]())
    for name, row in rows.items():
        commit = row.split("|")[3].strip()
        if not commit.startswith("unknown; last changed in "):
            content = (ROOT / name).read_bytes()
            stated = f'"commit": "{commit}"' if name.endswith(".ipynb") else f"rigmatch {commit}"
            assert stated.encode() in content or name.startswith("tests/campaign"), name
