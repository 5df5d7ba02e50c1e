"""Pictures and pages of an earlier run that a new one does not make again.

A result file lists the files written with it (``files``). Where the new one no longer lists a picture or page that the
old one did, it would stand beside results it does not belong to. Other kinds of files are never removed: a user may
have gone on with a model that a run wrote.
"""

import json
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

REMOVED_KINDS = (".svg", ".png", ".html")
LARGEST_BYTES = 50_000_000  # of a result file that is read for its list


def outdated(directory: Path, new: Path) -> Iterator[Path]:
    """The pictures and pages in ``directory`` that its result files list and those in the folder ``new`` do not."""
    for result in sorted(new.glob("*.json")):
        for name in sorted(_listed(directory / result.name) - _listed(result)):
            path = directory / name
            if not path.is_symlink() and path.is_file() and path.resolve().is_relative_to(directory.resolve()):
                yield path


def _listed(result: Path) -> set[str]:
    """Names of pictures and pages that a result file lists; none where it is no such file."""
    try:
        if not result.is_file() or result.stat().st_size > LARGEST_BYTES:
            return set()
        content = json.loads(result.read_bytes())
    except (OSError, ValueError, RecursionError):
        return set()
    names = content.get("files") if isinstance(content, dict) else None
    return {
        name
        for name in (names if isinstance(names, list) else [])
        if isinstance(name, str) and name.endswith(REMOVED_KINDS) and _stays_inside(name)
    }


def _stays_inside(name: str) -> bool:
    path = PurePosixPath(name)
    return "\0" not in name and not path.is_absolute() and ".." not in path.parts
