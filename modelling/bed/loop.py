"""The control loop as data, and what a control structure has to answer.

Per dynamometer: measured flange torque → torque-sensor lag → residual vehicle → reference speed → controller →
dead time → inverter lag → air-gap torque on the rotor. What the controller does with these signals is its structure,
an object from one file of :mod:`modelling.bed.structures`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import scipy

from modelling.bed.blocks import ControllerBlock
from modelling.bed.feed_forward import FeedForward
from modelling.bed.observer_controller import ObserverController
from modelling.bed.residual_vehicle import ResidualVehicle
from modelling.linear.state_space import StateSpace
from modelling.model.system import System


@dataclass(frozen=True)
class LoopQuantity:
    """A quantity of the loop: SI unit, start value, physical bounds, what it is."""

    unit: str
    start: float
    lower: float
    upper: float
    meaning: str


HARDWARE = {
    "dead_time": LoopQuantity(
        "s", 0.003, 0.0, 0.2, "total dead time from sensor to air-gap torque: computing, bus, half a sample of hold"
    ),
    "inverter_lag": LoopQuantity("s", 0.002, 1e-5, 0.2, "first-order lag of the air-gap torque"),
    "torque_sensor_lag": LoopQuantity("s", 0.0005, 1e-6, 0.2, "first-order lag of the torque flange and its filter"),
    "sample_time": LoopQuantity("s", 0.001, 1e-5, 0.05, "sample time of the residual vehicle model and the controller"),
}


@dataclass(frozen=True)
class Dynamometer:
    """One dynamometer: the rig input it drives, its torque and speed sensors, the cut shaft whose outer end it is.

    ``torque_gain`` is its air-gap torque over its command as calibrated: commands are divided by it.
    """

    name: str
    torque_input: str
    torque_sensor: str
    speed_sensor: str
    follows: str
    torque_gain: float = 1.0


class ControlStructure(ABC):
    """What a controller does with the measured signals; k dynamometers, x states, r inputs of the residual vehicle.

    Structures have no state of their own: every method takes the values it works with.

    Attributes
    ----------
    name : str
        As case files write it under ``loop.structure``.
    quantities : dict of str to LoopQuantity
        What may be tuned of it.
    blocks : tuple of ControllerBlock
        The controller of one dynamometer; every one of ``quantities`` is entered in one of them.
    has_feed_forward : bool
        Whether :meth:`feed_forward` gives one.
    is_observer : bool
        Whether :meth:`observer` gives the whole controller; there is no law in the Laplace domain then.
    further_starts : tuple of dict
        Values of all quantities where a search may begin beside those of the case.
    """

    name: str
    quantities: Mapping[str, LoopQuantity]
    blocks: tuple[ControllerBlock, ...] = ()
    has_feed_forward: bool = False
    is_observer: bool = False
    further_starts: tuple[Mapping[str, float], ...] = ()

    @abstractmethod
    def gives_torque(self, values: Mapping[str, float]) -> bool:
        """Whether the dynamometers ever give torque at these values."""

    def integrators(self, values: Mapping[str, float]) -> int:
        """Poles at s = 0 that the feedback law of one dynamometer has at these values."""
        return 0

    @abstractmethod
    def measured_inputs(self, measured: Sequence[str], simulated: Sequence[str]) -> tuple[str, ...]:
        """Torque inputs that the feed-forward takes as measured.

        Parameters
        ----------
        measured : sequence of str
            Inputs of the rig whose torque is measured.
        simulated : sequence of str
            Inputs of the residual vehicle, whose torque the controller itself computes.
        """

    def commands(
        self, values: Mapping[str, Any], s: Any, reference: Sequence[Any], speeds: Sequence[Any], torques: Sequence[Any]
    ) -> list[Any]:
        """Feedback law in the Laplace domain: the torque command of each dynamometer (k), before the dead time.

        Numbers may be NumPy arrays or CasADi expressions
        (:class:`modelling.equations.complex_sx.Complex`), of any one shape.

        Parameters
        ----------
        values : mapping
            Of :attr:`quantities`, SI.
        s : complex
            rad/s.
        reference, speeds, torques : sequence (k)
            Reference speed, rotor speed (rad/s) and lagged flange torque in the direction that drives the rotor (N·m).
        """
        raise NotImplementedError(f"{self.name} runs from sample to sample only")

    def controller(self, loop: Loop, residual: StateSpace, rig: System) -> StateSpace:
        """The same feedback law in continuous time, residual vehicle included.

        Parameters
        ----------
        residual : StateSpace
            All of the residual vehicle: inputs [interface torques (k), its own inputs (r)], outputs reference speeds
            (k), in the order of the dynamometers.
        rig : System
            As the controller believes it to be.

        Returns
        -------
        StateSpace
            Inputs [flange torques (k), rotor speeds (k), inputs of the residual vehicle (r)], outputs commands (k).
        """
        raise NotImplementedError(f"{self.name} runs from sample to sample only")

    def sampled(self, loop: Loop, residual: StateSpace, rig: System) -> StateSpace:
        """The feedback law as it runs, from sample to sample: :meth:`controller` by Tustin's rule unless overridden."""
        continuous = self.controller(loop, residual, rig)
        A, B, C, D, _ = scipy.signal.cont2discrete(
            (continuous.A, continuous.B, continuous.C, continuous.D), loop["sample_time"], "bilinear"
        )
        return StateSpace(A, B, C, D, continuous.inputs, continuous.outputs)

    def feed_forward(self, rig: System, residual: ResidualVehicle, loop: Loop) -> FeedForward | None:
        """The model-based feed-forward of measured torques, which has poles of its own; None where there is none.

        Parameters
        ----------
        residual : ResidualVehicle
            As cut out of the vehicle: the reference, not what was tuned for the feedback.

        Raises
        ------
        InputError
            If there is no stabilising solution.
        """
        return None

    def observer(self, rig: System, residual: ResidualVehicle, loop: Loop) -> ObserverController | None:
        """The whole controller where it is an observer with state feedback; None for feedback laws.

        Parameters
        ----------
        residual : ResidualVehicle
            As cut out of the vehicle.

        Raises
        ------
        InputError
            If a model cannot be made linear or a Riccati equation has no stabilising solution.
        """
        return None


