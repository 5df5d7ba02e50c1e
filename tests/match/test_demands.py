"""Demands at shafts and rotors behind a cut, against an own simulation of nine elastic rigs that follow the vehicle.

The own simulation knows inertias and springs alone. Gears, differentials and planetary gears are springs that are stiff
beside all others. A controller holds the rig's end of the cut on the vehicle's motion, and what it needs for that is
compared.
"""

from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import cont2discrete

import rigmatch as rm
from matching.match.demands import demands, rig_values

STIFF = 3e6  # N·m/rad: shafts between cut and rotor, so stiff that the manoeuvre does not bend them
RATE = 1000.0  # Hz
SUBSTEPS = 2

# Inertias behind the cut (kg·m²; the first hangs at the cut), and the joints between them:
# shaft (first, second, ratio), gear (first, second, ratio), differential (cage, left, right),
# planetary gear (carrier, ring, sun, ratio)
RIGS = {
    "flange": ([0.05, 0.9], [("shaft", 0, 1, 1.0)]),
    "flange with a ratio": ([0.05, 0.9], [("shaft", 0, 1, 2.0)]),
    "shaft turned round, ratio below one": ([0.08, 1.4], [("shaft", 1, 0, 0.6)]),
    "gear before the rotor": ([0.05, 0.1, 0.9], [("shaft", 0, 1, 1.0), ("gear", 1, 2, 2.0)]),
    "gear at the cut": ([0.05, 0.02, 0.3], [("gear", 1, 0, 3.2), ("shaft", 1, 2, 1.0)]),
    "reversing gear, then a ratio": ([0.1, 0.05, 0.7], [("gear", 0, 1, -1.5), ("shaft", 2, 1, 0.8)]),
    "disc beside the way": ([0.05, 0.4, 0.9, 0.6], [("shaft", 0, 1, 1.0), ("shaft", 1, 2, 1.5), ("shaft", 1, 3, 0.5)]),
    "differential with a free side": (
        [0.05, 0.2, 6.0, 0.9],
        [("differential", 1, 0, 2), ("shaft", 1, 3, 2.5)],
    ),
    "planetary gear with a free sun": (
        [0.05, 0.2, 3.0, 0.9],
        [("planetary", 1, 0, 2, 2.6), ("shaft", 1, 3, 1.4)],
    ),
}
MOTOR, WHEEL, BODY, SIDE, TYRE, DRAG = 0.3, 1.1, 30.0, 6000.0, 9000.0, 0.4
VEHICLE = f"""
[inertias.motor]
J = {MOTOR}
[inertias.wheel]
J = {WHEEL}
[inertias.body]
J = {BODY}
drag = {DRAG}
[shafts.side]
between = ["motor", "wheel"]
stiffness = {SIDE}
damping = 8
[shafts.tyre]
between = ["wheel", "body"]
stiffness = {TYRE}
damping = 40
[inputs.motor_torque]
on = "motor"
[sensors.motor_speed]
measures = "speed"
of = "motor"
[sensors.side_torque]
measures = "torque"
of = "side"
"""
CASE = """
vehicle = "vehicle.toml"
rig = "rig.toml"
[dynamometers.dyno]
torque_input = "dyno"
torque_sensor = "side_torque"
speed_sensor = "rotor_speed"
follows = "side"
[loop]
structure = "observer"
knows = ["motor_torque"]
measures = ["motor_speed"]
dead_time = 0.003
[[targets]]
mode = 2
[response]
compare = [{ input = "motor_torque", sensor = "motor_speed" }]
[manoeuvre.motor_torque]
kind = "tip_in"
amplitude = 80
at = 0.1
rise_time = 0.4
duration = 1.5
[limits]
dynamometer_torque = 1e-6
dynamometer_speed = 1e-6
dynamometer_power = 1e-6
"""


def rig_file(inertias, connections):
    """The rig as a model file with limits for each of its shafts."""
    text = f"[inertias.motor]\nJ = {MOTOR}\n"
    text += '[shafts.side]\nbetween = ["motor", "n0"]\nstiffness = 6000\ndamping = 8\n'
    limits = ""
    for i, J in enumerate(inertias):
        text += f"[inertias.n{i}]\nJ = {J}\ndrag = {0.05 * i}\n"
    for k, (kind, *ends) in enumerate(connections):
        if kind == "differential":
            text += f'[differentials.j{k}]\ncage = "n{ends[0]}"\nleft = "n{ends[1]}"\nright = "n{ends[2]}"\n'
            continue
        if kind == "planetary":
            text += f'[planetary_gears.j{k}]\ncarrier = "n{ends[0]}"\nring = "n{ends[1]}"\nsun = "n{ends[2]}"\n'
            text += f"ratio = {ends[3]}\n"
            continue
        text += f'[{kind}s.j{k}]\nbetween = ["n{ends[0]}", "n{ends[1]}"]\nratio = {ends[2]}\n'
        if kind == "shaft":
            text += f"stiffness = {STIFF}\ndamping = 100\n"
            limits += f'"shafts.j{k}.torque" = 1e-6\n"shafts.j{k}.twist" = 1e-9\n'
    rotor = f"n{len(inertias) - 1}"
    text += f'[inputs.motor_torque]\non = "motor"\n[inputs.dyno]\non = "{rotor}"\n'
    text += '[sensors.motor_speed]\nmeasures = "speed"\nof = "motor"\n'
    text += '[sensors.side_torque]\nmeasures = "torque"\nof = "side"\n'
    return text + f'[sensors.rotor_speed]\nmeasures = "speed"\nof = "{rotor}"\n', limits


