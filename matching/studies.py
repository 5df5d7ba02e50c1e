"""Many like tasks on any executor: in chunks, prepared once a worker, written as they come, resumed after a kill.

A study is a module-level function ``work(prepared, chunk)`` and a module-level function ``prepare(given)`` that builds
what all chunks share (solvers, compiled functions); a worker process calls ``prepare`` once. Results are plain values
that JSON holds. With a ``record`` every finished chunk is appended to that file, and a study that is started anew with
the same content takes what is there and does the rest; a line that a kill left half written is dropped. What keeps its
results in a way of its own takes them from ``finished`` as they come.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from pathlib import Path
from threading import Lock, Thread
from typing import Any

from modelling.common.errors import InputError

SECONDS = 10  # to wait for a scheduler to answer

_prepared: dict[str, Any] = {}
_preparing = Lock()  # of the threads of a worker


@contextmanager
def executor_of(workers: int | None = None, scheduler: str | None = None) -> Iterator[Executor]:
    """Processes of this machine, or a Dask cluster by its scheduler's address; what waits is dropped at the end.

    Raises
    ------
    InputError
        If Dask is not installed or the scheduler does not answer.
    """
    if scheduler is None:
        pool = ProcessPoolExecutor(workers, get_context("spawn"), _end_with_parent)
        try:
            yield pool
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
        return
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "--scheduler", "Dask is not installed", "in rigmatch's folder: pip install -e '.[dask]'"
        ) from None
    try:
        client = Client(scheduler, timeout=SECONDS)
    except (OSError, ValueError, TypeError) as fault:
        said = " ".join(str(fault).split())[:120]
        right = "give the address of a running dask scheduler, such as tcp://host:8786"
        raise InputError("--scheduler", f"{scheduler!r} does not answer ({said})", right) from None
    with client:
        yield client.get_executor()


def _end_with_parent() -> None:
    """Have a worker end when the process that began it is gone: a kill leaves none of them waiting for ever."""
    parent = parent_process()

    def wait() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    Thread(target=wait, daemon=True).start()


def run(
    work: Callable[[Any, Any], Any],
    prepare: Callable[[Any], Any],
    given: Any,
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
    given : object
        What ``prepare`` takes; sent along with every chunk.
    chunks : sequence
        Plain values.
    content : str
        All that the results depend on, in words: results on record with another content are left alone.
    record : Path, optional
        File that finished chunks are appended to.
    progress : callable, optional
        Called with (chunks done, all chunks).
    """
    token = _token(content)
    keys = [json.dumps(chunk, sort_keys=True) for chunk in chunks]
    found = {} if record is None else _on_record(record, token)
    open_chunks = [(key, chunk) for key, chunk in zip(keys, chunks, strict=True) if key not in found]
    done = len(keys) - len(open_chunks)
    if progress and done:
        progress(done, len(keys))
    for place, result in finished(work, prepare, given, [chunk for _, chunk in open_chunks], executor, content=content):
        key = open_chunks[place][0]
        found[key] = result
        if record is not None:
            _append(record, {"study": token, "chunk": key, "result": result})
        done += 1
        if progress:
            progress(done, len(keys))
    return [found[key] for key in keys]


def finished(
    work: Callable[[Any, Any], Any],
    prepare: Callable[[Any], Any],
    given: Any,
    chunks: Sequence[Any],
    executor: Executor,
    *,
    content: str,
) -> Iterator[tuple[int, Any]]:
    """Place and result of every chunk, as they come; what has not begun is dropped when the iterator is closed.

    Parameters as for :func:`run`; chunks are whatever pickles.
    """
    token = _token(content)
    waiting: dict[Future, int] = {}
    try:
        for place, chunk in enumerate(chunks):
            waiting[executor.submit(_one, work, prepare, token, given, chunk)] = place
        for future in as_completed(waiting):
            yield waiting[future], future.result()
    finally:
        for future in waiting:
            future.cancel()


def whole_lines(record: Path) -> list[str]:
    """Lines of a file that rows are appended to; one that a kill left half written is cut off, in the file too."""
    if not record.exists():
        return []
    text = record.read_bytes()
    whole = text[: text.rfind(b"\n") + 1]
    if len(whole) < len(text):
        with record.open("r+b") as file:
            file.truncate(len(whole))
    return whole.decode("utf-8", "replace").splitlines()


def _token(content: str) -> str:
    return hashlib.sha256(content.encode()).hexdigest()


def _one(work: Callable[[Any, Any], Any], prepare: Callable[[Any], Any], token: str, given: Any, chunk: Any) -> Any:
    """One chunk in a worker, which keeps what the last study needed."""
    with _preparing:
        if token not in _prepared:
            _prepared.clear()
            _prepared[token] = prepare(given)
        prepared = _prepared[token]
    return work(prepared, chunk)


def _on_record(record: Path, token: str) -> dict[str, Any]:
    """Finished chunks of a study."""
    found = {}
    for line in whole_lines(record):
        try:
            row = json.loads(line)
            if row["study"] == token:
                found[row["chunk"]] = row["result"]
        except (ValueError, KeyError, TypeError):
            raise InputError(
                str(record), "holds a line that is no result", "remove the file, or name another --out"
            ) from None
    return found


def _append(record: Path, row: dict[str, Any]) -> None:
    record.parent.mkdir(parents=True, exist_ok=True)
    with record.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row, allow_nan=False) + "\n")
        file.flush()
        os.fsync(file.fileno())
