"""Torque converters: stall, coupling point and coasting in closed form, and motions by equations of the tests' own."""

from dataclasses import replace

import numpy as np
import pytest
from fmu.slave import slave
from needs import compiles

import rigmatch as rm
from modelling.errors import InputError
from modelling.fmu.export import block, fmu
from modelling.linear.linearise import linearise
from modelling.linear.steady_motion import speeds_of, torques_of
from modelling.model_file import from_dict, to_dict
from modelling.simulation.simulate import simulate
from modelling.system import OperatingPoint

POINTS = (0.0, 0.4, 0.7, 0.87, 1.0, 1.4)
FACTORS = (2.4e-3, 2.3e-3, 1.9e-3, 1.3e-3, 0.0, -1.1e-3)  # N·m/(rad/s)²
GAINS = (2.1, 1.6, 1.2, 1.0, 1.0, 1.0)
J = {"engine": 0.25, "turbine": 0.06, "wheel": 18.0}
SIDE, DAMPING, DRAG = 3000.0, 3.0, 0.3
INPUTS = ("torque", "lock_up", "load")


def data(**changes):
    converter = {"speed_ratios": [*POINTS], "capacity_factors": [*FACTORS], "torque_ratios": [*GAINS]}
    return {
        "inertias": {name: {"J": value} for name, value in J.items()} | {"wheel": {"J": J["wheel"], "drag": DRAG}},
        "gearboxes": {"box": {
            "between": ["engine", "turbine"], "ratios": [1.0], "capacities": ["lock_up"], "deflection": 5e-4,
            "settling": 2e-5, "converter": converter, **changes,
        }},
        "shafts": {"side": {"between": ["turbine", "wheel"], "stiffness": SIDE, "damping": DAMPING}},
        "inputs": {"torque": {"on": "engine"}, "lock_up": {"on": "engine"}, "load": {"on": "wheel"}},
        "sensors": {
            "engine_speed": {"measures": "speed", "of": "engine"}, "wheel_speed": {"measures": "speed", "of": "wheel"},
            "side_torque": {"measures": "torque", "of": "side"},
        },
    }  # fmt: skip


def at(x, values):
    """A table at x, straight in between and constant beyond."""
    if x <= POINTS[0]:
        return values[0]
    for low, high, first, last in zip(POINTS, POINTS[1:], values, values[1:], strict=False):
        if x < high:
            return first + (last - first) * (x - low) / (high - low)
    return values[-1]


def own(time, torques, step=1e-5):
    """Engine and wheel speed and side torque (t, 3) from rest under torques (t, 3): Heun's formula, then the lock-up
    clutch as rigid friction (of first order: 4e-5 s would be off by as much as is allowed)."""
    (J1, J2, J3), out = J.values(), []
    e = t = w = z = 0.0

    def rates(e, t, w, z, engine, load):
        ratio = t / e if abs(e) > 1e-6 else 0.0
        pump, side = at(ratio, FACTORS) * e * abs(e), SIDE * z + DAMPING * (t - w)
        turbine = at(ratio, GAINS) * pump
        return (engine - pump) / J1, (turbine - side) / J2, (load + side - DRAG * w) / J3, t - w

    count, torques = round((time[1] - time[0]) / step), torques.tolist()
    for n, now in enumerate(torques):
        out.append((e, w, SIDE * z + DAMPING * (t - w)))
        after = torques[min(n + 1, len(torques) - 1)]
        for piece in range(count):
            engine, lock, load = (a + (b - a) * (piece + 0.5) / count for a, b in zip(now, after, strict=True))
            a = rates(e, t, w, z, engine, load)
            b = rates(e + step * a[0], t + step * a[1], w + step * a[2], z + step * a[3], engine, load)
            e, t, w, z = (x + step / 2 * (p + q) for x, p, q in zip((e, t, w, z), a, b, strict=True))
            friction = min(max((e - t) / step / (1 / J1 + 1 / J2), -lock), lock)
            e, t = e - step * friction / J1, t + step * friction / J2
    return np.array(out)


