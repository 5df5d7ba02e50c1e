"""Matching, judging and diagnosing: what is done with drivetrain models. Users import :mod:`rigmatch`."""

from importlib import import_module
from typing import Any

from modelling.common import display
from modelling.common.version import VERSION

__all__ = [
    "diagnose", "export", "fidelity", "load", "load_case", "map", "match", "modes", "read_recording", "response",
    "simulate", "tolerance", "uncertainty",
]  # fmt: skip


def _load_view(shown: type) -> None:
    import_module("matching.report").load_view(shown)


display.provide(_load_view)
__version__ = VERSION


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(import_module("matching.api"), name)
    raise AttributeError(f"module 'matching' has no attribute {name!r}; it has {', '.join(__all__)}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
