"""Many like tasks on any executor: in chunks, prepared once a worker, written as they come, resumed after a kill.

A study is a module-level function ``work(prepared, chunk)`` and a module-level function ``prepare(given)`` that builds
what all chunks share (solvers, compiled functions); a worker process calls ``prepare`` once. Results are plain values
that JSON holds. With a ``record`` every finished chunk is appended to that file, and a study that is started anew with
the same content takes what is there and does the rest; a line that is damaged or half written is computed anew. What
keeps its results in a way of its own takes them from ``finished`` as they come.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, as_completed
from pathlib import Path
from threading import Lock
from typing import Any

from matching.worker_pool import LocalProcesses
from modelling.errors import InputError

# --- Files that the finished parts of a study are appended to, a line each with its checksum.

CHECKSUM = "sha256"  # key of a line's last entry: checksum of the line without it


def append(record: Path, row: dict[str, Any]) -> None:
    """Append a row of plain values and force it to the disk.

    Raises
    ------
    InputError
        If a pipe, a folder or a link stands in its place.
    """
    record.parent.mkdir(parents=True, exist_ok=True)
    _check_place(record)
    with record.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row | {CHECKSUM: _checksum(row)}, allow_nan=False) + "\n")
        file.flush()
        os.fsync(file.fileno())


def rows(record: Path, kinds: Mapping[str, type]) -> list[dict[str, Any]]:
    """The rows of a record; a line that is damaged, or that a kill left half written, counts as not written.

    ``kinds`` are what every row holds by key; a row of another build is none of this record's. Raises as
    :func:`append` does.
    """
    whole = []
    for line in whole_lines(record):
        try:
            row = json.loads(line)
            as_built = all(isinstance(row[key], kind) for key, kind in kinds.items())
            if row.pop(CHECKSUM) == _checksum(row) and as_built:
                whole.append(row)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            continue
    return whole


def whole_lines(record: Path) -> list[str]:
    """Lines of a file that rows are appended to; one that a kill left half written is cut off, in the file too.

    Raises as :func:`append` does.
    """
    _check_place(record)
    if not record.exists():
        return []
    text = record.read_bytes()
    whole = text[: text.rfind(b"\n") + 1]
    if len(whole) < len(text):
        with record.open("r+b") as file:
            file.truncate(len(whole))
    return whole.decode("utf-8", "replace").split("\n")[:-1]


def _check_place(record: Path) -> None:
    """Raise ``InputError`` for a pipe, a folder, or a link, which would be written to wherever it leads."""
    if record.is_symlink() or (record.exists() and not record.is_file()):
        raise InputError(str(record), "is no file of ours", "remove it, or name another --out")


def _checksum(row: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(row).encode()).hexdigest()[:32]


# --- Studies

KINDS = {"study": str, "chunk": str, "result": object}  # of a row on record, by key
MOST_LOSSES = 3  # of workers in a row, without a chunk that ends between them

_prepared: dict[str, Any] = {}
_preparing = Lock()  # of the threads of a worker


# more than six parameters: the work, and how the study runs
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
        All that the results depend on, in words: results on record with another content are left alone.
    record : Path, optional
        File that finished chunks are appended to.
    progress : callable, optional
        Called with (chunks done, all chunks).

    Raises
    ------
    InputError
        If workers are killed again and again, or the cluster is gone.
    """
    token = _token(content)
    keys = [json.dumps(chunk, sort_keys=True) for chunk in chunks]
    kept = [] if record is None else rows(record, KINDS)
    results = {row["chunk"]: row["result"] for row in kept if row["study"] == token}
    open_chunks = [(key, chunk) for key, chunk in zip(keys, chunks, strict=True) if key not in results]
    done = len(keys) - len(open_chunks)
    if progress and done:
        progress(done, len(keys))
    to_do = [chunk for _, chunk in open_chunks]
    for place, result in finished(work, prepare, shared, to_do, executor, content=content, record=record):
        key = open_chunks[place][0]
        results[key] = result
        if record is not None:
            append(record, {"study": token, "chunk": key, "result": result})
        done += 1
        if progress:
            progress(done, len(keys))
    return [results[key] for key in keys]


# more than six parameters: the work, and how the study runs
def finished(
    work: Callable[[Any, Any], Any],
    prepare: Callable[[Any], Any],
    shared: Any,
    chunks: Sequence[Any],
    executor: Executor,
    *,
    content: str,
    record: Path | None = None,
) -> Iterator[tuple[int, Any]]:
    """Place and result of every chunk, as they come; what has not begun is dropped when the iterator is closed.

    Workers of this machine that are killed are begun anew, and their chunks with them. Parameters as for :func:`run`;
    chunks are whatever pickles, ``record`` is only named where the study cannot go on. Raises as :func:`run` does.
    """
    token, losses = _token(content), 0
    open_chunks = dict(enumerate(chunks))
    while open_chunks:
        waiting: dict[Future, int] = {}
        lost: BaseException | None = None
        try:
            for place, chunk in open_chunks.items():
                waiting[executor.submit(_one, work, prepare, token, shared, chunk)] = place
            for future in as_completed(waiting):
                if future.cancelled() or isinstance(future.exception(), BrokenExecutor | CancelledError):
                    lost = CancelledError() if future.cancelled() else future.exception()
                    continue
                place, losses = waiting[future], 0
                del open_chunks[place]
                yield place, future.result()
        except BrokenExecutor as fault:  # at submitting
            lost = fault
        finally:
            for future in waiting:
                future.cancel()
        if lost is not None:
            losses += 1
            _begin_anew(executor, losses, lost, record)


def _begin_anew(executor: Executor, losses: int, fault: BaseException, record: Path | None) -> None:
    """New workers for those that were lost.

    Raises
    ------
    InputError
        If there can be none, or they are lost again and again.
    """
    go_on = f"the same command goes on from {record}" if record is not None and record.exists() else "run it again"
    if isinstance(fault, CancelledError):
        raise InputError("--scheduler", "the cluster's scheduler is gone", f"start it again; {go_on}")
    if not isinstance(executor, LocalProcesses) or losses > MOST_LOSSES:
        wrong = f"{losses} times in a row a worker process was killed, perhaps because memory ran out"
        raise InputError("--workers", wrong, f"use fewer; {go_on}")
    executor.restart()


def _token(content: str) -> str:
    return hashlib.sha256(content.encode()).hexdigest()


def _one(work: Callable[[Any, Any], Any], prepare: Callable[[Any], Any], token: str, shared: Any, chunk: Any) -> Any:
    """One chunk in a worker, which keeps what the last study needed."""
    with _preparing:
        if token not in _prepared:
            _prepared.clear()
            _prepared[token] = prepare(shared)
        prepared = _prepared[token]
    return work(prepared, chunk)
