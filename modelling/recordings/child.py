"""A process of its own that reads one file with a library in C: a damaged file may crash, stall or fill that process.

:func:`read_in_child` starts it. Its standard input holds the request, its standard output the answer: a line of JSON,
then the numbers of one column after the other.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from modelling.errors import InputError
from modelling.recordings.readers import reader_of
from modelling.recordings.table import Column, Table

LEAST_SECONDS, BYTES_PER_SECOND = 120.0, 5e6  # time limit: at least, and by the file's size
LEAST_BYTES, FILE_SIZES = 4_000_000_000, 30  # memory limit: at least, and in file sizes (files may be compressed)
DAMAGED = "it is probably damaged: save it again, or as CSV"


def read_in_child(path: Path, used: Collection[str] | None, options: Mapping[str, Any]) -> Table:
    """The table that the reader of this file makes.

    Raises
    ------
    InputError
        If the file is not right; if reading it crashes, takes too long or needs too much memory.
    ModuleNotFoundError, FileNotFoundError
        If the reader needs a package that is missing; if there is no such file.
    """
    size = path.stat().st_size
    seconds, most = LEAST_SECONDS + size / BYTES_PER_SECOND, LEAST_BYTES + FILE_SIZES * size
    request = {"path": str(path), "used": used if used is None else sorted(used), "options": options, "bytes": most}
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(sys.path), "ARROW_DEFAULT_MEMORY_POOL": "system",
        "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1",
    }  # fmt: skip
    with TemporaryDirectory(prefix="rigmatch-") as temporary:  # asammdf leaves files there
        try:
            done = subprocess.run(
                [sys.executable, "-P", "-m", __name__], input=json.dumps(request).encode(), capture_output=True,
                env=environment | {"TMPDIR": temporary}, timeout=seconds, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise InputError(str(path), f"is not read within {seconds:.0f} s", DAMAGED) from None
    line, _, numbers = done.stdout.partition(b"\n")
    if not line or done.returncode:
        code = done.returncode
        end = signal.Signals(-code).name if code < 0 and -code in set(signal.Signals) else f"exit {code}"
        raise InputError(str(path), f"the library that reads it crashed ({end})", DAMAGED)
    head = json.loads(line)
    if "wrong" in head:
        raise InputError(*head["wrong"])
    if "needs" in head:
        raise ModuleNotFoundError(name=head["needs"])
    if "memory" in head:
        raise InputError(str(path), f"needs more than {most / 1e9:.1f} GB to be read", DAMAGED)
    values = np.frombuffer(numbers, dtype=np.float64).reshape(len(head["columns"]), -1).copy()
    columns = [Column(name, unit, own) for (name, unit), own in zip(head["columns"], values, strict=True)]
    return Table(tuple(columns), notes=tuple(head["notes"]), others=tuple(head["others"]))


def _answer(request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
    """The table as text and numbers, or the line that says why there is none."""
    path = Path(request["path"])
    try:
        table = reader_of(path)(path, request["used"], **request["options"])
    except InputError as error:
        return {"wrong": [error.where, error.wrong, error.right]}, b""
    except ModuleNotFoundError as error:
        return {"needs": error.name}, b""
    except MemoryError:
        return {"memory": True}, b""
    except OSError as error:
        return {"wrong": [str(path), error.strerror or "cannot be read", "name a readable file"]}, b""
    head = {"columns": [(column.name, column.unit) for column in table.columns]}
    numbers = b"".join(np.ascontiguousarray(column.values, dtype=np.float64).tobytes() for column in table.columns)
    return head | {"notes": table.notes, "others": table.others}, numbers


def main() -> None:
    """Read the request, obey its memory limit, write the answer; what a library prints goes nowhere."""
    output = os.fdopen(os.dup(1), "wb")
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    request = json.load(sys.stdin)
    with suppress(ImportError, ValueError):  # Windows; a lower limit of the caller stays
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (request["bytes"], resource.getrlimit(resource.RLIMIT_AS)[1]))
        resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    head, numbers = _answer(request)
    output.write(json.dumps(head).encode() + b"\n" + numbers)
    output.flush()


if __name__ == "__main__":
    main()
    os._exit(0)  # a library may crash while it is taken down: the answer is out
