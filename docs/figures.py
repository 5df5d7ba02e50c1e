"""Makes the generated files of this repository anew and writes ``docs/provenance.md``: ``make figures``.

``python docs/figures.py NAME …`` makes only what is named. Every PNG carries the commit in its metadata (``Source``),
every notebook in its metadata under ``rigmatch``. Uncommitted code is refused: the commit would be wrong.
"""

from __future__ import annotations

import base64
import datetime
import io
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "docs" / "provenance.md"
NOTEBOOK_TIMEOUT_S = 1200  # a cell
PALETTE = (
    256  # colours of a picture in a notebook: a quarter of the bytes of true colours, and no difference to the eye
)
FEWER_COLOURS = {"03_calibrating_the_residual_vehicle.ipynb": 48}  # six large pictures: else above 300 kB
MAP_AXES = (
    "loop.dead_time=1 ms,3 ms,5 ms,8 ms,12 ms",
    "rig.shafts.flange_left.stiffness=4e4,2e5,1e6",
)
HEADER = """# Generated files of this repository

Written by `make figures` (`docs/figures.py`). *Commit* is the state of the program that made the file; where it is
unknown, the last commit that changed the file is given.

| file | made by | commit | date |
|---|---|---|---|
"""


def generators() -> dict[str, Callable[[str], None]]:
    """What makes each generated file, by the file's path; called with the commit."""
    makers: dict[str, Callable[[str], None]] = {
        "examples/road_to_rig/drivetrain.png": make_drawing,
        "examples/road_to_rig/overview.png": make_overview,
        "examples/road_to_rig/map.png": make_map,
        "examples/road_to_rig/on_the_bed.png": make_circle,
        "examples/road_to_rig/variants.json": make_variants,
        "tests/campaign/latest.png": keep_campaign,
    }
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        makers[f"notebooks/{path.name}"] = lambda commit, path=path: run_notebook(path, commit)
    return makers


COMMANDS = {
    "examples/road_to_rig/drivetrain.png": "`rigmatch show`",
    "examples/road_to_rig/overview.png": "`rm.match(case).plot()`, seed 0",
    "examples/road_to_rig/map.png": "`rigmatch map`, `observer`",
    "examples/road_to_rig/on_the_bed.png": "`python -m tests.virtual_bed.reference_circle`",
    "examples/road_to_rig/variants.json": "`python -m tests.benchmarks.observer_variants`",
    "tests/campaign/latest.png": "`make campaign`",
}


def make_drawing(commit: str) -> None:
    """Vehicle and rig of the reference case."""
    import rigmatch as rm
    from matching.report.common import image

    folder = ROOT / "examples" / "road_to_rig"
    figure = rm.show(folder / "case.toml")
    (folder / "drivetrain.png").write_bytes(image(figure, "png", {"Source": f"rigmatch {commit}"}))


def make_overview(commit: str) -> None:
    """The overview of the reference match."""
    import rigmatch as rm
    from matching.report.common import image

    folder = ROOT / "examples" / "road_to_rig"
    figure = rm.match(folder / "observer.toml").plot()
    (folder / "overview.png").write_bytes(image(figure, "png", {"Source": f"rigmatch {commit}"}))


def make_map(commit: str) -> None:
    """The map of the reference case over dead time and flange stiffness: some minutes."""
    import rigmatch as rm
    from matching.report.common import image

    folder = ROOT / "examples" / "road_to_rig"
    figure = rm.map(folder / "observer.toml", *MAP_AXES).plot()
    (folder / "map.png").write_bytes(image(figure, "png", {"Source": f"rigmatch {commit}"}))


def make_circle(commit: str) -> None:
    """What two matches gain on the virtual bed of the reference case: some minutes."""
    sys.path.insert(0, str(ROOT))
    from matching.report.common import image
    from tests.virtual_bed.reference_circle import measure, picture

    figure = picture(measure(ROOT / "out" / "reference_circle"))
    target = ROOT / "examples" / "road_to_rig" / "on_the_bed.png"
    target.write_bytes(image(figure, "png", {"Source": f"rigmatch {commit}"}))


