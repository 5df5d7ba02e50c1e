"""The table of views: every class and module in it is there, and every module shows the class."""

from importlib import import_module

import pytest

from matching.report import VIEWS, load_view
from modelling import display


@pytest.mark.parametrize("path", VIEWS)
def test_every_result_has_the_view_that_the_table_names(path):
    module, _, name = path.rpartition(".")
    result_class = getattr(import_module(module), name)
    load_view(result_class)
    views = (display.plot, display.text, display.html, display.animation)
    assert any(view.dispatch(result_class) is not view.dispatch(object) for view in views)
