"""What must hold for any signals: range, exactness for identical signals, invariance, monotony in delay."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from matching.fidelity import attribute, bands, xil_fidelity
from modelling.fidelity.delay import Delay
from modelling.fidelity.measures import (
    Fidelity,
    FidelityMethod,
    SignalFidelity,
    SignalPair,
    delay_fidelity,
    fidelity_distribution,
    fidelity_of_signals,
)

COUNT, STEP = 400, 5e-3
TIME = STEP * np.arange(COUNT)
WEIGHTS = {"system_dynamics": 0.7, "measurement_uncertainty": 0.3}
seeds = st.integers(0, 10**6)
kinds = st.sampled_from(["noise", "walk", "sine", "step", "constant", "spike", "ramp"])


def signal(kind, seed):
    generator = np.random.default_rng(seed)
    if kind == "noise":
        return generator.standard_normal(COUNT)
    if kind == "walk":
        return np.cumsum(generator.standard_normal(COUNT))
    if kind == "sine":
        return np.sin(2 * np.pi * generator.uniform(0.5, 20) * TIME + generator.uniform(0, 6))
    if kind == "step":
        return np.tanh((TIME - generator.uniform(0.5, 1.5)) / generator.uniform(0.02, 0.2))
    if kind == "spike":
        return np.where(np.arange(COUNT) == generator.integers(1, COUNT - 1), 1.0, 0.0)
    return generator.normal() + (TIME if kind == "ramp" else 0 * TIME)


def judge(reference, test, time=TIME, scale=1.0, u=0.02):
    width = float(np.ptp(reference)) * scale
    return fidelity_of_signals(
        time, {"torque": SignalPair(scale * reference, scale * test, u * width)}, f_max=30.0, weights=WEIGHTS
    )


@given(kinds.filter(lambda kind: kind != "constant"), kinds, seeds, st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
@settings(max_examples=60, deadline=None)
def test_range(reference, test, seed, offset, scale):
    fidelity = judge(signal(reference, seed), offset + scale * signal(test, seed + 1))
    values = [
        fidelity.total,
        *fidelity.domains.values(),
        fidelity.signals["system_dynamics"][0].nrmse,
        fidelity.signals["system_dynamics"][0].delay_fidelity,
    ]
    assert all(0 <= value <= 1 for value in values)


@given(kinds.filter(lambda kind: kind != "constant"), seeds)
@settings(max_examples=40, deadline=None)
def test_identical_signals_score_exactly_one(kind, seed):
    reference = signal(kind, seed)
    fidelity = fidelity_of_signals(
        TIME, {"torque": SignalPair(reference, reference.copy(), 0.0)}, f_max=30.0, weights=WEIGHTS
    )
    assert fidelity.total == 1
    assert max((loss.loss for loss in attribute(fidelity).losses), default=0.0) < 1e-9


def test_a_signal_without_relation_scores_zero_at_worst():
    reference = signal("step", 1)
    fidelity = fidelity_of_signals(
        TIME, {"torque": SignalPair(reference, 50 * signal("noise", 2), 1e3)}, f_max=30.0, weights=WEIGHTS
    )
    assert fidelity.total == 0


@given(seeds, st.sampled_from([1e-6, 1e-3, 0.1047197551, 9.5492965855, 1e3, 1e6]), st.floats(-1e4, 1e4))
@settings(max_examples=25, deadline=None)
def test_units_and_offsets_of_time_do_not_matter(seed, scale, offset):
    reference = signal("step", seed)
    test = 0.9 * np.interp(TIME - 0.012, TIME, reference) + 0.02 * signal("noise", seed + 1)
    first, second, third = (
        judge(reference, test),
        judge(reference, test, scale=scale),
        judge(reference, test, TIME + offset),
    )
    assert second.total == pytest.approx(first.total, abs=1e-7)
    assert third.total == pytest.approx(first.total, abs=1e-7)


@given(st.floats(0, 0.05), st.floats(0, 0.05))
def test_delay_fidelity_is_monotone(first, second):
    low, high = sorted((first, second))
    assert delay_fidelity(low, 30.0) >= delay_fidelity(high, 30.0)


@given(seeds)
@settings(max_examples=15, deadline=None)
def test_fidelity_falls_with_delay(seed):
    start = np.random.default_rng(seed).uniform(0.6, 1.2)
    reference = np.tanh((TIME - start) / 0.08)
    totals = [
        judge(reference, np.tanh((TIME - start - lag) / 0.08)).total for lag in (0.0, 0.001, 0.003, 0.006, 0.012, 0.03)
    ]
    assert all(a > b for a, b in itertools.pairwise(totals))


@given(kinds.filter(lambda kind: kind != "constant"), kinds, seeds)
@settings(max_examples=30, deadline=None)
def test_bands_add_up_and_losses_too(reference, test, seed):
    pair = SignalPair(signal(reference, seed), signal(test, seed + 1))
    found = bands(pair, STEP, 30.0)
    whole = float(np.mean((pair.reference - pair.test) ** 2))
    assert sum(band.mean_square for band in found) == pytest.approx(whole, rel=1e-9, abs=1e-20)
    fidelity = judge(pair.reference, pair.test)
    assert sum(loss.loss for loss in attribute(fidelity).losses) == pytest.approx(1 - fidelity.total**2, abs=1e-9)


def test_bands_find_where_and_by_how_much():
    """A tone of 12 Hz that is 4 ms late and one of 3 Hz with half the amplitude."""
    time = 1e-3 * np.arange(4000)
    window = np.hanning(len(time))
    reference = window * (np.sin(2 * np.pi * 3 * time) + np.sin(2 * np.pi * 12 * time))
    test = window * (0.5 * np.sin(2 * np.pi * 3 * time) + np.sin(2 * np.pi * 12 * (time - 0.004)))
    found = {(band.low, band.high): band for band in bands(SignalPair(reference, test), 1e-3, 30.0)}
    assert found[2.0, 4.0].amplitude_share > 0.99
    assert found[10.0, 15.0].phase_share > 0.95
    assert found[10.0, 15.0].delay == pytest.approx(0.004, abs=1e-4)
    assert sum(band.share for band in found.values()) == pytest.approx(1)
    assert found[2.0, 4.0].share + found[10.0, 15.0].share > 0.99


def test_uncertainty_of_fidelity_is_that_of_repetitions():
    """The scatter of R_XiL over simulated repetitions agrees with what one measurement says of it."""
    generator = np.random.default_rng(0)
    reference = np.tanh((TIME - 0.7) / 0.05) + np.where(
        TIME > 0.7, 0.3 * np.exp(-5 * (TIME - 0.7)) * np.sin(50 * (TIME - 0.7)), 0
    )
    test = np.interp(TIME - 0.006, TIME, 0.95 * reference)
    sigma = 0.03
    totals, told = [], []
    for _ in range(60):
        pair = SignalPair(
            reference + sigma * generator.standard_normal(COUNT),
            test + sigma * generator.standard_normal(COUNT),
            noise=(sigma, sigma),
        )
        fidelity = fidelity_of_signals(TIME, {"torque": pair}, f_max=30.0, weights={"system_dynamics": 1.0})
        totals.append(fidelity.total)
        told.append(fidelity_distribution(fidelity, 4000).total.std())
    assert np.mean(told) == pytest.approx(np.std(totals, ddof=1), rel=0.35)


def test_a_value_with_an_undetermined_delay_is_the_upper_end_of_its_interval():
    time = np.arange(0, 2, 1e-3)
    wave = np.sin(2 * np.pi * 5 * time)  # every period later would do as well
    pair = SignalPair(wave, 0.8 * wave, noise=(0.01, 0.01))
    found = fidelity_of_signals(time, {"torque": pair}, f_max=30.0, weights={"system_dynamics": 1.0})
    assert found.signals["system_dynamics"][0].delay.value is None
    for one, value in (("total", found.total), ("system_dynamics", found.domains["system_dynamics"])):
        low, high = fidelity_distribution(found, 4000).summary()[one].interval
        assert high == pytest.approx(value, rel=0.01)
        assert low < value <= high


def stated(nrmse_uncertainty=0.0, delay_uncertainty=None, step=None, form="definition", pair=None):
    """R_NRMSE 0.9 and no delay, as a paper states them, or with signals (t,) of range 2 that are 0.2 apart."""
    delay = Delay(0.0, delay_uncertainty)
    dynamic = SignalFidelity("torque", 0.9, delay, 1.0, nrmse_uncertainty, pair, 0.04, 2.0)
    total = float(np.sqrt((0.81 + 1) / 2))
    domains, weights = {"system_dynamics": total}, {"system_dynamics": 1.0}
    return Fidelity(
        total, domains, weights, {"system_dynamics": (dynamic,)}, (), FidelityMethod(30.0, nrmse_form=form), step
    )


@pytest.mark.parametrize("step", [None, STEP])
def test_a_stated_value_scatters_by_its_own_uncertainty_beside_recorded_signals_too(step):
    drawn = fidelity_distribution(stated(0.02, step=step)).domains["system_dynamics"]
    nrmse = np.sqrt(2 * drawn**2 - 1)
    assert np.mean(nrmse) == pytest.approx(0.9, abs=5e-4)
    assert np.std(nrmse) == pytest.approx(0.02, rel=0.02)


@pytest.mark.parametrize(("form", "nrmse"), [("definition", 1 - 0.2 / 2), ("literal", 1 - np.sqrt(0.04 / 2))])
def test_without_noise_and_uncertainty_every_draw_is_the_value_itself(form, nrmse):
    reference = np.linspace(-1.0, 1.0, 50)
    pair = SignalPair(reference, reference + 0.2, noise=(0.0, 0.0))
    drawn = fidelity_distribution(stated(step=STEP, form=form, pair=pair), draws=10).domains["system_dynamics"]
    np.testing.assert_allclose(drawn, np.sqrt((nrmse**2 + 1) / 2), rtol=1e-12)


@pytest.mark.parametrize(
    ("fidelity", "said"),
    [(stated(), True), (stated(0.02), False), (stated(0.0, 1e-3), False), (stated(step=STEP), False)],
)
def test_only_values_without_any_uncertainty_are_said_to_have_none(fidelity, said):
    notes = xil_fidelity("paper", fidelity, draws=10).notes
    assert any("stated without uncertainty" in note for note in notes) == said