def make_variants(commit: str) -> None:
    """What each part of the reference match contributes, for notebook 03: two to three minutes of one core."""
    sys.path.insert(0, str(ROOT))
    from tests.benchmarks.observer_variants import BEDS, table

    kept = {"made_by": f"rigmatch {commit}", "fresh_beds": BEDS, "rows": table([])}
    text = json.dumps(kept, indent=1, ensure_ascii=False) + "\n"
    (ROOT / "examples" / "road_to_rig" / "variants.json").write_text(text, encoding="utf-8")


def keep_campaign(commit: str) -> None:
    """The picture of the last campaign that was run to its end, which states its commit itself."""
    folder = ROOT / "out" / "campaign"
    if not (folder / "results.json").exists():
        raise FileNotFoundError("out/campaign/results.json: run `make campaign` first (hours)")
    made_by = json.loads((folder / "results.json").read_text(encoding="utf-8"))["commit"]
    if not commit.startswith(made_by) and not made_by.startswith(commit):
        raise ValueError(f"the campaign was run at commit {made_by}, not at {commit}")
    shutil.copyfile(folder / "campaign.png", ROOT / "tests" / "campaign" / "latest.png")


def run_notebook(path: Path, commit: str) -> None:
    """Run a notebook from top to bottom and keep its outputs."""
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    resources = {"metadata": {"path": str(path.parent)}}
    client = NotebookClient(notebook, timeout=NOTEBOOK_TIMEOUT_S, kernel_name="python3", resources=resources)
    done = client.execute()
    done.metadata.pop("widgets", None)
    done.metadata["language_info"] = {"name": "python"}
    done.metadata["rigmatch"] = {"commit": commit}
    colours = FEWER_COLOURS.get(path.name, PALETTE)
    for cell in done.cells:
        cell.metadata.pop("execution", None)
        for output in cell.get("outputs", []):
            if "image/png" in output.get("data", {}):
                output["data"]["image/png"] = with_palette(output["data"]["image/png"], colours)
    nbformat.write(done, path)


def with_palette(picture: str, colours: int = PALETTE) -> str:
    """A PNG in base64 with a palette of the colours it uses most, instead of four bytes a pixel."""
    small = io.BytesIO()
    with Image.open(io.BytesIO(base64.b64decode(picture))) as opened:
        opened.convert("RGB").quantize(colours, dither=Image.Dither.NONE).save(small, "png", optimize=True)
    return base64.b64encode(small.getvalue()).decode("ascii")


def head() -> str:
    """The commit of the working tree.

    Raises
    ------
    SystemExit
        If the program has uncommitted changes.
    """
    changed = _git("status", "--porcelain", "--untracked-files=no", "--", "modelling", "matching", "rigmatch.py")
    if changed:
        raise SystemExit(f"commit the program first: {changed.splitlines()[0].strip()} …")
    return _git("rev-parse", "--short", "HEAD")


def rows() -> dict[str, str]:
    """Rows of the table by file, as they stand in it."""
    lines = TABLE.read_text(encoding="utf-8").splitlines() if TABLE.exists() else []
    return {
        line.split("|")[1].strip(): line for line in lines if line.startswith("| ") and not line.startswith("| file")
    }


def row(name: str, commit: str, date: str) -> str:
    """A row of the table."""
    return f"| {name} | {COMMANDS.get(name, 'running it')} | {commit} | {date} |"


def unknown(name: str) -> str:
    """A row for a file that was made before commits were recorded."""
    last = _git("log", "-1", "--format=%h %ad", "--date=short", "--", name).split() or ["no commit", ""]
    return row(name, f"unknown; last changed in {last[0]}", last[1])


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()


def main(names: list[str]) -> int:
    """Make the named files, or all; the exit code says whether all could be made."""
    makers, table, failed = generators(), rows(), 0
    table = {name: table.get(name) or unknown(name) for name in makers}
    wrong = [name for name in names if name not in makers]
    if wrong:
        raise SystemExit(f"{wrong[0]} is not a generated file; these are: {', '.join(makers)}")
    commit = head()
    for name in names or makers:
        print(f"{name} …", flush=True)
        try:
            makers[name](commit)
        except Exception as error:
            print(f"  not made: {error}", file=sys.stderr)
            failed += 1
        else:
            table[name] = row(name, commit, datetime.date.today().isoformat())
            TABLE.write_text(HEADER + "\n".join(table.values()) + "\n", encoding="utf-8")
    TABLE.write_text(HEADER + "\n".join(table.values()) + "\n", encoding="utf-8")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
