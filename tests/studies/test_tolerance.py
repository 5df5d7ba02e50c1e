"""Tolerance studies against the verification of single draws, and against answers known beforehand."""

import json
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from independent.dynamic_stiffness import Judge
from result_schema import check_schema

import rigmatch as rm
from matching.cli import main
from matching.match.case_file import load_case
from matching.match.kept import kept
from matching.match.loop import control_law
from matching.match.map import Axis
from matching.match.tolerance import (
    Prepared,
    Regressors,
    draw,
    quantile_intervals,
    spread,
    tolerance,
    tuned,
    varied_of,
)
from modelling.errors import InputError

STARTER = Path(__file__).parents[2] / "matching" / "starter" / "case.toml"
# A loop that a match of the starter case found, rounded: what a study begins with.
TUNED = {
    "loop.proportional_gain": 260.0, "loop.integral_gain": 790.0, "loop.torque_feed_forward": 1.06,
    "loop.lead_time": 0.002, "rig.shafts.flange.stiffness": 6.5e5,
}  # fmt: skip
REFERENCE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "case.toml"
ADDED = {"rig.inertias.rotor.J": 0.1, "rig.inertias.motor.J": 0.1, "loop.dead_time": 0.3}


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("starter")
    for part in STARTER.parent.iterdir():
        (folder / part.name).write_text(part.read_text())
    text = STARTER.read_text()
    for name, value in TUNED.items():
        text = text.replace(f'"{name}" = {{ ', f'"{name}" = {{ start = {value!r}, ')
    (folder / "case.toml").write_text(text)
    return load_case(folder / "case.toml")


@pytest.fixture(scope="module")
def prepared(case):
    own = tuned(case)
    return Prepared((own, varied_of(own, ADDED), 5))


def test_without_a_tolerance_what_is_uncertain_of_rig_and_loop_varies():
    """Of the reference with an observer: 5 % of inertias and stiffnesses, 0.5 ms of 3 ms of dead time."""
    varied = {one.name: one for one in varied_of(load_case(REFERENCE.with_name("observer.toml")))}
    assert (varied["loop.dead_time"].lower, varied["loop.dead_time"].upper) == pytest.approx((0.0025, 0.0035))
    flange = varied["rig.shafts.flange_left.stiffness"]
    assert flange.upper / flange.value == pytest.approx(1.05)
    assert all(name.startswith(("rig.", "loop.")) for name in varied)
    assert [one.name for one in varied_of(load_case(REFERENCE), {"loop.dead_time": 0.1})] == ["loop.dead_time"]


def test_draws_against_the_verification_of_each(case, prepared):
    """Dead time, lags and inertias drawn: each draw is a bed of its own, verified as a match verifies it."""
    x = draw(prepared.varied, 5, 0, 4)
    found = prepared.figures(x)
    for i, row in enumerate(x):
        values = {one.name: value for one, value in zip(prepared.varied, row.tolist(), strict=True)}
        law = control_law(prepared.bed)
        judge = Judge(prepared.case, law, required=(0.0, prepared.required.rolled_off_from))
        verdict = judge.verdict(values)
        assert found["stable"][i] == verdict.stable
        assert found["response_error"][i] == pytest.approx(verdict.measured, rel=0.02)  # nodes of another rule
        assert found["response_error_unmeasured"][i] == pytest.approx(verdict.unmeasured, rel=0.02)


def test_observers_are_drawn_as_well():
    case = load_case(REFERENCE.with_name("observer.toml"))
    with ThreadPoolExecutor(1) as executor:
        study = tolerance(case, 20, executor, seed=2, added={"loop.dead_time": 0.1})
    assert study.shares["stable"] == 1.0
    assert {spread.name for spread in study.spreads} >= {"modulus_margin", "response_error", "target_mode_2_frequency"}


def test_unstable_draws_are_seen(prepared):
    x = np.tile(prepared.center, (6, 1))
    x[:, [one.name for one in prepared.varied].index("loop.dead_time")] = [0.003, 0.006, 0.009, 0.012, 0.02, 0.03]
    stable = prepared.figures(x)["stable"]
    assert stable[0]
    assert not stable[-1]
    assert (np.diff(stable) <= 0).all()


