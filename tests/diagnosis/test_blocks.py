"""Blocks of a recording that are left out in turn, against refits by SciPy over the closed form of a rotor."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import Fit, polished, solve
from matching.diagnosis.problem import base_problem
from matching.diagnosis.settings import DiagnosisSettings
from matching.diagnosis.unseen import Blocks, _restarted, blocks_for, cut, unseen_errors
from modelling.model_file import from_dict

J, DRAG, TORQUE, NOISE, COUNT = 0.5, 0.3, 2.0, 0.02, 6
TIME = np.arange(0, 6, 0.01)
SYSTEM = from_dict({
    "inertias": {"rotor": {"J": {"value": 0.9, "tolerance": 0.9},
                           "drag": {"value": 0.15, "lower": 0.05, "upper": 1.0}}},
    "inputs": {"motor": {"on": "rotor"}},
    "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": NOISE}},
})  # fmt: skip


def speed(J: float, drag: float, start: float) -> np.ndarray:
    """ω of J·ω̇ = M − drag·ω under a constant torque."""
    return TORQUE / drag + (start - TORQUE / drag) * np.exp(-drag * TIME / J)


def data(added: np.ndarray, *names: str) -> FitData:
    segments = []
    for i, name in enumerate(names or ("made",)):
        readings = speed(J, DRAG, 1.0) + NOISE * np.random.default_rng(i).standard_normal(len(TIME)) + added
        segments.append(Segment(TIME, np.full((len(TIME), 1), TORQUE), readings[:, None], name, i + 1))
    return FitData(tuple(segments), np.array([NOISE]))


def fitted(whole: FitData) -> Fit:
    return polished(solve(*base_problem(SYSTEM, whole)))


def test_every_recording_is_cut_into_equal_pieces_and_each_block_has_one_of_every_recording() -> None:
    whole = data(np.zeros(len(TIME)), "one", "other")
    blocks = cut(whole, COUNT)
    first, second = (blocks.of(segment) for segment in whole.segments)
    for number in (first, second):
        np.testing.assert_array_equal(np.bincount(number), np.full(COUNT, len(TIME) // COUNT))
        assert np.count_nonzero(np.diff(number)) == COUNT - 1  # pieces, not scattered samples
    assert not (first == second).any()  # other times of each
    np.testing.assert_array_equal(blocks.of(whole.segments[0].part(150, 250)), first[150:250])


@pytest.mark.parametrize("wrong", [0.0, 0.2])
def test_a_block_is_predicted_by_the_fit_without_it(wrong: float) -> None:
    """Also where the model is wrong by ten times the noise: a torque that comes and goes."""
    whole = data(wrong * np.sin(3 * TIME))
    fit, blocks = fitted(whole), cut(whole, COUNT)
    (found,) = unseen_errors(fit, blocks)
    number, readings = blocks.of(whole.segments[0]), whole.segments[0].readings[:, 0]
    for block in range(1, COUNT):
        seen = number != block
        truth = least_squares(lambda q, seen=seen: (readings - speed(*q))[seen], [J, DRAG, 1.0], xtol=1e-12).x
        own, since = readings[~seen], TIME[~seen] - TIME[~seen][0]
        decay = np.exp(-truth[1] * since / truth[0])  # the state with which the block begins is fitted to it: linear
        free = own - TORQUE / truth[1] * (1 - decay)
        expected = (free - decay * (decay @ free) / (decay @ decay)) / NOISE
        np.testing.assert_allclose(found[~seen, 0], expected, atol=0.1 + 0.05 * np.abs(expected).max())


def test_what_happens_in_one_block_is_not_foretold_by_the_others() -> None:
    blocks = cut(data(np.zeros(len(TIME))), COUNT)
    there = blocks.of(data(np.zeros(len(TIME))).segments[0]) == 3
    wave = 10 * np.sqrt(2) * NOISE * np.sin(2 * np.pi * 4 * TIME)
    (found,) = unseen_errors(fitted(data(np.where(there, wave, 0.0))), blocks)
    assert np.sqrt(np.mean(found[there] ** 2)) == pytest.approx(10, rel=0.1)


def test_an_error_of_the_speed_does_not_speak_against_a_later_block() -> None:
    """A torque that nobody knows acts in the second second alone: the blocks long after it are met to their noise."""
    free, start = speed(J, DRAG, 1.0), np.flatnonzero(TIME >= 1.0)[0]
    kick = np.where(TIME >= 1.0, 0.5 * np.exp(-DRAG * (TIME - TIME[start]) / J), 0.0)  # of 0.5 rad/s, then fading
    whole = data(kick)
    blocks = cut(whole, COUNT)
    fit = fitted(whole)
    known = replace(fit, v=np.array([J, DRAG, 1.0]))
    problem = known.problem
    known = replace(known, residual=problem.residuals(known.v[None])[0])
    late = blocks.of(whole.segments[0]) == COUNT - 4
    free_run = (whole.segments[0].readings[:, 0] - free)[late] / NOISE
    assert np.sqrt(np.mean(free_run**2)) > 5
    (found,) = _restarted(problem, [blocks.of(whole.segments[0])], np.repeat(known.v[None], COUNT, axis=0))
    assert np.sqrt(np.mean(found[late] ** 2)) == pytest.approx(1.0, abs=0.15)


def test_a_segment_within_a_block_has_a_start_of_its_own() -> None:
    """A short recording at another speed: no other reading tells where it begins."""
    whole = data(np.zeros(len(TIME)))
    short = replace(whole.segments[0].part(0, 90), name="short", recording=2)
    whole = replace(whole, segments=(*whole.segments, short))
    blocks = Blocks(2, {("made", 1): np.array([3.0]), ("short", 2): np.array([-1.0])})  # all of it in one block
    assert set(blocks.of(short)) == {0}
    found = unseen_errors(fitted(whole), blocks)
    assert np.sqrt(np.mean(found[1] ** 2)) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(("correlation", "count"), [(0.0, 6), (0.985, 4), (0.999, 3)])
def test_blocks_are_long_beside_the_memory_of_the_residual(correlation: float, count: int) -> None:
    """An autoregressive residual remembers (1 + a)/(1 − a) samples: 1, 132 and 2000 of 1200."""
    time = np.arange(1200) * 0.01
    slow = lfilter([1], [1, -correlation], np.random.default_rng(7).standard_normal((1200, 4)), axis=0)
    whole = FitData((Segment(time, np.zeros((1200, 0)), np.zeros((1200, 4)), "made"),), np.ones(4))
    fit = SimpleNamespace(problem=SimpleNamespace(data=whole), errors=[slow])
    assert blocks_for(fit, DiagnosisSettings()).count == pytest.approx(count, abs=correlation == 0.985)
