"""Absolute speeds, torques and powers: compact_bev at speed, against equations written by hand."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from scipy.signal import lsim

from matching.match.case_file import case_files, load_case
from matching.match.demands import BehindCut, CutMotion, Demands, demands
from matching.match.findings import sentences
from matching.match.limits import Relaxations, Solution, limits
from matching.match.problem import problem_of, standstill
from matching.report.match import content, operating_point, report
from modelling.bed.vehicle import TorqueCurve
from modelling.linear.state_space import state_space
from modelling.linear.steady_motion import speeds_of, torques_of

COMPACT = Path(__file__).parents[2] / "examples" / "compact_bev"
RADIUS, RATIO = 0.31, 9.7  # m
PER_MINUTE = 30 / np.pi


def at(folder, slip=None, keep=True, **entries):
    """compact_bev with entries of its operating point changed, or without one."""
    data = tomllib.loads((COMPACT / "case.toml").read_text())
    data["operating_point"] = data["operating_point"] | entries
    if not keep:
        del data["operating_point"]
    for name in ("vehicle", "rig"):
        text = (COMPACT / f"{name}.toml").read_text()
        (folder / f"{name}.toml").write_text(text.replace("coefficient = 923", f"coefficient = {slip or 923}"))
    (folder / "case.toml").write_text(tomli_w.dumps(data))
    return load_case(folder / "case.toml")


def by_hand(speed, slip):
    """Largest speed (1/min), torque (N·m) and power (W) of the left dynamometer, on equations written by hand.

    Vehicle of compact_bev at ``speed`` (m/s): tip-in of 120 N·m in 0.04 s over the torque that holds the speed. The
    rotor of 0.55 kg·m² and the adapter of 0.045 kg·m² turn as the wheel does; rotor drag 0.02 N·m·s/rad.
    """
    cage = 0.0008 * RATIO**2 + 0.055  # with pinion, on the cage's shaft
    body = speed / RADIUS
    tyre = 0.6 * body / 2  # torque of each tyre holds half of the body's drag
    wheel = body + tyre / slip
    held = 2 * tyre / RATIO + 0.002 * wheel * RATIO

    def rates(x, torque):
        speeds, twists = x[:6], x[6:]  # motor, side gears, wheels, body; rotor shaft, side shafts, tyres' springs
        motor, left, right, wheels, vehicle = speeds[0], speeds[1], speeds[2], speeds[3:5], speeds[5]
        pinion = RATIO * (left + right) / 2
        rotor = 9000 * twists[0] + 0.08 * (motor - pinion)
        slipping = np.array([left - wheels[0], right - wheels[1]])
        side = np.array([8200, 7000]) * twists[1:3] + np.array([12, 10]) * slipping
        # tyre: slip·(wheel − body − spring rate) = 16000·spring + 20·spring rate
        rate = (slip * (wheels - vehicle) - 16000 * twists[3:5]) / (slip + 20)
        tyres = 16000 * twists[3:5] + 20 * rate
        mass = np.full((2, 2), cage / 4) + np.diag([0.0015, 0.0015])
        gears = np.linalg.solve(mass, RATIO * rotor / 2 - side)
        rest = [*(side - tyres) / 0.95, (tyres.sum() - 0.6 * vehicle) / 144.2]
        return [(torque - 0.002 * motor - rotor) / 0.032, *gears, *rest, motor - pinion, *slipping, *rate]

    drive = (held - 0.002 * wheel * RATIO) / 9000
    start = [wheel * RATIO, *[wheel] * 4, body, drive, tyre / 8200, tyre / 7000, tyre / 16000, tyre / 16000]
    zero, unit = np.zeros(11), np.eye(11)
    A = np.stack([np.array(rates(row, 0.0)) for row in unit], axis=1)  # the equations are linear
    B = np.array(rates(zero, 1.0))[:, None]
    time = np.arange(3001) / 1000
    torques = held + 120 * np.clip((time - 0.2) / 0.04, 0, 1)
    x = lsim((A, B, unit, np.zeros((11, 1))), torques, time, start)[1].T
    acceleration = np.gradient(x[3], 0.001)
    side = 8200 * x[7] + 12 * (x[1] - x[3])
    torque = side - (0.55 + 0.045) * acceleration - 0.02 * x[3]
    return PER_MINUTE * x[3].max(), np.abs(torque).max(), np.abs(torque * x[3]).max()


def asked(case):
    """Demands on the left dynamometer by limit, whatever the limits are."""
    names = ("dynamometer_speed", "dynamometer_torque", "dynamometer_power")
    small = replace(demands(case), limits=dict.fromkeys(names, 1e-9))
    values = {f"rig.{name}": quantity.value for name, quantity in case.rig.parameters.items()}
    return {limit: value for dynamometer, limit, value, _ in small.broken(values) if dynamometer == "left"}


@pytest.mark.parametrize(("kmh", "slip", "speed"), [(30, 923, 468), (120, 923 / 4, 1256)])
def test_demands_are_absolute(kmh, slip, speed, tmp_path):
    found = asked(at(tmp_path, slip, vehicle_speed=f"{kmh} km/h"))
    turning, torque, power = by_hand(kmh / 3.6, slip)
    assert found["dynamometer_speed"] * PER_MINUTE == pytest.approx(turning, rel=1e-4)
    assert found["dynamometer_speed"] * PER_MINUTE == pytest.approx(speed, rel=0.002)
    assert found["dynamometer_torque"] == pytest.approx(torque, rel=0.01)
    assert found["dynamometer_power"] == pytest.approx(power, rel=1e-3)


def test_limits_that_hold_from_standstill_only(tmp_path):
    """468 1/min and 28 kW at 30 km/h, 211 1/min and 12.4 kW from standstill, limits of 300 1/min and 20 kW."""
    allowed = {"dynamometer_speed": 300 / PER_MINUTE, "dynamometer_power": 20e3}
    broken = {}
    for moving in (True, False):
        case = at(tmp_path, keep=moving)
        case = replace(case, limits=case.limits | allowed)
        values = {f"rig.{name}": quantity.value for name, quantity in case.rig.parameters.items()}
        broken[moving] = {limit for _, limit, _, _ in demands(case).broken(values)}
        (note,) = standstill(case) or ("",)
        assert ("dynamometer_speed, dynamometer_power" in note and "standstill is assumed" in note) is not moving
    assert broken == {True: set(allowed), False: set()}


def test_operating_point_by_hand(tmp_path):
    """Body at v/r; each tyre slips by its torque over the coefficient; the motor gives drag and road load."""
    load = {"constant": "100 N", "linear": 2.0, "quadratic": "0.4 N*s^2/m^2"}
    case = at(tmp_path, road_load=load)
    v = 30 / 3.6
    body = v / RADIUS
    tyre = (0.6 * body + (100 + 2 * v + 0.4 * v**2) * RADIUS) / 2
    wheel = body + tyre / 923
    speeds = {
        "body": body, "wheel_left": wheel, "wheel_right": wheel, "cage": wheel, "side_gear_left": wheel,
        "side_gear_right": wheel, "motor": RATIO * wheel, "pinion": RATIO * wheel,
    }  # fmt: skip
    assert speeds_of(case.vehicle) == pytest.approx(speeds)
    assert torques_of(case.vehicle)["motor_torque"] == pytest.approx(2 * tyre / RATIO + 0.002 * RATIO * wheel)
    assert speeds_of(case.rig)["rotor_left"] == pytest.approx(wheel)
    assert torques_of(case.rig)["dyno_right"] == pytest.approx(-(tyre - 0.02 * wheel))
    (part,) = case.residual_vehicle.parts
    assert torques_of(part)["side_left_torque"] == pytest.approx(tyre)
    # the slope of the road load there: 0.6 + 2·r² + 2·0.4·r³·ω on 144.2 kg·m² and the rest of the drive
    slowest = max(np.linalg.eigvals(state_space(part).A).real)
    slope = 0.6 + 2 * RADIUS**2 + 2 * 0.4 * RADIUS**3 * body
    assert slowest == pytest.approx(-slope / (144.2 + 2 * 0.95), rel=2e-3)


def test_a_torque_of_the_road_that_is_stated_stays(tmp_path):
    """A pull of 50 N·m at the body: the motor gives it beside the drag."""
    case = at(tmp_path, road_torque="-50 N*m")
    body = 30 / 3.6 / RADIUS
    tyres = 0.6 * body + 50
    wheel = body + tyres / 2 / 923
    assert torques_of(case.vehicle)["road_torque"] == -50
    assert torques_of(case.vehicle)["motor_torque"] == pytest.approx(tyres / RATIO + 0.002 * RATIO * wheel)


def test_the_speed_follows_from_torque_and_road_load(tmp_path):
    case = at(tmp_path)
    data = tomllib.loads((tmp_path / "case.toml").read_text())
    load = {"constant": 100, "quadratic": 0.4}
    data["operating_point"] = {"motor_torque": 10, "rolling_radius": RADIUS, "road_load": load}
    (tmp_path / "case.toml").write_text(tomli_w.dumps(data))
    case = load_case(tmp_path / "case.toml")
    v = RADIUS * speeds_of(case.vehicle)["body"]
    tyres = 0.6 * v / RADIUS + (100 + 0.4 * v**2) * RADIUS
    wheel = v / RADIUS + tyres / 2 / 923
    assert pytest.approx(10) == tyres / RATIO + 0.002 * RATIO * wheel


def test_a_case_is_written_with_its_operating_point(tmp_path):
    case = at(tmp_path, road_load="100 N")
    again = tmp_path / "again"
    again.mkdir()
    for name, text in case_files(case).items():
        (again / name).write_text(text)
    read = load_case(again / "case.toml")
    assert speeds_of(read.rig) == pytest.approx(speeds_of(case.rig))
    assert torques_of(read.vehicle) == pytest.approx(torques_of(case.vehicle))
    assert read.torque_curve == case.torque_curve
    assert read.limits == case.limits


def test_manoeuvres_of_segments_and_of_a_record_are_written_again(tmp_path):
    """A tip-in and a tip-out on the motor, a recorded push on the road; a record that is absolute starts at 0."""
    at(tmp_path)
    data = tomllib.loads((tmp_path / "case.toml").read_text())
    data["manoeuvre"] = {
        "motor_torque": [{"to": 120, "over": 0.05, "hold": 1}, {"to": 0, "over": 0.1, "hold": 1}],
        "road_torque": {"file": "push.csv"},
    }
    (tmp_path / "push.csv").write_text("time [s],road_torque [N*m]\n0,0\n1,50\n2.5,50\n3.5,0\n")
    (tmp_path / "case.toml").write_text(tomli_w.dumps(data))
    case = load_case(tmp_path / "case.toml")
    again = tmp_path / "again"
    again.mkdir()
    for name, text in case_files(case).items():
        (again / name).write_text(text)
    assert load_case(again / "case.toml").manoeuvre == case.manoeuvre
    speeds = PER_MINUTE * demands(case).behind[0].cuts[0].speed
    assert speeds.max() > 300  # over all of both manoeuvres, up to 3.5 s
    held = torques_of(case.vehicle)["motor_torque"]
    (tmp_path / "drive.csv").write_text(f"time [s],motor_torque [N*m]\n0,{held!r}\n1,{held + 50!r}\n")
    data["manoeuvre"] = {"motor_torque": {"file": "drive.csv", "absolute": True}}
    (tmp_path / "case.toml").write_text(tomli_w.dumps(data))
    torque = load_case(tmp_path / "case.toml").manoeuvre["motor_torque"].torque(np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(torque, [0, 25, 50], atol=1e-9)


def test_torque_that_falls_with_speed():
    """4 N·m at 5 rad/s where 10 N·m at rest fall to 2 N·m at 10 rad/s: two thirds of 6 N·m."""
    curve = TorqueCurve((0.0, 10.0), (10.0, 2.0))
    motion = CutMotion("rotor", *(np.array([x]) for x in (10.0, 3.0, 5.0)))
    part = BehindCut(("rotor",), (), (motion,), {"left": "rotor"})
    falling = Demands((part,), {"dynamometer_torque_over_speed": 0.5}, curve)
    values = {"rig.inertias.rotor.J": 2.0, "rig.inertias.rotor.drag": 0.0}
    ((_, limit, share, _),) = falling.broken(values)
    assert limit == "dynamometer_torque_over_speed"
    assert share == pytest.approx(2 / 3)
    assert falling.shares(values).tolist() == pytest.approx([2 / 3 / 0.5])
    assert falling.shares({**values, "rig.inertias.rotor.drag": 0.2}).tolist() == pytest.approx([3 / 6 / 0.5])


def test_the_result_states_it(compact):
    """In result.json, in the terminal and in the report."""
    turning, torque, power = by_hand(30 / 3.6, 923)
    peaks = compact.verification.peaks
    assert peaks["dynamometers.left.speed"] * PER_MINUTE == pytest.approx(turning, rel=2e-3)
    assert peaks["dynamometers.left.torque"] == pytest.approx(torque, rel=0.02)
    assert peaks["dynamometers.left.power"] == pytest.approx(power, rel=5e-3)
    result = json.loads(json.dumps(content(compact)))
    assert result["operating_point"]["rotor_left"] == pytest.approx(30 / 3.6 / RADIUS, rel=1e-3)
    line = operating_point(result)
    assert "256.8 1/min" in line
    assert "256.8 1/min" in str(report(content(compact), "OUT", None, compact).folds)
    assert compact.notes == () or "standstill" not in compact.notes[0]


def test_a_limit_over_speed_is_named(compact):
    """The curve of the case drawn in to what the manoeuvre takes: one sentence with the share."""
    verification = compact.verification
    used = verification.peaks["dynamometers.left.torque_over_speed"]
    assert 0.5 < used < 1
    name = "dynamometer_torque_over_speed"
    less = replace(compact.case, limits=compact.case.limits | {name: 0.9 * used})
    found = Solution({}, compact.tuned, 0.0, (), True, [], verification)
    stands = sentences(limits(problem_of(less), found, compact.targets, Relaxations()))
    assert any(f"{used:.2g}"[:3] in sentence and "at its speed" in sentence for sentence in stands)
