"""Signals that end the program: which are taken over, what the first and the later ones do."""

import signal

import pytest

from modelling.common import interruption
from modelling.common.interruption import Interrupted, install, put_off, whatever_it_became


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
