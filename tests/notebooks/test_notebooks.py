"""Every notebook runs from top to bottom in a fresh kernel; its own assertions hold its key numbers."""

import shutil
from pathlib import Path

import nbformat
import pytest
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


def code(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def figures(notebook: nbformat.NotebookNode) -> int:
    return sum("image/png" in output.get("data", {}) for cell in code(notebook) for output in cell.outputs)


LONG = {
    "02_sizing_adapters",
    "03_finding_a_hidden_effect",
    "04_from_road_to_bed",
    "05_drive_away",
}  # matches and diagnoses


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=pytest.mark.long if path.stem in LONG else (), id=path.stem) for path in NOTEBOOKS],
)
def test_runs(path: Path, place: Path) -> None:
    committed = nbformat.read(path, as_version=4)
    shown = figures(committed)
    found = executed(nbformat.read(path, as_version=4), place)
    assert figures(found) == shown
    assert shown >= 3


def test_they_import_the_package_alone() -> None:
    for path in NOTEBOOKS:
        for cell in code(nbformat.read(path, as_version=4)):
            assert "from matching" not in cell.source
            assert "from modelling" not in cell.source


def test_a_false_number_fails(place: Path) -> None:
    """The runner does notice: a notebook with a wrong number does not pass."""
    from nbclient.exceptions import CellExecutionError

    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("assert abs(1.6 - 16.7) < 0.1")])
    with pytest.raises(CellExecutionError):
        executed(notebook, place)
    shutil.rmtree(place)
