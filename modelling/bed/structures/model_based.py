"""Model-based feed-forward of measured torques, and the feedback of ``pi`` for everything else.

A model of rig and vehicle runs in the controller on the measured torques, is predicted across the dead time, and
commands what makes its interface follow the vehicle (:mod:`modelling.bed.feed_forward_design`). The feedback acts on
what the measurements deviate from that model by, so its poles, margins and its response to unmeasured torques are those
of ``pi``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from modelling.bed.blocks import ControllerBlock
from modelling.bed.feed_forward import FeedForward
from modelling.bed.feed_forward_design import design_feed_forward
from modelling.bed.loop import Loop
from modelling.bed.residual_vehicle import ResidualVehicle
from modelling.bed.structures.pi import BLOCKS, PI
from modelling.model.system import System

FEED_FORWARD = ControllerBlock(
    "Model of rig and vehicle, predicted across the dead time",
    "command; the feedback below acts on how far readings deviate from the model",
    takes=("measured torques",),
)


@dataclass(frozen=True)
class ModelBased(PI):
    """Feed-forward through a model of rig and vehicle, with the feedback of :class:`PI`."""

    name = "model_based"
    blocks = (FEED_FORWARD, *BLOCKS)
    has_feed_forward = True

    def gives_torque(self, values: Mapping[str, float]) -> bool:
        """Always: the feed-forward needs no gain."""
        return True

    def measured_inputs(self, measured: Sequence[str], simulated: Sequence[str]) -> tuple[str, ...]:
        """All that are measured; what acts inside the residual vehicle is computed by the controller itself."""
        return (*measured, *simulated)

    def feed_forward(self, rig: System, residual: ResidualVehicle, loop: Loop) -> FeedForward | None:
        """See :meth:`ControlStructure.feed_forward`."""
        return design_feed_forward(rig, residual, loop)