def chain_matrices(J, drag, springs):
    """A (2n, 2n) of angles and speeds, and the rows (k, n) of twists; springs are (row, stiffness, damping)."""
    n = len(J)
    stiff, damp = np.zeros((n, n)), np.diag(np.asarray(drag, float))
    for row, k, d in springs:
        stiff += k * np.outer(row, row)
        damp += d * np.outer(row, row)
    inverse = np.diag(1 / np.asarray(J, float))
    return np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiff, -inverse @ damp]])


def vehicle_motion(time):
    """Torque of the side shaft, acceleration and speed of the wheel (t,) under the ramp of the motor's torque."""
    springs = [(np.array([1, -1, 0]), SIDE, 8), (np.array([0, 1, -1]), TYRE, 40)]
    A = chain_matrices([MOTOR, WHEEL, BODY], [0, 0, DRAG], springs)
    B = np.zeros((6, 1))
    B[3] = 1 / MOTOR
    ramp = np.clip((time - 0.1) / 0.4, 0, 1)
    states = sampled(A, B, 80 * ramp[:, None], time[1])
    torque = SIDE * (states[:, 0] - states[:, 1]) + 8 * (states[:, 3] - states[:, 4])
    return torque, (states @ A.T)[:, 4], states[:, 4]


def sampled(A, B, u, step):
    """States (t, x) under inputs (t, u) that are straight between the samples."""
    whole, now, *_ = cont2discrete((A, B, np.eye(len(A)), np.zeros_like(B)), step, "zoh")
    states = np.zeros((len(u), len(A)))
    for i, (a, b) in enumerate(pairwise(u)):
        states[i + 1] = whole @ states[i] + now @ ((a + b) / 2)
    return states


def followed(inertias, connections, torque, acceleration, speed, time):
    """Peaks of a rig that follows the vehicle: torque of each shaft; torque, speed and power of the dynamometer."""
    n, springs, shafts = len(inertias), [], []
    for k, (kind, *ends) in enumerate(connections):
        row = np.zeros(n)
        if kind == "differential":
            row[ends[0]], row[ends[1]], row[ends[2]] = 1, -0.5, -0.5
        elif kind == "planetary":
            row[ends[0]], row[ends[1]], row[ends[2]] = 1, -ends[3] / (1 + ends[3]), -1 / (1 + ends[3])
        else:
            row[ends[0]], row[ends[1]] = 1 / ends[2], -1
        springs.append((row, STIFF if kind == "shaft" else 30 * STIFF, 100 if kind == "shaft" else 2000))
        if kind == "shaft":
            shafts.append((k, row))
    drag = [0.05 * i for i in range(n)]
    A = chain_matrices(inertias, drag, springs)
    # the rotor's ratio to the cut, and all inertia there, set sign and size of the controller's gains
    turning = static_ratio(n, connections)
    total = sum(J * s**2 for J, s in zip(inertias, turning, strict=True))
    inverse = 1 / turning[-1]
    bandwidth = 60.0
    gains = total * inverse * np.array([bandwidth**2, 2 * bandwidth])
    B = np.zeros((2 * n, 4))  # cut torque, wanted angle, wanted speed, wanted acceleration
    B[n, 0] = 1 / inertias[0]
    to_rotor = np.zeros(2 * n)
    to_rotor[-1] = 1 / inertias[-1]
    command = np.array([-inverse, gains[0], gains[1], total * inverse])
    feedback = np.zeros(2 * n)
    feedback[0], feedback[n] = -gains[0], -gains[1]
    closed = A + np.outer(to_rotor, feedback)
    B = B + np.outer(to_rotor, command)
    angle = np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2 * time[1])])
    u = np.stack([torque, angle, speed, acceleration], axis=1)
    states = sampled(closed, B, u, time[1])
    supplied = u @ command + states @ feedback
    assert np.abs(states[:, n] - speed).max() < 0.01 * np.abs(speed).max()
    out = {
        "dynamometer_torque": np.abs(supplied).max(),
        "dynamometer_speed": np.abs(states[:, -1]).max(),
        "dynamometer_power": np.abs(supplied * states[:, -1]).max(),
    }
    for k, row in shafts:
        transmitted = STIFF * states[:, :n] @ row + 100 * states[:, n:] @ row
        out[f"shafts.j{k}.torque"] = np.abs(transmitted).max()
        out[f"shafts.j{k}.twist"] = np.abs(states[:, :n] @ row).max()
    return out


def static_ratio(n, connections):
    """Speed of each inertia per speed of the cut, a free side of a differential at rest."""
    rows = []
    for kind, *ends in connections:
        row = np.zeros(n)
        if kind == "differential":
            row[ends[0]], row[ends[1]] = 1, -0.5
        elif kind == "planetary":
            row[ends[0]], row[ends[1]] = 1, -ends[3] / (1 + ends[3])
        else:
            row[ends[0]], row[ends[1]] = 1, -ends[2]
        rows.append(row)
    rows.append(np.eye(n)[0])
    return np.linalg.lstsq(np.array(rows), np.eye(len(rows))[-1])[0]


@pytest.mark.parametrize("name", RIGS)
def test_demands_are_those_of_an_elastic_rig_that_follows_the_vehicle(name, tmp_path):
    inertias, connections = RIGS[name]
    rig, limits = rig_file(inertias, connections)
    for file, text in (("vehicle.toml", VEHICLE), ("rig.toml", rig), ("case.toml", CASE + limits)):
        (tmp_path / file).write_text(text, encoding="utf-8")
    case = rm.load_case(tmp_path / "case.toml")
    stated = {one.limit: one.demand for one in demands(case).taken(rig_values(case))}
    fine = np.arange(0, 1.5, 1 / RATE / SUBSTEPS)
    expected = followed(inertias, connections, *vehicle_motion(fine), fine)
    assert set(stated) == set(expected)
    for limit, demand in expected.items():
        assert stated[limit] == pytest.approx(demand, rel=0.01), limit
