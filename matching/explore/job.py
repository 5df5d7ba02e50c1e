"""A command of rigmatch in a process of its own, as a terminal would run it: its progress is read, it can be ended."""

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
from pathlib import Path
from typing import Any

from matching.arguments import PROGRESS_ALWAYS

ROOT = Path(__file__).parents[2]  # where `matching` is imported from, installed or not


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code, the result object where it answered, else its last line on standard error."""

    code: int
    result: dict[str, Any]
    line: str

    @property
    def cancelled(self) -> bool:
        """Whether it was asked to end."""
        return self.code in (128 + signal.SIGINT, 128 + signal.SIGTERM)


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
            [sys.executable, "-m", "matching", *words, "--json"],
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
        """How it ended, when it has.

        Raises
        ------
        TimeoutError
            If it is still running after so many seconds.
        """
        self._reader.join(seconds)
        if self._ended is None:
            raise TimeoutError(f"{self.words[0]} is still running")
        return self._ended

    def _follow(self) -> None:
        answer = threading.Thread(target=self._take_answer, daemon=True)
        answer.start()
        assert self._process.stderr is not None
        line = b""
        while piece := self._process.stderr.read1(4096):  # type: ignore[attr-defined]
            *lines, line = (line + piece).replace(b"\r", b"\n").split(b"\n")
            for each in filter(None, (text.decode(errors="replace").strip() for text in lines)):
                self._last_line = each
                self._tell(each)
            if text := line.decode(errors="replace").strip():  # a bar of progress ends its line when the next begins
                self._tell(text)
        answer.join()
        code = self._process.wait()
        self._process.stderr.close()
        if line.strip():
            self._last_line = line.decode(errors="replace").strip()
        result = json.loads(self._out) if code == 0 else {}
        self._ended = Ended(code, result, "" if code == 0 else self._last_line.removeprefix("rigmatch: "))
        self._done(self._ended)

    def _take_answer(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as stream:
            self._out = stream.read()
