"""Foreign libraries in the tests' own process where what they read is tested: each child would import them anew."""

import importlib

import pytest

from modelling.recordings import readers as apart


@pytest.fixture(autouse=True)
def in_this_process(request, monkeypatch):
    """All tests but those of ``test_reading_apart``."""
    if request.module.__name__.endswith("test_reading_apart"):
        return

    def read(reader, path, used, options):
        return importlib.import_module(reader).read(path, used, **options)

    monkeypatch.setattr(apart, "read_apart", read)
