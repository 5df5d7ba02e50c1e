"""Buttons that run a command in a process of its own, tell its progress and cancel it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from time import monotonic
from typing import Any

import panel as pn

from matching.explore.job import Ended, Job
from matching.explore.page.elements import Message, paragraph

TICK_MS = 1000  # between two times that a running command is said to be running for
RESULTS = "results"  # part of the address below which the folder of results is served


class Runner:
    """A button to run, one to cancel, and a line of progress.

    Parameters
    ----------
    name : str
        On the button.
    words : callable
        The command line when the button is pressed; may raise ``InputError``, which is shown.
    done : callable
        Shows what the command answered.
    """

    def __init__(self, name: str, words: Callable[[], Sequence[str]], done: Callable[[Ended], None]):
        self._words, self._done = words, done
        self.job: Job | None = None
        self._end_ticks: Callable[[], None] = lambda: None
        self.run = pn.widgets.Button(name=name, button_type="primary", width=140)
        self.cancel = pn.widgets.Button(name="Cancel", width=100, disabled=True)
        self.message = Message()
        self.clock = paragraph("")  # apart from the message, which is read out whenever it changes
        self.run.on_click(lambda _: self.start())
        self.cancel.on_click(lambda _: self.stop())

    def panel(self) -> Any:
        """Buttons and line."""
        return pn.Column(pn.FlexBox(self.run, self.cancel), self.message, self.clock, sizing_mode="stretch_width")

    def start(self) -> None:
        """Run the command."""
        try:
            words = self._words()
        except ValueError as error:  # InputError is one
            self.message.say(str(error), wrong=True)
            return
        self.run.disabled, self.cancel.disabled = True, False
        self.message.say(f"{words[0]} is running …")
        page, begun = pn.state.curdoc, monotonic()
        if page is not None:
            ticks = page.add_periodic_callback(lambda: self._tick(begun), TICK_MS)
            self._end_ticks = lambda: page.remove_periodic_callback(ticks)
        self.job = Job(words, lambda line: _in_page(page, self.message.say, line),
                       lambda ended: _in_page(page, self._ended, ended))  # fmt: skip

    def stop(self) -> None:
        """Ask the command to end."""
        if self.job is not None:
            self.job.cancel()

    def _tick(self, begun: float) -> None:
        self.clock.object = f"<p>running for {monotonic() - begun:.0f} s</p>"

    def _ended(self, ended: Ended) -> None:
        self._end_ticks()
        self._end_ticks, self.clock.object = lambda: None, ""
        self.run.disabled, self.cancel.disabled = False, True
        if ended.cancelled:
            self.message.say("cancelled; nothing was written")
        elif ended.code:
            self.message.say(ended.line, wrong=True)
        else:
            self.message.say("done")
            self._done(ended)


def address_of(file: Path, out: Path) -> str:
    """Address of a file in the folder of results, from the page."""
    return f"{RESULTS}/{file.relative_to(out).as_posix()}"


def _in_page(page: Any, act: Callable[[Any], None], value: Any) -> None:
    """Do something in the page's own thread, where there is a page."""
    if page is None:
        act(value)
    else:
        page.add_next_tick_callback(lambda: act(value))
