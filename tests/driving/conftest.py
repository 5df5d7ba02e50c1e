"""What several of these modules start from."""

from pathlib import Path

import pytest

from matching.export import exported_controller
from matching.match.case_file import load_case


@pytest.fixture(scope="session")
def drive_away():
    """Controller of an example with the weights of a search's start: none was tuned on the drives of these tests."""
    return exported_controller(load_case(Path(__file__).parents[2] / "examples" / "drive_away" / "case.toml"))
