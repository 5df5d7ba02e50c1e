"""A car with an engine of a torque map pulls away and tips in, simulated against equations of this file alone.

Own interpolation of the map, Runge and Kutta's classical method with 10 steps a millisecond; nothing of rigmatch.
"""

import numpy as np
import pytest

import rigmatch as rm
from modelling.model_file import from_dict

J_ENGINE, J_GEAR, J_WHEEL, J_CAR = 0.16, 0.02, 2.0, 120.0
DRAG, DRAG_CAR, AIR = 0.015, 2.0, 0.05
K_IN, C_IN, K_SIDE, C_SIDE, RATIO = 900.0, 0.8, 7000.0, 25.0, 11.0
K_TYRE, C_TYRE = 30000.0, 250.0
STEP, PIECES = 1e-3, 10
NAMES = ("engine_speed", "car_speed", "input_torque", "side_torque")


def bilinear(speeds, pedals, torques, speed, pedal):
    i = min(max(int(np.searchsorted(speeds, speed)) - 1, 0), len(speeds) - 2)
    j = min(max(int(np.searchsorted(pedals, pedal)) - 1, 0), len(pedals) - 2)
    a = min(max((speed - speeds[i]) / (speeds[i + 1] - speeds[i]), 0.0), 1.0)
    b = min(max((pedal - pedals[j]) / (pedals[j + 1] - pedals[j]), 0.0), 1.0)
    low = (1 - b) * torques[i][j] + b * torques[i][j + 1]
    high = (1 - b) * torques[i + 1][j] + b * torques[i + 1][j + 1]
    return (1 - a) * low + a * high


def rates(x, pedal, of):
    """Engine, gearbox, wheel, car; twists of input shaft, side shaft and tyre."""
    engine, gear, wheel, car, first, side, tyre = x
    into = K_IN * first + C_IN * (engine - gear)
    out = K_SIDE * side + C_SIDE * (gear / RATIO - wheel)
    road = K_TYRE * tyre + C_TYRE * (wheel - car)
    return np.array([
        (bilinear(*of, engine, pedal) - DRAG * engine - into) / J_ENGINE, (into - out / RATIO) / J_GEAR,
        (out - road) / J_WHEEL, (road - DRAG_CAR * car - AIR * car * abs(car)) / J_CAR,
        engine - gear, gear / RATIO - wheel, wheel - car,
    ])  # fmt: skip


def driven(pedal, of):
    """Readings (t, 4) of the car from rest, the pedal (t,) straight between its samples."""
    x, h, rows = np.zeros(7), STEP / PIECES, []
    for now, then in zip(pedal, [*pedal[1:], pedal[-1]], strict=True):
        rows.append([x[0], x[3], K_IN * x[4] + C_IN * (x[0] - x[1]), K_SIDE * x[5] + C_SIDE * (x[1] / RATIO - x[2])])
        for piece in range(PIECES):
            begin, middle, end = (now + (then - now) * (piece + part) / PIECES for part in (0.0, 0.5, 1.0))
            a = rates(x, begin, of)
            b = rates(x + h / 2 * a, middle, of)
            c = rates(x + h / 2 * b, middle, of)
            x = x + h / 6 * (a + 2 * b + 2 * c + rates(x + h * c, end, of))
    return np.array(rows)


def car(of):
    speeds, pedals, torques = of
    return from_dict({
        "inertias": {
            "engine": {"J": J_ENGINE, "drag": DRAG}, "gear": {"J": J_GEAR}, "wheel": {"J": J_WHEEL},
            "car": {"J": J_CAR, "drag": DRAG_CAR},
        },
        "shafts": {
            "input": {"between": ["engine", "gear"], "stiffness": K_IN, "damping": C_IN},
            "side": {"between": ["gear", "wheel"], "ratio": RATIO, "stiffness": K_SIDE, "damping": C_SIDE},
            "tyre": {"between": ["wheel", "car"], "stiffness": K_TYRE, "damping": C_TYRE},
        },
        "inputs": {"pedal": {"on": "engine"}},
        "sensors": {
            "engine_speed": {"measures": "speed", "of": "engine"}, "car_speed": {"measures": "speed", "of": "car"},
            "input_torque": {"measures": "torque", "of": "input"}, "side_torque": {"measures": "torque", "of": "side"},
        },
        "effects": [
            {"kind": "torque_map", "at": "inputs.pedal", "speed": speeds, "pedal": pedals, "torque": torques},
            {"kind": "quadratic_drag", "at": "inertias.car", "coefficient": AIR},
        ],
    })  # fmt: skip


def drawn(random):
    """A map: torque rises with the pedal and falls beyond a speed; at rest it creeps."""
    speeds = (60 + np.cumsum(random.uniform(30, 120, random.integers(3, 7)))).tolist()
    pedals = np.r_[0.0, np.sort(random.uniform(0.1, 0.9, random.integers(1, 4))), 1.0].tolist()
    full, best = random.uniform(120, 260), random.uniform(0.3, 0.7) * (speeds[0] + speeds[-1])
    torques = [
        [full * p ** random.uniform(0.6, 1.2) * (1 - ((w - best) / 900) ** 2) - (1 - p) * w / 20 for p in pedals]
        for w in speeds
    ]
    torques[0][0] = random.uniform(5, 25)
    return speeds, pedals, torques


def pulls_away(random, time):
    """Creeps, pulls away, and tips in."""
    first, second = random.uniform(0.1, 0.4), random.uniform(0.5, 1.0)
    away = np.clip((time - random.uniform(0.2, 0.5)) / random.uniform(0.2, 0.6), 0, 1)
    tip = np.clip((time - random.uniform(1.5, 2.0)) / random.uniform(0.03, 0.1), 0, 1)
    return first * away + (second - first) * tip


def check(seed, seconds):
    random, time = np.random.default_rng(seed), np.arange(round(seconds / STEP)) * STEP
    of, pedal = drawn(random), pulls_away(random, time)
    wanted, model = driven(pedal, of), car(of)
    found = rm.simulate(model, rm.Recording(time, {"pedal": pedal}), start="rest")
    for column, name in enumerate(NAMES):
        error = np.abs(found[name] - wanted[:, column]).max() / np.ptp(wanted[:, column])
        assert error < 1e-3, (seed, name, error)
    assert np.ptp(wanted[:, 0]) > 50, "it has pulled away"


def test_a_car_pulls_away_and_tips_in_by_its_pedal():
    check(2211, 2.3)


@pytest.mark.long
def test_drawn_maps_and_pedals():
    for seed in np.random.SeedSequence().spawn(12):
        check(seed, 4.0)
