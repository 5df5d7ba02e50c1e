"""When a measured error counts as predicted, in closed form."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from matching.bed.commission import Commissioning, Round, best_round, end_of
from matching.bed.measured import MeasuredFunction
from matching.bed.verify import Figures, _Function, _open_error, interval_of, judged


def figures(error, spread=0.0, predicted=0.005, unknown=0.0, resolution=0.0):
    return Figures(error**2, (2 * error * spread) ** 2, predicted**2, unknown, resolution)


@pytest.mark.parametrize(
    ("error", "spread", "expected", "status"),
    [
        (0.004, 0.0005, 0.006, "as_predicted"),
        (0.009, 0.0005, 0.006, "as_predicted"),  # below a tenth of what is allowed
        (0.04, 0.002, 0.006, "short"),  # within what is allowed, but not what the match promised
        (0.04, 0.002, 0.05, "as_predicted"),  # the case states so much as uncertain
        (0.13, 0.002, 0.2, "short"),  # more than the case allows
        (0.03, 0.015, 0.006, "as_predicted"),  # consistent, and surely within what is allowed
        (0.09, 0.045, 0.02, "undetermined"),
    ],
)
def test_an_error_is_held_against_the_prediction_within_its_uncertainty(error, spread, expected, status):
    assert judged("measured", [figures(error, spread)], expected, 0.1).status == status


def test_what_does_not_show_is_left_out_and_said():
    hidden = Figures(math.nan, math.nan, 0.04**2, 0.6)
    found = judged("measured", [figures(0.003), hidden], 0.01, 0.1)
    assert (found.status, found.resolved) == ("as_predicted", 0.5)
    assert found.value == pytest.approx(0.003)
    assert found.predicted == pytest.approx(0.005)
    nothing = judged("measured", [hidden], 0.01, 0.1)
    assert (nothing.status, nothing.resolved) == ("undetermined", 0.0)


def test_what_spectral_lines_change_is_taken_off_and_stays_half_unsure():
    """A true error of 0.02 that the lines show as √(0.02² + 0.03²)."""
    found = judged("measured", [figures(math.hypot(0.02, 0.03), resolution=0.03**2)], 0.01, 0.1)
    assert found.value == pytest.approx(0.02)
    spread = 0.5 * 0.03**2 / math.sqrt(3)
    assert found.interval == (0.0, pytest.approx(math.sqrt(0.02**2 + 2 * spread)))
    assert found.uncertainty == pytest.approx(0.01)  # down to none at all


def test_a_function_below_the_noise_is_not_known():
    f = np.geomspace(1, 10, 50)
    ones = np.ones(50, complex)
    noisy = np.sqrt(np.where(f > 5, 0.5, 1e-6))[:, None]
    found = Figures.of(MeasuredFunction(f, ones, noisy, np.ones(50)), ones, ones, (1.0, 10.0))
    assert found.unknown == pytest.approx(1 - math.log10(5), abs=0.03)
    assert not found.known


def test_the_interval_holds_where_a_dip_of_the_response_moved_and_lies_in_the_noise():
    """A drawn zero s² + 2ζω₀s + ω₀² that is off by up to 12 %, in drawn noise; 90 to 98 % of 300 are asked."""
    rng, covered, band = np.random.default_rng(3), [], (1.0, 30.0)

    def dip(f, f0, damping):
        return 1 + 2j * damping * f / f0 - (f / f0) ** 2

    for _ in range(300):
        f = np.sort(rng.choice(np.arange(1, 30, 0.1), 100, replace=False))
        f0, damping, off = (
            rng.uniform(8, 25),
            10 ** rng.uniform(-3, -1.5),
            rng.normal() * rng.choice([0.002, 0.02, 0.06]),
        )
        true = dip(f, f0 * (1 + off), damping) * np.exp(complex(*rng.normal(size=2)) * abs(off))
        vehicle, noise = dip(f, f0, damping * np.exp(0.3 * rng.normal())), 10 ** rng.uniform(-2.5, -1.2)
        read = true + noise * (rng.normal(size=100) + 1j * rng.normal(size=100)) / np.sqrt(2)
        measured = MeasuredFunction(f, read, np.full((100, 1), noise + 0j), np.ones(100))
        found = Figures.of(measured, vehicle, vehicle, band)
        low, high = interval_of(found.square, math.sqrt(found.variance))
        middles = np.log([band[0], *np.sqrt(f[1:] * f[:-1]), band[1]])
        error = np.sqrt(np.diff(middles) @ np.abs(np.log(true / vehicle)) ** 2 / (middles[-1] - middles[0]))
        covered.append(low <= error <= high)
    assert 0.9 <= np.mean(covered) <= 0.98


def verification(error, status="as_predicted", uncertainty=0.001, predicted=0.005):
    one = {"name": "measured", "error": error, "standard_uncertainty": uncertainty, "predicted": predicted,
           "allowed": 0.1, "status": status}  # fmt: skip
    return {"status": status, "errors": [one]}


def test_a_circle_goes_on_as_long_as_a_round_would_gain():
    first = Round(1, verification=verification(0.06))
    assert end_of([first]) is None  # allowed, and far above what a match with the true values reaches
    good = Round(2, verification=verification(0.012))
    assert "as well as the match can make it" in end_of([first, good])
    same = Round(2, verification=verification(0.0595, "short"))
    assert "gained nothing" in end_of([first, same])
    assert end_of([Round(1, verification=verification(0.01, "short"))]) is None


def test_a_round_that_cannot_gain_more_than_its_uncertainty_is_not_asked_for():
    weak = {"open": [{"name": "response error to measured torques", "because": "excitation"}]}
    open_ = verification(0.05, "undetermined", uncertainty=0.09)
    assert "planned excitation is too weak" in end_of(
        [Round(1, verification=open_ | weak | {"planned": {"measured": 0.06}})]
    )
    # the next proof is planned to decide it: what made this one worse can be diagnosed
    assert end_of([Round(1, verification=open_ | weak | {"planned": {"measured": 0.01}})]) is None
    vehicle = {"open": [{"name": "response error to measured torques", "because": "vehicle"}]}
    assert "not known of the vehicle" in end_of([Round(1, verification=open_ | vehicle)])
    hidden = verification(None, "undetermined", uncertainty=None) | weak
    assert "planned excitation is too weak" in end_of(
        [Round(1, verification=hidden | {"planned": {"measured": math.inf}})]
    )
    assert end_of([Round(1, verification=hidden | {"planned": {"measured": 0.01}})]) is None
    # 0.02 over what can be reached: told by a proof of ± 0.012, not by one of ± 0.024
    assert end_of([Round(1, verification=verification(0.035, uncertainty=0.006))]) is None
    assert "the uncertainty of this one" in end_of([Round(1, verification=verification(0.035, uncertainty=0.012))])


def recorded(rng, sigma, case):
    """A function of 120 lines that is off by 0.02, read with noise of ``sigma`` over the response."""
    f = np.geomspace(*case.band, 120)
    noise = sigma * (rng.normal(size=120) + 1j * rng.normal(size=120)) / np.sqrt(2)
    off = 0.02 * np.exp(2j * np.pi * rng.random(120))
    ones, few = np.ones(120, complex), np.zeros((0, 120))
    measured = MeasuredFunction(f, np.exp(off) + noise, np.full((120, 1), sigma + 0j), np.ones(120))
    return _Function("measured", 0, "torque", "sensor", measured, None, ones, ones, few, case.band)


def test_a_length_that_would_do_does():
    """An excitation that is too weak for its question says so with a length; recordings of that length decide it."""
    rng, case = np.random.default_rng(8), SimpleNamespace(band=(1.0, 30.0))

    def question(function):
        def of_kind(longer, known_vehicle=False):
            return judged("measured", [function.figures_of(longer, known_vehicle)], 0.01, 0.1)

        now = of_kind(1.0)
        return now, _open_error(now, of_kind) if now.status == "undetermined" else None

    enough, weak = [], []
    for _ in range(60):
        sigma = 10 ** rng.uniform(-0.7, 0.0)
        now, asked = question(recorded(rng, sigma, case))
        if asked is None:
            continue
        assert (asked.because == "excitation") == (not 2 * now.uncertainty <= 0.1)
        weak.append(asked.because == "excitation")
        then, _ = question(recorded(rng, sigma / math.sqrt(asked.longer), case))
        enough.append(then.uncertainty <= 1.2 * 0.1 / 3)
    assert len(weak) > 30
    assert 0 < sum(weak) < len(weak)
    assert np.mean(enough) > 0.9


def test_what_is_not_known_of_the_vehicle_is_not_blamed_on_the_excitation():
    """Vehicles drawn 0.3 to either side: no recording decides, a known vehicle does."""
    case = SimpleNamespace(band=(1.0, 30.0))
    function = recorded(np.random.default_rng(2), 0.01, case)
    far = replace(function, drawn=np.exp(np.outer([0.3, -0.3], np.ones(120))))

    def of_kind(longer, known_vehicle=False):
        return judged("measured", [far.figures_of(longer, known_vehicle)], 0.01, 0.1)

    asked = _open_error(of_kind(1.0), of_kind)
    assert (asked.because, asked.longer) == ("vehicle", math.inf)


def test_the_best_round_is_the_one_nearest_to_the_same_vehicle():
    rounds = [
        Round(1, verification=verification(0.01), against_last_vehicle=verification(0.08)),
        Round(2, verification=verification(0.02)),
        Round(3),
    ]
    assert best_round(rounds) == 2
    assert best_round([Round(1)]) is None


def test_a_commissioning_that_waits_says_so_and_keeps_what_it_had():
    verified = Round(1, match={"status": "as given"}, verification=verification(0.02, "short"))
    result = Commissioning((verified, Round(2)), waiting_for="put the recording there")
    assert result.status == "waiting"
    assert replace(result, waiting_for=None).status == "short"
    assert result.to_dict()["rounds"] == [
        {"round": 1, "match": {"status": "as given"}, "verification": verification(0.02, "short")},
        {"round": 2},
    ]
    assert replace(result, rounds=(), waiting_for=None).status is None
