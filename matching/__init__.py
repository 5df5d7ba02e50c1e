"""Matching, judging and diagnosing: what is done with drivetrain models. Users import :mod:`rigmatch`."""

import sys
from importlib import import_module

try:
    from modelling.common import display
except KeyboardInterrupt:
    if sys.argv[:1] != ["-m"]:
        raise
    # `python -m matching` imports this package before its first line
    print("rigmatch: interrupted", file=sys.stderr)
    sys.exit(130)

DISTRIBUTION = "rigmatch"  # by which rigmatch.py notices another distribution's package of the same name


def _load_view(result_class: type) -> None:
    import_module("matching.report").load_view(result_class)


display.register_provider(_load_view)
