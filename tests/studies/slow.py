"""Work for the tests of studies: it takes a while, and counts how often a worker prepared itself."""

import os
import signal
import time
from pathlib import Path


def prepare(given):
    return {"given": given, "prepared": time.monotonic_ns(), "pid": os.getpid()}


def square(prepared, chunk):
    time.sleep(1000 if os.environ.get("SLOW_STOPS_AT") == str(chunk) else prepared["given"])  # 1000: until it is killed
    return {"square": chunk**2, "prepared": prepared["prepared"], "pid": prepared["pid"]}


def once(prepared, chunk):
    """Kills its process where the chunk is a path, the first time; always where it is ``always``."""
    if chunk == "always" or (isinstance(chunk, str) and not Path(chunk).exists()):
        if chunk != "always":
            Path(chunk).write_text("1")
        os.kill(os.getpid(), signal.SIGKILL)
    return chunk
