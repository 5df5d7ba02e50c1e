"""Every notebook runs from top to bottom in a fresh kernel; its own assertions hold its key numbers."""

import base64
import io
import re
import shutil
import subprocess
import sys
from pathlib import Path

import nbformat
import numpy as np
import pytest
from matplotlib.figure import Figure
from nbclient import NotebookClient
from PIL import Image

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
TIMEOUT = 240  # s a cell, on a busy machine; under the limit of a test
LARGEST = 300_000  # bytes


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder beside the examples, as notebooks/ is, that may be written to; nothing of the user's own set-up."""
    (tmp_path / "examples").symlink_to(ROOT / "examples", target_is_directory=True)
    folder = tmp_path / "notebooks"
    folder.mkdir()
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.setenv("MPLBACKEND", "module://matplotlib_inline.backend_inline")
    return folder


def executed(notebook: nbformat.NotebookNode, folder: Path) -> nbformat.NotebookNode:
    """The notebook run in a kernel of its own; raises where a cell does."""
    for cell in code(notebook):
        cell.outputs, cell.execution_count = [], None
    resources = {"metadata": {"path": str(folder)}}
    return NotebookClient(notebook, timeout=TIMEOUT, kernel_name="python3", resources=resources).execute()


def smaller(notebook: nbformat.NotebookNode, name: str) -> nbformat.NotebookNode:
    """The notebook with a number of its own made smaller where that takes most of its time; all assertions stay."""
    for written, instead in [SMALLER[name]] if name in SMALLER else []:
        (cell,) = (cell for cell in code(notebook) if written in cell.source)
        cell.source = cell.source.replace(written, instead)
    return notebook


def code(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def figures(notebook: nbformat.NotebookNode) -> int:
    return sum("image/png" in output.get("data", {}) for cell in code(notebook) for output in cell.outputs)


SMALLER = {"06_where_the_reference_parameters_come_from": ("STARTS = 80", "STARTS = 30")}  # shows the same, sooner
LONG = {"02_sizing_adapters", "03_calibrating_the_residual_vehicle"}  # several matches of the reference case


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=pytest.mark.long if path.stem in LONG else (), id=path.stem) for path in NOTEBOOKS],
)
def test_runs(path: Path, place: Path) -> None:
    committed = nbformat.read(path, as_version=4)
    shown = figures(committed)
    found = executed(smaller(nbformat.read(path, as_version=4), path.stem), place)
    assert figures(found) == shown
    assert shown >= 3


def test_long_notebooks_ask_for_what_there_is(tmp_path: Path) -> None:
    """They run in `make test-long` alone: here a name that the program has no more is told by the types."""
    pytest.importorskip("mypy")
    for name in sorted(LONG):
        cells = code(nbformat.read(ROOT / "notebooks" / f"{name}.ipynb", as_version=4))
        lines = [line for cell in cells for line in cell.source.splitlines() if not line.startswith("%")]
        text = "\n".join(["# mypy: allow-redefinition", *lines, "case.no_such_name"])
        (tmp_path / f"notebook_{name}.py").write_text(text + "\n", encoding="utf-8")
    asked = [sys.executable, "-m", "mypy", "--config-file", "pyproject.toml", str(tmp_path)]
    answer = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, encoding="utf-8").stdout
    wrong = [line for line in answer.splitlines() if line.endswith(("[attr-defined]", "[call-arg]", "[name-defined]"))]
    assert [line for line in wrong if "no_such_name" not in line] == []
    assert len(wrong) == len(LONG)  # the name that was put in


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_is_a_story_with_key_numbers(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    prose = [cell.source for cell in notebook.cells if cell.cell_type == "markdown"]
    assert re.match(r"# .+\n(.+\n)*?.*\bteaches\b", prose[0] + "\n", re.DOTALL)
    assert "## What to try" in prose[-1]
    assert sum(line.startswith("assert ") for cell in code(notebook) for line in cell.source.splitlines()) >= 5
    assert f"]({path.name})" in (ROOT / "notebooks" / "README.md").read_text(encoding="utf-8")


def picture(figure: Figure) -> str:
    """As Matplotlib's inline backend puts it into a cell."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    return base64.b64encode(buffer.getvalue()).decode()


def test_pictures_are_kept_with_a_palette(monkeypatch: pytest.MonkeyPatch) -> None:
    """As `make figures` keeps them: the same pixels to within what the eye sees, in less than half of the bytes."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    from figures import with_palette

    drawn = Figure(figsize=(6, 3))
    axes = drawn.add_subplot()
    for phase, colour in enumerate(("#0072B2", "#D55E00", "#009E73")):
        axes.plot(np.sin(np.linspace(0, 9, 300) + phase), color=colour)
    before = picture(drawn)
    after = with_palette(before)
    sys.modules.pop("figures")
    assert len(after) < 0.5 * len(before)
    true, small = (Image.open(io.BytesIO(base64.b64decode(each))) for each in (before, after))
    assert (small.size, small.mode) == (true.size, "P")
    difference = np.abs(np.asarray(true.convert("RGB"), float) - np.asarray(small.convert("RGB"), float))
    assert np.mean(difference) < 0.5  # of 255
    assert np.max(difference) < 40


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_pictures_of_notebooks_have_a_palette(path: Path) -> None:
    outputs = [output for cell in code(nbformat.read(path, as_version=4)) for output in cell.outputs]
    pictures = [output.data["image/png"] for output in outputs if "image/png" in output.get("data", {})]
    modes = {Image.open(io.BytesIO(base64.b64decode(each))).mode for each in pictures}
    assert modes == {"P"}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_is_small_clean_and_whole(path: Path) -> None:
    assert path.stat().st_size < LARGEST
    notebook = nbformat.read(path, as_version=4)
    cells = code(notebook)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell.outputs]
    assert not [output for output in outputs if output.output_type == "error" or output.get("name") == "stderr"]
    assert not re.search(r"/(home|tmp|root|work|Users)/", "".join(str(output) for output in outputs))
    assert "widgets" not in notebook.metadata


def test_links_lead_somewhere() -> None:
    for path in (*NOTEBOOKS, ROOT / "notebooks" / "README.md"):
        for link in re.findall(r"\]\(([\w./-]+)\)", path.read_text(encoding="utf-8")):
            assert (path.parent / link).exists(), f"{path.name} links to {link}"


def test_sliders_are_optional(place: Path) -> None:
    """Without ipywidgets the figures stand and a sentence says what to call."""
    path = ROOT / "notebooks" / "02_sizing_adapters.ipynb"
    notebook = nbformat.read(path, as_version=4)
    needed = ("%matplotlib", "def shuffle(", "def bed(", "ipywidgets import")
    cells = [cell for cell in code(notebook) if any(part in cell.source for part in needed)]
    assert len(cells) == len(needed)
    blocked = nbformat.v4.new_code_cell("import sys\nsys.modules['ipywidgets'] = None")
    notebook.cells = [blocked, *cells]
    said = executed(notebook, place).cells[-1].outputs
    assert [output.get("name") for output in said] == ["stdout"]
    assert "no ipywidgets" in said[0].text


def test_a_false_number_fails(place: Path) -> None:
    """The runner does notice: a notebook with a wrong number does not pass."""
    from nbclient.exceptions import CellExecutionError

    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("assert abs(1.6 - 16.7) < 0.1")])
    with pytest.raises(CellExecutionError):
        executed(notebook, place)
    shutil.rmtree(place)
