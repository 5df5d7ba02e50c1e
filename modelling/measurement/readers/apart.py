"""Reading by libraries in C that a damaged file may crash, let run on or fill the memory: in a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Collection, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from modelling.common.errors import InputError
from modelling.measurement.readers import child
from modelling.measurement.readers.table import Table

SECONDS, BYTES_PER_SECOND = 120.0, 5e6  # time to read: at least, and by the file's size
BYTES, FILE_SIZES = 4_000_000_000, 30  # memory to read: at least, and by the file's size; compressed ones are larger
DAMAGED = "it is probably damaged: save it again, or as CSV"


def read(
    reader: str, path: Path, used: Collection[str] | None, options: Mapping[str, Any], least_bytes: int = BYTES
) -> Table:
    """What ``read`` of the module ``reader`` returns, for which see there.

    Raises
    ------
    InputError
        As the reader; and if it crashes, takes too long or needs too much memory.
    ModuleNotFoundError, FileNotFoundError
        If the reader needs a package that is missing; if there is no such file.
    """
    size = path.stat().st_size
    seconds, most = SECONDS + size / BYTES_PER_SECOND, least_bytes + FILE_SIZES * size
    request = {
        "reader": reader, "path": str(path), "used": None if used is None else sorted(used), "options": dict(options),
        "bytes": most,
    }  # fmt: skip
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    environment = os.environ | one_thread | {
        "PYTHONPATH": os.pathsep.join(sys.path), "ARROW_DEFAULT_MEMORY_POOL": "system"
    }  # fmt: skip
    with ExitStack() as until_read:
        with suppress(OSError):  # the reader of MDF leaves files there
            environment["TMPDIR"] = until_read.enter_context(TemporaryDirectory(prefix="rigmatch-"))
        try:
            done = subprocess.run(
                [sys.executable, "-P", "-m", child.__name__],
                input=json.dumps(request).encode(), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment,
                timeout=seconds, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise InputError(str(path), f"is not read within {seconds:.0f} s", DAMAGED) from None
    return _table(done, path, most)


def _table(done: subprocess.CompletedProcess[bytes], path: Path, most: int) -> Table:
    line, _, numbers = done.stdout.partition(b"\n")
    if not line or done.returncode:
        raise InputError(str(path), f"the library that reads it crashed ({_end(done.returncode)})", DAMAGED)
    head = json.loads(line)
    if "wrong" in head:
        raise InputError(*head["wrong"])
    if "needs" in head:
        raise ModuleNotFoundError(name=head["needs"])
    if "memory" in head:
        raise InputError(str(path), f"needs more than {most / 1e9:.1f} GB to be read", DAMAGED)
    values = np.frombuffer(numbers, dtype=np.float64).reshape(head["shape"]).copy()
    return Table(head["names"], head["units"], values, notes=tuple(head["notes"]), others=tuple(head["others"]))


def _end(code: int) -> str:
    """How a process ended."""
    if code >= 0:
        return f"exit {code}"
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"
