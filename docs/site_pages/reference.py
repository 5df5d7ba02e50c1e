"""Reference pages written from the program itself: its parsers, its registry of effects, its readers' keys."""

from pathlib import Path

from site_pages.commands import commands_page
from site_pages.effects import effects_page
from site_pages.functions import functions_page, results_page
from site_pages.keys import keys_page


def write(folder: Path) -> None:
    """Write every generated page; an unchanged one is left alone, so that it is not built again."""
    folder.mkdir(exist_ok=True)
    pages = {
        "commands": commands_page(),
        "effects": effects_page(),
        "functions": functions_page(),
        "keys": keys_page(),
        "results": results_page(),
    }
    for name, text in pages.items():
        path = folder / f"{name}.md"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
