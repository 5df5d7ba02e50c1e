"""Matching, judging and diagnosing: what is done with drivetrain models. Users import :mod:`rigmatch`."""

from importlib import import_module

from modelling import display

DISTRIBUTION = "rigmatch"  # by which rigmatch.py notices another distribution's package of the same name


def _load_view(result_class: type) -> None:
    import_module("matching.report").load_view(result_class)


display.register_provider(_load_view)
