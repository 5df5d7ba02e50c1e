"""The blocks of a controller, in the order in which a signal runs through them: what a diagram of it shows."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ControllerBlock:
    """One block.

    Attributes
    ----------
    title : str
    gives : str
        The signal that goes to the next block.
    takes : tuple of str
        Signals that enter beside that of the block before.
    quantities : tuple of str
        Values of the loop that are entered here, by name.
    holds_residual_vehicle : bool
        Whether the values of the residual vehicle are entered here.
    """

    title: str
    gives: str
    takes: tuple[str, ...] = ()
    quantities: tuple[str, ...] = ()
    holds_residual_vehicle: bool = False


# What every structure's command runs through until it comes back as a reading.
OF_BED = (
    ControllerBlock("Dead time and inverter", "air-gap torque", quantities=("dead_time", "inverter_lag")),
    ControllerBlock("Dynamometer, adapter, specimen", "torque at the flange", takes=("torques on the specimen",)),
    ControllerBlock("Torque flange", "readings, once a sample", quantities=("torque_sensor_lag", "sample_time")),
)
