"""Signals that end the program: which are taken over, what the first and the later ones do."""

import contextlib
import signal
import threading

import pytest
from modelling.interruption import Interrupted, install, none_swallowed, put_off, whatever_it_became

from matching.match.programme import solved
from modelling import interruption


@pytest.fixture
def handlers(monkeypatch):
    """As at the start of a program; put back afterwards."""
    before = {number: signal.getsignal(number) for number in interruption.ENDING_SIGNALS}
    monkeypatch.setattr(interruption, "_asked", [])
    monkeypatch.setattr(interruption, "_put_off", [])
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def test_every_signal_is_taken_over_but_those_that_are_ignored(handlers):
    first, *others = interruption.ENDING_SIGNALS
    signal.signal(first, signal.SIG_IGN)
    for number in others:
        signal.signal(number, signal.SIG_DFL)
    install()
    assert signal.getsignal(first) is signal.SIG_IGN
    assert {signal.getsignal(number) for number in others} == {interruption._raise_once}


def test_the_first_signal_ends_and_later_ones_are_noted_alone(handlers):
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    install()
    with pytest.raises(Interrupted) as ended:
        signal.raise_signal(signal.SIGTERM)
    assert ended.value.exit_code == 143
    assert str(ended.value) == "ended by SIGTERM"
    signal.raise_signal(signal.SIGTERM)  # raises nothing
    assert interruption._asked == [signal.SIGTERM, signal.SIGTERM]


def test_a_signal_in_a_block_that_puts_it_off_ends_after_it(handlers):
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    install()
    done = []

    def work():
        with put_off():
            signal.raise_signal(signal.SIGTERM)
            done.append("whole")

    with pytest.raises(Interrupted):
        work()
    assert done == ["whole"]
    assert interruption._put_off == []


class Named:
    """Python 3.11 makes a RuntimeError of what comes while a class is made."""

    def __set_name__(self, owner, name):
        try:
            signal.raise_signal(signal.SIGTERM)
        except Interrupted as interrupt:
            raise RuntimeError("Error calling __set_name__") from interrupt


def test_a_signal_that_was_wrapped_is_still_that_signal(handlers):
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    install()
    with pytest.raises(Interrupted) as ended, whatever_it_became():
        type("Made", (), {"attribute": Named()})
    assert ended.value.exit_code == 143


def test_an_error_without_a_signal_stays_what_it_is(handlers):
    with pytest.raises(KeyError), whatever_it_became():
        raise KeyError("missing")


class Swallows:
    """A solver in C, as CasADi has them: it takes the exception for a point that cannot be evaluated, and goes on."""

    def __call__(self):
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return {}

    @staticmethod
    def stats():
        return {"return_status": "Solve_Succeeded"}


def test_ctrl_c_that_a_solver_swallows_is_raised_after_it_in_a_notebook_too(handlers):
    signal.signal(signal.SIGINT, signal.default_int_handler)  # none of ours
    with pytest.raises(KeyboardInterrupt):
        solved(Swallows())
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    install()
    with pytest.raises(Interrupted):
        solved(Swallows())


def test_a_handler_of_ctrl_c_that_raises_nothing_ends_nothing(handlers):
    came = []
    signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    assert solved(Swallows()) == {}
    assert came == [signal.SIGINT]


def test_where_ctrl_c_is_ignored_or_another_thread_works_no_handler_is_changed(handlers):
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    assert solved(Swallows()) == {}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    seen = []

    def work():
        with none_swallowed():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [signal.default_int_handler]
