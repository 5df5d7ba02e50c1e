"""Work for one more process beside this one, which takes it in order; this one does what that has not begun."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Generic, ParamSpec, TypeVar

from matching.executors import executor_of

P = ParamSpec("P")
R = TypeVar("R")


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
    """One process beside this one; without it everything is worked out here, when it is asked for."""

    def __init__(self, process: Executor | None = None):
        self._process = process

    def prepare(self, *modules: str) -> None:
        """Have the other process import what it will need."""
        for module in modules:
            self.begin(_import, module)

    def begin(self, function: Callable[P, R], *arguments: P.args, **options: P.kwargs) -> BesideTask[R]:
        """A task: function of a module, with arguments that can be sent to another process."""
        promise = None
        if self._process is not None:
            try:
                promise = self._process.submit(function, *arguments, **options)
            except BrokenExecutor:
                self._process = None
        return BesideTask(lambda: function(*arguments, **options), promise)


@contextmanager
def beside(processes: int) -> Iterator[Aside]:
    """One process beside this one where there may be two or more; it ends with the block."""
    if processes < 2:
        yield Aside()
        return
    with executor_of(1) as process:
        yield Aside(process)


def _import(module: str) -> None:
    import_module(module)