def test_a_study_is_seeded_and_independent_of_the_executor(case, prepared):
    with ThreadPoolExecutor(1) as one, ThreadPoolExecutor(2) as two:
        first = tolerance(case, 60, one, seed=2, added=ADDED)
        assert first.to_dict() == tolerance(case, 60, two, seed=2, added=ADDED).to_dict()
    margin = first.spreads[0]
    assert margin.quantiles[0.05] < margin.nominal
    swings = {}  # one at a time
    for i, one in enumerate(prepared.varied):
        x = np.tile(prepared.center, (2, 1))
        x[:, i] = one.lower, one.upper
        swings[one.name] = abs(np.diff(prepared.figures(x)["modulus_margin"])[0])
    assert margin.drivers[0][0] == max(swings, key=lambda name: swings[name])
    assert first.shares["all"] <= min(first.shares[name] for name in ("stable", "damped", "response_error"))


def test_shares_of_a_sum_are_those_of_its_terms():
    x = np.random.default_rng(1).random((20_000, 3))
    terms = Regressors(["a", "b", "c"], x)
    bowl = spread("bowl", "", 0.0, (x[:, 2] - 0.5) ** 2, terms)
    assert dict(bowl.drivers) == pytest.approx({"a": 0.0, "b": 0.0, "c": 1.0}, abs=0.01)
    own = spread("sum", "", 1.5, 3 * x[:, 0] + x[:, 1], terms)
    assert dict(own.drivers) == pytest.approx({"a": 0.9, "b": 0.1, "c": 0.0}, abs=0.01)
    assert own.explained == pytest.approx(1.0)
    assert own.standard_deviation == pytest.approx(np.sqrt(10 / 12), rel=0.02)
    assert own.counts.sum() == 20_000


def test_no_share_is_more_than_the_whole_and_they_add_up_to_what_is_explained():
    """Of few draws, whose inputs are correlated by chance, with values that a square and a straight part share."""
    for seed in range(20):
        random = np.random.default_rng(seed)
        x = random.random((60, 2))
        alone = spread("one input", "", 0.0, x[:, 0] + x[:, 0] ** 2, Regressors(["a"], x[:, :1]))
        assert alone.drivers[0][1] == pytest.approx(1.0)
        both = spread("two", "", 0.0, x[:, 0] + x[:, 1] ** 2 + 0.1 * random.normal(size=60), Regressors(["a", "b"], x))
        assert sum(share for _, share in both.drivers) == pytest.approx(both.explained)


def test_intervals_of_quantiles_cover_the_true_ones():
    """Of an exponential distribution, whose quantiles are known: each interval covers in at least 93 of 100 studies."""
    random = np.random.default_rng(4)
    for count in (400, 5000):
        studies = [quantile_intervals(random.exponential(size=count)) for _ in range(400)]
        for level in (0.05, 0.5, 0.95):
            wanted = -np.log(1 - level)
            covered = [low <= wanted <= high for low, high in (study[level] for study in studies)]
            assert 0.93 <= np.mean(covered) <= 0.99
    few = quantile_intervals(np.arange(50.0))
    assert few[0.01][0] is None  # so few draws say nothing about how low a hundredth of all beds lies
    assert few[0.99][1] is None
    assert few[0.5] == (17.0, 32.0)  # ranks 18 and 33 of 50


def test_kept_beds_counted_by_hand():
    """Errors of at most 0.1, frequencies within 1 % of the own vehicle's; the margin is shown and does not count."""
    values = {
        "stable": np.array([1.0, 1.0, 1.0, 0.0]),
        "damped": np.array([1.0, 1.0, 1.0, 1.0]),
        "modulus_margin": np.array([0.5, 0.6, 0.49, 0.7]),
        "response_error": np.array([0.05, 0.1, 0.11, 0.01]),  # the third is too large, the last of no stable loop
        "target_mode_1_frequency_error": np.array([0.008, -0.012, -0.008, 0.0]),  # the second
    }
    found = kept(values, {"response_error": 0.1, "target_mode_1_frequency_error": 0.01})
    assert {name: which.mean() for name, which in found.items()} == {
        "stable": 0.75, "damped": 1.0, "response_error": 0.5, "target_mode_1_frequency_error": 0.5, "all": 0.25,
    }  # fmt: skip


