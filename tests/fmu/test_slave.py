"""A slave's life: several at once, reset, states saved, errors told."""

import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import fmi2Error
from fmu.slave import slave
from needs import compiles

pytestmark = compiles

OUTPUTS = ["wheel_left_speed", "body_left_acceleration"]


@pytest.fixture(scope="module")
def path(export, reference_case):
    return export(reference_case)


def run(one, steps=20, torque=100.0):
    one.set({"road_left": torque})
    for _ in range(steps):
        one.step(1e-3)
    return one.get(OUTPUTS)


def test_instances_share_nothing(path):
    with slave(path, name="one") as one, slave(path, name="two") as two:
        one.begin()
        two.begin(given={"inertias.body_left.J": 60.0})
        alone = run(one, 10)
        run(two, 15, -300.0)
        assert run(one, 0) == alone
        after = run(one, 10)
    with slave(path) as fresh:
        assert run(fresh.begin(), 20) == after


def test_two_instances_of_one_library(path):
    """The second instance lives in the same loaded library."""
    with slave(path) as one:
        one.begin()
        first, wanted = one.fmu.component, run(one)
        one.fmu.instantiate(callbacks=one.callbacks)
        assert one.fmu.component != first
        one.begin(given={"inertias.body_left.J": 60.0})
        other = run(one)
        one.fmu.fmi2FreeInstance(one.fmu.component)
        one.fmu.component, one.time = first, 0.02
        assert one.get(OUTPUTS) == wanted
        assert other != wanted


def test_reset_begins_anew_with_the_values_of_the_model(path):
    with slave(path) as one:
        plain = run(one.begin())
        one.fmu.terminate()
        one.fmu.reset()
        one.time = 0.0
        assert run(one.begin(given={"inertias.body_left.J": 60.0})) != plain
        one.fmu.reset()
        assert run(one.begin()) == plain


def test_a_saved_state_is_the_whole_state(path):
    with slave(path) as one:
        run(one.begin())
        one.set({"inertias.tyre_left.J": 0.3})
        saved, then = one.fmu.getFMUstate(), one.time
        ahead = run(one, 7, -50.0)
        bytes_of_it = one.fmu.serializeFMUstate(saved)
        one.set({"inertias.tyre_left.J": 0.9})
        run(one, 3, 1000.0)
        one.fmu.setFMUstate(saved)
        one.time = then
        assert run(one, 7, -50.0) == ahead
        one.fmu.freeFMUstate(saved)
        again = one.fmu.deSerializeFMUstate(bytes_of_it)
        one.fmu.setFMUstate(again)
        one.time = then
        assert run(one, 7, -50.0) == ahead
        one.fmu.freeFMUstate(again)


def short_steps(one, count):
    for _ in range(count):
        one.step(1e-6)


def set_to(name, value):
    return lambda one: one.set({name: value})


WRONG = {
    "impossible parameter": (set_to("inertias.body_left.J", 0.0), "inertias.body_left.J: 0 is not possible"),
    "negative parameter": (set_to("shafts.tyre_body_left.damping", -1.0), "shafts.tyre_body_left.damping: -1 is not"),
    "not a number": (set_to("road_left", float("nan")), "road_left: the value is not a finite number"),
    "an output": (set_to("wheel_left_speed", 1.0), "wheel_left_speed: is computed and cannot be set"),
    "a state in motion": (set_to("speed(wheel_left)", 1.0), "speed(wheel_left): a state cannot be set once"),
    "unknown reference": (lambda one: one.fmu.getReal([9999]), "no variable has the value reference 9999"),
    "step back": (lambda one: one.step(-1e-3), "a communication step of -0.001 s is not possible"),
    "endless step": (lambda one: one.step(1e9), "internal steps"),
    "time jumps": (lambda one: one.fmu.doStep(0.5, 1e-3), "the step begins at 0.5 s, but the last one ended at 0 s"),
    "no such type": (lambda one: one.fmu.getInteger([1]), "all variables of this FMU are of type Real"),
    "initialised twice": (lambda one: one.fmu.enterInitializationMode(), "initialisation begins after instantiation"),
    "slope of a parameter": (lambda one: one.slope({"inertias.body_left.J": 1.0}), "only inputs have derivatives"),
}


@pytest.mark.parametrize(("call", "line"), WRONG.values(), ids=WRONG)
def test_what_is_wrong_is_told_through_the_logger(path, call, line):
    with slave(path, name="mine") as one:
        one.begin()
        with pytest.raises(FMICallException):
            call(one)
        ((instance, status, said),) = one.said
        assert (instance, status) == ("mine", fmi2Error)
        assert line in said
        one.time = 0.0
        assert all(value == value for value in run(one))  # it goes on from where it was


def test_step_before_initialisation(path):
    with slave(path) as one:
        with pytest.raises(FMICallException):
            one.step(1e-3)
        assert "a step needs initialisation to be over" in one.said[0][2]


def test_wrong_guid(path):
    with pytest.raises(Exception, match="Failed to instantiate"), slave(path, token="{0}"):
        pass


def test_motion_that_runs_away_is_told_and_undone(path):
    with slave(path) as one:
        one.begin()
        run(one, 5)
        one.set({"shafts.wheel_tyre_left.stiffness": 1e13})
        with pytest.raises(FMICallException):
            run(one, 2000)
        assert "is not finite after" in one.said[-1][2]
        assert "raise simulation.steps_per_second" in one.said[-1][2]
        assert all(value == value for value in one.get(OUTPUTS))


def test_more_internal_steps_on_demand(path):
    """What runs away at the exported steps does not with enough of them."""
    stiff = {"shafts.wheel_tyre_left.stiffness": 4e7, "shafts.wheel_tyre_left.damping": 0.0}
    with slave(path) as one:
        one.begin(given=stiff | {"simulation.steps_per_second": 50e3})
        assert abs(run(one, 100)[0]) < 10


def test_delays_that_look_back_too_far_are_told(export, delayed_model):
    with slave(export(delayed_model)) as one:
        one.begin()
        one.set({"inputs.motor_torque.dead_time.delay": 0.012})
        with pytest.raises(FMICallException):
            short_steps(one, 30000)
        assert "look back over more than the" in one.said[-1][2]


def test_a_saved_state_holds_what_is_on_its_way(export, delayed_model):
    with slave(export(delayed_model)) as one:
        one.begin()
        one.set({"motor_torque": 80.0})
        for _ in range(20):
            one.step(1e-3)
        saved, then, ends = one.fmu.getFMUstate(), one.time, []
        one.set({"motor_torque": -20.0})
        for _ in range(2):
            for _ in range(25):
                one.step(1e-3)
            ends.append(one.get(["motor_speed", "link_torque"]))
            one.fmu.setFMUstate(saved)
            one.time = then
            one.set({"motor_torque": -20.0})
        one.fmu.freeFMUstate(saved)
    assert ends[0] == ends[1]


def test_a_failed_step_leaves_delays_as_they_were(export, delayed_model):
    """A step that runs away is undone with what was on its way: the motion goes on as if it had not been tried."""

    def run(fails):
        with slave(export(delayed_model)) as one:
            one.begin()
            one.set({"motor_torque": 80.0})
            for _ in range(40):
                one.step(1e-3)
            if fails:
                one.set({"shafts.link.stiffness": 1e13})
                with pytest.raises(FMICallException):
                    one.fmu.doStep(one.time, 0.2)
                one.set({"shafts.link.stiffness": 200.0})
            readings = []
            for _ in range(40):
                one.step(1e-3)
                readings.append(one.get(["motor_speed", "link_torque", "load_acceleration"]))
            return readings

    assert run(True) == run(False)
