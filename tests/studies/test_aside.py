"""Work beside this process: the same values wherever they are worked out, also when the other process is killed."""

import os
import signal
import sys
import time
from concurrent.futures import BrokenExecutor, Future

import pytest

from matching import worker_pool as executors
from matching.worker_pool import Aside, beside


def work(x):
    return os.getpid(), x * x


def fail():
    raise ValueError("wrong")


class Never:
    """A process that never comes to what it was asked for."""

    def submit(self, function, *arguments):
        return Future()


class Gone:
    """A process that was killed."""

    def submit(self, function, *arguments):
        promise = Future()
        promise.set_running_or_notify_cancel()
        promise.set_exception(BrokenExecutor("killed"))
        return promise


@pytest.mark.parametrize("process", [None, Never(), Gone()])
def test_what_nobody_else_does_is_done_here(process):
    assert Aside(process).begin(work, 3).result() == (os.getpid(), 9)


def test_one_process_alone_begins_no_other():
    with beside(1) as aside:
        assert aside.begin(work, 2).result() == (os.getpid(), 4)


def test_two_processes_share_and_errors_come_through():
    with beside(2) as aside:
        aside.prepare("json")
        first = aside.begin(work, 4)
        other = first.promise.result(60)
        assert first.result() == other == (other[0], 16)
        assert other[0] != os.getpid()
        with pytest.raises(ValueError, match="wrong"):
            aside.begin(fail).result()


class Counted:
    """A value that counts how often it is sent."""

    sent = 0

    def __reduce__(self):
        Counted.sent += 1
        return Counted, ()


def count_and(value, number):
    return type(value).__name__, number


def test_a_shared_value_is_sent_once():
    with beside(2) as aside:
        value = Counted()
        aside.share(value)
        tasks = [aside.begin(count_and, value, number) for number in range(3)]
        assert [task.promise.result(60) for task in tasks] == [("Counted", number) for number in range(3)]
        assert Counted.sent == 1


def both_work(mine, other):
    """Waits for the other: one process alone would never end."""
    mine.touch()
    wait_for(other)
    return os.getpid()


def test_two_helpers_work_at_the_same_time_and_get_a_shared_value_each(tmp_path):
    with beside(2, helpers=2) as aside:
        aside.prepare("json", "no_such_module")  # the second is no part of this installation
        value = Cached()
        value.known = 3
        aside.share(value)
        a, b = tmp_path / "a", tmp_path / "b"
        tasks = [aside.begin(both_work, *pair) for pair in ((a, b), (b, a))]
        processes = {task.promise.result(60) for task in tasks}
        assert len(processes | {os.getpid()}) == 3
        assert [aside.begin(keys_of, value).promise.result(60) for _ in range(2)] == [["known"], ["known"]]


@pytest.mark.skipif(sys.platform != "linux", reason="processes are not forked here")
def test_the_other_process_knows_what_was_worked_out_before_it_began(monkeypatch):
    with beside(2) as aside:
        monkeypatch.setattr(executors, "active_count", lambda: 1)  # a thread watches over the test's time
        monkeypatch.setattr(sys.modules[__name__], "fail", lambda: "known")
        aside.start()
        monkeypatch.undo()
        assert aside.begin(call_fail).promise.result(60) == "known"


def call_fail():
    return fail()


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal here")
def test_a_killed_process_costs_nothing_but_time():
    with beside(2) as aside:
        process, _ = aside.begin(work, 1).promise.result(60)
        os.kill(process, signal.SIGKILL)
        assert aside.begin(work, 5).result()[1] == 25
        assert aside.begin(work, 6).result()[1] == 36


def wait_for(path):
    while not path.exists():
        time.sleep(0.01)


def keys_of(value):
    return sorted(vars(value))


class Cached:
    """A value in which its process keeps what it works out."""


def test_a_task_has_its_arguments_as_they_were_when_it_was_begun(tmp_path):
    """What this process caches in them later is not sent: it would be pickled while it changes."""
    value, go_on = Cached(), tmp_path / "go_on"
    value.known = 1
    with beside(2) as aside:
        waiting = [aside.begin(wait_for, go_on) for _ in range(4)]  # more than the pool pickles ahead
        aside.share(value)
        shared, sent = aside.begin(keys_of, value), Aside(aside._process).begin(keys_of, value)
        value.later = 2
        go_on.touch()
        assert [task.promise.result(60) for task in (shared, sent)] == [["known"], ["known"]]
        assert all(task.promise.result(60) is None for task in waiting)