def test_what_belongs_to_the_specimen_is_no_fault_of_the_bed():
    """A bed whose motor and side shafts are 5 % off, as the vehicle's are: its modes are the vehicle's own.

    The vehicle's modes move by more than the 1 % that a target allows.
    """
    case = tuned(load_case(REFERENCE.with_name("observer.toml")))
    varied = tuple(one for one in varied_of(case) if one.specimen)
    assert {one.name for one in varied} >= {"rig.inertias.motor.J", "rig.shafts.side_left.stiffness"}
    assert not any("flange" in one.name or one.name.startswith("loop.") for one in varied)
    found = Prepared((case, varied, 1)).figures(draw(varied, 1, 0, 12))
    for number in (target.mode for target in case.targets):
        of_rig, error = found[f"target_mode_{number}_frequency"], found[f"target_mode_{number}_frequency_error"]
        assert np.ptp(of_rig) / of_rig.mean() > np.ptp(error)
    shuffle = case.targets[-1].mode
    assert np.abs(found[f"target_mode_{shuffle}_frequency_error"]).max() < 0.01
    assert np.ptp(found[f"target_mode_{shuffle}_frequency"]) > 0.01 * found[f"target_mode_{shuffle}_frequency"].mean()


@pytest.mark.parametrize(
    ("added", "said"),
    [
        ({"rig.inertias.roto.J": 0.1}, "did you mean"),
        ({"rig.inertia.*": 0.1}, "does not exist"),
        ({"residual_vehicle.inertias.body.J": 0.1}, "is a number in the controller"),
        ({"loop.dead_time": 1.5}, "give 0 < SHARE < 1"),
    ],
)
def test_wrong_tolerances(case, added, said):
    with pytest.raises(InputError, match=said):
        varied_of(case, added)


def test_a_pattern_stands_for_all_that_fit_and_what_is_later_counts(case):
    alone = {one.name for one in varied_of(case)}
    found = {one.name: one for one in varied_of(case, {"*.inertias.*": 0.1, "rig.inertias.motor.J": 0.01})}
    assert set(found) - alone >= {"rig.inertias.motor.J", "rig.inertias.rotor.J"}
    assert not any(name.startswith("residual_vehicle.") or one.value == 0 for name, one in found.items())
    motor, rotor = (found[f"rig.inertias.{name}.J"] for name in ("motor", "rotor"))
    assert motor.upper == pytest.approx(1.01 * motor.value)
    assert rotor.lower == pytest.approx(0.9 * rotor.value)


def test_command(case, tmp_path, capsys):
    words = ["tolerance", case.path, "-n", "100", "--workers", "1", "--out", tmp_path, "--json"]
    assert main([str(word) for word in [*words, "--tolerance", "loop.dead_time=0.1"]]) == 0
    result = json.loads(capsys.readouterr().out)
    assert "are stable and damped and keep what a match asks" in (tmp_path / "report.html").read_text()
    assert json.loads((tmp_path / "tolerance.json").read_text()) == result
    assert result["draws"] == 100
    check_schema("tolerance", result)
    assert (tmp_path / "tolerance.svg").exists()
    assert not (tmp_path / "tolerance.partial.jsonl").exists()
    assert main([str(word) for word in [*words, "--tolerance", "loop.dead_time"]]) == 2
    assert "write NAME=VALUE" in capsys.readouterr().err


def test_python_users_bring_their_own_executor(case, tmp_path):
    record = tmp_path / "tolerance.jsonl"
    with ThreadPoolExecutor(2) as threads, ProcessPoolExecutor(1) as processes:
        other = rm.tolerance(case.path, draws=12, executor=processes, seed=4, added=ADDED)
        first = rm.tolerance(case.path, 12, threads, seed=3, added=ADDED, record=record)
        assert len(record.read_text().splitlines()) == 1
        # what is on record is of another seed and left alone
        assert rm.tolerance(case.path, 12, threads, seed=4, added=ADDED, record=record).to_dict() == other.to_dict()
        assert rm.tolerance(case.path, draws=12, executor=processes, seed=3, added=ADDED).to_dict() == first.to_dict()
        small = replace(case, moves=tuple(move for move in case.moves if "gain" in move.name)[:1])
        axes = (Axis("loop.dead_time", "s", (2e-3,), 3e-3), Axis("loop.inverter_lag", "s", (1e-3,), 2e-3))
        drawn = rm.map(small, *axes, executor=processes, starts=1, record=tmp_path / "map.jsonl")
    assert np.isfinite(drawn.errors()).all()
    assert len((tmp_path / "map.jsonl").read_text().splitlines()) == 1
