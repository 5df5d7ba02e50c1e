"""Error over range (:mod:`modelling.fidelity.over_range`): one rule for what rests, what is no number, and parts."""

import numpy as np
import pytest

from modelling.fidelity.over_range import REST, at_rest, error_over_range, parts_of, worst_part

TIME = np.arange(1000) / 50


def test_a_sine_is_off_by_its_own_closed_form():
    """A sine that is 1 % too large: 0.01/√2 over a range of 2, whatever its size."""
    for size in (1e-3, 1.0, 1e6):
        wanted = size * np.sin(2 * np.pi * np.arange(1000) / 100)[:, None]
        error = error_over_range(wanted, 1.01 * wanted).error
        assert error == pytest.approx([0.01 / np.sqrt(2) / 2], rel=1e-3)


def pair():
    wanted = np.zeros((1000, 2))
    wanted[:, 1] = 3 * np.sin(TIME)
    return wanted, wanted.copy()


def test_what_is_to_rest_and_swings_is_no_match():
    wanted, found = pair()
    found[:, 0] += 30 * np.sin(np.arange(1000) / 7)
    alone = error_over_range(wanted, found)
    assert alone.error[0] == np.inf
    assert alone.largest == np.inf
    beside = error_over_range(wanted, found, kinds=["speed", "speed"])  # over the range of the other speed
    assert beside.error[0] == pytest.approx(30 / np.sqrt(2) / np.ptp(wanted[:, 1]), rel=0.02)
    assert beside.error[1] == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("column", [0, 1])
def test_what_is_not_finite_passes_nowhere(bad, side, column):
    signals = pair()
    signals[side][500, column] = bad
    found = error_over_range(*signals, kinds=["speed", "torque"])
    assert found.error[column] == np.inf
    assert found.largest == np.inf


def test_what_rests_in_both_has_no_error_and_rounding_is_rest():
    wanted, found = pair()
    found[:, 0] = 5.5e-15 * np.sin(TIME)
    made = error_over_range(wanted, found)
    assert np.isnan(made.error[0])
    assert made.resting.tolist() == at_rest(wanted).tolist() == [True, False]
    assert made.by_name(["still", "moving"]) == {"moving": 0.0}
    assert made.largest == 0


def test_noise_of_a_sensor_at_rest_is_rest_and_more_is_not():
    wanted, found = pair()
    found[:, 0] = 0.05 * np.sin(TIME)
    assert np.isnan(error_over_range(wanted, found, uncertainty=[0.1, None]).error[0])
    assert error_over_range(wanted, 10 * found, uncertainty=[0.1, None]).error[0] == np.inf
    assert REST.uncertainties * 0.1 > 0.1


def test_rows_side_by_side_are_judged_one_by_one():
    wanted = np.stack(pair(), axis=2)
    found = wanted.copy()
    found[:, 1, 1] *= 1.02
    found[10, 0, 0] = np.nan
    made = error_over_range(wanted, found)
    assert made.largest[0] == np.inf
    assert made.largest[1] == pytest.approx(0.02 * np.sqrt(np.mean(np.sin(TIME) ** 2)) * 3 / np.ptp(wanted[:, 1, 1]))


def test_a_drive_is_as_good_as_its_worst_part():
    """An error of half a second in three minutes: hidden by the whole, shown by its manoeuvre and its window."""
    step, count = 0.01, 18000
    torque = np.zeros(count)
    torque[9000:] = 100.0
    wanted = np.cumsum(torque)[:, None] * step
    found = wanted.copy()
    found[9000:9050] += 0.1 * np.ptp(wanted)
    parts = parts_of([torque], step)
    assert [(part.start, part.stop) for part in parts[:2]] == [(0, 1000), (1000, 2000)]
    assert (parts[-1].start, parts[-1].stop) == (8999, 9200)
    whole = error_over_range(wanted, found).error[0]
    assert whole == pytest.approx(0.1 * np.sqrt(50 / count), rel=1e-6)
    assert worst_part(wanted, found, parts[:-1]).error[0] == pytest.approx(0.1 * np.sqrt(50 / 1000), rel=1e-6)
    assert worst_part(wanted, found, parts).error[0] == pytest.approx(0.1 * np.sqrt(50 / 201), rel=1e-6)


def test_parts_cover_a_drive_and_long_changes_are_no_manoeuvre():
    random = np.random.default_rng(1)
    for count in (300, 1499, 4321):
        parts = parts_of([random.normal(size=count)], 0.01)
        covered = np.zeros(count, bool)
        for part in parts:
            covered[part] = True
        assert covered.all()
        assert all(part.stop - part.start <= 2000 for part in parts)
