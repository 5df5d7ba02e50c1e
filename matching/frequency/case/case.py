"""A match as asked for: what is matched to what, by which loop, and which quantities may move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from matching.frequency.case.uncertainty import Box
from modelling.bed.loop import Loop
from modelling.bed.manoeuvres import Manoeuvre
from modelling.bed.residual_vehicle import ResidualVehicle
from modelling.bed.torque_curve import TorqueCurve
from modelling.common import display
from modelling.model.system import System

OBJECTIVES = ("response_error", "fidelity")  # what the feedback may be tuned by; each is a file of programme/objectives


@dataclass(frozen=True)
class Compared:
    """A transfer function that vehicle and rig are compared by: an input and a sensor both know by name."""

    input: str
    sensor: str


@dataclass(frozen=True)
class Target:
    """A vehicle mode the rig has to show: its number, and how far frequency (relative) and damping ratio may be off."""

    mode: int
    frequency_tolerance: float = 0.01
    damping_tolerance: float = 0.02


@dataclass(frozen=True)
class Move:
    """A quantity that may move.

    Attributes
    ----------
    name : str
        ``residual_vehicle.…``, ``rig.…`` or ``loop.…``.
    together : tuple of str
        The name itself and its mirror image, which moves with it.
    start, lower, upper : float
        In SI.
    unit : str
    planned : float
        Value, SI, from which a change is counted, wherever the search starts: the model's, or as the case states it.
    """

    name: str
    together: tuple[str, ...]
    start: float
    lower: float
    upper: float
    unit: str
    planned: float


@dataclass(frozen=True)
class Case:
    """A match as asked for; see ``examples/road_to_rig/case.toml`` for every key with a comment.

    Vehicle, rig and the parts of the residual vehicle carry the operating point, if the case states one.
    """

    vehicle: System
    rig: System
    residual_vehicle: ResidualVehicle
    loop: Loop
    targets: tuple[Target, ...]
    band: tuple[float, float]
    compared: tuple[Compared, ...]
    manoeuvre: Mapping[str, Manoeuvre]
    limits: Mapping[str, float]
    moves: tuple[Move, ...]
    title: str = ""
    path: str = field(default="", compare=False)
    objective: str = "response_error"
    uncertainty: Box = field(default_factory=Box)
    tolerance: float = 0.1  # largest response error to measured torques that is still called matched
    unmeasured_tolerance: float = 0.3  # the same to unmeasured torques
    torque_curve: TorqueCurve | None = None
    simple_vehicle: System | None = None  # the vehicle with a residual vehicle of the user's own, if the case has one
    notes: tuple[str, ...] = ()  # what was changed of the model files, as sentences

    @property
    def emulated_vehicle(self) -> System:
        """The vehicle that the controller emulates: with the user's residual vehicle where the case has one."""
        return self.vehicle if self.simple_vehicle is None else self.simple_vehicle

    def _repr_html_(self) -> str:
        return display.html(self)
