"""What to order: the range that is as good, against ranges known beforehand."""

import pytest

from matching.frequency.search.adapters import HALVINGS, as_good_between


@pytest.mark.parametrize(("low", "high", "at"), [(0.3, 0.8, 0.5), (-1.0, 2.0, 0.5), (0.45, 3.0, 0.5), (0.0, 0.02, 0.0)])
def test_the_range_that_is_as_good_is_found_to_a_part_of_the_way_to_its_bound(low, high, at):
    tried = []

    def as_good(part):
        tried.append(part)
        return low <= part <= high

    first, last = as_good_between(as_good, at)
    low, high = max(low, 0.0), min(high, 1.0)
    assert low <= first <= low + (at - 0.0) / 2**HALVINGS
    assert high - (1.0 - at) / 2**HALVINGS <= last <= high
    assert all(0 <= part <= 1 for part in tried)
    assert len(tried) <= 2 * (HALVINGS + 1)
