import pytest

from plant.engine import compiler


@pytest.fixture(autouse=True)
def compiled_plant() -> None:
    if compiler() is None:
        pytest.skip("the truth plant needs a C compiler (cc, gcc or clang)")
