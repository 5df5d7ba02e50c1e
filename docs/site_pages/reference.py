"""Pages written from the program itself: its parsers, its effects, its readers' keys; examples and notebooks."""

from pathlib import Path

from site_pages.commands import commands_page
from site_pages.effects import effects_page
from site_pages.functions import functions_page, results_page
from site_pages.gallery import gallery_pages
from site_pages.keys import keys_page


def write(folder: Path) -> None:
    """Write every generated page; an unchanged one is left alone, so that it is not built again."""
    folder.mkdir(exist_ok=True)
    pages = {
        "commands.md": commands_page(),
        "effects.md": effects_page(),
        "functions.md": functions_page(),
        "keys.md": keys_page(),
        "results.md": results_page(),
        **gallery_pages(),
    }
    for name, text in pages.items():
        path, content = folder / name, text.encode() if isinstance(text, str) else text
        if not path.exists() or path.read_bytes() != content:
            path.write_bytes(content)
