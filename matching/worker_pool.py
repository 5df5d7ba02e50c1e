"""Work for one more process beside this one, or two, which take it in order; this one does what they have not begun."""

from __future__ import annotations

import logging
import os
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
from modelling.interruption import ignore_in_worker

# --- Where studies run: processes of this machine, begun anew when one of them is killed, or a Dask cluster.

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


# --- Aside

P = ParamSpec("P")
R = TypeVar("R")

BEHIND = 5  # of the other processes' priority: they wait for this one more often than it for them


@dataclass(frozen=True)
class BesideTask(Generic[R]):
    """A function and its arguments, and the other process's promise of its value."""

    work: Callable[[], R]
    promise: Future[R] | None

    def result(self) -> R:
        """The function's value, worked out here where the other process has not begun it, or is gone."""
        if self.promise is None or self.promise.cancel():
            return self.work()
        try:
            return self.promise.result()
        except BrokenExecutor:
            return self.work()


class Aside:
    """A process beside this one, or two; without it everything is worked out here, when it is asked for."""

    def __init__(self, process: Executor | None = None, begins: Callable[[], Executor] | None = None, helpers: int = 1):
        self._process = process
        self._begins = begins
        self._helpers = helpers
        self._prepared: list[str] = []
        self._shared: dict[int, Any] = {}  # the values are kept, so that an id is not used again

    def prepare(self, *modules: str) -> None:
        """Have the other process import what it will need."""
        self._prepared += modules
        if self._process is not None:
            self._send_prepared()

    def start(self) -> None:
        """Begin the other process now: where the machine can fork, it knows all that was worked out until then."""
        if self._process is None and self._begins is not None:
            self._process, self._begins = self._begins(), None
            self._submit(int)  # processes begin with the first task
            self._send_prepared()

    def share(self, value: Any) -> None:
        """Send a value that several tasks take as an argument once for all of them, where one process takes them."""
        self.start()
        if self._helpers == 1 and self._process is not None and id(value) not in self._shared:
            self._shared[id(value)] = value
            self._submit(_keep, id(value), value)

    def begin(self, function: Callable[P, R], *arguments: P.args, **options: P.kwargs) -> BesideTask[R]:
        """A task: function of a module, with arguments that can be sent to another process."""
        self.start()
        sent = [_Kept(id(value)) if id(value) in self._shared else value for value in arguments]
        promise = self._submit(_call_aside, function, sent, options)
        return BesideTask(lambda: function(*arguments, **options), promise)

    def _send_prepared(self) -> None:
        modules, self._prepared = self._prepared, []
        for _ in range(self._helpers if modules else 0):
            self._submit(_import, modules)

    def _submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any] | None:
        if self._process is not None:
            try:
                return self._process.submit(function, *arguments)
            except BrokenExecutor:
                self._process = None
        return None


@contextmanager
def beside(processes: int, helpers: int = 1) -> Iterator[Aside]:
    """Processes beside this one, where there may be two or more; they begin when they are needed, end with the block.

    Parameters
    ----------
    processes : int
        How many may run at a time.
    helpers : int
        How many there are beside this one, which may wait for them.
    """
    if processes < 2:
        yield Aside()
        return
    with ExitStack() as until_the_end:
        yield Aside(
            begins=lambda: until_the_end.enter_context(executor_of(helpers, like_this_process=True)), helpers=helpers
        )


@dataclass(frozen=True)
class _Kept:
    """Stands for a value that was shared."""

    number: int


_KEPT: dict[int, Any] = {}  # in the other process: what was shared with it


def _keep(number: int, value: Any) -> None:
    _KEPT[number] = value


def _import(modules: Sequence[str]) -> None:
    if hasattr(os, "nice"):
        os.nice(BEHIND)
    for module in modules:
        with suppress(ImportError):  # no part of a plain installation
            import_module(module)


def _call_aside(function: Callable[..., R], arguments: Sequence[Any], options: dict[str, Any]) -> R:
    return function(*(_KEPT[value.number] if isinstance(value, _Kept) else value for value in arguments), **options)
