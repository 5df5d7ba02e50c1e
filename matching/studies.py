"""Many like tasks on any executor: in chunks, prepared once a worker, recorded as they come, resumed after a kill.

A study is a module-level function ``work(prepared, chunk)`` and a module-level function ``prepare(given)`` that builds
what all chunks share (solvers, compiled functions); a worker process calls ``prepare`` once. Results are plain values
that JSON holds. With a ``record`` every finished chunk is appended to that file; the same study takes the chunks that
are recorded and does the rest. A line that is damaged or half written counts as not there.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, as_completed
from pathlib import Path
from typing import Any

from modelling.errors import InputError

CHECKSUM = "sha256"  # key of a line's last entry: checksum of the line without it
KINDS = {"study": str, "chunk": str, "result": object}  # of a recorded row, by key

_prepared: dict[str, Any] = {}  # in a worker: what the last study needed, by the study's token


def append(record: Path, row: dict[str, Any]) -> None:
    """Append a row of plain values to a record and force it to the disk.

    Raises
    ------
    InputError
        If a pipe, a folder or a link stands in the record's place.
    """
    record.parent.mkdir(parents=True, exist_ok=True)
    _check_place(record)
    with record.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row | {CHECKSUM: _checksum(row)}, allow_nan=False) + "\n")
        file.flush()
        os.fsync(file.fileno())


def rows(record: Path, kinds: Mapping[str, type]) -> list[dict[str, Any]]:
    """The whole rows of a record that hold values of these kinds by key; a half-written last line is cut off.

    Raises
    ------
    InputError
        As :func:`append`.
    """
    _check_place(record)
    if not record.exists():
        return []
    text = record.read_bytes()
    end = text.rfind(b"\n") + 1
    if end < len(text):
        with record.open("r+b") as file:
            file.truncate(end)
    whole = []
    for line in text[:end].decode("utf-8", "replace").split("\n")[:-1]:
        try:
            row = json.loads(line)
            if row.pop(CHECKSUM) == _checksum(row) and all(isinstance(row[key], kind) for key, kind in kinds.items()):
                whole.append(row)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            continue
    return whole


def _check_place(record: Path) -> None:
    if record.is_symlink() or (record.exists() and not record.is_file()):
        raise InputError(str(record), "is no record of a study", "remove it, or name another --out")


def _checksum(row: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(row).encode()).hexdigest()[:32]


def run(
    work: Callable[[Any, Any], Any],
    prepare: Callable[[Any], Any],
    shared: Any,
    chunks: Sequence[Any],
    executor: Executor,
    *,
    content: str,
    record: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Any]:
    """Results of all chunks, in their order.

    Parameters
    ----------
    work, prepare : callable
        At the top of a module, so that workers find them.
    shared : object
        What ``prepare`` takes; sent along with every chunk.
    chunks : sequence
        Plain values.
    executor : Executor
        What runs them.
    content : str
        All that the results depend on, in words: recorded results with another content are not taken.
    record : Path, optional
        File that finished chunks are appended to.
    progress : callable, optional
        Called with (chunks done, all chunks).

    Raises
    ------
    InputError
        If a worker is killed or the cluster is gone.
    """
    token = _token(content)
    keys = [json.dumps(chunk, sort_keys=True) for chunk in chunks]
    kept = [] if record is None else rows(record, KINDS)
    results = {row["chunk"]: row["result"] for row in kept if row["study"] == token}
    to_do = {key: chunk for key, chunk in zip(keys, chunks, strict=True) if key not in results}
    done = len(keys) - len(to_do)
    if progress and done:
        progress(done, len(keys))
    waiting = {}
    try:
        for key, chunk in to_do.items():
            waiting[executor.submit(_one, work, prepare, token, shared, chunk)] = key
        for future in as_completed(waiting):
            key = waiting[future]
            results[key] = future.result()
            if record is not None:
                append(record, {"study": token, "chunk": key, "result": results[key]})
            done += 1
            if progress:
                progress(done, len(keys))
    except (BrokenExecutor, CancelledError):
        wrong = "a worker process was killed, perhaps because memory ran out, or the cluster is gone"
        go_on = "the same command goes on from there" if record is not None and record.exists() else "run it again"
        raise InputError(str(record or "--workers"), wrong, f"use fewer --workers; {go_on}") from None
    finally:
        for future in waiting:
            future.cancel()
    return [results[key] for key in keys]


def _token(content: str) -> str:
    return hashlib.sha256(content.encode()).hexdigest()


def _one(work: Callable[[Any, Any], Any], prepare: Callable[[Any], Any], token: str, shared: Any, chunk: Any) -> Any:
    """One chunk in a worker. A Dask worker's threads may prepare twice at the same time, which does no harm."""
    prepared = _prepared.get(token)
    if prepared is None:
        prepared = prepare(shared)
        _prepared.clear()
        _prepared[token] = prepared
    return work(prepared, chunk)
