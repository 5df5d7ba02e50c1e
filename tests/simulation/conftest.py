"""Both integration paths as a fixture."""

from __future__ import annotations

import pytest


@pytest.fixture(params=[True, False], ids=["compiled", "virtual"])
def path(request) -> bool | None:
    """Both paths; the compiled one where there is a compiler."""
    from modelling.simulation.compiled import compiler

    if request.param and not compiler():
        pytest.skip("no C compiler here")
    return None if request.param else False
