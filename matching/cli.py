"""The command line: `rigmatch COMMAND …`.

Exit 0: answered, as predicted; 3: a defect of the bed was found; 2: wrong input, one line; 1: a fault of the program.
"""

from __future__ import annotations

import argparse
import contextlib
import mmap
import os
import re
import shutil
import signal
import sys
import textwrap
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from difflib import get_close_matches
from functools import partial
from io import TextIOWrapper
from pathlib import Path
from typing import Any, NoReturn

from matching.arguments import add_arguments, described
from matching.commands import COMMANDS, REQUIRED, Command, calls
from modelling.errors import ANSWERED, BAD_INPUT, DEFECT, FAULT, VERSION, FitError, InputError, NoDesign, of_the_machine
from modelling.escape import terminal
from modelling.resources import end_early, ended_early_by, tell_ends_early
from modelling.toml import line_of

# PYTHON_ARGCOMPLETE_OK

WITHOUT = ("new", "export", "explore")  # commands without --check: they read no file, or do little else
ABOUT = "Tunes a powertrain test bed until it reproduces the vehicle's response; checks models against recordings."
HELP_AND_TAB = """rigmatch COMMAND --help explains a command.
Tab in bash and zsh: eval "$(register-python-argcomplete rigmatch)"; other shells: docs/commands.md"""
MADE_BY_MAKE_RUN = "out/road_to_rig"  # what examples of help take as there
NARROWEST_TERMINAL = 40  # columns
REPORT = "report.html"  # the page of a command, next to which others may stand
GO_ON_IN_PLACE = ("explore", "commission")  # commands that write to files they read


class HelpFormatter(argparse.HelpFormatter):
    """Help that wraps paragraphs and leaves the lines of examples as they are."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if text.startswith(("examples,", "begin,")):
            return text
        return "\n\n".join(super(HelpFormatter, self)._fill_text(part, width, indent) for part in text.split("\n\n"))


class Parser(argparse.ArgumentParser):
    """Argument parser that says what is wrong in one line; ``words`` are those on the command line."""

    words: Sequence[str] = ()

    def error(self, message: str) -> NoReturn:
        """Print one line on standard error and exit with 2."""
        near = self._nearest(message)
        self.exit(BAD_INPUT, f"{self.prog}: {_one_line(message)}; {near}see {self.prog} --help\n")

    def _nearest(self, message: str) -> str:
        """``did you mean …?`` for a command or an option that does not exist."""
        if wrong := re.match(r"argument COMMAND: invalid choice: '(.*?)'", message):
            known = list(COMMANDS)
        elif wrong := re.match(r"unrecognized arguments: (--[\w-]+)", message):
            known = self._flags()
        elif "are required" in message:  # perhaps because the option was misspelt
            known, given = self._flags(), " ".join(word.partition("=")[0] for word in self.words)
            wrong = next((found for found in re.finditer(r"(--[\w-]+)", given) if found[1] not in known), None)
        near = get_close_matches(wrong[1], known, 1, 0.6) if wrong else []
        whose = f" instead of {wrong[1]!r}" if wrong and "are required" in message else ""
        return f"did you mean {near[0]!r}{whose}? " if near else ""

    def _flags(self) -> list[str]:
        return [flag for action in self._all_actions() for flag in action.option_strings]

    def _all_actions(self) -> list[argparse.Action]:
        """Those of the parser and of its commands."""
        actions = list(self._actions)
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                actions += [each for command in action.choices.values() for each in command._actions]
        return actions


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; its exit code: 0 answered, 2 bad input, 1 fault of the program, 130 or 143 interrupted."""
    _one_thread_for_blas()
    words = list(sys.argv[1:] if argv is None else argv)
    warnings.formatwarning = lambda message, *_: f"rigmatch: note: {_one_line(str(message))}\n"
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # units and Greek letters must not fail on a terminal that lacks them
            stream.reconfigure(errors="backslashreplace")
    try:
        code = _run(words)
    except SystemExit as end:  # --help, --version and wrong arguments
        return int(end.code or 0)
    except InputError as error:
        number = line_of(error.where, error.wrong)
        return _say(f"{error} (line {number})" if number else str(error), BAD_INPUT)
    except (FitError, NoDesign) as error:
        return _say(str(error), BAD_INPUT)
    except KeyboardInterrupt as interrupt:
        number = interrupt.args[0] if interrupt.args else signal.SIGINT
        return _say(_ended_by(number), 128 + number)
    except BrokenPipeError:  # whoever read the output has gone; keep the interpreter from complaining at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAULT
    except Exception as error:
        if line := str(of_the_machine(error) or "") or _wrong_path(error, words):
            return _say(line, BAD_INPUT)
        if "--traceback" in words or os.environ.get("RIGMATCH_TRACEBACK"):
            import traceback

            traceback.print_exc()
        return _say(f"a fault of rigmatch, not of your input: {_place(error)} (--traceback shows more)", FAULT)
    if number := ended_early_by():
        return _say(f"{_ended_by(number)}; this is the best answer so far", 128 + number)
    return code


