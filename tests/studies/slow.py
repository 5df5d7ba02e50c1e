"""Work for the tests of studies: it takes a while, and counts how often a worker prepared itself."""

import os
import time


def prepare(given):
    return {"given": given, "prepared": time.monotonic_ns(), "pid": os.getpid()}


def square(prepared, chunk):
    time.sleep(1000 if os.environ.get("SLOW_STOPS_AT") == str(chunk) else prepared["given"])  # 1000: until it is killed
    return {"square": chunk**2, "prepared": prepared["prepared"], "pid": prepared["pid"]}
