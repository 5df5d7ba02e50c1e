"""Long data: causes are searched for in a window, fitted to all, and searched for in all where that is not enough."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from plant.case import make_case
from plant.marks import needs_compiler

from matching.diagnosis import diagnose as identify_causes
from matching.diagnosis import search as search_window
from matching.diagnosis.data import FitData, Segment, prepare_data
from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.fit import base_problem, solve
from matching.diagnosis.holdout import OtherRecordings, split_holdout
from modelling.model_file import load
from modelling.recordings.read import read_recording

pytestmark = needs_compiler


@pytest.fixture(scope="module")
def drag(tmp_path_factory):
    """Model and recording of a two-mass drive with a drag that grows with the square of the speed."""
    folder = tmp_path_factory.mktemp("drag")
    make_case("two_mass", ["quadratic_drag"], "plain", "normal", 5, 8.0, 500.0).write(folder)
    system = load(folder / "model.toml")
    return system, read_recording(folder / "recording.csv", system)


@pytest.fixture(scope="module")
def base(drag):
    system, recording = drag
    return solve(*base_problem(system, split_holdout(prepare_data(system, [recording])[0])[0]))


def test_short_data_have_no_window(base) -> None:
    assert search_window.search_window(base) is None


def test_the_worst_window_is_taken(base, monkeypatch) -> None:
    monkeypatch.setattr(search_window, "MOST_READINGS", 3000)
    part = search_window.search_window(base)
    assert 2900 <= part.readings_count <= 3000
    time = base.problem.data.segments[0].time
    square = (base.by_sensor()[0] ** 2).sum(axis=1)
    inside = (time >= part.segments[0].time[0]) & (time <= part.segments[0].time[-1])
    length = int(inside.sum())
    most = max(square[k : k + length].mean() for k in range(len(square) - length))
    assert square[inside].mean() > 0.9 * most
    assert square[inside].mean() > 1.1 * square.mean()


def test_several_short_segments_fill_it(base, monkeypatch) -> None:
    whole = base.problem.data.segments[0]
    cuts = tuple(whole.part(k, k + 400) for k in range(0, 2800, 400))
    data = FitData(cuts, base.problem.data.noise)
    fit = solve(*base_problem(base.problem.system, data))
    monkeypatch.setattr(search_window, "MOST_READINGS", 3000)
    part = search_window.search_window(fit)
    assert [len(one.time) for one in part.segments].count(400) == 2
    assert part.readings_count <= 3000
    worst = int(np.argmax([np.sum(own**2) for own in fit.by_sensor()]))
    assert any(one.time[0] == cuts[worst].time[0] for one in part.segments)
    assert [one.time[0] for one in part.segments] == sorted(one.time[0] for one in part.segments)


def test_first_readings_are_cut_to_length(monkeypatch) -> None:
    monkeypatch.setattr(search_window, "MOST_READINGS", 300)
    one = Segment(np.arange(200) * 1e-3, np.zeros((200, 1)), np.zeros((200, 2)))
    assert [len(own.time) for own in search_window.first_readings(FitData((one, one), np.ones(2))).segments] == [150]
    assert [
        len(own.time) for own in search_window.first_readings(FitData((one.part(0, 80), one), np.ones(2))).segments
    ] == [80, 70]


def test_answer_is_that_of_a_search_over_all(drag, monkeypatch) -> None:
    system, recording = drag
    steps: list[str] = []
    whole = diagnose(system, [recording])
    monkeypatch.setattr(search_window, "MOST_READINGS", 4000)
    found = diagnose(system, [recording], progress=steps.append)
    assert any("time window" in step for step in steps)
    assert [(cause.kind, cause.at) for cause in found.causes] == [(cause.kind, cause.at) for cause in whole.causes]
    assert found.verdict == whole.verdict == "explained"
    for key, expected in whole.causes[0].parameters.items():
        value = found.causes[0].parameters[key]
        assert abs(value.value - expected.value) < 0.3 * expected.standard_uncertainty
        assert value.standard_uncertainty == pytest.approx(expected.standard_uncertainty, rel=0.1)
    for name, errors in whole.errors.items():
        assert found.errors[name].after_holdout == pytest.approx(errors.after_holdout, rel=0.02)


def test_causes_are_searched_for_in_all_data_where_the_window_is_not_enough(drag, base, monkeypatch) -> None:
    """As when a second effect acts at another time than the one that is largest."""
    system, _ = drag
    monkeypatch.setattr(search_window, "MOST_READINGS", 4000)
    searched = []
    search = identify_causes._search_and_rate

    def spy(system, fit, holdout, progress):
        searched.append(samples(fit))
        return search(system, fit, holdout, progress)

    def samples(fit) -> int:
        return len(fit.problem.data.segments[0].time)

    monkeypatch.setattr(identify_causes, "_search_and_rate", spy)
    monkeypatch.setattr(identify_causes, "at_noise", lambda hypothesis: samples(hypothesis.fit) < samples(base))
    rest = replace(base.problem.data, segments=(base.problem.data.segments[0].part(0, 500),))
    state = identify_causes.identify_causes(system, base, OtherRecordings(rest), lambda _: None).state
    assert searched == [pytest.approx(4000 / 3, abs=1), samples(base)]
    assert samples(state.best.fit) == samples(base)


def flat_fit(*levels):
    """A fit of segments of 1000 samples, two sensors, whose residuals are these; only what a window is chosen by."""
    segments = tuple(
        Segment(np.arange(1000) * 1e-3 + 10 * i, np.zeros((1000, 1)), np.zeros((1000, 2))) for i in range(len(levels))
    )
    problem = SimpleNamespace(data=FitData(segments, np.ones(2)))
    return SimpleNamespace(problem=problem, by_sensor=lambda: list(levels))


def test_the_window_with_the_largest_mean_square_of_all_sensors_is_taken(monkeypatch) -> None:
    """Windows of 400 samples begin every 50, and at the last one that fits."""
    monkeypatch.setattr(search_window, "MOST_READINGS", 800)
    residual = np.zeros((1000, 2))
    residual[450:850, 0] = 2.0
    residual[100:300, 1] = 2.5  # less in all: 1250 against 1600
    (part,) = search_window.search_window(flat_fit(residual)).segments
    assert (part.time[0], len(part.time)) == (pytest.approx(0.45), 400)
    end = np.zeros((1000, 2))
    end[-1] = 1.0
    (part,) = search_window.search_window(flat_fit(end)).segments
    assert (part.time[0], part.time[-1]) == (pytest.approx(0.6), pytest.approx(0.999))


def test_what_is_left_goes_to_the_next_worst_segment(monkeypatch) -> None:
    monkeypatch.setattr(search_window, "MOST_READINGS", 2800)
    quiet, loud, middle = (np.full((1000, 2), level) for level in (0.1, 2.0, 1.0))
    middle[700:] = 5.0  # 400 samples with 300 of these: the worst window is the last
    parts = search_window.search_window(flat_fit(quiet, loud, middle)).segments
    assert [(part.time[0], len(part.time)) for part in parts] == [(10.0, 400), (20.0, 1000)]
