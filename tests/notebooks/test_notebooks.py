"""Every notebook runs from top to bottom in a fresh kernel; its own assertions hold its key numbers."""

import base64
import io
import shutil
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest
from matplotlib.figure import Figure
from nbclient import NotebookClient

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


def picture(figure: Figure) -> str:
    """As Matplotlib's inline backend puts it into a cell."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    return base64.b64encode(buffer.getvalue()).decode()


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