def build_parser(words: Sequence[str]) -> Parser:
    """Parser for all commands; only the one that ``words`` call for gets its arguments (help must be instant)."""
    parser = Parser(
        prog="rigmatch", usage="rigmatch COMMAND …", description=ABOUT, epilog=_commands_in_groups(),
        allow_abbrev=False, formatter_class=HelpFormatter,
    )  # fmt: skip
    parser.add_argument("--version", action="version", version=f"rigmatch {VERSION}")
    commands = parser.add_subparsers(
        dest="command", metavar="COMMAND", required=True, help=argparse.SUPPRESS, prog="rigmatch"
    )
    wanted = next((word for word in words if not word.startswith("-")), None)
    for name, known in COMMANDS.items():
        if name != wanted:
            commands.add_parser(name, add_help=False)
            continue
        command = commands.add_parser(
            name, allow_abbrev=False, formatter_class=HelpFormatter, epilog=_examples(calls(name)),
            description=described(known.function).text,
        )  # fmt: skip
        command.words = words
        add_arguments(command, known.function, known.required, known.hidden)
        if known.out is not None:
            at = "" if known.out == REQUIRED else "; without it nothing is written"
            command.add_argument("--out", metavar="DIR", help=f"directory to write to{at}", required=not at)
        if known.further:
            known.further(command)
        command.add_argument("--json", action="store_true", help="print the result object and nothing else")
        command.add_argument("--traceback", action="store_true", help="show where a fault of the program arose")
        if name not in WITHOUT:
            _add_check(command, words)
    return parser


def _commands_in_groups() -> str:
    """The commands in the order of work, with their first lines of help."""
    lines, group = [], ""
    for name, known in COMMANDS.items():
        if known.group != group:
            group = known.group
            lines += ["", f"{group}:"]
        lines.append(f"  {name:12}{described(known.function).line}")
    return "\n".join([*lines[1:], "", HELP_AND_TAB])


def _examples(shown: Sequence[str]) -> str:
    """Calls as one types them, one after the other, and where."""
    before = f" ({MADE_BY_MAKE_RUN} is what make run writes)" if any(MADE_BY_MAKE_RUN in call for call in shown) else ""
    return f"examples, in the program's folder{before}:\n" + "".join(f"  {call}\n" for call in shown)


def _add_check(command: argparse.ArgumentParser, words: Sequence[str]) -> None:
    """The dry run, which needs no place to write to."""
    command.add_argument(
        "--check", action="store_true", help="only read and check the input files; nothing is calculated or written"
    )
    if "--check" in words:
        for action in command._actions:
            action.required = action.required and action.dest != "out"


def _run(words: Sequence[str]) -> int:
    """Run a command and print its answer; the exit code."""
    parser = build_parser(_words_to_complete() or words)
    _offer_completion(parser)
    _check_no_empty_words(words)
    arguments = parser.parse_args(words)
    command = COMMANDS[arguments.command]
    if getattr(arguments, "check", False):
        arguments.out = None
        command = Command(command.group, command.function, partial(_only_read, command), summary=_contents, out=None)
    with _inputs_kept(arguments):
        text, code = _answer(command, arguments)
    if text:
        print(_fitted(text.rstrip("\n")), flush=True)
    return code


def _only_read(command: Command, arguments: argparse.Namespace) -> dict[str, Any]:
    """What the files of a command hold, by file: nothing is calculated or written."""
    from matching.dry_run import dry_run

    with dry_run() as contents:
        command.run(arguments)
    return {"checked": contents}


def _contents(result: dict[str, Any]) -> str:
    return "\n".join(f"{file}: {content}" for file, content in result["checked"].items())


def _check_no_empty_words(words: Sequence[str]) -> None:
    """A path that is empty, perhaps by a variable of the shell that is not set, would name the folder one is in."""
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


def _answer(command: Command, arguments: argparse.Namespace) -> tuple[str, int]:
    """What a command prints, and its exit code."""
    if arguments.json:
        from modelling.writing import strict_json

        with _standard_output_kept_clean():
            result = command.run(arguments)
            text: str = strict_json(result)
        if isinstance(sys.stdout, TextIOWrapper):
            sys.stdout.reconfigure(encoding="utf-8")  # as JSON demands
        return text, DEFECT if command.defect(result) else ANSWERED
    result = command.run(arguments)
    text = terminal(command.told(result, arguments))
    pages = [name for name in result.get("files", ()) if name.endswith(".html")]
    page = next((name for name in pages if Path(name).name == REPORT), pages[0] if pages else "")
    code = DEFECT if command.defect(result) else ANSWERED
    return f"{text.rstrip()}\nreport: {Path(arguments.out) / page}" if page else text, code


