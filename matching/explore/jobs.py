"""Commands that run beside the page: each in a process of its own, with its progress, until it ends or is cancelled."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any

import panel as pn

from matching.explore.elements import Message, paragraph, plain_button
from matching.progress import PROGRESS_ALWAYS
from modelling.errors import ANSWERED, DEFECT, FAULT, InputError

# --- A command of rigmatch in a process of its own, as a terminal would run it: its progress is read, it can be ended.

ROOT = Path(__file__).parents[2]  # where `matching` is imported from, installed or not


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code, the result object where it answered, else its last line on standard error."""

    code: int
    result: dict[str, Any]
    line: str

    @property
    def answered(self) -> bool:
        """Whether it has a result; a defect that was found on the bed is one."""
        return self.code in (ANSWERED, DEFECT)

    @property
    def cancelled(self) -> bool:
        """Whether it was asked to end."""
        return self.code in [own for number in (signal.SIGINT, signal.SIGTERM) for own in (128 + number, -number)]


class Job:
    """A running command.

    Parameters
    ----------
    words : sequence of str
        As on the command line, without ``rigmatch`` and ``--json``.
    tell : callable of str, optional
        Called from another thread with every line of progress.
    done : callable of Ended, optional
        Called from that thread when it has ended.
    """

    def __init__(
        self,
        words: Sequence[str],
        tell: Callable[[str], None] | None = None,
        done: Callable[[Ended], None] | None = None,
    ):
        self.words = tuple(words)
        self._tell, self._done = tell or (lambda _: None), done or (lambda _: None)
        self._last_line, self._out = "", b""
        paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "matching", *words, "--json"],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": paths, PROGRESS_ALWAYS: "1"},
        )  # fmt: skip
        self._ended: Ended | None = None
        self._reader = threading.Thread(target=self._follow, daemon=True)
        self._reader.start()

    @property
    def running(self) -> bool:
        """Whether it has not ended yet."""
        return self._ended is None

    def cancel(self) -> None:
        """Ask it to end, and return at once; nothing of its results is left half written."""
        if self._process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                self._process.send_signal(signal.SIGTERM)

    def wait(self, seconds: float | None = None) -> Ended:
        """How it ended, when it has."""
        self._reader.join(seconds)
        if self._ended is None:
            raise TimeoutError(f"{self.words[0]} is still running")
        return self._ended

    def _follow(self) -> None:
        """Read until the command has ended; whatever it writes, it counts as ended then."""
        try:
            self._read()
            code = self._process.wait()
            answered = code in (ANSWERED, DEFECT)
            result = json.loads(self._out) if answered else {}
            line = "" if answered else self._last_line.removeprefix("rigmatch: ")
        except (OSError, ValueError) as fault:
            self._process.kill()
            code, result, line = FAULT, {}, f"{self.words[0]} gave no answer that can be read ({fault})"
        self._ended = Ended(code, result, line)
        self._done(self._ended)

    def _read(self) -> None:
        answer = threading.Thread(target=self._take_answer, daemon=True)
        answer.start()
        assert self._process.stderr is not None
        line = b""
        with self._process.stderr as stream:
            while piece := stream.read1(4096):  # type: ignore[attr-defined]
                *lines, line = (line + piece).replace(b"\r", b"\n").split(b"\n")
                for each in filter(None, (text.decode(errors="replace").strip() for text in lines)):
                    self._last_line = each
                    self._tell(each)
                if text := line.decode(errors="replace").strip():  # a line of progress ends when the next begins
                    self._tell(text)
        answer.join()
        if line.strip():
            self._last_line = line.decode(errors="replace").strip()

    def _take_answer(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as stream:
            self._out = stream.read()


# --- The commands of the program: every window shows them, also one that is opened or loaded again meanwhile.


class Task:
    """A command that runs or has ended, and the windows that follow it.

    Attributes
    ----------
    line : str
        What it said last.
    ended : Ended or None
        How it ended; None as long as it runs.
    """

    def __init__(self, words: Sequence[str]):
        self.line = f"{words[0]} is running …"
        self.ended: Ended | None = None
        self._begun, self._followers, self._lock = monotonic(), list[Callable[[], None]](), threading.Lock()
        self.job = Job(words, self._told, self._done)

    @property
    def seconds(self) -> float:
        """How long it has been running."""
        return monotonic() - self._begun

    def follow(self, heard: Callable[[], None]) -> None:
        """Call ``heard`` now, after every line and at the end, mostly from another thread."""
        with self._lock:
            self._followers.append(heard)
        heard()

    def forget(self, heard: Callable[[], None]) -> None:
        """Call it no longer."""
        with self._lock:
            self._followers = [each for each in self._followers if each is not heard]

    def _told(self, line: str) -> None:
        self.line = line
        self._tell_all()

    def _done(self, ended: Ended) -> None:
        self.ended = ended
        self._tell_all()

    def _tell_all(self) -> None:
        with self._lock:
            followers = list(self._followers)
        for heard in followers:
            heard()


Tasks = dict[str, Task]  # of a program, by the name of what they do: one at a time

# --- Buttons that run a command, show its progress and cancel it.

TICK_MS = 1000  # between two times that a running command is said to be running for
RESULTS = "results"  # part of the address below which the folder of results is served


class Runner:
    """A button to run, one to cancel, and a line of progress.

    Parameters
    ----------
    name : str
        On the button.
    tasks : dict of str to Task
        The commands of the program; under the button's name stands the one that it began, in whichever window.
    words : callable
        The command line when the button is pressed; may raise ``InputError``, which is shown.
    done : callable
        Shows what the command answered.
    """

    def __init__(self, name: str, tasks: Tasks, words: Callable[[], Sequence[str]], done: Callable[[Ended], None]):
        self._name, self._tasks, self._words, self._done = name, tasks, words, done
        self.run = pn.widgets.Button(name=name, button_type="primary", width=190)
        self.cancel = plain_button("Cancel", visible=False)
        self.message = Message()
        self.clock = paragraph("")  # apart from the message, which is read out whenever it changes
        self.run.on_click(lambda _: self.start())
        self.cancel.on_click(lambda _: self.stop())

    @property
    def job(self) -> Job | None:
        """The process that it began last."""
        task = self._tasks.get(self._name)
        return None if task is None else task.job

    def panel(self) -> Any:
        """*Cancel* and the line of progress, without the button; a command that runs or has ended is shown."""
        if self._name in self._tasks:
            self._follow(self._tasks[self._name])
        return pn.FlexBox(self.message, self.clock, self.cancel, align_items="center", sizing_mode="stretch_width")

    def start(self) -> None:
        """Run the command, unless another window has begun it."""
        task = self._tasks.get(self._name)
        if task is None or task.ended is not None:
            try:
                words = self._words()
            except InputError as error:
                self.message.say(str(error), wrong=True)
                return
            task = self._tasks[self._name] = Task(words)
        self._follow(task)

    def stop(self) -> None:
        """Ask the command to end."""
        if self.job is not None:
            self.job.cancel()

    def _follow(self, task: Task) -> None:
        page = pn.state.curdoc
        end_ticks: Callable[[], None] = lambda: None  # noqa: E731  # replaced below
        if page is not None and task.ended is None:
            ticks = page.add_periodic_callback(lambda: self._tick(task), TICK_MS)
            end_ticks = partial(page.remove_periodic_callback, ticks)

        def show() -> None:
            if task.ended is None:
                self.run.disabled, self.cancel.visible = True, True
                self.message.say(task.line)
                return
            task.forget(heard)
            end_ticks()
            self._show_end(task.ended)

        def heard() -> None:
            if page is None:
                show()
            else:  # the page's own thread; a window that was closed hears nothing
                with contextlib.suppress(RuntimeError):
                    page.add_next_tick_callback(show)

        if page is not None:
            page.on_session_destroyed(lambda _: task.forget(heard))
        task.follow(heard)

    def _tick(self, task: Task) -> None:
        self.clock.object = f"<p>running for {task.seconds:.0f} s</p>"

    def _show_end(self, ended: Ended) -> None:
        self.clock.object = ""
        self.run.disabled, self.cancel.visible = False, False
        if ended.cancelled:
            self.message.say("cancelled; nothing was written")
        elif not ended.answered:
            self.message.say(ended.line, wrong=True)
        else:
            self.message.say("done")
            self._done(ended)


def address_of(file: Path, out: Path) -> str:
    """Address of a file in the folder of results, from the page; another one for every version of it.

    A browser shows a page that it has under the same address again.
    """
    address = f"{RESULTS}/{file.relative_to(out).as_posix()}"
    return f"{address}?at={file.stat().st_mtime_ns}" if file.exists() else address
