"""Orders of an engine in the step *Modes*: the Campbell diagram, and the torques that orders make in the shafts."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from typing import Any

import panel as pn

from matching.explore.elements import (
    PANE_STYLE,
    WIDE,
    Equivalent,
    EquivalentBox,
    heading,
    paragraph,
    report_frame,
    same,
)
from matching.explore.files import Workspace, write_model
from matching.explore.jobs import Ended, Runner, address_of
from modelling.errors import InputError

SPEEDS, ORDERS = "600:6000 1/min", "2,4,6"  # of a four-cylinder four-stroke engine
FIRST_TORQUE = "{}:2=100"  # N·m at order 2, of an input; a user replaces it


class OrdersView:
    """Campbell diagram and response of the model that ``role`` names."""

    def __init__(self, workspace: Workspace, role: Callable[[], str]):
        self.workspace, self._role = workspace, role
        self.speed = pn.widgets.TextInput(name="Speeds: lowest:highest unit", value=SPEEDS, width=230)
        self.orders = pn.widgets.TextInput(name="Orders of the diagram", value=ORDERS, width=180)
        self.torques = pn.widgets.TextInput(
            name="Torques in N·m: input:order=amplitude, more after a blank", styles={"flex": "1 1 380px"}
        )
        self.campbell = Runner("Campbell diagram", workspace.tasks, self._campbell_words, self._show("campbell"))
        self.response = Runner("Response to orders", workspace.tasks, self._response_words, self._show("response"))
        self.result = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        self.same = EquivalentBox(Equivalent("", ""))
        for field in (self.speed, self.orders, self.torques):
            field.param.watch(lambda _: self._name_commands(), "value")
        self.model_changed()

    def panel(self) -> Any:
        """Fields, buttons, report."""
        return pn.Column(
            heading("Orders"),
            paragraph("Which speeds are critical, and which torque do the shafts carry? An order is a swing that comes "
                      "so often a turn."),
            pn.FlexBox(self.speed, self.orders, self.torques, align_items="end"),
            pn.FlexBox(self.campbell.run, self.response.run),
            self.campbell.panel(), self.response.panel(), self.result, self.same, sizing_mode=WIDE,
        )  # fmt: skip

    def model_changed(self) -> None:
        """Offer the first torque of another model."""
        system = self.workspace.models[self._role()].system
        inputs = [part.name for part in system.inputs if part.name not in system.pedals]
        if self.torques.value.partition(":")[0] not in inputs:
            self.torques.value = FIRST_TORQUE.format(inputs[0]) if inputs else ""
        self._name_commands()

    def _name_commands(self) -> None:
        model, out = str(write_model(self.workspace, self._role())), self.workspace.out
        diagram = same("campbell", model, out=out / "campbell", speed=self.speed.value, orders=self.orders.value)
        forced = shlex.join(["rigmatch", *self._response(str(model))])
        self.same.set(Equivalent(f"{diagram.command}\n{forced}", diagram.python))

    def _campbell_words(self) -> list[str]:
        model, out = str(write_model(self.workspace, self._role())), str(self.workspace.out / "campbell")
        return ["campbell", model, "--speed", self.speed.value, "--orders", self.orders.value, "--out", out]

    def _response(self, model: str) -> list[str]:
        torques = [word for each in self.torques.value.split() for word in ("--torques", each)]
        return ["response", model, "--speed", self.speed.value, *torques, "--out", str(self.workspace.out / "response")]

    def _response_words(self) -> list[str]:
        if not self.torques.value.strip():
            raise InputError("torques", "are none", "write input:order=amplitude, e.g. engine_torque:2=100")
        return self._response(str(write_model(self.workspace, self._role())))

    def _show(self, command: str) -> Callable[[Ended], None]:
        def show(_: Ended) -> None:
            address = address_of(self.workspace.out / command / "report.html", self.workspace.out)
            self.result.object = report_frame("Orders", address=address)

        return show
