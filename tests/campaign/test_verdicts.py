"""Verdicts on drawn beds: decided, and right."""

from importlib.util import find_spec

import numpy as np
import pytest
from needs import compiles
from plant.engine import compiler

from tests.campaign.verdicts import verdicts

pytestmark = [compiles, pytest.mark.skipif(not (find_spec("fmpy") and compiler()), reason="needs FMPy, a C compiler")]


@pytest.mark.long
def test_linear_beds_are_decided_and_their_error_is_covered(tmp_path):
    """Of ten beds at most one may be missed, and at most one is at the limit."""
    found = list(verdicts(10, 78, tmp_path))
    assert sum(one.covered for one in found) >= 9
    assert sum(one.status == "undetermined" for one in found) <= 1
    assert 1 / 1.5 < np.median([one.width for one in found]) < 1.5
