"""R_XiL as objective: its signals against the time simulation, its gradient against differences, its matches."""

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from matching.match.case_file import case_text, load_case
from matching.match.loop import linear_bed
from matching.match.loop_modes import PLACE
from matching.match.match import match
from matching.match.objectives import FidelityObjective
from matching.match.programme import build, closed_loop
from matching.match.solve import start
from matching.match.verify import manoeuvre_torques, match_fidelity, simulate_case
from modelling.errors import InputError

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "case.toml"


@pytest.fixture(scope="module")
def aim(feedback):
    return FidelityObjective.of(feedback)


def responses(aim, values):
    loop = closed_loop(aim.case)
    p = loop.values.copy()
    for name, value in values.items():
        p[loop.parameters.index(name)] = value
    count = len(aim.s)
    return loop.response.map(count)(ca.DM(aim.s.real).T, ca.DM(aim.s.imag).T, ca.repmat(ca.DM(p), 1, count))


def trace_of(name):
    for added, place, what in (("verified_torque_", "shafts", "torque"), ("verified_speed_", "interfaces", "speed")):
        if name.startswith(added):
            return f"{place}.{name.removeprefix(added)}.{what}"
    return None


def test_signals_are_those_of_the_time_simulation(aim, simulated):
    """Inverse Laplace of the optimiser's loop against delay lines and a sampled controller: no code in common."""
    _, traces = simulated
    found = aim.signals(*responses(aim, {}))
    for references in aim.domains.values():
        for name, reference in references.items():
            own, rig = trace_of(name) or name, trace_of(name) or PLACE + name
            for mine, theirs in ((reference, traces.vehicle[own]), (found[name].full().ravel(), traces.matched[rig])):
                theirs = np.interp(aim.time, traces.time, theirs)
                assert np.sqrt(np.mean((mine - theirs) ** 2)) < 0.006 * np.ptp(theirs), name


def test_loss_of_the_vehicles_own_responses_is_none(aim):
    class Ideal(type(aim)):
        def signals(self, re, im):
            return {name: ca.DM(own) for references in self.domains.values() for name, own in references.items()}

    assert float(Ideal(**vars(aim)).loss(None, None)) == pytest.approx(0, abs=1e-6)


def test_gradient_by_differences(feedback, aim):
    moves = feedback.moves[:6]
    weights = np.ones(len(moves))

    class Nothing:
        def constraints(self, p):
            return []

    problem = build(feedback, moves, weights, (), aim, Nothing(), compiled=False)
    v = ca.MX.sym("v", len(moves))
    f = problem.objective(v, [])[0]
    gradient = ca.Function("gradient", [v], [ca.gradient(f, v)])
    at = start(problem, None)
    numeric = [
        float(problem.objective(at + h, [])[0] - problem.objective(at - h, [])[0]) / 2e-5
        for h in 1e-5 * np.eye(len(moves))
    ]
    assert gradient(at).full().ravel() == pytest.approx(numeric, rel=1e-4, abs=1e-7)


def test_what_is_tuned_by_stays_in_the_case_file(feedback):
    assert 'objective = "fidelity"' in case_text(replace(feedback, objective="fidelity"))
    assert 'objective = "response_error"' in case_text(feedback)


def test_unknown_objective_is_one_line(tmp_path):
    text = CASE.read_text().replace('objective = "response_error"', 'objective = "beauty"')
    for name in ("vehicle.toml", "rig.toml"):
        (tmp_path / name).write_bytes((CASE.parent / name).read_bytes())
    (tmp_path / "case.toml").write_text(text)
    with pytest.raises(InputError, match=r"response\.objective.*beauty"):
        load_case(tmp_path / "case.toml")


def test_loss_ranks_tunings_as_the_simulation_does(feedback, aim, simulated):
    """Quick form of the match below: a weaker tuning loses in the objective and in the simulated R_XiL alike."""
    weaker = {"proportional_gain": 15.0, "integral_gain": 0.0, "torque_feed_forward": 0.0}
    parts = linear_bed(replace(feedback, loop=feedback.loop.with_values(weaker)))
    traces = simulate_case(parts, *manoeuvre_torques(parts))
    totals = [match_fidelity(*one).after.total for one in (simulated, (parts, traces))]
    losses = [float(aim.loss(*responses(aim, values))) for values in ({}, {f"loop.{k}": v for k, v in weaker.items()})]
    assert totals[0] > totals[1] + 0.01
    assert losses[0] < losses[1] - 0.01


@pytest.mark.long
def test_each_objective_wins_at_what_it_is_for(feedback):
    """The matched rig's R_XiL by the simulation, delays by the estimator: nothing of the objective's own code."""
    errors, fidelity = (match(replace(feedback, objective=own), starts=1) for own in ("response_error", "fidelity"))
    assert fidelity.fidelity.after.total >= errors.fidelity.after.total
    assert errors.response_error.after <= fidelity.response_error.after
    assert fidelity.verification.stable
    assert fidelity.verification.modulus_margin >= feedback.limits["modulus_margin"]
