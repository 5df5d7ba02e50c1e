# PYTHON_ARGCOMPLETE_OK
"""The command line: `rigmatch COMMAND …`. Exit 0: answered; 2: wrong input, one line; 1: a fault of the program."""

import argparse
import os
import shutil
import sys
import textwrap
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, redirect_stdout
from importlib import import_module
from io import TextIOWrapper
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

from matching import dry_run
from matching.commands import available
from modelling.common import memory_limits
from modelling.common.errors import ANSWERED, BAD_INPUT, FAULT, InputError, of_the_machine
from modelling.common.escape import terminal
from modelling.common.interruption import Interrupted, whatever_it_became
from modelling.common.toml_lines import line_of
from modelling.common.version import VERSION

MADE_BY_MAKE_RUN = "out/road_to_rig"  # what examples of help take as there
NARROWEST_TERMINAL = 40  # columns
GO_ON_IN_PLACE = ("explore", "commission")  # commands that write to files they read

# Errors of the operating system that a wrong path on the command line causes; a full disk, say, is not among them.
WRONG_PATH: dict[type[Exception], tuple[str, str]] = {
    FileNotFoundError: ("no such file", "a path that exists"),
    IsADirectoryError: ("is a directory", "a file"),
    NotADirectoryError: ("has a file where a directory is needed", "a path of directories"),
    FileExistsError: ("exists and is not a directory", "another name"),
    PermissionError: ("access denied", "a path you may read, or write to for output"),
}


