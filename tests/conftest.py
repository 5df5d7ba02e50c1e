"""What every test begins with."""

import pytest

from modelling.common import floating_point


@pytest.fixture(autouse=True)
def ieee_arithmetic() -> None:
    """Hypothesis refuses to work where a library that an earlier test called left small numbers flushed to zero."""
    floating_point.restore()
