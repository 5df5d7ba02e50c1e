"""The small bed, with an observer."""

from __future__ import annotations

import pytest
from small_bed import write

from matching.frequency.case.case import Case
from matching.frequency.case.load import load_case


@pytest.fixture(scope="session")
def small_case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """The case with ``observer``, at a dead time that is no multiple of the sample time."""
    return load_case(write(tmp_path_factory.mktemp("small")))