@contextmanager
def _inputs_kept(arguments: argparse.Namespace) -> Iterator[None]:
    """What the command reads stays as it is, and the folder that it writes to can be written to."""
    if getattr(arguments, "out", None) is None:
        yield
        return
    from modelling.writing import check_writable, inputs_kept

    check_writable(arguments.out)
    if arguments.command in GO_ON_IN_PLACE:
        yield
        return
    with inputs_kept(_named(vars(arguments).values())):
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
    """Line for a path on the command line that the operating system refuses; empty for any other error."""
    if not isinstance(error, OSError) or not isinstance(error.filename, str | bytes | os.PathLike):
        return ""
    path = Path(os.fsdecode(error.filename))
    on_command_line = [Path(word.partition("=")[2] if word.startswith("--") else word).absolute() for word in words]
    is_users = any(path.absolute() in (each, *each.parents) for each in on_command_line)
    return str(InputError(str(path), (error.strerror or "fails").lower(), "give another path")) if is_users else ""


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


# --- The command in a process of its own, so that Ctrl-C also ends native code and worker processes

GRACE_SECONDS = 0.5  # from a signal until the command is killed
WRITING_SECONDS = 120.0  # the same of a command that ends with the best answer so far: its figures take some
ENDING_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of Linux's prctl


def supervised(command: Callable[[], int]) -> int:
    """Run a command in a process of its own; its exit code, or 128 and the signal's number if a signal ended it.

    Native code notices Ctrl-C late, and a library may swallow it. The parent passes a signal on and kills the command
    and its worker processes, which are one session, half a second later. A command that can answer with what it has is
    given the time to write it; a second signal kills it at once.
    """
    if "_ARGCOMPLETE" in os.environ or sys.platform == "win32":  # where Ctrl-C reaches every process of a console
        return command()
    parent = os.getpid()
    can_end_early = mmap.mmap(-1, 1)  # shared with the child
    # Held back until both processes have their handlers: the command may be signalled before its parent is ready.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING_SIGNALS)
    try:
        child = os.fork()
    except OSError as error:  # no further process is allowed
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        return _say(str(of_the_machine(error) or error), BAD_INPUT)
    if child == 0:
        os.setsid()
        with contextlib.suppress(ImportError, OSError, AttributeError):  # not on Linux
            import ctypes

            ctypes.CDLL(None).prctl(DIE_WITH_PARENT, signal.SIGKILL, 0, 0, 0)
        tell_ends_early(lambda can: can_end_early.__setitem__(0, int(can)))
        for number in ENDING_SIGNALS:
            signal.signal(number, _interrupt)  # also where the caller ignores them: the parent passes on what counts
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        return command() if os.getppid() == parent else FAULT
    asked: list[int] = []

    def pass_on(number: int, _frame: Any) -> None:
        if asked and can_end_early[0]:
            _kill_session(child)
        if not asked:
            signal.setitimer(signal.ITIMER_REAL, WRITING_SECONDS if can_end_early[0] else GRACE_SECONDS)
        asked.append(number)
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, number)

    signal.signal(signal.SIGALRM, lambda *_: _kill_session(child))
    for number in ENDING_SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, pass_on)
    signal.pthread_sigmask(signal.SIG_SETMASK, before)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    signal.setitimer(signal.ITIMER_REAL, 0)
    _kill_session(child)  # worker processes that are left
    if asked and code < 0:
        print("\r", end="", file=sys.stderr)  # over a progress bar that was cut short
        return _say(_ended_by(asked[0]), 128 + asked[0])
    if code == -signal.SIGKILL:
        line = "killed from outside, perhaps because memory ran out; results are whole or not there: run it again"
        return _say(f"{line} (map and tolerance go on from what they had finished)", 128 + signal.SIGKILL)
    if code < 0:
        name = signal.strsignal(-code) or f"signal {-code}"
        return _say(f"a fault of rigmatch or of a library, not of your input: {name.lower()}", FAULT)
    return code


def _interrupt(number: int, _frame: Any) -> None:
    if end_early(number):
        _say(f"{_ended_by(number)}: ends with the best answer so far; once more ends at once", 0)
        return
    for each in ENDING_SIGNALS:  # a second signal must not disturb the clearing up after the first
        signal.signal(each, signal.SIG_IGN)
    raise KeyboardInterrupt(number)


def _ended_by(number: int) -> str:
    return "interrupted" if number == signal.SIGINT else f"ended by {signal.Signals(number).name}"


def _kill_session(leader: int) -> None:
    if sys.platform != "win32":
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(leader, signal.SIGKILL)
