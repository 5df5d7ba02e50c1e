"""The processor's floating-point state, which some compiled libraries change for the whole process."""

from __future__ import annotations

import contextlib
import ctypes


def restore() -> None:
    """Go back to IEEE 754 as a process starts with it: numbers below 2.2e-308 are no longer flushed to zero.

    Libraries built with -ffast-math switch that on for the thread that loads or calls them. Where the C library does
    not offer ``fesetenv`` with its default environment, nothing happens.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).fesetenv(ctypes.c_void_p(-1))
