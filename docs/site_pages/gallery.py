"""The gallery: a card an example and a notebook, each with its page, made from its README or from its cells."""

import base64
import json
import os
import re
from pathlib import Path

from site_pages.reports import report_cards

ROOT = Path(__file__).resolve().parents[2]
REFERENCE, PICTURES = ROOT / "docs" / "reference", ROOT / "docs" / "gallery"
LINK = re.compile(r"(\[[^\]]*\]\()(?!https?:|#)([^)#\s]+)")
TOP = """# Gallery

## Reports, as the commands write them

They are live: point at a curve, zoom, save the curves.

::::{grid} 1 2 2 3
:gutter: 3

REPORTS::::

## Examples and notebooks

Examples to start from, and notebooks to read: each card leads to its page. The files lie in `examples/` and
`notebooks/`.

::::{grid} 1 2 2 3
:gutter: 3
"""
OF_A_NOTEBOOK = {  # the example whose result a notebook shows
    "01_first_look": "road_to_rig",
    "02_sizing_adapters": "adapter_only",
    "03_finding_a_hidden_effect": "diagnosis",
    "04_from_road_to_bed": "from_recordings",
    "05_drive_away": "drive_away",
}


def gallery_pages() -> dict[str, str | bytes]:
    """Texts and pictures by their names in the folder of generated pages."""
    cards: list[str] = []
    pages: dict[str, str | bytes] = {}
    for readme in sorted((ROOT / "examples").glob("*/README.md")):
        name = readme.parent.name
        text = _moved(readme.read_text(encoding="utf-8"), readme.parent)
        pages[f"example_{name}.md"] = text + _files(readme.parent)
        cards.append(_card(f"example_{name}", text, _picture(name)))
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        text, pictures = _notebook(path)
        pages[f"notebook_{path.stem}.md"] = _moved(text, path.parent)
        pages |= pictures
        cards.append(_card(f"notebook_{path.stem}", text, _picture(OF_A_NOTEBOOK.get(path.stem, ""))))
    hidden = "".join(f"{name.removesuffix('.md')}\n" for name in pages if name.endswith(".md"))
    top = TOP.replace("REPORTS", report_cards())
    pages["gallery.md"] = f"{top}\n{''.join(cards)}::::\n\n```{{toctree}}\n:hidden:\n\n{hidden}```\n"
    return pages


def _picture(name: str) -> str:
    """The picture of a card: the result as a small figure, else the drivetrain."""
    shown = (f"card_{name}.svg", f"card_{name}.png", f"{name}.svg")
    return next((f"../gallery/{one}" for one in shown if (PICTURES / one).exists()), "")


def _files(folder: Path) -> str:
    """The input files of an example, each to be unfolded."""
    files = sorted(folder.glob("*.toml"))
    shown = [f"::::{{dropdown}} {path.name}\n```toml\n{path.read_text(encoding='utf-8')}```\n::::\n" for path in files]
    return "\n## Files\n\n" + "\n".join(shown) if shown else ""


def _card(page: str, text: str, picture: str) -> str:
    """A card: title and first sentence of its page, with a picture where there is one."""
    title, _, rest = text.lstrip("# ").partition("\n")
    paragraph = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", " ".join(rest.strip().split("\n\n")[0].split()))
    sentence = re.split(r"(?<=[.?]) (?=[A-Z])", paragraph)[0]
    image = f":img-top: {picture}\n" if picture else ""
    return f":::{{grid-item-card}} {title}\n:link: {page}\n:link-type: doc\n{image}\n{sentence}\n:::\n\n"


def _moved(text: str, folder: Path) -> str:
    """A text whose links are meant from its own folder, for the folder of generated pages."""

    def link(found: re.Match[str]) -> str:
        target = folder / found[2]
        return found[1] + (os.path.relpath(target, REFERENCE) if target.exists() else found[2])

    return LINK.sub(link, text)


def _notebook(path: Path) -> tuple[str, dict[str, bytes]]:
    """Cells of a notebook as a page, and its pictures."""
    parts: list[str] = []
    pictures: dict[str, bytes] = {}
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            if png := data.get("image/png"):
                name = f"{path.stem}_{len(pictures) + 1}.png"
                pictures[name] = base64.b64decode("".join(png))
                parts.append(f"![Output of the cell above]({name})")
            elif shown := "".join(data.get("text/plain", output.get("text", ()))).rstrip():
                parts.append(f"```text\n{shown}\n```")
    return "\n\n".join(parts) + "\n", pictures
