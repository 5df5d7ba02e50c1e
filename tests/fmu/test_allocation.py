"""No memory is asked for while the model runs."""

import pytest
from fmu.timing import possible, timed


@pytest.mark.skipif(not possible(), reason="needs a C compiler and the GNU C library")
@pytest.mark.parametrize("source", ["reference_case", "lashed_model"])
def test_no_allocation_in_the_step(source, export, request, tmp_path):
    found = timed(export(request.getfixturevalue(source)), tmp_path, span=1.7e-3)
    assert found.early_allocations >= 1  # the counter counts
    assert found.allocations == 0
