"""Spectra of residuals: white noise is 1 at every frequency and order, a wave stands where it belongs."""

from types import SimpleNamespace

import numpy as np
import pytest

from matching.diagnosis.result import DiscrepancyCurve
from matching.report.diagnosis import _orders, _running_mean, _spectrum, balance_figure, discrepancy_figure, recorded

RNG = np.random.default_rng(11)


def test_white_noise_is_one_over_frequency_and_orders() -> None:
    noise = RNG.standard_normal(20_000)
    frequency, amplitude = _spectrum(noise, 0.002)
    assert frequency[-1] == pytest.approx(250)
    assert np.sqrt(np.mean(amplitude[1:-1] ** 2)) == pytest.approx(1, abs=0.05)
    _, amplitude = _orders(noise, np.cumsum(RNG.uniform(0, 0.1, len(noise))))
    assert np.sqrt(np.mean(amplitude**2)) == pytest.approx(1, abs=0.15)


def test_a_sensor_at_half_the_rate_is_drawn_and_its_noise_is_one_too() -> None:
    noise = RNG.standard_normal(20_000)
    noise[::2] = np.nan
    frequency, amplitude = _spectrum(noise, 0.002)
    assert frequency[-1] == pytest.approx(125)
    assert np.sqrt(np.mean(amplitude[1:-1] ** 2)) == pytest.approx(1, abs=0.05)
    mean = _running_mean(noise + 3)
    assert np.isnan(mean[::2]).all()
    assert np.mean(mean[1::2]) == pytest.approx(3, abs=0.05)
    noise[1001:1101] = np.nan
    time, values = recorded(np.arange(20_000) * 0.002, noise)
    assert np.flatnonzero(np.isnan(values)).tolist() == [500]  # the gap alone
    assert len(time) == len(values) == 10_000 - 50 + 1
    assert time[499:502] == pytest.approx([0.002 * 999, 0.002 * 1101, 0.002 * 1101])


def test_a_wave_over_the_angle_shows_at_its_order_though_the_shaft_reverses() -> None:
    time = np.arange(0, 12, 0.001)
    angle = 30 * np.sin(0.9 * time) + 4 * time
    residual = RNG.standard_normal(len(time)) + 0.5 * np.sin(3 * angle + 0.4)
    residual[100:300] = np.nan
    order, amplitude = _orders(residual, angle)
    assert order[np.argmax(amplitude)] == pytest.approx(3, abs=0.03)
    expected = 0.5 * np.sqrt(np.isfinite(residual).sum()) / 2  # of a sine of amplitude ½ among so many readings
    assert amplitude.max() == pytest.approx(expected, rel=0.1)
    far = np.abs(order - 3) > 1  # the angle is not sampled evenly, so the wave leaks to the sides
    assert np.median(amplitude[far]) < 0.1 * expected


def test_a_wave_over_time_shows_at_its_frequency() -> None:
    time = np.arange(0, 12, 0.001)
    frequency, amplitude = _spectrum(RNG.standard_normal(len(time)) + np.sin(2 * np.pi * 7 * time), 0.001)
    assert frequency[np.argmax(amplitude)] == pytest.approx(7, abs=0.25)


def a_balance(shafts):
    """Torques of two inertias over 4 s, 1000 N·m in the 0.3 s at either end; the speed rises by 5 rad/s a second."""
    time = np.arange(4000) * 0.001
    inner = (time >= 0.3) & (time <= time[-1] - 0.3)
    motion = SimpleNamespace(
        time=time, segments=(slice(0, 4000),), speed={"motor": 5 * time, "load": -time}, twist={"link": 0.01 * time}
    )
    of_inertias = {"load": np.where(inner, 1.0, 1000.0), "motor": np.where(inner, 10 * time, 1000.0)}
    return SimpleNamespace(before=motion, inertias=of_inertias, shafts=shafts), time[inner]


def test_a_balance_shows_the_worst_components_over_their_motion_away_from_the_ends() -> None:
    data, inner = a_balance({"link": np.arange(4000) * 0.003})
    bars, first, second = balance_figure(data).axes
    widths = {
        label.get_text(): bar.get_width() for label, bar in zip(bars.get_yticklabels(), bars.patches, strict=True)
    }
    motor, link = (np.sqrt(np.mean((slope * inner) ** 2)) for slope in (10, 3))
    assert widths == pytest.approx({"inertia load": 1.0, "shaft link": link, "inertia motor": motor})
    assert list(widths) == ["inertia load", "shaft link", "inertia motor"]  # the largest on top
    for axes, slope, label in ((first, 2.0, "Speed of motor in rad/s"), (second, 300.0, "Twist of link in rad")):
        dots, mean = axes.get_lines()
        np.testing.assert_allclose(dots.get_ydata(), slope * dots.get_xdata())
        near = 0.02 * np.ptp(dots.get_ydata())  # a bin is 1/48 of the range wide, and samples do not lie evenly in it
        np.testing.assert_allclose(mean.get_ydata(), slope * mean.get_xdata(), atol=near)
        assert len(mean.get_ydata()) == 48
        assert axes.get_xlabel() == label


def test_unexplained_torques_have_their_band_and_their_words() -> None:
    grid = np.linspace(-3, 3, 7)
    curve = DiscrepancyCurve("inertias.load", "speed", grid, 2 * grid, np.full(7, 0.5), 0.62, 0.9)
    over_time = DiscrepancyCurve("shafts.link", "time", grid, -grid, np.ones(7), 0.1, np.nan)
    figure = discrepancy_figure([curve, over_time, curve, curve])
    assert len(figure.axes) == 3
    first, second, _ = figure.axes
    (area,), (line,) = first.collections, first.get_lines()
    np.testing.assert_array_equal(line.get_xydata(), np.stack([grid, 2 * grid], axis=1))
    corners = area.get_paths()[0].vertices
    assert (corners[:, 1].min(), corners[:, 1].max()) == (-7, 7)  # two standard uncertainties beyond ± 6
    assert (first.get_xlabel(), first.get_ylabel()) == ("Speed of load in rad/s", "Unexplained on load in N·m")
    assert (second.get_xlabel(), second.get_ylabel()) == ("Time in s", "Unexplained in link in N·m")
    assert first.get_title() == "takes 62 % of the rest"


def test_a_channel_whose_rate_is_no_whole_part_of_the_grid_shows_no_lines_of_its_own():
    """200 Hz on a grid of 500 Hz, a sine of 3 Hz: nothing at 50 Hz, and nothing above 100 Hz."""
    residual = np.full(5000, np.nan)
    at = np.round(np.arange(0, 5000, 2.5)).astype(int)
    at = at[at < 5000]
    residual[at] = 100 * np.sin(2 * np.pi * 3 * 0.002 * at)
    frequency, amplitude = _spectrum(residual, 0.002)
    assert frequency[-1] == pytest.approx(100, rel=1e-3)
    assert frequency[np.argmax(amplitude)] == pytest.approx(3, abs=0.2)
    assert amplitude[frequency > 20].max() < 2e-3 * amplitude.max()
