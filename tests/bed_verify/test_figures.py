"""What the figure of a bed's verification draws."""

from types import SimpleNamespace

import numpy as np
from axis_units import check

from matching.bed.verify import COVERAGE_FACTOR, FunctionCurves
from matching.report.bed import LARGEST_BAND, responses


def test_the_band_is_the_uncertainty_and_no_wider_than_is_drawn():
    """A modulus of 2 with a small, an unknown and a huge uncertainty."""
    f, uncertainty = np.array([1.0, 2.0, 3.0, 4.0]), np.array([0.1, 0.1, np.nan, 50.0])
    ones = np.ones(4, complex)
    curve = FunctionCurves("motor", "speed", "rad/s", "N*m", f, 2 * ones, uncertainty, ones, ones)
    drawn = responses(SimpleNamespace(curves=(curve,)))
    assert check(drawn, hertz=(1, 4)) == 1  # as the axis says
    axes = drawn.axes[0]
    corners = np.concatenate([path.vertices for band in axes.collections for path in band.get_paths()])
    assert 3.0 not in corners[:, 0]
    for frequency, half in ((1.0, COVERAGE_FACTOR * 0.1), (2.0, COVERAGE_FACTOR * 0.1)):
        at = corners[corners[:, 0] == frequency, 1]
        np.testing.assert_allclose([at.min(), at.max()], [2 - half, 2 + half])
    at = corners[corners[:, 0] == 4.0, 1]
    np.testing.assert_allclose([at.min(), at.max()], [2 / LARGEST_BAND, 2 * LARGEST_BAND])
