"""A process of its own that reads one file with a library in C, which a damaged file may crash, stall or fill.

:func:`modelling.recordings.readers.read_in_child` starts it. Standard input holds the request, standard output the
answer, a line of JSON; the numbers go into the file that the request names, as they lie in memory, column by column.
"""

from __future__ import annotations

import json
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from modelling.errors import InputError
from modelling.recordings.readers import reader_of


def _answer(request: dict[str, Any]) -> dict[str, Any]:
    """The table without its numbers, which are written, or why there is none."""
    path = Path(request["path"])
    try:
        table = reader_of(path)(path, request["used"], **request["options"])
    except InputError as error:
        return {"wrong": [error.where, error.wrong, error.right]}
    except ModuleNotFoundError as error:
        return {"needs": error.name}
    except MemoryError:
        return {"memory": True}
    except OSError as error:
        return {"wrong": [str(path), error.strerror or "cannot be read", "name a readable file"]}
    head = {"columns": [(column.name, column.unit) for column in table.columns]}
    with open(request["numbers"], "wb") as file:
        for column in table.columns:
            np.ascontiguousarray(column.values, dtype=np.float64).tofile(file)
    return head | {"notes": table.notes, "others": table.others}


def main() -> None:
    """Read the request, obey its limits of memory and time, write the answer; what a library prints goes nowhere."""
    output = os.fdopen(os.dup(1), "wb")
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    request = json.load(sys.stdin)
    if sys.platform != "win32":  # which has no such limits
        import resource

        with suppress(ValueError):  # a lower limit of the caller stays
            resource.setrlimit(resource.RLIMIT_AS, (request["bytes"], resource.getrlimit(resource.RLIMIT_AS)[1]))
            resource.setrlimit(resource.RLIMIT_CPU, (request["seconds"], resource.getrlimit(resource.RLIMIT_CPU)[1]))
            resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    output.write(json.dumps(_answer(request)).encode())
    output.flush()


if __name__ == "__main__":
    main()
    os._exit(0)  # a library may crash while it is taken down: the answer is out
