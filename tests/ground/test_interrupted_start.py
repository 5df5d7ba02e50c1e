"""Ctrl-C while the program is being loaded: one line, exit code 130."""

import runpy
import sys
from types import ModuleType

import pytest


class Loading(ModuleType):
    """A module in whose loading Ctrl-C falls."""

    def __getattr__(self, name):
        raise KeyboardInterrupt


def test_an_interrupt_before_the_command_begins_is_one_line(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rigmatch", Loading("rigmatch"))
    with pytest.raises(SystemExit) as end:
        runpy.run_module("matching", run_name="__main__")
    assert end.value.code == 130
    assert capsys.readouterr().err == "rigmatch: interrupted\n"
