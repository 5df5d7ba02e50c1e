"""Where studies run: processes of this machine, begun anew when one of them is killed, or a Dask cluster."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from multiprocessing.reduction import ForkingPickler
from threading import Thread, active_count
from typing import Any

from modelling.common.errors import InputError
from modelling.common.interruption import ignore_in_worker

SCHEDULER_SECONDS = 10  # to wait for a scheduler to answer


class LocalProcesses(Executor):
    """Worker processes of this machine.

    When one is killed all of them are lost to :class:`concurrent.futures.ProcessPoolExecutor`; :meth:`restart` begins
    new ones. A task is what its arguments were when it was submitted: they are pickled there, not by the pool's thread
    some time later, while this process goes on and caches what it works out in them.
    """

    def __init__(self, workers: int | None = None, like_this_process: bool = False):
        self.workers = workers
        self._method = "fork" if like_this_process and can_fork() else "spawn"
        self._pool = self._begun()

    def _begun(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self.workers, get_context(self._method), _begin_worker)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future:
        """As :meth:`concurrent.futures.Executor.submit`."""
        return self._pool.submit(_call, bytes(ForkingPickler.dumps((fn, args, kwargs))))

    def restart(self) -> None:
        """Begin new processes; what has not ended has to be submitted anew."""
        self.kill()
        self._pool = self._begun()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As :meth:`concurrent.futures.Executor.shutdown`."""
        self._pool.shutdown(wait, cancel_futures=cancel_futures)

    def kill(self) -> None:
        """End all processes at once, whatever they are at."""
        processes = list((getattr(self._pool, "_processes", None) or {}).values())
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.kill()


@contextmanager
def executor_of(
    workers: int | None = None, scheduler: str | None = None, *, like_this_process: bool = False
) -> Iterator[Executor]:
    """Processes of this machine, or a Dask cluster by its scheduler's address; what waits is dropped at the end.

    Processes ``like_this_process`` know all that it has imported and worked out, where the machine can fork.

    Raises
    ------
    InputError
        If Dask is not installed or the scheduler does not answer.
    """
    if scheduler is not None:
        with _cluster(scheduler) as executor:
            yield executor
        return
    processes = LocalProcesses(workers, like_this_process)
    try:
        yield processes
    except BaseException:  # an interruption too: nobody waits for what is still computed
        processes.kill()
        raise
    processes.shutdown(wait=False, cancel_futures=True)


@contextmanager
def _cluster(scheduler: str) -> Iterator[Executor]:
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "--scheduler", "Dask is not installed", 'in rigmatch\'s folder: pip install -e ".[dask]"'
        ) from None
    for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)  # a scheduler that goes is one line, of ours
    try:
        client = Client(scheduler, timeout=SCHEDULER_SECONDS)
    except (OSError, ValueError, TypeError) as fault:
        said = " ".join(str(fault).split())[:120]
        right = "give the address of a running dask scheduler, such as tcp://host:8786"
        raise InputError("--scheduler", f"{scheduler!r} does not answer ({said})", right) from None
    with client:
        yield client.get_executor()


def _call(task: bytes) -> Any:
    function, arguments, options = ForkingPickler.loads(task)
    return function(*arguments, **options)


def can_fork() -> bool:
    """Whether processes may begin as copies of this one.

    Only Linux's libraries bear it, and only without other threads, whose locks would never be let go.
    """
    return sys.platform == "linux" and active_count() == 1


def _begin_worker() -> None:
    """Have a worker end when the process that began it is gone: a kill leaves none of them waiting for ever."""
    ignore_in_worker()
    parent = parent_process()

    def wait() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    Thread(target=wait, daemon=True).start()