def drive(seed):
    """Away on the converter, locked up by a ramp, coasting, open again."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, 4, 2e-3)
    pull = rng.uniform(80, 160)
    engine = pull * np.clip((time - 0.1) / 0.3, 0, 1) * (time < 2.8) - 15 * (time >= 2.8)
    closing = np.clip((time - rng.uniform(1.4, 1.7)) / 0.3, 0, 1)
    lock = rng.uniform(250, 400) * closing * np.clip((3.2 - time) / 0.1, 0, 1)
    return time, np.stack([engine, lock, np.full(len(time), -rng.uniform(0, 20))], axis=1)


READ = ("engine_speed", "wheel_speed", "side_torque")


def errors(found, right):
    off = (found - right) / np.ptp(right, axis=0)
    return np.sqrt(np.mean(off**2, axis=0)).max(), np.abs(off).max()


@pytest.mark.parametrize("seed", [890001, *(pytest.param(n, marks=pytest.mark.long) for n in range(891000, 891020))])
def test_a_drive_with_lock_up_is_that_of_own_equations(seed):
    time, torques = drive(seed)
    ours = simulate(from_dict(data()), time, dict(zip(INPUTS, torques.T, strict=True)), start="rest")
    rms, largest = errors(np.stack([ours[name] for name in READ], axis=1), own(time, torques))
    assert rms < 2e-3
    assert largest < 0.02


def test_stall_coupling_and_coasting_in_closed_form():
    """Held wheels: the pump turns at √(T/λ(0)) and the wheels are held with μ(0) times the torque."""
    held = data()
    held["inertias"]["wheel"] = {"J": 1e9}
    time = np.arange(0, 6, 5e-3)
    still = simulate(
        from_dict(held), time, {"torque": 100 + 0 * time, "lock_up": 0 * time, "load": 0 * time}, start="rest"
    )  # fmt: skip
    assert still["engine_speed"][-1] == pytest.approx(np.sqrt(100 / FACTORS[0]), rel=1e-3)
    assert still["side_torque"][-1] == pytest.approx(GAINS[0] * 100, rel=1e-3)
    # about steady motion the turbine's torque is the pump's at and beyond the coupling point, and coasting reverses it
    model = from_dict(data()).in_gear(0)
    for ratio in (0.87, 0.95, 1.2):
        speed = 200.0
        torque = np.interp(ratio, POINTS, FACTORS) * speed**2
        turbine = np.interp(ratio, POINTS, GAINS) * torque
        load = DRAG * ratio * speed - turbine
        start = np.array([0.0, turbine / SIDE, 0.0, speed, ratio * speed, ratio * speed])
        found = simulate(model, time, {"torque": torque + 0 * time, "load": load + 0 * time}, start=_of(model, start))
        np.testing.assert_allclose(found["engine_speed"], speed, rtol=1e-6)
        np.testing.assert_allclose(found["side_torque"], turbine, rtol=1e-4, atol=1e-6)
        assert np.sign(turbine) == (1 if ratio < 1 else -1)


def _of(model, values):
    """States by angle and speed of engine, turbine and wheel, in the order of the model."""
    from modelling.equations.casadi_code import compiled

    names = [f"{what}({part})" for what in ("angle", "speed") for part in J]
    return np.array([dict(zip(names, values, strict=True))[name] for name in compiled(model).states])


def test_about_an_operating_point_it_is_a_damper_and_no_spring():
    """Linear: derivatives of the tables by hand; modes: engine and driveline apart; locked: one chain."""
    model = from_dict(data())
    with_lock, without = model.in_gear(1), model.in_gear(0)
    assert model.gears_of_gearboxes == [{"box": 1}, {"box": 0}]
    driveline = np.sqrt(SIDE * (1 / J["turbine"] + 1 / J["wheel"])) / (2 * np.pi)
    np.testing.assert_allclose(rm.modes(without).frequencies, [0, 0, driveline], atol=1e-6)
    chain = np.sqrt(SIDE * (1 / (J["turbine"] + J["engine"]) + 1 / J["wheel"])) / (2 * np.pi)
    np.testing.assert_allclose(rm.modes(with_lock).frequencies, [0, chain], atol=1e-6)
    speed, ratio = 220.0, 0.55
    factor, gain = np.interp(ratio, POINTS, FACTORS), np.interp(ratio, POINTS, GAINS)
    torque = factor * speed**2
    point = OperatingPoint(
        (("engine", speed), ("turbine", ratio * speed)),
        (("torque", torque), ("load", DRAG * ratio * speed - gain * torque)),
    )
    linear = linearise(replace(without, operating_point=point))
    slope = np.diff(FACTORS)[1] / np.diff(POINTS)[1]
    of_gain = np.diff(GAINS)[1] / np.diff(POINTS)[1]
    by_engine, by_turbine = 2 * factor * speed - slope * ratio * speed, slope * speed
    states = list(linear.model.states)
    rows = [states.index("speed(engine)"), states.index("speed(turbine)")]
    at = linear.A[np.ix_(rows, rows)]
    turbine = (gain * by_engine - of_gain * ratio * speed * factor, gain * by_turbine + of_gain * speed * factor)
    right = np.array([
        [-by_engine / J["engine"], -by_turbine / J["engine"]],
        [turbine[0] / J["turbine"], (turbine[1] - DAMPING) / J["turbine"]],
    ])  # fmt: skip
    np.testing.assert_allclose(at, right, rtol=1e-9)


def test_steady_motion_is_found_at_any_load():
    """Drawn tables that end where pump and turbine turn alike, drags and speeds of the engine: the turbine's speed by
    bisection, and the torque that holds it."""
    random = np.random.default_rng(61803)
    for _ in range(60):
        count = random.integers(3, 7)
        points = [0.0, *np.sort(random.uniform(0.3, 0.95, count - 2)), 1.0]
        factors = [*-np.sort(-random.uniform(5e-4, 3e-3, count - 1)), 0.0]
        gains = [*-np.sort(-random.uniform(1.0, 2.5, count - 1)), 1.0]
        speed, drag = random.uniform(40, 500), np.exp(random.uniform(np.log(5e-6), np.log(30)))
        table = data(**of_tables(points, factors, gains))
        table["inertias"]["wheel"]["drag"] = drag
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = (low + high) / 2
            torque = np.interp(middle, points, gains) * np.interp(middle, points, factors) * speed**2
            low, high = (middle, high) if torque > drag * middle * speed else (low, middle)
        model = replace(
            from_dict(table).in_gear(0), operating_point=OperatingPoint((("engine", speed),), (("load", 0.0),))
        )
        assert speeds_of(model)["wheel"] == pytest.approx(low * speed, rel=1e-6)
        assert torques_of(model)["torque"] == pytest.approx(np.interp(low, points, factors) * speed**2, rel=1e-4)


@pytest.mark.long
@compiles
def test_an_fmu_has_it(tmp_path):
    time, torques = drive(890002)
    right = own(time, torques)
    (tmp_path / "box.fmu").write_bytes(fmu(block([from_dict(data())], "box", "box")).content)
    with slave(tmp_path / "box.fmu") as one:
        one.begin()
        rows = [one.get(READ)]
        for n in range(len(time) - 1):
            one.set(dict(zip(INPUTS, torques[n], strict=True)))
            one.slope(dict(zip(INPUTS, (torques[n + 1] - torques[n]) / 2e-3, strict=True)))
            one.step(2e-3)
            rows.append(one.get(READ))
    rms, largest = errors(np.array(rows), right)
    assert rms < 2e-3
    assert largest < 0.02


def of_tables(*lists):
    named = zip(("speed_ratios", "capacity_factors", "torque_ratios"), lists, strict=True)
    return {"converter": {key: values for key, values in named if values is not None}}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"converter": 3}, "converter: is no table"),
        (of_tables([0, 1], [1e-3, 0], None), "torque_ratios: is missing"),
        (of_tables([0, 1], [1e-3], [2, 1]), "has 1 values"),
        (of_tables([1, 0], [1e-3, 0], [2, 1]), "do not rise"),
        (of_tables([0, 0.8, 1], [1e-3, -1e-3, 0], [2, 1, 1]), "-0.001 at the speed ratio 0.8"),
        (of_tables([0, 1], [1e-3, 0], [2, -1]), "-1 is not possible"),
        ({"converter": {"speed_ratios": [0, 1], "k": [1e-3, 0]}}, "'k'"),
        ({"engages_below": 3.0}, "stands beside dog clutches"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(changes, said):
    with pytest.raises(InputError, match=r"gearboxes\.box") as fault:
        from_dict(data(**changes))
    assert said in str(fault.value)
    assert "\n" not in str(fault.value)


def test_it_is_written_again_with_units():
    given = data()
    given["gearboxes"]["box"]["converter"]["capacity_factors"][0] = "2.4e-3 N*m*s^2/rad^2"
    model = from_dict(given)
    assert from_dict(to_dict(model)) == model == from_dict(data())
