"""The control loop that closes the residual vehicle model round the rig.

Per dynamometer: measured torque → torque-sensor lag → residual vehicle → reference speed → speed controller with
torque and acceleration feed-forward and a lead → dead time → inverter lag → air-gap torque on the rotor.

Two structures. ``pi`` is that and nothing else. ``model_based`` runs a twin of rig and vehicle on the announced
torques (motor torque demand, simulated road torques), predicts it across the dead time and commands what makes the
twin's interface follow the vehicle (:mod:`modelling.bed.model_based`); the ``pi`` loop then acts on what the
measurements
deviate from the twin by, so its poles, margins and its answer to unannounced torques are those of ``pi``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

LEAD_SPREAD = 5.0  # the lead's pole lies this many times above its zero


@dataclass(frozen=True)
class Knob:
    """A quantity of the loop: SI unit, start value, physical bounds, what it is."""

    unit: str
    start: float
    lower: float
    upper: float
    meaning: str


HARDWARE = {
    "dead_time": Knob(
        "s", 0.003, 0.0, 0.2, "total dead time from sensor to air-gap torque, computing and bus included"
    ),
    "inverter_lag": Knob("s", 0.002, 1e-5, 0.2, "first-order lag of the air-gap torque"),
    "torque_sensor_lag": Knob("s", 0.0005, 1e-6, 0.2, "first-order lag of the torque flange and its filter"),
    "sample_time": Knob("s", 0.001, 1e-5, 0.05, "sample time of the residual vehicle model and the controller"),
}
_CONTROLLER = {
    "proportional_gain": Knob("N*m*s/rad", 100.0, 0.0, 1e5, "torque for a speed error"),
    "integral_gain": Knob("N*m/rad", 50.0, 0.0, 1e7, "torque for an angle error"),
    "torque_feed_forward": Knob("1", 0.0, -1.0, 3.0, "share of the measured torque that is compensated"),
    "acceleration_feed_forward": Knob(
        "kg*m^2", 0.0, -10.0, 1e3, "inertia whose torque for the reference's acceleration is fed forward"
    ),
    "lead_time": Knob("s", 0.003, 0.0, 0.1, "time constant of the lead that makes up for lags"),
}
GAINS = ("proportional_gain", "integral_gain", "torque_feed_forward", "acceleration_feed_forward")  # all 0: no torque
KNOBS = {"pi": _CONTROLLER, "model_based": _CONTROLLER}


@dataclass(frozen=True)
class Dynamometer:
    """One dynamometer: the rig input it drives, its torque and speed sensors, the cut shaft whose outer end it is."""

    name: str
    torque_input: str
    torque_sensor: str
    speed_sensor: str
    follows: str


@dataclass(frozen=True)
class Loop:
    """Structure, dynamometers, inputs the controller is told of, values of :data:`HARDWARE` and :data:`KNOBS` in SI."""

    structure: str
    dynamometers: tuple[Dynamometer, ...]
    knows: tuple[str, ...]
    values: Mapping[str, float]

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    @property
    def torqueless(self) -> bool:
        """Whether the dynamometers never give torque: structure ``pi`` with every gain at 0."""
        return self.structure == "pi" and not any(self.values[name] for name in GAINS)

    def with_values(self, values: Mapping[str, float]) -> Loop:
        """The same loop with some values changed by name."""
        return replace(self, values={**self.values, **values})
