"""The loop of a match, closed round the FMU instead of rigmatch's own residual vehicle."""

import json
from dataclasses import replace

import numpy as np
import pytest
from fmu.slave import slave
from needs import compiles
from scipy.signal import cont2discrete

from matching.export import acceleration
from matching.match import verify as running_controller
from matching.match import verify as simulation
from matching.match.case import apply
from matching.match.case_file import case_files, load_case
from matching.match.loop import control_law, linear_bed
from matching.match.verify import manoeuvre_torques, pencil, thinned
from modelling.bed.controllers import LEAD_POLE_OVER_ZERO

pytestmark = compiles

# What `rigmatch match` found for the reference case, rounded: here it only has to be a tuned loop.
TUNED = {
    "loop.proportional_gain": 245.8, "loop.integral_gain": 1.0, "loop.torque_feed_forward": 0.5433,
    "loop.acceleration_feed_forward": 2.0, "rig.inertias.adapter_left.J": 0.1,
    "rig.shafts.flange_left.stiffness": 2.301e5,
    "residual_vehicle.shafts.wheel_tyre_left.stiffness": 2.38e5,
    "residual_vehicle.shafts.tyre_body_left.stiffness": 1.875e5, "residual_vehicle.inertias.body_left.J": 62.85,
}  # fmt: skip


@pytest.fixture(scope="module")
def result(tmp_path_factory, reference_case):
    """structure → directory as `rigmatch match` writes it, of the tuned values; of result.json what an FMU needs."""
    made = {}

    def make(structure):
        if structure not in made:
            case = load_case(reference_case)
            moves = {move.name: move for move in case.moves}
            values = {move.name: TUNED.get(move.name, move.start) for move in case.moves}
            spread = {name: value for key, value in values.items() for name in moves[key].together}
            tuned = apply(case, spread)
            folder = tmp_path_factory.mktemp(structure)
            for name, text in case_files(tuned).items():
                (folder / name).write_text(text.replace('"model_based"', f'"{structure}"'), encoding="utf-8")
            rows = [{"name": name, "tuned": value} for name, value in values.items()]
            (folder / "result.json").write_text(json.dumps({"status": "matched", "parameters": rows}))
            made[structure] = folder
        return made[structure]

    return make


class Round:
    """The feedback controller with the FMU as its residual vehicle.

    At each sample the FMU takes the step that ends there, its torques linear between the last measured and this one;
    its speed and acceleration then meet speed controller, feed-forwards and lead, which are Tustin's as in rigmatch.
    """

    def __init__(self, one, parts):
        step = parts.case.loop["sample_time"]
        law = control_law(parts)
        self.sensors, self.known, self.A, self.signs = law.sensors, law.known, np.zeros((0, 0)), parts.torque_signs
        loop, self.k, self.one = parts.case.loop, len(parts.dynamometers), one
        self.inputs = [*(own.torque for own in parts.cuts), *parts.simulated]
        self.wanted = [own.speed for own in parts.cuts] + [acceleration(own) for own in parts.cuts]
        rate = LEAD_POLE_OVER_ZERO / loop["lead_time"]
        kp, ki = loop["proportional_gain"], loop["integral_gain"]
        # one dynamometer; inputs: speed error, reference acceleration, torque; states: integral, lead
        A = np.array([[0.0, 0.0], [rate * ki, -rate]])
        through = np.array([kp, loop["acceleration_feed_forward"], -loop["torque_feed_forward"]])
        B = np.array([[1.0, 0.0, 0.0], rate * through])
        C = np.array([[LEAD_POLE_OVER_ZERO * ki, 1 - LEAD_POLE_OVER_ZERO]])
        self.law = cont2discrete((A, B, C, LEAD_POLE_OVER_ZERO * through[None]), step, "bilinear")[:4]
        self.x, self.last, self.sample = np.zeros((2, self.k)), None, step

    def step(self, state, readings, known, limits):
        torques, speeds = self.signs * readings[: self.k], readings[self.k :]
        now = np.concatenate([torques, known])
        if self.last is not None:
            self.one.set(dict(zip(self.inputs, self.last, strict=True)))
            self.one.slope(dict(zip(self.inputs, (now - self.last) / self.sample, strict=True)))
            self.one.step(self.sample)
        self.one.set(dict(zip(self.inputs, now, strict=True)))
        self.last = now
        wanted = np.array(self.one.get(self.wanted))
        drive = np.stack([wanted[: self.k] - speeds, wanted[self.k :], torques])
        A, B, C, D = self.law
        out = C @ self.x + D @ drive
        self.x = A @ self.x + B @ drive
        return out[0], state


class Rounds:
    """Stands in for rigmatch's sampled controller; the FMU begins anew with every run."""

    def __init__(self, one):
        self.one, self.begun = one, False

    def __call__(self, parts):
        if self.begun:
            self.one.fmu.reset()
        self.one.begin()
        self.begun = True
        return Round(self.one, parts)


def run(case):
    """Traces of the matched rig over the manoeuvre, and when its torques last change."""
    parts = linear_bed(case)
    traces = simulation.simulate_case(parts, *manoeuvre_torques(parts))
    ends = [np.flatnonzero(np.diff(torque))[-1] for torque in traces.torques.values()]
    return traces.matched, max(ends) + 2


def ringing(traces, begin, near, step=1e-3):
    """Frequency and damping ratio of the pole that the sensors share nearest to a frequency (Hz)."""
    names = ("motor_speed", "side_left_torque", "side_right_torque")
    signals, step = thinned(np.stack([traces[name][begin:] for name in names], axis=1), step, 30.0)
    poles = pencil(signals, step).poles
    best = poles[np.argmin(np.abs(np.abs(poles) / (2 * np.pi) - near) - 1e3 * (poles.imag > 0))]
    return abs(best) / (2 * np.pi), -best.real / abs(best)


def test_closed_round_the_fmu_the_rig_shows_the_same_shuffle(result, export, monkeypatch):
    case = load_case(result("pi") / "case.toml")
    case = apply(case, {name: move.start for move in case.moves for name in move.together})
    shorter = {name: replace(manoeuvre, duration=5.0) for name, manoeuvre in case.manoeuvre.items()}
    case = replace(case, manoeuvre=shorter)
    wanted, begin = run(case)
    with slave(export(result("pi"))) as one:
        monkeypatch.setattr(running_controller, "control_law", Rounds(one))
        found, _ = run(case)
        (speed,) = one.get(["wheel_left_interface_speed"])
    assert one.time == pytest.approx(5.0)
    assert abs(speed) > 1
    for near in (1.9, 8.4):
        there, here = ringing(wanted, begin, near), ringing(found, begin, near)
        assert here[0] == pytest.approx(there[0], rel=1e-3)
        assert here[1] == pytest.approx(there[1], abs=1e-3)
    for name in ("motor_speed", "dynamometers.left.torque"):
        assert np.abs(found[name] - wanted[name]).max() < 5e-4 * np.abs(wanted[name]).max()
