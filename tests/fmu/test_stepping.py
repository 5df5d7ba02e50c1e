"""The FMU against rigmatch's own stepping."""

import fmpy
import numpy as np
import pytest
from fmu.slave import slave
from needs import compiles

from matching.export import read_export_source
from matching.match.case_file import load_case
from modelling.bed.manoeuvres import TipIn
from modelling.equations.casadi_code import compiled
from modelling.fmu.export import block
from modelling.model_file import from_dict, load
from modelling.simulation.simulate import simulate

pytestmark = compiles

EQUAL = 1e-9  # of a reading's largest value


def torques(names, time, seed=3):
    """A tip-in and noise, another for every input."""
    rng = np.random.default_rng(seed)
    base = TipIn(amplitude=100, at=0.05, rise_time=0.05, duration=time[-1]).torque(time)
    return {name: base * (1 - 0.3 * i) + 5 * rng.standard_normal(len(time)) for i, name in enumerate(names)}


def own(system, time, inputs, block, values=None, *, held=False):
    """rigmatch's readings with the FMU's steps; friction as sharp as the FMU has it; inputs held or linear between."""
    model = compiled(system)
    fixed = {one.name: one.start for one in block.parameters if one.name in model.parameters} | (values or {})
    steps = {"values": fixed, "steps_per_second": block.steps_per_second, "compile": False}
    if not held:
        return simulate(model, time, inputs, **steps).readings
    x, rows = np.zeros(len(model.states)), []
    for k in range(len(time) - 1):
        still = {name: np.full(2, value[k]) for name, value in inputs.items()}
        done = simulate(model, time[k : k + 2], still, start=x, **steps)
        x = done.states[-1]
        rows.append([done[name][-1] for name in model.sensors])
    return dict(zip(model.sensors, np.array(rows).T, strict=True))


def through_fmpy(path, time, inputs, start_values=None):
    """Readings at the end of every step, inputs held over it: what `fmpy simulate` gives."""
    signals = np.empty(len(time), dtype=[("time", float), *((name, float) for name in inputs)])
    signals["time"] = time
    for name, values in inputs.items():
        signals[name] = values
    about = fmpy.read_model_description(str(path))
    outputs = {own.name: own.valueReference for own in about.modelVariables if own.causality == "output"}
    found = []

    def keep(now, recorder):
        read = recorder.fmu.getReal if about.fmiVersion == "2.0" else recorder.fmu.getFloat64
        found.append(read(list(outputs.values())))
        return True

    fmpy.simulate_fmu(
        str(path), start_time=time[0], stop_time=time[-1], output_interval=time[1] - time[0], input=signals,
        start_values=start_values or {}, step_finished=keep,
    )  # fmt: skip
    return dict(zip(outputs, np.array(found).T, strict=True))


def linearly(path, time, inputs, start_values=None):
    """Readings at every sample, inputs linear between samples by their derivatives."""
    with slave(path) as one:
        names = [own.name for own in one.about.modelVariables if own.causality == "output"]
        one.begin(time[0], given=(start_values or {}) | {name: values[0] for name, values in inputs.items()})
        rows = [one.get(names)]
        for k in range(len(time) - 1):
            one.set({name: values[k] for name, values in inputs.items()})
            one.slope({name: (values[k + 1] - values[k]) / (time[k + 1] - time[k]) for name, values in inputs.items()})
            one.step(time[k + 1] - time[k])
            rows.append(one.get(names))
    return dict(zip(names, np.array(rows).T, strict=True))


def assert_equal(found, wanted):
    for name, values in wanted.items():
        scale = np.abs(values).max()
        assert scale > 0, name
        assert np.abs(found[name] - values).max() <= EQUAL * scale, name


def test_residual_vehicle_with_inputs_that_vary_linearly(export, reference_case):
    wanted = read_export_source(reference_case)
    time = np.arange(1001) * 1e-3
    inputs = torques([one.name for one in wanted.block.inputs], time)
    found = linearly(export(reference_case), time, inputs)
    for part in load_case(reference_case).residual_vehicle.parts:
        mine = {one.name: inputs[one.name] for one in part.inputs}
        assert_equal(found, own(part, time, mine, wanted.block))


OTHER = {"shafts.link.stiffness": 260.0, "inertias.load.J": 0.7, "shafts.link.backlash.gap": 0.05}


@pytest.mark.parametrize("values", [{}, OTHER], ids=["as exported", "overridden"])
@pytest.mark.parametrize("held", [True, False], ids=["held", "linear"])
def test_bent_model(export, lashed_model, values, held):
    wanted = read_export_source(lashed_model)
    time = np.arange(301) * 1e-3
    inputs = torques(["motor_torque", "load_torque"], time)
    run = through_fmpy if held else linearly
    found = run(export(lashed_model), time, inputs, values)
    assert_equal(found, own(load(lashed_model), time, inputs, wanted.block, values, held=held))


@pytest.mark.parametrize("change", [{}, {"inputs.motor_torque.dead_time.delay": 0.02}], ids=["as exported", "longer"])
def test_delayed_inputs_and_readings(export, delayed_model, change):
    wanted = read_export_source(delayed_model)
    time = np.arange(301) * 1e-3
    inputs = torques(["motor_torque", "load_torque"], time)
    found = linearly(export(delayed_model), time, inputs, change)
    assert_equal(found, own(load(delayed_model), time, inputs, wanted.block, change))


