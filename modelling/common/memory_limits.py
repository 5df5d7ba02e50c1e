"""Too little memory: limits are read before libraries are loaded, and a thread that gets none ends the program.

Below what its libraries need OpenBLAS asks for memory for ever, workers wait for threads that are gone, and modules
fail in odd ways; so a limit that leaves no room is an error at once.
"""

from __future__ import annotations

import os
import sys
import threading
from contextlib import suppress

from modelling.common.errors import BAD_INPUT, InputError, of_the_machine

LEAST_BYTES = 1_000_000_000  # of addresses; a match with its libraries and their threads' stacks takes 0.8e9 to 0.9e9


def check() -> None:
    """Refuse a limit on memory that leaves no room for the libraries.

    Raises
    ------
    InputError
        Naming the limit, which is smaller than :data:`LEAST_BYTES`.
    """
    with suppress(ImportError):  # Windows has none
        import resource

        for name, limit in (("ulimit -v", resource.RLIMIT_AS), ("ulimit -d", resource.RLIMIT_DATA)):
            allowed = resource.getrlimit(limit)[0]
            if allowed != resource.RLIM_INFINITY and allowed < LEAST_BYTES:
                raise InputError(
                    f"this machine: {name}",
                    f"{allowed / 1e6:.0f} MB are allowed, too few for the libraries",
                    f"allow at least {LEAST_BYTES / 1e6:.0f} MB ({name} {-(-LEAST_BYTES // 1024)})",
                )


def end_where_a_thread_has_none() -> None:
    """From now on a thread that ends without memory ends the program with one line: others would wait for it."""
    as_before = threading.excepthook

    def ended(end: threading.ExceptHookArgs) -> None:
        line = of_the_machine(end.exc_value) if end.exc_value else None
        if line is None:
            as_before(end)
            return
        print(f"rigmatch: {line}", file=sys.stderr, flush=True)
        os._exit(BAD_INPUT)

    threading.excepthook = ended
