"""Processes that a test starts: with default signals, in a group of their own, and ended with the test."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

END_SECONDS = 20  # at most, for what was killed; it takes milliseconds
# Whoever runs the tests in the background ignores SIGINT, and every process below inherits that.
DEFAULT_SIGNALS = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.SIG_DFL)
signal.signal(signal.SIGTERM, signal.SIG_DFL)
os.execv(sys.argv[1], sys.argv[1:])
"""


@contextmanager
def started(words: Sequence[str], **options: Any) -> Iterator[subprocess.Popen]:
    """A process as from a terminal; at the end all of its group is killed, and waited for until a limit."""
    command = [sys.executable, "-I", "-S", "-c", DEFAULT_SIGNALS, *words]
    process = subprocess.Popen(command, start_new_session=True, **options)
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait(END_SECONDS)
        for stream in (process.stdin, process.stdout, process.stderr):
            if stream is not None:
                stream.close()
