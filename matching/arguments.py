"""Arguments of a command, made from the signature and the docstring of its function in :mod:`matching.api`.

The function is the only place for names, defaults and explanations: parameters without a default are the positional
arguments, the others are options.
"""

from __future__ import annotations

import argparse
import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from modelling.errors import InputError

NOT_TYPED = ("Callable", "Executor", "Settings")  # parameters of these types exist in Python only
FROM_ZERO = ("seed", "port")  # whole numbers that may be 0; all others count from 1
SHORT = {"draws": "-n"}  # one-letter names that scripts rely on
OPTIONS = {"added": "tolerance"}  # options whose name differs from the parameter's
_SECTION = re.compile(r"\n\s*(Parameters|Returns|Raises|Examples)\n\s*-{3,}\n")
_PARAMETER = re.compile(r"^(\w+(?:, \w+)*) : (.*)$", re.MULTILINE)


@dataclass(frozen=True)
class Described:
    """The docstring of a function: its first line, its paragraphs, and by parameter its type and explanation."""

    line: str
    text: str
    parameters: Mapping[str, tuple[str, str]]


def described(function: Callable[..., Any]) -> Described:
    """What the docstring of a function says."""
    head, *sections = _SECTION.split(inspect.getdoc(function) or "")
    parameters: dict[str, tuple[str, str]] = {}
    if "Parameters" in sections:
        body = sections[sections.index("Parameters") + 1]
        found = list(_PARAMETER.finditer(body))
        for match, after in zip(found, [*found[1:], None], strict=True):
            text = _plain(" ".join(body[match.end() : after.start() if after else None].split())).rstrip(".")
            text = text[:1].lower() + text[1:] if text[1:2].islower() else text
            parameters |= dict.fromkeys(match[1].split(", "), (match[2], text.replace("%", "%%")))
    line, _, text = head.partition("\n")
    return Described(_plain(line).rstrip("."), _plain(f"{line}\n{text}".strip()), parameters)


def _plain(text: str) -> str:
    return re.sub(r":\w+:`~?([^`]+)`", r"\1", text).replace("``", "").replace("`", "")


def add_arguments(
    parser: argparse.ArgumentParser,
    function: Callable[..., Any],
    required: Iterable[str] = (),
    hidden: Iterable[str] = (),
) -> None:
    """Add the parameters of a function to a parser.

    Parameters
    ----------
    parser : ArgumentParser
    function : callable
        Of :mod:`matching.api`.
    required : iterable of str
        Parameters without a default that are options all the same.
    hidden : iterable of str
        Parameters that exist in Python only.
    """
    words = described(function).parameters
    for name, parameter in inspect.signature(function).parameters.items():
        kind = str(parameter.annotation)
        if name in hidden or any(word in kind for word in NOT_TYPED):
            continue
        stated, text = words[name]
        positional = parameter.default is inspect.Parameter.empty and name not in required
        options = _looks(name, kind, stated, parameter)
        if positional:
            parser.add_argument(name, help=text, **options)
            continue
        options["default"] = None if name in required else parameter.default
        if not positional and parameter.default not in (None, ()) and kind != "bool" and name not in required:
            text = f"{text} (default: %(default)s)"
        flags = [SHORT[name]] if name in SHORT else []
        parser.add_argument(
            *flags,
            f"--{OPTIONS.get(name, name).replace('_', '-')}",
            dest=name,
            required=name in required,
            help=text,
            **options,
        )


def _looks(name: str, kind: str, stated: str, parameter: inspect.Parameter) -> dict[str, Any]:
    """How argparse is to read a parameter."""
    several = parameter.kind is inspect.Parameter.VAR_POSITIONAL or "Sequence" in kind
    if kind == "bool":
        return {"action": "store_true"}
    if "Mapping" in kind:
        return {"action": "append", "metavar": "NAME=VALUE"}
    if choices := re.match(r"\{(.*?)\}", stated):
        values = [value.strip().strip('"') for value in choices[1].split(",")]
        return {"choices": [int(value) for value in values] if values[0].isdigit() else values}
    if kind.startswith("int"):
        return {"type": count(0 if name in FROM_ZERO else 1), "metavar": "N"}
    if kind.startswith("float | str"):  # the function reads its unit
        return {"metavar": "VALUE"}
    if kind.startswith("float"):
        return {"type": float, "metavar": "X"}
    metavar = {"channels": "FILE", "fmu": "FILE", "out": "DIR", "x": "QUANTITY", "y": "QUANTITY"}.get(name)
    if not several:
        return {"metavar": metavar or name.upper()}
    metavar = "FILE" if name == "files" else "RECORDING"
    if parameter.default is None:
        return {"metavar": metavar, "action": "extend", "nargs": "+"}
    return {"metavar": metavar, "nargs": "*" if name == "files" else "+"}


def called(function: Callable[..., Any], arguments: argparse.Namespace, **more: Any) -> Any:
    """What a function returns for the arguments of the command line; ``more`` are given as they are."""
    given, positional = vars(arguments), []
    for name, parameter in inspect.signature(function).parameters.items():
        if parameter.kind is inspect.Parameter.VAR_POSITIONAL:
            positional += given[name]
        elif name in given and name not in more:
            value = given[name]
            if "Mapping" in str(parameter.annotation) and value is not None:
                value = pairs(value, f"--{OPTIONS.get(name, name)}")
            more[name] = value
    if positional:  # what stands before them has to come by position, too
        first = [name for name in inspect.signature(function).parameters if name in more][:1]
        return function(*(more.pop(name) for name in first), *positional, **more)
    return function(**more)


def pairs(entries: Iterable[str], where: str) -> dict[str, str]:
    """Entries NAME=VALUE as a dictionary.

    Raises
    ------
    InputError
        If an entry is no pair.
    """
    found = {}
    for entry in entries:
        name, equals, value = entry.partition("=")
        if not equals or not name.strip():
            raise InputError(where, f"{entry!r} is no pair", "write NAME=VALUE")
        found[name.strip()] = value.strip()
    return found


def count(least: int) -> Callable[[str], int]:
    """Type of an argument that is a whole number, ``least`` or more."""

    def whole(text: str) -> int:
        try:
            number = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is no whole number") from None
        if number < least:
            raise argparse.ArgumentTypeError(f"{number} is less than {least}")
        return number

    return whole


def completed(parser: argparse.ArgumentParser, dest: str, names: Callable[[argparse.Namespace], Iterable[str]]) -> None:
    """Have the shell complete an argument with names, found from the arguments that stand before it."""

    def completer(prefix: str, parsed_args: argparse.Namespace, **_: Any) -> list[str]:
        try:
            return [name for name in names(parsed_args) if name.startswith(prefix)]
        except Exception:  # a file that is not there yet or not right: nothing to offer, and the prompt stays clean
            return []

    for action in parser._actions:
        if action.dest == dest:
            action.completer = completer  # type: ignore[attr-defined]