def test_a_held_input_arrives_a_dead_time_later(export, delayed_model):
    """A torque acts 12.3 ms later, which is 41 steps of 0.3 ms, exactly from there on."""
    with slave(export(delayed_model)) as one:
        one.begin()
        one.step(3e-4)
        one.set({"motor_torque": 50.0})
        speeds = []
        for _ in range(80):
            one.step(3e-4)
            speeds.append(one.get(["speed(motor)"])[0])
    assert speeds[40] == 0.0
    assert speeds[41] == pytest.approx(50.0 / 0.1 * 3e-4, rel=1e-3)


def test_communication_steps_of_any_length(export, reference_case):
    """Steps that are no multiple of anything, each held input by held input, against rigmatch from state to state."""
    wanted = read_export_source(reference_case)
    part = load_case(reference_case).residual_vehicle.parts[0]
    names = [one.name for one in part.inputs]
    rng = np.random.default_rng(5)
    spans = rng.uniform(1e-5, 7e-3, 60)
    model, outputs = compiled(part), [one.name for one in part.sensors]
    x = np.zeros(len(model.states))
    with slave(export(reference_case)) as one:
        one.begin(0.25)
        for span in spans:
            held = dict(zip(names, rng.uniform(-300, 300, len(names)), strict=True))
            one.set(held)
            now = one.time
            one.step(span)
            done = simulate(
                model, np.array([now, now + span]), {name: np.full(2, value) for name, value in held.items()},
                start=x, steps_per_second=wanted.block.steps_per_second, compile=False,
            )  # fmt: skip
            x = done.states[-1]
            found = one.get(outputs)
            for name, value in zip(outputs, found, strict=True):
                scale = max(np.abs(done[name]).max(), 1e-3)
                assert abs(value - done[name][-1]) <= EQUAL * scale, name


def test_a_parameter_may_change_while_it_runs(export, reference_case):
    wanted = read_export_source(reference_case)
    part = load_case(reference_case).residual_vehicle.parts[0]
    change = {"inertias.body_left.J": 70.0}
    time = np.array([0.0, 0.01])
    inputs = {one.name: np.full(2, 120.0) for one in part.inputs}
    steps = {"steps_per_second": wanted.block.steps_per_second, "compile": False}
    first = simulate(part, time, inputs, **steps)
    second = simulate(part, time + 0.01, inputs, change, first.states[-1], **steps)
    with slave(export(reference_case)) as one:
        one.begin(given={name: value[0] for name, value in inputs.items()})
        one.step(0.01)
        one.set(change)
        one.step(0.01)
        (found,) = one.get(["body_left_speed"])
    assert found == pytest.approx(second["body_left_speed"][-1], rel=EQUAL)
    assert found != pytest.approx(2 * first["body_left_speed"][-1], rel=1e-3)


def test_readings_follow_an_input_at_once(export, reference_case):
    """An acceleration answers to its torque without a step."""
    with slave(export(reference_case)) as one:
        one.begin()
        one.set({"road_left": 90.1})
        assert one.get(["body_left_acceleration"])[0] == pytest.approx(1.0, rel=1e-12)


def test_start_states(export, reference_case):
    """A vehicle that rolls from the beginning goes on rolling."""
    names = [one.name for one in read_export_source(reference_case).block.states if one.name.startswith("speed(")]
    with slave(export(reference_case)) as one:
        one.begin(given=dict.fromkeys(names, 30.0))
        one.step(0.05)
        assert one.get(["wheel_left_speed"])[0] == pytest.approx(30.0, rel=1e-3)


def test_version_three_steps_as_version_two(export, lashed_model):
    time = np.arange(301) * 1e-3
    inputs = torques(["motor_torque", "load_torque"], time)
    two, three = (through_fmpy(export(lashed_model, fmi), time, inputs, OTHER) for fmi in ("2.0", "3.0"))
    for name, values in two.items():
        assert np.array_equal(three[name], values), name


@pytest.mark.parametrize(("name", "fastest", "slowest"), [
    ("inertias.motor.J", 0.02, 0.5), ("shafts.link.stiffness", 2e5, 200.0),
])  # fmt: skip
def test_steps_suffice_at_the_end_of_a_range_that_makes_it_fast(name, fastest, slowest):
    """A light inertia, a stiff shaft: as many steps as a model takes that has this value."""
    data = {
        "inertias": {"motor": {"J": 0.1}, "load": {"J": 1.0}},
        "shafts": {"link": {"between": ["motor", "load"], "stiffness": 2e4, "damping": 0.5}},
        "inputs": {"torque": {"on": "motor"}}, "sensors": {"speed": {"measures": "speed", "of": "load"}},
    }  # fmt: skip
    system = from_dict(data, "test")
    bounded = block([system], "test", "test", bounds={name: (min(fastest, slowest), max(fastest, slowest))})
    alone = block([system.with_values({name: fastest})], "test", "test")
    assert bounded.steps_per_second == pytest.approx(alone.steps_per_second)
    assert alone.steps_per_second > 1.1 * block([system], "test", "test").steps_per_second
