"""Foreign libraries in the tests' own process where what they read is tested: each child would import them anew."""

import pytest

from modelling.recordings import readers


@pytest.fixture(autouse=True)
def in_this_process(request, monkeypatch):
    """All tests but those of ``test_reading_apart``."""
    if not request.module.__name__.endswith("test_reading_apart"):
        monkeypatch.setattr(
            readers, "read_in_child", lambda path, used, options: readers.reader_of(path)(path, used, **options)
        )
