"""The reference of the commands, from their parsers."""

import argparse
from collections.abc import Iterator

from matching.cli import build_parser
from matching.commands import COMMANDS, calls

TOP = """# Commands

Written from the program's own parsers when the site is built. Every command has `--help`, `--json` (the result object
on standard output, nothing else) and `--traceback`; most have `--check`, which only reads and checks the input files.
The examples work as typed in the program's folder, one after the other; `out/road_to_rig` is what `make run` writes.
Exit codes: 0 answered, 2 wrong input (one line says where, what is wrong and what would be right), 1 a fault of the
program, 130 and 143 interrupted.
"""
EVERYWHERE = {"help", "json", "traceback", "check"}


def commands_page() -> str:
    """One section a command, in the order of work: what it does, how it is called, its arguments, examples."""
    return "\n".join([TOP, *(_section(name) for name in COMMANDS)])


def _section(name: str) -> str:
    parser = build_parser([name])
    commands = next(action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    command = commands.choices[name]
    rows = list(_rows(command))
    table = ["| argument | means |", "|---|---|", *rows] if rows else []
    return "\n".join(
        [f"## rigmatch {name}", "", command.description or "", "", "```", *calls(name), "```", "", *table, ""]
    )


def _rows(command: argparse.ArgumentParser) -> Iterator[str]:
    formatter = command._get_formatter()
    for action in command._actions:
        if action.dest in EVERYWHERE:
            continue
        name = ", ".join(action.option_strings) or action.metavar or action.dest
        if isinstance(name, tuple):
            name = " ".join(name)
        if action.option_strings and action.nargs != 0:
            choices = "{" + ",".join(map(str, action.choices)) + "}" if action.choices else action.dest.upper()
            name += f" {action.metavar or choices}"
        text = formatter._expand_help(action) if action.help else ""
        needed = " Required." if action.required and action.option_strings else ""
        yield f"| `{name}` | {_cell(text)}{needed} |"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ").replace("*", "\\*").replace("<", "&lt;")
