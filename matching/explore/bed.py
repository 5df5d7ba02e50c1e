"""The step *Bed*: check of the channels, rounds of recording and matching, verdict, on recordings of the bed."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import panel as pn

from matching.explore.elements import (
    PANE_STYLE,
    WIDE,
    Equivalent,
    EquivalentBox,
    heading,
    opening,
    report_frame,
    same,
)
from matching.explore.files import Workspace, write_case
from matching.explore.jobs import Ended, Runner, address_of
from matching.explore.recordings import RecordingsTab
from modelling.errors import InputError
from modelling.escape import html
from modelling.recordings.readers import READERS
from modelling.writing import write_all

STEPS = "bed"  # folder of its results
HANDED = "bed_recordings"  # folder that recordings are put into
ROUNDS = 3
EXCITATION = "_excitation"  # what the names of files of torques end in, beside the places of recordings
_FILES = re.compile(r"\d+_\w+/[\w.]+")  # of the steps, in what is to be recorded


class BedTab(RecordingsTab):
    """The way onto the bed with the open case."""

    recordings_named = "Recording of the bed"

    def __init__(self, workspace: Workspace):
        super().__init__(workspace, ["rig"])
        self.out, self.folder = workspace.out / STEPS, workspace.out / HANDED
        self._asked = ""  # name of the recording that the command asked for last
        self.fmu = pn.widgets.TextInput(name="FMU of the bed, by its path; empty: you record", width=340)
        self.rounds = pn.widgets.TextInput(name="Rounds at most", value=str(ROUNDS), width=140)
        self.go = Runner("Go on", workspace.tasks, self._words, self._show)
        self.wanted = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        self.verdict = pn.pane.HTML("<p>Nothing was run yet.</p>", sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        self.same = EquivalentBox(self._equivalent())
        for field in (self.fmu, self.rounds):
            field.param.watch(lambda _: self.same.set(self._equivalent()), "value")
        for path in sorted(self.folder.glob("*")):
            if path.suffix.lower() in READERS and not path.stem.endswith(EXCITATION):
                self.open(path)

    def panel(self) -> Any:
        """The step's content."""
        return pn.Column(
            opening(
                "Bed",
                "Check the channels at rest, prove the controller, then diagnose and match again until the bed answers "
                "as predicted. Go on says what to record; drop the recording, and press it again. It begins with the "
                "match that was run, else with a match of the case as shown.",
                self.go.run,
            ),
            pn.FlexBox(self.fmu, self.rounds, align_items="end"),
            self.go.panel(),
            self.wanted,
            heading("Verdict"),
            self.verdict,
            *self.recordings_panel(),
            self.signals,
            self.same,
            sizing_mode=WIDE,
        )

    def remember(self, path: Path) -> None:
        """Recordings of the bed stay in this step."""

    def take_dropped(self, name: str, content: bytes) -> None:
        """Put a recording where the next run looks for it, in place of one of another format."""
        if not self._asked:
            self.message.say("Nothing is to be recorded yet: press Go on, which says what to record", wrong=True)
            return
        target = self.folder / f"{self._asked}{Path(name).suffix.lower()}"
        write_all(self.folder, {target.name: content})
        for other in (self.folder / f"{self._asked}{suffix}" for suffix in READERS):
            if other != target:
                other.unlink(missing_ok=True)
        self.forget(target)
        if self.open(target):
            self.message.say(f"{Path(name).name} is taken as {target.name}; press Go on")

    def channels_changed(self) -> None:
        """Name the channel file in the command that is shown."""
        self.same.set(self._equivalent())

    def _case(self) -> str:
        """The match that was run, where it is one of the case as it is shown; else the case."""
        task = self.workspace.tasks.get("Run the match")
        done = task is not None and task.ended is not None and task.ended.answered
        if done and self.workspace.matched == self.workspace.texts:
            return str(self.workspace.out / "match")
        return str(write_case(self.workspace))

    def _bed(self) -> str:
        return self.fmu.value.strip() or str(self.folder)

    def _channels(self) -> dict[str, str]:
        """The channel file, where a recording calls its channels otherwise than the rig."""
        if self.file is None:
            return {}
        chosen = {name: (column.value, own.value) for name, (column, own) in self._choosers.items()}
        if all(column in ("", name) and own in ("", self.file.columns.get(column, own))
               for name, (column, own) in chosen.items()):  # fmt: skip
            return {}
        return {"channels": str(self.write_channels())}

    def _equivalent(self) -> Equivalent:
        rounds = int(self.rounds.value) if self.rounds.value.isdigit() else self.rounds.value
        try:
            channels = self._channels()
        except InputError as error:
            self.message.say(str(error), wrong=True)
            channels = {}
        return same("commission", self._case(), out=self.out, bed=self._bed(), rounds=rounds, **channels)

    def _words(self) -> list[str]:
        more = [word for name, value in self._channels().items() for word in (f"--{name}", value)]
        if not self.fmu.value.strip():
            self.folder.mkdir(parents=True, exist_ok=True)
        self.same.set(self._equivalent())
        return ["commission", self._case(), "--bed", self._bed(), "--rounds", self.rounds.value, *more, "--out",
                str(self.out)]  # fmt: skip

    def _show(self, ended: Ended) -> None:
        waiting = ended.result["waiting_for"] or ""
        place, _, what = waiting.partition(".csv: ")
        self._asked = Path(place).name
        self.wanted.object = self._to_record(what.partition("; then run")[0]) if waiting else ""
        address = address_of(self.out / "report.html", self.workspace.out)
        self.verdict.object = report_frame("Commissioning", address=address)

    def _to_record(self, what: str) -> str:
        """What to record next, with the files that it needs."""
        needed = [self.out / name for name in _FILES.findall(what)]
        needed += sorted(self.folder.glob(f"{self._asked}{EXCITATION}*"))
        links = "".join(
            f'<li><a href="{html(address_of(file, self.workspace.out))}" target="_blank">'
            f"{html(f'{file.parent.name}/{file.name}')}</a></li>"
            for file in needed
            if file.is_file()
        )
        return (
            f"<h2>Record next: {html(self._asked)}</h2><p>{html(what[:1].upper() + what[1:])}.</p><ul>{links}</ul>"
            "<p>Drop the recording below, and press Go on.</p>"
        )


def bed(workspace: Workspace, example: Callable[[], Any]) -> Any:
    """The step's content, also without a case."""
    if workspace.case is not None:
        return BedTab(workspace).panel()
    return pn.Column(opening("Bed", "Open a case under Files, or begin with the example.", example()), sizing_mode=WIDE)