class HelpFormatter(argparse.HelpFormatter):
    """Help that wraps paragraphs and leaves the lines of examples as they are."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if text.startswith("examples,") else super()._fill_text(text, width, indent)


class Parser(argparse.ArgumentParser):
    """Argument parser that says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """Print one line on standard error and exit with 2."""
        self.exit(BAD_INPUT, f"{self.prog}: {_one_line(message)}; see {self.prog} --help\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; its exit code: 0 answered, 2 bad input, 1 fault of the program, 130 or 143 interrupted."""
    _one_thread_for_blas()
    words = list(sys.argv[1:] if argv is None else argv)
    warnings.formatwarning = lambda message, *_: f"rigmatch: note: {_one_line(str(message))}\n"
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # units and Greek letters must not fail on a terminal that lacks them
            stream.reconfigure(errors="backslashreplace")
    try:
        with whatever_it_became():
            _run(words)
    except SystemExit as end:  # --help, --version and wrong arguments
        return int(end.code or 0)
    except InputError as error:
        number = line_of(error.where, error.wrong)
        return _say(f"{error} (line {number})" if number else str(error), BAD_INPUT)
    except KeyboardInterrupt as interrupt:
        stop = interrupt if isinstance(interrupt, Interrupted) else Interrupted()
        return _say(str(stop), stop.exit_code)
    except BrokenPipeError:  # whoever read the output has gone; keep the interpreter from complaining at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAULT
    except Exception as error:
        if line := _wrong_path(error, words):
            return _say(line, BAD_INPUT)
        if fault := of_the_machine(error):
            return _say(str(fault), BAD_INPUT)
        if "--traceback" in words or os.environ.get("RIGMATCH_TRACEBACK"):
            import traceback

            traceback.print_exc()
        return _say(f"a fault of rigmatch, not of your input: {_place(error)} (--traceback shows more)", FAULT)
    return ANSWERED


def build_parser(words: Sequence[str]) -> tuple[Parser, dict[str, ModuleType]]:
    """Parser for all commands, of which only the one that `words` call for is imported (help must be instant)."""
    about = (
        "Tunes a powertrain test bed until it reproduces the vehicle's response, and checks models against recordings."
    )
    tab = 'Tab in bash and zsh: eval "$(register-python-argcomplete rigmatch)"; other shells: docs/commands.md'
    parser = Parser(prog="rigmatch", description=about, epilog=tab, allow_abbrev=False)
    parser.add_argument("--version", action="version", version=f"rigmatch {VERSION}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    wanted = next((word for word in words if not word.startswith("-")), None)
    modules = {}
    for name, line in available().items():
        command = commands.add_parser(name, help=line, allow_abbrev=False, formatter_class=HelpFormatter)
        command.add_argument(
            "--json", action="store_true", help="print the result object on standard output, nothing else"
        )
        command.add_argument("--traceback", action="store_true", help="show where a fault of the program arose")
        if name == wanted:
            modules[name] = import_module(f"matching.commands.{name}")
            command.description = modules[name].HELP
            command.epilog = _examples(modules[name].EXAMPLES)
            modules[name].add_arguments(command)
            if name not in dry_run.WITHOUT:
                _add_check(command, words)
    return parser, modules


def _examples(calls: Sequence[str]) -> str:
    """Calls as one types them, one after the other, and where."""
    before = f" ({MADE_BY_MAKE_RUN} is what make run writes)" if any(MADE_BY_MAKE_RUN in call for call in calls) else ""
    return f"examples, in the program's folder{before}:\n" + "".join(f"  {call}\n" for call in calls)


def _add_check(command: argparse.ArgumentParser, words: Sequence[str]) -> None:
    """The dry run, which needs no place to write to."""
    command.add_argument(
        "--check", action="store_true", help="only read and check the input files; nothing is calculated or written"
    )
    if "--check" in words:
        for action in command._actions:
            action.required = action.required and action.dest != "out"


def _run(words: Sequence[str]) -> None:
    parser, modules = build_parser(_words_to_complete() or words)
    _offer_completion(parser)
    _check_no_empty_words(words)
    arguments = parser.parse_args(words)
    memory_limits.check()
    command = modules[arguments.command]
    if getattr(arguments, "check", False):
        command, arguments.out = dry_run, None
    with _reserved(arguments):
        text = _answer(command, arguments)
    if text:
        print(_fitted(text.rstrip("\n")), flush=True)


def _check_no_empty_words(words: Sequence[str]) -> None:
    """A path that is empty, perhaps by a variable of the shell that is not set, would name the folder one is in.

    Raises
    ------
    InputError
        Naming the first option or argument that is empty.
    """
    for number, word in enumerate(words):
        option, sign, value = word.partition("=")
        if not word or (word.startswith("--") and sign and not value):
            before = words[number - 1] if number else ""
            where = option if word else before if before.startswith("--") else f"argument {number + 1}"
            raise InputError(where, "is empty", "give a value; . names the folder you are in")


def _fitted(text: str, width: int | None = None) -> str:
    """Lines no longer than the terminal is wide, where one reads them; what goes on is set in."""
    if width is None:
        if not sys.stdout.isatty():
            return text
        width = max(shutil.get_terminal_size().columns, NARROWEST_TERMINAL)
    return "\n".join(
        line if len(line) <= width else textwrap.fill(line, width, subsequent_indent="    ", break_long_words=False)
        for line in text.split("\n")
    )


def _answer(command: ModuleType, arguments: argparse.Namespace) -> str:
    """What a command prints."""
    if arguments.json:
        from modelling.writing.output import strict_json

        with _standard_output_kept_clean():
            text: str = strict_json(command.run(arguments))
        if isinstance(sys.stdout, TextIOWrapper):
            sys.stdout.reconfigure(encoding="utf-8")  # as JSON demands
        return text
    result = command.run(arguments)
    text = terminal(str(command.summary(result))) if hasattr(command, "summary") else ""
    page = getattr(command, "PAGE", "")  # the last line of what is read says where more stands
    return f"{text.rstrip()}\nreport: {Path(arguments.out) / page}" if page else text


@contextmanager
def _reserved(arguments: argparse.Namespace) -> Iterator[None]:
    """The folder that a command writes to is this run's alone, and what the command reads stays as it is."""
    if getattr(arguments, "out", None) is None:
        yield
        return
    from modelling.common.protection import protected
    from modelling.writing.reservation import reserved

    with reserved(arguments.out, arguments.command), ExitStack() as stack:
        if arguments.command not in GO_ON_IN_PLACE:
            stack.enter_context(protected(_named(vars(arguments).values())))
        yield


def _named(values: Iterable[Any]) -> Iterator[str]:
    """The texts among the values of arguments, which may name files."""
    for value in values:
        if isinstance(value, str):
            yield value
        elif isinstance(value, list | tuple):
            yield from _named(value)


def _one_thread_for_blas() -> None:
    """Matrices here are small: more threads of OpenBLAS (read when NumPy is imported) only wait and occupy a
    core each, in worker processes too. A value that the user has set is kept."""
    if not {"OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"} & os.environ.keys():
        os.environ["OPENBLAS_NUM_THREADS"] = "1"


def _wrong_path(error: Exception, words: Sequence[str]) -> str:
    """Line for a wrong path on the command line that no reader caught; empty if the error is a fault of the program."""
    if type(error) not in WRONG_PATH or not isinstance(error, OSError):
        return ""
    if not isinstance(error.filename, str | bytes | os.PathLike):
        return ""
    wrong, right = WRONG_PATH[type(error)]
    path = Path(os.fsdecode(error.filename))
    on_command_line = [Path(word.partition("=")[2] if word.startswith("--") else word).absolute() for word in words]
    is_users = any(path.absolute() in (each, *each.parents) for each in on_command_line)
    return str(InputError(str(path), wrong, f"give {right}")) if is_users else ""


def _place(error: Exception) -> str:
    step, last = error.__traceback__, None
    while step:
        step, last = step.tb_next, step
    place = f" at {Path(last.tb_frame.f_code.co_filename).name}:{last.tb_lineno}" if last else ""
    return f"{type(error).__name__}: {_one_line(str(error)) or 'no message'}{place}"


def _say(line: str, code: int) -> int:
    print(f"rigmatch: {_one_line(line)}", file=sys.stderr)
    return code


def _one_line(text: str) -> str:
    return terminal(" ".join(text.split()))


@contextmanager
def _standard_output_kept_clean() -> Iterator[None]:
    """Send what commands, solvers in C and worker processes print to standard error instead."""
    with redirect_stdout(sys.stderr):
        sys.__stdout__.flush()  # type: ignore[union-attr]
        saved = os.dup(1)
        os.dup2(2, 1)
        try:
            yield
        finally:
            os.dup2(saved, 1)
            os.close(saved)


def _words_to_complete() -> list[str]:
    """Words on the command line so far when a shell asks for completions, else none."""
    return os.environ["COMP_LINE"].split()[1:] if "_ARGCOMPLETE" in os.environ and "COMP_LINE" in os.environ else []


def _offer_completion(parser: Any) -> None:
    if "_ARGCOMPLETE" in os.environ:  # asked by a shell; otherwise the import would only cost time
        import argcomplete

        argcomplete.autocomplete(parser)
