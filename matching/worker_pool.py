"""Worker processes: for studies (or a Dask cluster in their place), and next to this process for work needed later."""

from __future__ import annotations

import logging
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import get_context, parent_process
from multiprocessing.reduction import ForkingPickler
from threading import Thread, active_count
from typing import Any, Generic, ParamSpec, TypeVar

from modelling.errors import InputError

P = ParamSpec("P")
R = TypeVar("R")

SCHEDULER_SECONDS = 10  # to wait for a scheduler to answer


class LocalProcesses(ProcessPoolExecutor):
    """Worker processes of this machine; arguments are pickled when a task is submitted, as they are then."""

    def __init__(self, workers: int | None = None, method: str = "spawn"):
        os.environ["PYTHONSAFEPATH"] = "1"  # workers import nothing from the folder that one stands in
        super().__init__(workers, get_context(method), _begin_worker)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future:
        """As :meth:`concurrent.futures.Executor.submit`."""
        return super().submit(_call, bytes(ForkingPickler.dumps((fn, args, kwargs))))


def _call(task: bytes) -> Any:
    function, arguments, options = ForkingPickler.loads(task)
    return function(*arguments, **options)


def _begin_worker() -> None:
    """Leave Ctrl-C to the parent, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()

    def wait() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    Thread(target=wait, daemon=True).start()


@contextmanager
def executor_of(workers: int | None = None, scheduler: str | None = None) -> Iterator[Executor]:
    """Processes of this machine, or a Dask cluster by its scheduler's address; what waits is dropped at the end.

    Raises
    ------
    InputError
        If Dask is not installed or the scheduler does not answer.
    """
    if scheduler is None:
        executor = LocalProcesses(workers)
        try:
            yield executor
        finally:
            executor.shutdown(wait=False, cancel_futures=True)
        return
    try:
        from distributed import Client
    except ImportError:
        right = 'in rigmatch\'s folder: pip install -e ".[dask]"'
        raise InputError("--scheduler", "Dask is not installed", right) from None
    for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)  # if the scheduler ends, the user sees one line, ours
    try:
        client = Client(scheduler, timeout=SCHEDULER_SECONDS)
    except (OSError, ValueError, TypeError) as fault:
        said = " ".join(str(fault).split())[:120]
        right = "give the address of a running dask scheduler, such as tcp://host:8786"
        raise InputError("--scheduler", f"{scheduler!r} does not answer ({said})", right) from None
    with client:
        yield client.get_executor()


@dataclass(frozen=True)
class SideTask(Generic[R]):
    """A function's value, from the other process or, without one, worked out when it is asked for."""

    work: Callable[[], R]
    future: Future[R] | None

    def result(self) -> R:
        """The value; worked out here if the other process is gone."""
        if self.future is not None:
            with suppress(BrokenExecutor):
                return self.future.result()
        return self.work()


class SideProcesses:
    """Processes next to this one; without any, everything is worked out here."""

    def __init__(self, begin: Callable[[], Executor] | None = None, helpers: int = 1):
        self._begin, self._helpers = begin, helpers
        self._executor: Executor | None = None
        self._modules: Sequence[str] = ()

    def prepare(self, *modules: str) -> None:
        """Name the modules that the processes import as soon as they are there."""
        self._modules = modules

    def start(self) -> None:
        """Begin the processes: where the machine can fork, they know all that was worked out until now."""
        if self._executor is None and self._begin is not None:
            self._executor, self._begin = self._begin(), None
            for _ in range(self._helpers):
                self._executor.submit(_import, self._modules)

    def begin(self, function: Callable[P, R], *arguments: P.args, **options: P.kwargs) -> SideTask[R]:
        """Begin a task: a function of a module, with arguments that can be sent to another process."""
        self.start()
        future: Future[R] | None = None
        if self._executor is not None:
            with suppress(BrokenExecutor):
                future = self._executor.submit(function, *arguments, **options)
        return SideTask(lambda: function(*arguments, **options), future)


@contextmanager
def beside(processes: int, helpers: int = 1) -> Iterator[SideProcesses]:
    """``helpers`` processes next to this one, if at least two may run at a time; they begin when they are needed."""
    with ExitStack() as until_the_end:

        def begin() -> Executor:
            # Forked processes know all that this one has imported. Only Linux's libraries bear a fork, and only
            # without other threads, whose locks would never be let go.
            method = "fork" if sys.platform == "linux" and active_count() == 1 else "spawn"
            executor = LocalProcesses(helpers, method)
            until_the_end.callback(executor.shutdown, wait=False, cancel_futures=True)
            return executor

        yield SideProcesses(begin if processes > 1 else None, helpers)


def _import(modules: Sequence[str]) -> None:
    for module in modules:
        with suppress(ImportError):  # no part of a plain installation
            import_module(module)
