"""`rigmatch new`: write a commented case to start from."""

import argparse
from typing import Any

HELP = """Write a vehicle, a rig and a case that run as they are, every key with a comment, into a new or empty
directory. Nothing is overwritten."""
EXAMPLES = (
    "rigmatch new my_bed",
    "rigmatch new bench/electric_drive",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The directory."""
    parser.add_argument("directory", metavar="DIR", help="directory to make")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Write the files; the result object names them.

    Raises
    ------
    InputError
        If the directory is not empty.
    """
    from importlib.resources import files
    from pathlib import Path

    from modelling.common.errors import InputError
    from modelling.writing.output import write_all

    target = Path(arguments.directory)
    if target.is_dir() and any(target.iterdir()):
        raise InputError(str(target), "is not empty", "name a new or an empty directory")
    if target.exists() and not target.is_dir():
        raise InputError(str(target), "is a file", "name a new or an empty directory")
    starter = {part.name: part.read_text(encoding="utf-8") for part in files("matching").joinpath("starter").iterdir()}
    write_all(target, dict(sorted(starter.items())))
    return {"directory": str(target), "files": sorted(starter)}


def summary(result: dict[str, Any]) -> str:
    """What to do next."""
    here = result["directory"]
    return f"{here}: {', '.join(result['files'])}\nnext: rigmatch match {here}/case.toml --out {here}/out"
