"""Twelve drawn beds of kinds that no example has, judged by beds that share nothing with the program's.

Responses come from dynamic stiffness; in time every bed is stepped by matrices made here from masses, dampings and
stiffnesses, with a delay line of its own, under the exported controller with its supervision.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from independent.dynamic_stiffness import Chain, DrawnBed
from independent.dynamic_stiffness import Judge as Independent
from match_beds.other_beds import KINDS, write
from plant.marks import needs_compiler

from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from matching.match.loop import control_law, linear_bed
from matching.match.match import match
from modelling.controller.batch import ControllerBatch
from modelling.controller.law import EMULATION, SPEED_HOLD

BEDS, SECONDS, SETTLE_S, SPEED, SPEED_SHARE = 20, 60.0, 3.0, 40.0, 0.2
ENCODER_GAIN = 1e-3
SOLVED_WITH = re.compile(r"takes a torque at dynamometer .*solved with ([\d.]+) N·m")
ERROR = re.compile(r"response error to (measured|unmeasured) torques is ([\d.]+), ([\d.]+) is allowed")
TOLERANCE = re.compile(r"response\.(tolerance|unmeasured_tolerance) = ([\d.]+)")
TOLERANCES = {"measured": "tolerance", "unmeasured": "unmeasured_tolerance"}


@pytest.fixture(scope="module", params=range(len(KINDS)), ids=[f"{i}-{kind.__name__}" for i, kind in enumerate(KINDS)])
def matched(request, tmp_path_factory):
    """The case and its match."""
    case = load_case(write(request.param, tmp_path_factory.mktemp("bed")))
    return case, match(case)


@pytest.mark.long
def test_the_errors_are_those_that_are_stated(matched):
    _, result = matched
    law = control_law(linear_bed(result.tuned))
    found, stated = Independent(result.tuned, law).verdict({}), result.response_error
    assert found.stable == result.verification.stable
    assert found.measured == pytest.approx(stated.after, rel=0.02)
    assert found.unmeasured == pytest.approx(stated.unmeasured, rel=0.02)


@pytest.mark.long
@needs_compiler
def test_what_is_called_matched_runs_two_minutes_on_twenty_drawn_beds(matched):
    """A minute at rest and a minute at speed, with noise, a drift of every sensor and a gain error of every encoder."""
    _, result = matched
    if result.status != "matched":
        pytest.skip("limited")
    left = two_minutes(result.tuned, np.random.default_rng(3))
    assert not left


def two_minutes(case, random):
    """Which rows leave emulation: (bed, at speed, seconds, fault)."""
    controller = exported_controller(case)
    step, k, chain = controller.law.sample_time, len(controller.law.dynamometers), Chain(case.rig)
    positions = random.uniform(-1, 1, (BEDS, len(case.uncertainty.uncertain)))
    values = [case.uncertainty.at(position) for position in positions]
    beds = [DrawnBed(case, chain.with_values(of_rig(one)), one).stepped for one in values for _ in range(2)]
    size = max(len(A) for A, _, _ in beds)
    A, B, C = (np.zeros((len(beds), *shape)) for shape in ((size, size), (size, k), (len(beds[0][2]), size)))
    for i, (a, b, c) in enumerate(beds):
        A[i, : len(a), : len(a)], B[i, : len(b)], C[i, :, : c.shape[1]] = a, b, c
    names = controller.law.sensors
    known = {sensor.name: sensor for sensor in case.rig.sensors}
    noise = np.array([known[name].uncertainty for name in names])[:, None]
    gains = np.where([[known[name].measures == "speed"] for name in names], ENCODER_GAIN, 0.0)
    gains = 1 + gains * random.choice([-1.0, 1.0], (len(names), len(beds)))
    drift = noise * random.choice([-1.0, 1.0], (len(names), len(beds)))
    speed = min(SPEED, SPEED_SHARE * case.limits.get("dynamometer_speed", np.inf))
    wanted = speed * np.tile([0.0, 1.0], BEDS) * np.ones((k, 1))
    batch, x, told = (
        ControllerBatch(controller, len(beds)),
        np.zeros((len(beds), size, 1)),
        np.zeros((len(controller.law.known), len(beds))),
    )
    begun, ended = round(SETTLE_S / step), round((SETTLE_S + SECONDS) / step)
    found = {}
    for n in range(ended):
        part = max(n - begun, 0) / (ended - begun)
        read = gains * (C @ x)[..., 0].T + part * drift + noise * random.standard_normal((len(names), len(beds)))
        mode, hold = (SPEED_HOLD if n < begun else EMULATION), min(2 * n / begun, 1.0) * wanted
        commands, _, faults = batch.step(read, told, mode, hold, n)
        for row in np.flatnonzero(faults) if n >= begun else ():
            found.setdefault(int(row), (row // 2, bool(row % 2), (n - begun) * step, int(faults[row])))
        x = A @ x + B @ commands.T[..., None]
    assert np.abs(x).max() < 1e6 or found
    return list(found.values())


def of_rig(values):
    return {name.removeprefix("rig."): value for name, value in values.items() if name.startswith("rig.")}


@pytest.mark.long
def test_what_is_called_limited_stays_so_and_is_lifted_as_the_text_says(matched):
    """Each limit that a sentence names, raised by 1 %; then all of them, raised as the sentences say."""
    case, result = matched
    if result.status == "matched":
        assert not result.limits
        return
    raised, lifted = case, case
    if case.simple_vehicle is not None:  # what limits it is its own residual vehicle, and the whole one is there
        assert "the residual vehicle of the case comes within" in result.limits[0]
        assert match(replace(case, tolerance=1.01 * case.tolerance), ordering=False).status == "limited"
        file = Path(case.path)
        file.write_text(re.sub(r"\[residual_vehicle\]\nmodel = .*\n", "", file.read_text()))
        assert match(load_case(file)).status == "matched"
        return
    for sentence in result.limits:
        if named := SOLVED_WITH.search(sentence):
            raised = with_limit(raised, dynamometer_torque=1.01 * case.limits["dynamometer_torque"])
            lifted = with_limit(lifted, dynamometer_torque=float(named[1]))
        elif named := ERROR.search(sentence):
            key = TOLERANCES[named[1]]
            raised = replace(raised, **{key: 1.01 * getattr(case, key)})
            assert float(named[2]) > 1.01 * getattr(case, key), "an error that 1 % would lift shows nothing here"
        elif "matched anew with" in sentence:
            lifted = replace(lifted, **{key: float(value) for key, value in TOLERANCE.findall(sentence)})
            if "limits.opened_shafts = false" in sentence:
                lifted = with_limit(lifted, opened_shafts=False)
        elif "limits.opened_shafts = false" in sentence:
            lifted = with_limit(lifted, opened_shafts=False)
    if raised is not case:
        assert match(raised, ordering=False).status == "limited"
    assert lifted is not case, result.limits
    again = match(lifted)
    assert again.status == "matched", (result.limits, again.limits)


def with_limit(case, **limits):
    return replace(case, limits={**case.limits, **limits})
