"""Work for one more process beside this one, which takes it in order; this one does what that has not begun."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Generic, ParamSpec, TypeVar

from matching.executors import can_fork, executor_of

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

    def __init__(self, process: Executor | None = None, begins: Callable[[], Executor] | None = None):
        self._process = process
        self._begins = begins
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
        """Send a value that several tasks take as an argument once for all of them."""
        self.start()
        if self._process is not None and id(value) not in self._shared:
            self._shared[id(value)] = value
            self._submit(_keep, id(value), value)

    def lend(self, value: Any) -> None:
        """Begin the other process as a copy of this one, which has a value that could not well be sent.

        Where the machine cannot do that, or the process has begun, everything from now on is worked out here.
        """
        if self._process is not None or self._begins is None or not can_fork():
            self._process = self._begins = None
            return
        _KEPT[id(value)] = self._shared[id(value)] = value
        self.start()
        del _KEPT[id(value)]

    def begin(self, function: Callable[P, R], *arguments: P.args, **options: P.kwargs) -> BesideTask[R]:
        """A task: function of a module, with arguments that can be sent to another process."""
        self.start()
        sent = [_Kept(id(value)) if id(value) in self._shared else value for value in arguments]
        promise = self._submit(_call, function, sent, options)
        return BesideTask(lambda: function(*arguments, **options), promise)

    def _send_prepared(self) -> None:
        while self._prepared:
            self._submit(import_module, self._prepared.pop(0))

    def _submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any] | None:
        if self._process is not None:
            try:
                return self._process.submit(function, *arguments)
            except BrokenExecutor:
                self._process = None
        return None


@contextmanager
def beside(processes: int) -> Iterator[Aside]:
    """One process beside this one where there may be two or more; it begins when it is needed, ends with the block."""
    if processes < 2:
        yield Aside()
        return
    with ExitStack() as until_the_end:
        yield Aside(begins=lambda: until_the_end.enter_context(executor_of(1, like_this_process=True)))


@dataclass(frozen=True)
class _Kept:
    """Stands for a value that was shared."""

    number: int


_KEPT: dict[int, Any] = {}  # in the other process: what was shared with it


def _keep(number: int, value: Any) -> None:
    _KEPT[number] = value


def _call(function: Callable[..., R], arguments: Sequence[Any], options: dict[str, Any]) -> R:
    return function(*(_KEPT[value.number] if isinstance(value, _Kept) else value for value in arguments), **options)
