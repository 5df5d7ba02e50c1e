"""Work for one more process beside this one, or two, which take it in order; this one does what they have not begun."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Generic, ParamSpec, TypeVar

from matching.executors import executor_of

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
        promise = self._submit(_call, function, sent, options)
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


def _call(function: Callable[..., R], arguments: Sequence[Any], options: dict[str, Any]) -> R:
    return function(*(_KEPT[value.number] if isinstance(value, _Kept) else value for value in arguments), **options)
