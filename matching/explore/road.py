"""The step *Road*: recordings of the car tell the values of the case's vehicle, with intervals; on to *Match*."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import panel as pn

from matching.explore.elements import (
    PANE_STYLE,
    WIDE,
    Equivalent,
    EquivalentBox,
    Message,
    opening,
    plain_button,
    report_frame,
    same,
)
from matching.explore.files import ROLES, Workspace, within, write_case
from matching.explore.jobs import Ended, Runner, address_of
from matching.explore.recordings import RecordingsTab
from modelling.errors import InputError
from modelling.writing import write_all

IDENTIFIED = "identify"  # folder of its results
CASE_FILES = (".toml", ".csv")  # of them
OPTIONS = {"vehicle": "vehicle", "rig": "bed"}  # of the command, by the model that was recorded


class RoadTab(RecordingsTab):
    """Recordings of the open case's vehicle, or of its bed without emulation.

    Parameters
    ----------
    to_match : callable
        Called when the identified case is open.
    """

    def __init__(self, workspace: Workspace, to_match: Callable[[], None] = lambda: None):
        super().__init__(workspace, list(ROLES))
        self._to_match = to_match
        self.identify = Runner("Identify", workspace.tasks, self._words, self._show_identified)
        self.identified = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        self.case_as = pn.widgets.TextInput(name="Folder for the case with these values", width=340, visible=False)
        self.hand_over = plain_button("Go on to Match", visible=False)
        self.handed = Message()
        self.same = EquivalentBox(self._equivalent())
        self.hand_over.on_click(lambda _: self._hand_over())
        self.open_first()

    def panel(self) -> Any:
        """The step's content."""
        return pn.Column(
            opening(
                "Road",
                "Recordings of the car on the road, or of the bed without emulation: find the values of the case, each "
                "with its interval, and hand them to the match.",
                self.identify.run,
            ),
            self.identify.panel(),
            self.identified,
            pn.FlexBox(self.case_as, self.hand_over, align_items="end"),
            self.handed,
            *self.recordings_panel(),
            self.signals,
            self.same,
            sizing_mode=WIDE,
        )

    def channels_changed(self) -> None:
        """Write the channel file as chosen, so that the command shown finds it."""
        try:
            self.same.set(self._equivalent(str(self.write_channels())))
        except InputError as error:
            self.message.say(str(error), wrong=True)

    def _equivalent(self, channels: str = "") -> Equivalent:
        recorded = {OPTIONS[self.role.value]: [str(path) for path in self._used()] or ["RECORDING"]}
        case, out = str(write_case(self.workspace)), self.workspace.out / IDENTIFIED
        return same("identify", case, out=out, **recorded, channels=channels)

    def _words(self) -> list[str]:
        channels, out = self.write_channels(), str(self.workspace.out / IDENTIFIED)
        recorded = [f"--{OPTIONS[self.role.value]}", *(str(path) for path in self._used())]
        return ["identify", str(write_case(self.workspace)), *recorded, "--channels", str(channels), "--out", out]

    def _show_identified(self, _: Ended) -> None:
        address = address_of(self.workspace.out / IDENTIFIED / "report.html", self.workspace.out)
        self.identified.object = report_frame("Identification", address=address)
        taken = (f"identified{number or ''}" for number in itertools.count())
        free = next(name for name in taken if not (self.workspace.home / name).exists())
        self.case_as.param.update(value=free, visible=True)
        self.hand_over.visible = True

    def _hand_over(self) -> None:
        """Write the identified case into a folder of its own, open it, and go on to the step Match."""
        try:
            folder = within(self.workspace.home, self.case_as.value)
            if folder.exists():
                raise InputError(self.case_as.value, "exists", "name a new folder")
            found = self.workspace.out / IDENTIFIED
            write_all(folder, {file.name: file.read_bytes() for file in found.iterdir() if file.suffix in CASE_FILES})
            self.workspace.open(folder / "case.toml")
        except InputError as error:
            self.handed.say(str(error), wrong=True)
            return
        self._to_match()


def road(workspace: Workspace, to_match: Callable[[], None], example: Callable[[], Any]) -> Any:
    """The step's content, also without a case."""
    if workspace.case is not None:
        return RoadTab(workspace, to_match).panel()
    return pn.Column(
        opening("Road", "Open a case under Files, or begin with the example.", example()), sizing_mode=WIDE
    )
