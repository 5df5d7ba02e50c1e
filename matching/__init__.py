"""Matching, judging and diagnosing: what is done with drivetrain models.

The functions behind the commands, under the same names; each is imported when it is first asked for::

    import matching as rm
    rm.modes("rig.toml")                     # energy shares, symmetry; .plot(), .to_dict(), .to_xarray()
    found = rm.match("case.toml")            # found.status, found.limits, found.plot()
"""

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

__all__ = [
    "diagnose", "export", "fidelity", "load", "load_case", "map", "match", "modes", "read_recording", "response",
    "simulate", "tolerance", "uncertainty",
]  # fmt: skip

if TYPE_CHECKING:
    from matching.api import (
        diagnose,
        export,
        fidelity,
        load,
        load_case,
        map,  # noqa: A004
        match,
        modes,
        read_recording,
        response,
        simulate,
        tolerance,
        uncertainty,
    )


def __getattr__(name: str) -> Any:
    if name in __all__:
        from importlib import import_module

        return getattr(import_module("matching.api"), name)
    raise AttributeError(f"module 'matching' has no attribute {name!r}; it has {', '.join(__all__)}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
