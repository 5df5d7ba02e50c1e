# PYTHON_ARGCOMPLETE_OK
"""rigmatch: tunes a powertrain test bed until it reproduces the vehicle, and says how far that can be trusted.

The functions behind the commands, under the same names; each is imported when it is first asked for::

    import rigmatch as rm
    rm.modes("rig.toml")                     # energy shares, symmetry; .plot(), .to_dict(), .to_xarray()
    found = rm.match("case.toml")            # found.status, found.limits, found.plot()
"""

import sys
from typing import TYPE_CHECKING, Any

import matching
from modelling.common.version import VERSION

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

REPLACED = (
    "the package 'matching' of another distribution stands in the place of rigmatch's: "
    "uninstall that distribution, then install rigmatch again"
)


def _replaced() -> bool:
    """Whether ``import matching`` finds a package that is not ours."""
    return getattr(matching, "__version__", None) != VERSION or not hasattr(matching, "_load_view")


def main() -> int:
    """The command ``rigmatch``; exit code as :func:`matching.cli.main` has it."""
    if _replaced():
        print(f"rigmatch: {REPLACED}", file=sys.stderr)
        return 2
    from matching.cli import main as run

    return run()


def __getattr__(name: str) -> Any:
    if _replaced():
        raise ImportError(f"rigmatch: {REPLACED}")
    if name == "__version__":
        return VERSION
    if name in __all__:
        return getattr(matching, name)
    raise AttributeError(f"module 'rigmatch' has no attribute {name!r}; it has {', '.join(__all__)}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
