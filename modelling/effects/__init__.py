"""The effects beyond a linear chain: the vocabulary of causes.

A new kind is a class derived from :class:`modelling.effects.effect.Kind` in one of the modules here; model files,
equations, simulation, fit, diagnosis and report read all they need from ``EFFECTS``.
"""

from modelling.effects import (
    drifts,
    friction_and_compliance,
    sensors_and_actuators,
    torque_map,
    torques,
    turning_sensors,
)
from modelling.effects.effect import Kind, Parameter

__all__ = [
    "EFFECTS",
    "Kind",
    "Parameter",
    "drifts",
    "friction_and_compliance",
    "sensors_and_actuators",
    "torque_map",
    "torques",
    "turning_sensors",
]

EFFECTS: dict[str, Kind] = {cls.kind: cls() for cls in sorted(Kind.__subclasses__(), key=lambda cls: cls.kind)}
