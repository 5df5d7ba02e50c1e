"""A process of its own that reads one file: ``python -m modelling.measurement.readers.child``, started by ``apart``.

Standard input holds the request, standard output the answer; what a library prints besides goes nowhere.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from modelling.common.errors import InputError


def limit(name: str, amount: int) -> None:
    """Limit a resource of this process, where the system can."""
    try:
        import resource
    except ImportError:  # Windows
        return
    kind = getattr(resource, name)
    _, most = resource.getrlimit(kind)
    if most == resource.RLIM_INFINITY or amount < most:
        resource.setrlimit(kind, (amount, most))


def answer(request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
    """The table as text and numbers, or in place of it the line that says why not."""
    path = Path(request["path"])
    try:
        reader = importlib.import_module(request["reader"])
        table = reader.read(path, request["used"], **request["options"])
    except InputError as error:
        return {"wrong": [error.where, error.wrong, error.right]}, b""
    except ModuleNotFoundError as error:
        return {"needs": error.name}, b""
    except MemoryError:
        return {"memory": True}, b""
    except OSError as error:
        return {"wrong": [str(path), error.strerror or "cannot be read", "name a readable file"]}, b""
    values = np.ascontiguousarray(table.values, dtype=np.float64)
    description = {name: list(getattr(table, name)) for name in ("names", "units", "notes", "others")}
    return description | {"shape": values.shape}, values.tobytes()


def main(output: BinaryIO) -> None:
    """Read the request, obey its limits, write the answer: a line of JSON, then the numbers as they lie in memory."""
    request = json.load(sys.stdin)
    limit("RLIMIT_AS", request["bytes"])
    limit("RLIMIT_CORE", 0)
    head, numbers = answer(request)
    output.write(json.dumps(head).encode() + b"\n")
    output.write(numbers)
    output.flush()


if __name__ == "__main__":
    channel = os.fdopen(os.dup(1), "wb")
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    main(channel)
    os._exit(0)  # a library may crash while it is taken down: the answer is out
