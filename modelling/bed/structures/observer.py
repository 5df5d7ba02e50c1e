"""Observer, prediction across the dead time and state feedback in one controller, for measured and unmeasured torques.

What it measures: the dynamometers' torques and speeds, further sensors (``loop.measures``) and torques that are
measured or demanded (``loop.knows``). Unmeasured torques it estimates. Its weights, :data:`QUANTITIES`, are no
physical values: a search over drawn beds sets them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from modelling.bed.blocks import ControllerBlock
from modelling.bed.loop import ControlStructure, Loop, LoopQuantity
from modelling.bed.observer.design import design
from modelling.bed.observer.model import observer_model
from modelling.bed.observer_controller import ObserverController
from modelling.bed.residual_vehicle import ResidualVehicle
from modelling.model.system import System

# Starts: tuned over drawn beds for the reference drive at 3 ms of dead time.
QUANTITIES = {
    "torque_drift": LoopQuantity("N*m/s^0.5", 21.0, 1e-4, 1e6, "how fast an unmeasured torque at an input may wander"),
    "dynamometer_drift": LoopQuantity("N*m/s^0.5", 3.4, 1e-4, 1e6, "how fast a torque at a rotor may wander"),
    "dynamometer_swing": LoopQuantity(
        "N*m/s^0.5", 14.0, 1e-4, 1e6, "how fast a torque at a rotor may wander that swings with an emulated mode"
    ),
    "dynamometer_noise": LoopQuantity("N*m*s^0.5", 0.04, 1e-6, 1e4, "noise of the torque at a rotor"),
    "shaft_noise": LoopQuantity("N*m*s^0.5", 0.33, 1e-6, 1e4, "noise of the torque in a shaft at a cut"),
    "command_weight": LoopQuantity("(rad/s/(N*m))^2", 3.6e-12, 1e-18, 1.0, "weight on a squared command"),
    "command_change_weight": LoopQuantity(
        "(rad/s/(N*m))^2", 1.2e-7, 1e-14, 1.0, "weight on the squared change of a command from sample to sample"
    ),
    "torque_sensor_noise": LoopQuantity("1", 1.4, 1e-3, 1e3, "noise of a flange torque over the sensor's uncertainty"),
    "rotor_speed_noise": LoopQuantity("1", 0.59, 1e-3, 1e3, "noise of a rotor speed over the sensor's uncertainty"),
    "further_sensor_noise": LoopQuantity("1", 0.075, 1e-3, 1e3, "noise of any other sensor over its uncertainty"),
}

# Where else a search may begin. For the same drive at 8 ms of dead time; and, at 3 and 8 ms, with no torque that swings
# and no noise in the cut shafts, which other drives may be nearer to.
WITHOUT_SWING = {"dynamometer_swing": 1e-4, "shaft_noise": 1e-6}
FURTHER_STARTS = (
    {
        "torque_drift": 20.0, "dynamometer_drift": 1.2, "dynamometer_swing": 14.0, "dynamometer_noise": 0.041,
        "shaft_noise": 0.13, "command_weight": 7.6e-12, "command_change_weight": 5.6e-7,
        "torque_sensor_noise": 0.68, "rotor_speed_noise": 0.55, "further_sensor_noise": 0.047,
    },
    {
        "torque_drift": 19.0, "dynamometer_drift": 11.0, "dynamometer_noise": 0.096, "command_weight": 3.6e-12,
        "command_change_weight": 1.2e-7, "torque_sensor_noise": 1.6, "rotor_speed_noise": 0.24,
        "further_sensor_noise": 0.072, **WITHOUT_SWING,
    },
    {
        "torque_drift": 10.0, "dynamometer_drift": 2.8, "dynamometer_noise": 0.27, "command_weight": 7.6e-12,
        "command_change_weight": 6.2e-8, "torque_sensor_noise": 0.95, "rotor_speed_noise": 0.27,
        "further_sensor_noise": 0.035, **WITHOUT_SWING,
    },
)  # fmt: skip

BLOCKS = (
    ControllerBlock(
        "Kalman filter", "states and unmeasured torques now",
        takes=("flange torque", "rotor speed", "further sensors", "measured torques"),
        quantities=(
            "torque_drift", "dynamometer_drift", "dynamometer_swing", "dynamometer_noise", "shaft_noise",
            "torque_sensor_noise", "rotor_speed_noise", "further_sensor_noise",
        ),
        holds_residual_vehicle=True,
    ),
    ControllerBlock(
        "Prediction across the dead time", "the same when the command acts", takes=("commands on their way",)
    ),
    ControllerBlock("State feedback", "command", quantities=("command_weight", "command_change_weight")),
)  # fmt: skip


@dataclass(frozen=True)
class Observer(ControlStructure):
    """Kalman filter, prediction and state feedback."""

    name = "observer"
    quantities = QUANTITIES
    blocks = BLOCKS
    is_observer = True
    further_starts = FURTHER_STARTS

    def gives_torque(self, values: Mapping[str, float]) -> bool:
        """Always."""
        return True

    def measured_inputs(self, measured: Sequence[str], simulated: Sequence[str]) -> tuple[str, ...]:
        """All that are measured, and what acts inside the residual vehicle."""
        return (*measured, *simulated)

    def observer(self, rig: System, residual: ResidualVehicle, loop: Loop) -> ObserverController | None:
        """See :meth:`ControlStructure.observer`."""
        return design(observer_model(rig, residual, loop), loop.values)