@dataclass(frozen=True)
class Loop:
    """Structure, dynamometers, measured rig inputs, and values of :data:`HARDWARE` and the structure's quantities (SI).

    ``measured`` are the inputs of the rig whose torque is measured, or known as a demand, and reaches the controller;
    ``further_sensors`` those of the rig that reach it beside the dynamometers' own.
    """

    structure: ControlStructure
    dynamometers: tuple[Dynamometer, ...]
    measured: tuple[str, ...]
    values: Mapping[str, float]
    further_sensors: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    @property
    def controller_sensors(self) -> tuple[str, ...]:
        """Sensors that reach the controller: the dynamometers' torques, their speeds, then further ones."""
        torques = [dynamometer.torque_sensor for dynamometer in self.dynamometers]
        return (*torques, *(dynamometer.speed_sensor for dynamometer in self.dynamometers), *self.further_sensors)

    @property
    def quantities(self) -> dict[str, LoopQuantity]:
        """Every quantity of the loop by name: hardware, then the structure's."""
        return {**HARDWARE, **self.structure.quantities}

    @property
    def torqueless(self) -> bool:
        """Whether the dynamometers never give torque."""
        return not self.structure.gives_torque(self.values)

    def command_delay(self, dead_time: float | None = None) -> float:
        """From a sample to the moment its command begins to act, s, not below 0.

        A command that is held for a sample lags half of it, which the dead time (s, the loop's unless given) counts.
        """
        return max((self["dead_time"] if dead_time is None else dead_time) - self["sample_time"] / 2, 0.0)

    def with_values(self, values: Mapping[str, float]) -> Loop:
        """The same loop with some values changed by name."""
        return replace(self, values={**self.values, **values})
