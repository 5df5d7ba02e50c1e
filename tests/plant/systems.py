"""The systems whose recordings are made, with parameter values drawn by seed."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Drive:
    """One mechanical system: its parts, its base values (SI), and which values its model file gives with a range."""

    system: str
    title: str
    inertias: list[str]
    shafts: dict[str, tuple[str, str]]
    inputs: dict[str, str]
    sensors: dict[str, tuple[str, str]]
    values: dict[str, float]
    torque: dict[str, float]  # input -> usual amplitude, N·m
    tolerance: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.tolerance:
            return
        for name, value in self.values.items():
            quantity = name.rsplit(".", 1)[1]
            if quantity != "J" and quantity != "ratio" and value != 0:
                self.tolerance[name] = 0.1 if quantity == "stiffness" else 0.5

    def speed_ratio(self, inertia: str) -> float:
        """Speed of an inertia over that of the last one when nothing twists."""
        ratios = {self.inertias[-1]: 1.0}
        while inertia not in ratios:
            for name, (first, second) in self.shafts.items():
                ratio = self.values.get(f"shafts.{name}.ratio", 1.0)
                if second in ratios:
                    ratios.setdefault(first, ratio * ratios[second])
                elif first in ratios:
                    ratios[second] = ratios[first] / ratio
        return ratios[inertia]


def _perhaps_geared(drive: Drive, rng: np.random.Generator, shafts: list[str]) -> Drive:
    """In three of ten draws the motor runs faster by the ratio of the shafts that leave it, its values with it."""
    if rng.random() < 0.3:
        ratio = round(rng.uniform(6, 12), 2)
        drive.values |= {f"shafts.{name}.ratio": ratio for name in shafts}
        for quantity in ("J", "drag"):
            drive.values[f"inertias.motor.{quantity}"] /= ratio**2
        drive.torque["motor_torque"] /= ratio
    return drive


def _values(inertias: dict[str, tuple[float, float]], shafts: dict[str, tuple[float, float]]) -> dict[str, float]:
    values: dict[str, float] = {}
    for name, (inertia, drag) in inertias.items():
        values |= {f"inertias.{name}.J": inertia, f"inertias.{name}.drag": drag}
    for name, (stiffness, damping) in shafts.items():
        values |= {f"shafts.{name}.stiffness": stiffness, f"shafts.{name}.damping": damping}
    return values


def two_mass(rng: np.random.Generator) -> Drive:
    draw = rng.uniform
    return Drive(
        "two_mass",
        "Two-mass drive",
        ["motor", "load"],
        {"link": ("motor", "load")},
        {"motor_torque": "motor", "brake_torque": "load"},
        {"motor_speed": ("speed", "motor"), "load_speed": ("speed", "load"), "link_torque": ("torque", "link")},
        _values(
            {"motor": (draw(0.05, 0.2), draw(0.01, 0.04)), "load": (draw(0.8, 2.2), draw(0.05, 0.3))},
            {"link": (draw(140, 560), draw(0.2, 0.9))},
        ),
        {"motor_torque": draw(6, 14), "brake_torque": draw(2, 5)},
    )


def test_bed(rng: np.random.Generator) -> Drive:
    draw = rng.uniform
    side, dyno = draw(7000, 12000), draw(0.6, 1.2)
    drive = Drive(
        "test_bed",
        "Electric drive unit on the test bed",
        ["motor", "differential", "dyno_left", "dyno_right"],
        {
            "gearbox": ("motor", "differential"),
            "side_left": ("differential", "dyno_left"),
            "side_right": ("differential", "dyno_right"),
        },
        {"motor_torque": "motor", "dyno_left_torque": "dyno_left", "dyno_right_torque": "dyno_right"},
        {
            "motor_speed": ("speed", "motor"),
            "speed_left": ("speed", "dyno_left"),
            "speed_right": ("speed", "dyno_right"),
            "torque_left": ("torque", "side_left"),
            "torque_right": ("torque", "side_right"),
        },
        _values(
            {
                "motor": (draw(3.5, 6.5), draw(0.8, 2.0)),
                "differential": (draw(0.12, 0.25), 0.0),
                "dyno_left": (dyno, draw(0.15, 0.4)),
                "dyno_right": (dyno * draw(0.98, 1.02), draw(0.15, 0.4)),
            },
            {
                "gearbox": (draw(1.2e5, 2.2e5), draw(30, 100)),
                "side_left": (side, draw(8, 17)),
                "side_right": (side * draw(0.88, 1.0), draw(8, 25)),
            },
        ),
        {"motor_torque": draw(180, 400), "dyno_left_torque": draw(25, 60), "dyno_right_torque": draw(25, 60)},
    )
    return _perhaps_geared(drive, rng, ["gearbox"])


test_bed.__test__ = False  # type: ignore[attr-defined]  # a system, not a test


def vehicle(rng: np.random.Generator) -> Drive:
    draw = rng.uniform
    side, tyre, wheel = draw(6000, 11000), draw(6e4, 11e4), draw(1.0, 1.8)
    drive = Drive(
        "vehicle",
        "Battery electric vehicle",
        ["motor", "wheel_left", "wheel_right", "body"],
        {
            "side_left": ("motor", "wheel_left"),
            "side_right": ("motor", "wheel_right"),
            "tyre_left": ("wheel_left", "body"),
            "tyre_right": ("wheel_right", "body"),
        },
        {"motor_torque": "motor"},
        {
            "motor_speed": ("speed", "motor"),
            "wheel_left_speed": ("speed", "wheel_left"),
            "wheel_right_speed": ("speed", "wheel_right"),
            "body_speed": ("speed", "body"),
            "body_acceleration": ("acceleration", "body"),
        },
        _values(
            {
                "motor": (draw(2.5, 5.0), draw(0.8, 1.8)),
                "wheel_left": (wheel, draw(0.15, 0.3)),
                "wheel_right": (wheel, draw(0.15, 0.3)),
                "body": (draw(120, 190), draw(2, 5)),
            },
            {
                "side_left": (side, draw(10, 22)),
                "side_right": (side * draw(0.9, 1.0), draw(10, 22)),
                "tyre_left": (tyre, draw(80, 230)),
                "tyre_right": (tyre * draw(0.95, 1.1), draw(80, 230)),
            },
        ),
        {"motor_torque": draw(200, 450)},
    )
    return _perhaps_geared(drive, rng, ["side_left", "side_right"])


SYSTEMS = {"two_mass": two_mass, "test_bed": test_bed, "vehicle": vehicle}
