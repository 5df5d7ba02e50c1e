"""Long data: causes are sought on a stretch, fitted to all, and sought on all where the stretch does not do."""

from dataclasses import replace

import numpy as np
import pytest
from plant.case import make_case
from plant.marks import needs_compiler

from matching.diagnosis import identify_causes as walk
from matching.diagnosis.data.preparation import prepare_data, split
from matching.diagnosis.data.segments import Data, Segment
from matching.diagnosis.diagnosis import diagnose
from matching.diagnosis.fitting.fit import base_problem, solve
from matching.diagnosis.search import search_window as looked_at
from matching.diagnosis.search.search_window import head, stretch
from modelling.measurement.recording import read_recording
from modelling.model.files import load

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
    return solve(*base_problem(system, split(prepare_data(system, [recording])[0])[0]))


def test_short_data_are_looked_at_whole(base) -> None:
    assert stretch(base) is None


def test_the_worst_stretch_is_taken(base, monkeypatch) -> None:
    monkeypatch.setattr(looked_at, "LONG", 3000)
    part = stretch(base)
    assert 2900 <= part.samples.sum() <= 3000
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
    data = Data(cuts, base.problem.data.noise)
    fit = solve(*base_problem(base.problem.system, data))
    monkeypatch.setattr(looked_at, "LONG", 3000)
    part = stretch(fit)
    assert [len(one.time) for one in part.segments].count(400) == 2
    assert part.samples.sum() <= 3000
    worst = int(np.argmax([np.sum(own**2) for own in fit.by_sensor()]))
    assert any(one.time[0] == cuts[worst].time[0] for one in part.segments)
    assert [one.time[0] for one in part.segments] == sorted(one.time[0] for one in part.segments)


def test_head_is_cut_to_length(monkeypatch) -> None:
    monkeypatch.setattr(looked_at, "LONG", 300)
    one = Segment(np.arange(200) * 1e-3, np.zeros((200, 1)), np.zeros((200, 2)))
    assert [len(own.time) for own in head(Data((one, one), np.ones(2))).segments] == [150]
    assert [len(own.time) for own in head(Data((one.part(0, 80), one), np.ones(2))).segments] == [80, 70]


def test_answer_is_that_of_a_search_over_all(drag, monkeypatch) -> None:
    system, recording = drag
    told: list[str] = []
    whole = diagnose(system, [recording])
    monkeypatch.setattr(looked_at, "LONG", 4000)
    found = diagnose(system, [recording], tell=told.append)
    assert any("stretch" in line for line in told)
    assert [(cause.kind, cause.at) for cause in found.causes] == [(cause.kind, cause.at) for cause in whole.causes]
    assert found.verdict == whole.verdict == "explained"
    for key, (own, _) in whole.causes[0].parameters.items():
        again, _ = found.causes[0].parameters[key]
        assert abs(again.value - own.value) < 0.3 * own.standard_uncertainty
        assert again.standard_uncertainty == pytest.approx(own.standard_uncertainty, rel=0.1)
    for name, errors in whole.errors.items():
        assert found.errors[name]["after_holdout"] == pytest.approx(errors["after_holdout"], rel=0.02)


def test_causes_are_sought_on_all_where_the_stretch_does_not_do(drag, base, monkeypatch) -> None:
    """As when a second effect acts at another time than the one that is largest."""
    system, _ = drag
    monkeypatch.setattr(looked_at, "LONG", 4000)
    searched = []
    real = walk._searched

    def spy(system, own, ahead, tell):
        searched.append(len(own.problem.data.segments[0].time))
        return real(system, own, ahead, tell)

    every = len(base.problem.data.segments[0].time)
    monkeypatch.setattr(walk, "_searched", spy)
    monkeypatch.setattr(walk, "at_noise", lambda named: len(named.fit.problem.data.segments[0].time) < every)
    rest = replace(base.problem.data, segments=(base.problem.data.segments[0].part(0, 500),))
    state, _ = walk.walk(system, base, lambda named: [], rest, lambda _: None)
    assert searched == [pytest.approx(4000 / 3, abs=1), every]
    assert len(state.best.fit.problem.data.segments[0].time) == every
