"""The page's server: on this machine only, with a secret in the address."""

from __future__ import annotations

import asyncio
import json
import re
import secrets
import webbrowser
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import NamedTemporaryFile
from threading import Event, Thread
from typing import Any

import numpy as np
import panel as pn
import panel_material_ui as pmui
from bokeh.events import Tap
from bokeh.models import ColorBar, ColumnDataSource, HoverTool, LogColorMapper
from bokeh.settings import settings
from panel.io.server import get_server
from tornado.web import OutputTransform, RequestHandler

from matching.explore import elements
from matching.explore.bed import bed
from matching.explore.elements import (
    KEYS_IN_WORDS,
    PANE_STYLE,
    WIDE,
    Alive,
    Equivalent,
    EquivalentBox,
    Message,
    StepBar,
    beside,
    heading,
    offer,
    opening,
    paragraph,
    plain_button,
    plain_figure,
    report_frame,
    same,
    strong,
)
from matching.explore.fields import Editing, Entry, lay_out
from matching.explore.files import (
    EMPTY,
    TEMPLATES,
    CaseForm,
    Document,
    Field,
    Keys,
    Workspace,
    case_path,
    case_tables,
    fields,
    listed,
    new_file,
    number_or_text,
    save_as,
    set_field,
    write_case,
    write_case_at,
)
from matching.explore.jobs import RESULTS, TICK_MS, Ended, Runner, address_of
from matching.explore.live import grid, interpolated_error, nearest_point
from matching.explore.measurement import measurement_tab
from matching.explore.modes import DrivetrainTab, ModesTab
from matching.explore.road import road
from matching.fidelity import fidelity_from_tables, xil_fidelity
from matching.match.case import Case
from matching.match.map import axis, quantities
from matching.report import order_sheet
from matching.report.common import component, number, practical, spaced, unit
from matching.report.match import PEAK_UNITS, answer
from matching.uncertainty.budget import budget_from_tables
from matching.uncertainty.evaluate import evaluate
from modelling import escape
from modelling.bed.controllers import STRUCTURES
from modelling.bed.manoeuvres import UNITS as MANOEUVRE_UNITS
from modelling.bed.profile import UNITS as DRIVER_UNITS
from modelling.display import counted, files
from modelling.errors import InputError
from modelling.escape import html
from modelling.units import to_si

# --- A map of the response error over two quantities: click a point, ask between points, have one computed exactly.

PALETTE = "Cividis256"  # read alike by colour-blind readers and in grey
POINTS = 4  # an axis, to begin with


class MapView:
    """Run a map and ask it; ``case`` gives the case as it is, ``write_at`` writes it with quantities held."""

    def __init__(self, workspace: Workspace, case: Callable[[], Case], write_at: Callable[[dict[str, float]], str]):
        self.workspace, self._case, self._write_at = workspace, case, write_at
        self.out, self.content = workspace.out / "map", dict[str, Any]()
        names = {component(name): name for name in quantities(case())}
        self.x = pn.widgets.Select(name="First quantity", options=names, value="loop.dead_time", width=300)
        self.y = pn.widgets.Select(name="Second quantity", options=names, value="loop.inverter_lag", width=300)
        self.points = pn.widgets.TextInput(name="Values of each", value=str(POINTS), width=140)
        self.figure = pn.Column(sizing_mode=WIDE)
        self.at_x, self.at_y = pn.widgets.TextInput(width=200), pn.widgets.TextInput(width=200)
        self.answer, self.message = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE]), Message()
        self.ask = plain_button("Answer from the map")
        self.runner = Runner("Run the map", workspace.tasks, self._words, self._show)
        self.exactly = Runner("Compute exactly", workspace.tasks, self._exact_words, self._show_exactly)
        self.ask.on_click(lambda _: self._ask())
        self.questions = pn.Column(sizing_mode=WIDE)
        self.same = EquivalentBox(self._equivalent())
        for chooser in (self.x, self.y, self.points):
            chooser.param.watch(lambda _: self.refresh(), "value")

    def panel(self) -> Any:
        """Form, figure and questions."""
        return pn.Column(
            heading("Map: what if …"),
            paragraph("The response error that a match reaches over two quantities, each point a match of its own."),
            pn.FlexBox(self.x, self.y, self.points),
            self.runner.panel(),
            self.figure,
            self.questions,
            self.same,
            sizing_mode=WIDE,
        )

    def refresh(self) -> None:
        """Name the files as the case is shown now."""
        self.same.set(self._equivalent())

    def _words(self) -> list[str]:
        x, y = (f"{name}{self._range(name)}" for name in (self.x.value, self.y.value))
        path = self._write_at({})
        return ["map", path, "--x", x, "--y", y, "--starts", "1", "--out", str(self.out)]

    def _range(self, name: str) -> str:
        low, high = _usual_range(self._case(), name)
        return f"={low:.6g}:{high:.6g}:{self.points.value}"

    def _equivalent(self) -> Equivalent:
        x, y = (f"{name}{self._range(name)}" for name in (self.x.value, self.y.value))
        return same("map", str(case_path(self.workspace)), out=self.out, x=x, y=y)

    def _show(self, ended: Ended) -> None:
        self.show_map(ended.result)

    def show_map(self, content: dict[str, Any]) -> None:
        """Draw a map from the content of ``map.json``."""
        self.content = json.loads(json.dumps(content))
        x, y, errors = grid(content)
        places = [(i, j) for j in range(len(y)) for i in range(len(x))]
        points = content["points"]
        source = ColumnDataSource({
            "i": [i for i, _ in places], "j": [j for _, j in places], "x": [x[i] for i, _ in places],
            "y": [y[j] for _, j in places], "error": errors.ravel(), "status": [point["status"] for point in points],
        })  # fmt: skip
        names = [f"{component(content[key]['name'])} [{content[key]['unit']}]" for key in ("x", "y")]
        fig = plain_figure("Response error", *names)
        for scale, values in ((fig.xaxis, x), (fig.yaxis, y)):
            scale.ticker = list(range(len(values)))
            scale.major_label_overrides = {place: number(value, 3) for place, value in enumerate(values)}
        known = errors[np.isfinite(errors)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.1, 1.0)
        colours = LogColorMapper(palette=PALETTE, low=low, high=max(high, low * 1.01), nan_color="#ffffff")
        cells = fig.rect(
            "i", "j", 1, 1, source=source, fill_color={"field": "error", "transform": colours}, line_color="#ffffff"
        )
        fig.add_layout(ColorBar(color_mapper=colours, title="error"), "right")
        tips = [(names[0], "@x{0.0000}"), (names[1], "@y{0.0000}"), ("error", "@error{0.0000}"), ("", "@status")]
        fig.add_tools(HoverTool(renderers=[cells], tooltips=tips))
        fig.on_event(Tap, lambda event: self._tapped(event.x, event.y))
        self.figure[:] = [pn.pane.Bokeh(fig, sizing_mode=WIDE)]
        for field, key, label in ((self.at_x, "x", names[0]), (self.at_y, "y", names[1])):
            if field.name != label:  # else what was asked last stays
                field.param.update(name=label, value=number(content[key]["value_in_case"], 6))
        self.questions[:] = [
            pn.FlexBox(self.at_x, self.at_y, self.ask), self.message, self.answer, self.exactly.panel()
        ]  # fmt: skip

    def _tapped(self, i: float, j: float) -> None:
        x, y = self.content["x"]["values"], self.content["y"]["values"]
        if -0.5 <= i <= len(x) - 0.5 and -0.5 <= j <= len(y) - 0.5:
            self.at_x.value, self.at_y.value = number(x[round(i)], 6), number(y[round(j)], 6)
            self._ask()

    def _asked(self) -> tuple[float, float]:
        x, y = (
            to_si(number_or_text(field.value), self.content[key]["unit"], component(self.content[key]["name"]))
            for field, key in ((self.at_x, "x"), (self.at_y, "y"))
        )
        return x, y

    def _ask(self) -> None:
        try:
            x, y = self._asked()
            error = interpolated_error(self.content, x, y)
        except InputError as fault:
            self.message.say(str(fault), wrong=True)
            return
        near = nearest_point(self.content, x, y)
        limits = "".join(f"<li>{html(limit)}</li>" for limit in near["limits"][:3])
        self.message.say(f"From the map: response error about {number(error, 2)}")
        self.answer.object = f"<p>The nearest point is {html(near['status'])}.</p><ul>{limits}</ul>"

    def _exact_words(self) -> list[str]:
        x, y = self._asked()
        names = self.content["x"]["name"], self.content["y"]["name"]
        path = self._write_at(dict(zip(names, (x, y), strict=True)))
        return ["match", path, "--out", str(self.workspace.out / "what_if" / "match")]

    def _show_exactly(self, ended: Ended) -> None:
        error = ended.result["response_error"]["after"]
        self.answer.object = f"<p>Exactly: response error {number(error, 3)}. {html(answer(ended.result))}</p>"


def _usual_range(case: Case, name: str) -> tuple[float, float]:
    values = axis(case, name).values
    return values[0], values[-1]


# --- The tab *Match*: the case as a form, a run with progress, results, and a map that answers what-if questions.

STARTS = 4
TITLES = {
    "move": "What may move (bounds)", "loop": "Loop", "limits": "Limits", "response": "Compared responses",
    "targets": "Target modes", "manoeuvre": "Manoeuvre", "operating_point": "Operating point",
    "operating_range": "Range of speeds", "drives": "Drive that judges it",
    "uncertainty": "What is not known exactly",
}  # fmt: skip
DRIVE = "drives "  # and its number from 0: the name of its card
RANGE_UNITS = {"vehicle_speed": "m/s", "rolling_radius": "m"}
PAIRS = {"max-width": "690px"}  # two fields: lower and upper bound beside each other
CHOICES: dict[Keys, tuple[str, ...]] = {("loop", "structure"): tuple(STRUCTURES)}
OPEN = ("move", "loop")  # tables that are shown unfolded


class MatchTab:
    """The open case; ``rig_changed`` is called when values were taken into the rig."""

    def __init__(self, workspace: Workspace, document: Any, rig_changed: Callable[[], None]):
        self.workspace, self._rig_changed = workspace, rig_changed
        self._ordered: dict[str, float] = {}  # of the match that is shown, SI
        self.form = CaseForm(document, partial(case_tables, workspace))
        self.editing = Editing(self._enter, self.form.undo, self.form.redo, lambda: [document], self.refresh, width=320)
        self.tables, self._cards, self._plans = pn.Column(sizing_mode=WIDE), dict[str, Any](), dict[str, Any]()
        self.added = pn.widgets.Select(name="Let another quantity move", width=340)
        self.held = pn.widgets.Select(name="Hold a quantity that moves", width=340)
        self.add, self.hold = (plain_button(name) for name in ("Add", "Hold"))
        self.limit = pn.widgets.Select(name="State another limit", width=340)
        self.limit_text = pn.widgets.TextInput(name="at most, or at least for a margin", width=220)
        self.state = plain_button("State")
        self.take = plain_button("Take the order into the rig", visible=False)
        self.export = Runner("Export the controller", workspace.tasks, self._export_words, self._show_export)
        self.excite = Runner("Plan the excitation", workspace.tasks, self._excite_words, self._show_excitation)
        self.links = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        self.way_on = pn.Column(
            pn.FlexBox(self.take, self.export.run, self.excite.run),
            *(each.panel() for each in (self.export, self.excite)), self.links,
            visible=False, sizing_mode=WIDE,
        )  # fmt: skip
        self.starts = pn.widgets.TextInput(name="Starting points", value=str(STARTS), width=140)
        self.seed = pn.widgets.TextInput(name="Seed", value="0", width=140)
        self.out = workspace.out / "match"
        self.result = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        self.runner = Runner("Run the match", workspace.tasks, self._words, self._show)
        self.same = EquivalentBox(self._equivalent())
        self.map = MapView(workspace, lambda: self.form.case, self._write_at)
        self.add.on_click(lambda _: self.editing.do(self._add))
        self.hold.on_click(lambda _: self.editing.do(self._hold))
        self.state.on_click(lambda _: self.editing.do(self._state))
        self.take.on_click(lambda _: self.editing.do(self._take))
        for number in (self.starts, self.seed):
            number.param.watch(lambda _: self.same.set(self._equivalent()), "value")
        self.unsaved = paragraph("")
        self.refresh()

    def panel(self) -> Any:
        """The tab's content."""
        return pn.Column(
            opening(
                "Match",
                "Tunes controller, residual vehicle and adapters until the rig answers like the vehicle. A run "
                "takes the values as they are shown below, saved or not.",
                self.runner.run,
            ),
            self.runner.panel(),
            self.result,
            self.way_on,
            heading("Case"),
            pn.FlexBox(self.starts, self.seed, self.editing.buttons(), align_items="end"),
            self.unsaved,
            self.editing.message,
            self.tables,
            pn.FlexBox(self.added, self.add, self.held, self.hold, align_items="end"),
            pn.FlexBox(self.limit, self.limit_text, self.state, align_items="end"),
            self.same,
            self.map.panel(),
            sizing_mode=WIDE,
        )

    def refresh(self) -> None:
        """Show the form as the case is; fields and tables that are there stay."""
        by_table = self.form.fields
        by_table["move"] = sorted(by_table.get("move", ()), key=_adapters_first)
        shown = [(_card_of(field), field) for table in TITLES for field in by_table.get(table, ())]
        members: dict[str, list[Any]] = {}
        widgets = self.editing.entries.show(self._entry(field) for _, field in shown)
        begun = set[str]()
        for (table, field), widget in zip(shown, widgets, strict=True):
            inside = members.setdefault(table, [])
            if table == "move" and (name := str(field.keys[1])) not in begun:
                begun.add(name)
                inside.append(self._plan(name))
            inside.append(widget)
        for table in members.keys() - self._cards.keys():
            self._cards[table] = pn.Card(
                pn.FlexBox(styles=PAIRS if table == "move" else {}),
                header=strong(self._title(table)),
                collapsed=table not in OPEN,
                sizing_mode=WIDE,
                margin=(4, 5),
            )
        for table, inside in members.items():
            lay_out(self._cards[table][0], inside)
            if table.startswith(DRIVE):  # its title may have been changed
                self._cards[table].header = strong(self._title(table))
        lay_out(self.tables, [self._cards[table] for table in members])
        for chooser, names in ((self.added, self.form.addable), (self.held, [m.name for m in self.form.case.moves])):
            offer(chooser, {component(name) + f" ({name.partition('.')[0]})": name for name in names})
        offer(
            self.limit,
            {f"{spaced(key.replace('.', ' '))} [{unit(si) or '1'}]": key for key, si in self.form.statable.items()},
        )
        changes = self.form.document.unsaved
        self.unsaved.object = f"<p>{counted(changes, 'change')}, not saved.</p>" if changes else ""
        self.same.set(self._equivalent())
        self.map.refresh()
        if self.result.object and self.workspace.texts != self.workspace.matched:
            self.runner.message.say("The report is of the case before the last change")

    def _plan(self, name: str) -> Any:
        """A line above the bounds of a quantity: its planned value between them."""
        move = next(one for one in self.form.case.moves if one.name == name)
        words = f"{component(name)}: planned {practical(move.planned, move.unit)}"
        if not move.lower < move.planned < move.upper:
            words += ", at a bound"
        if name not in self._plans:
            self._plans[name] = paragraph("")
        self._plans[name].object = f"<p><b>{html(words)}</b></p>"
        return self._plans[name]

    def models_changed(self) -> None:
        """Follow changes of the models in other tabs."""
        self.editing.do(self._read_again)

    def _read_again(self) -> str:
        self.form.read_again()
        return ""

    def _add(self) -> str:
        self.form.move(self.added.value)
        return self._changed_words()

    def _hold(self) -> str:
        self.form.hold(self.held.value)
        return self._changed_words()

    def _state(self) -> str:
        key = self.limit.value
        self.form.limit(key, self.limit_text.value)
        return f"{component(key)} is limited to {self.limit_text.value}. {self._changed_words()}"

    def _take(self) -> str:
        rig = self.workspace.models["rig"]
        known = rig.system.parameters | rig.system.dimensions
        ordered = {name: value for name, value in self._ordered.items() if name in known}
        for name, value in ordered.items():
            rig.set_value(name, value)
        self._rig_changed()
        self.form.read_again()
        names = "; ".join(map(component, ordered))
        return f"Taken into {rig.path.name}, not saved yet: {names}. Save it in the tab Drivetrain"

    def _changed_words(self) -> str:
        return "Changed; not saved yet" if self.form.document.changed else "As in the file"

    def _title(self, card: str) -> str:
        if not card.startswith(DRIVE):
            return TITLES[card]
        number = int(card.removeprefix(DRIVE))
        drive = self.form.document.content["drives"][number]
        return f"{TITLES['drives']}: {drive.get('title', f'drive {number + 1}')}"

    def _entry(self, field: Field) -> Entry:
        above = field.table.split()[1 + (field.keys[0] == "drives") :]  # a drive's number is the title of its card
        label = " ".join((*above, field.key)).replace("_", " ")
        if field.keys[0] == "move":
            name = str(field.keys[1])
            label = f"{component(name)}, {field.key} [{unit(quantities(self.form.case)[name][1]) or '1'}]"
        elif si := self._unit(field):
            label += f" [{unit(si)}]"
        return Entry(field.keys, label, field.text, CHOICES.get(field.keys, ()))

    def _unit(self, field: Field) -> str:
        """SI unit of a value of loop, limits or manoeuvre that is written without one; empty where there is none."""
        known = {
            "loop": {name: knob.unit for name, knob in self.form.case.loop.quantities.items()},
            "manoeuvre": MANOEUVRE_UNITS,
            "drives": {**MANOEUVRE_UNITS, **DRIVER_UNITS, **RANGE_UNITS},
            "operating_range": RANGE_UNITS,
            "response": {"band": "Hz"},
            "limits": PEAK_UNITS,
        }.get(str(field.keys[0]), {})
        key = field.key.partition(",")[0]
        key = re.split(r"[._](?=[a-z]+$)", key)[-1] if field.keys[0] == "limits" else key
        written = field.text.strip().partition(" ")[2]  # such as "1 deg"
        return "" if written or known.get(key) == "1" else known.get(key, "")

    def _enter(self, keys: Keys, text: str) -> str:
        self.form.set(keys, text)
        field = next(each for own in self.form.fields.values() for each in own if each.keys == keys)
        return f"{self._entry(field).label.partition(' [')[0]} is {text}. {self._changed_words()}"

    def _equivalent(self) -> Equivalent:
        starts, seed = (
            int(field.value) if field.value.isdigit() else field.value for field in (self.starts, self.seed)
        )
        return same("match", str(write_case(self.workspace)), out=self.out, starts=starts, seed=seed)

    def _words(self) -> list[str]:
        self.editing.all_taken()
        self.workspace.matched = self.workspace.texts
        more = ["--starts", self.starts.value, "--seed", self.seed.value, "--out", str(self.out)]
        return ["match", str(write_case(self.workspace)), *more]

    def _show(self, ended: Ended) -> None:
        self.result.object = report_frame("Report", address=address_of(self.out / "report.html", self.workspace.out))
        self._ordered = {trade["name"].removeprefix("rig."): trade["ordered"] for trade in ended.result["adapters"]}
        self.take.visible, self.way_on.visible = bool(self._ordered), True
        self.links.object = ""
        if (sheet := self.out / order_sheet.FILE).is_file():
            self._link(sheet, "Order sheet for the workshop")

    def _export_words(self) -> list[str]:
        return ["export", str(self.out), "--controller", str(self.workspace.out / "controller.fmu")]

    def _excite_words(self) -> list[str]:
        return ["excite", str(self.out), "--out", str(self.workspace.out / "excite")]

    def _show_export(self, ended: Ended) -> None:
        self._link(self.workspace.out / "controller.fmu", "The controller as FMU, with its C sources")

    def _show_excitation(self, ended: Ended) -> None:
        self._link(self.workspace.out / "excite" / "excitation.csv", "The torques to play on the bed")

    def _link(self, file: Path, words: str) -> None:
        link = f'<p><a href="{html(address_of(file, self.workspace.out))}" target="_blank">{html(words)}</a></p>'
        self.links.object = (self.links.object or "") + link

    def _write_at(self, values: dict[str, float]) -> str:
        self.editing.all_taken()
        if not values:
            return str(write_case(self.workspace))
        return str(write_case_at(self.form.case, values, self.workspace.out / "what_if" / "case"))


def _card_of(field: Field) -> str:
    """The card of a field: that of its table, or that of its drive."""
    return f"{DRIVE}{field.keys[1]}" if field.keys[0] == "drives" else str(field.keys[0])


def _adapters_first(field: Field) -> int:
    """The order in which a designer decides: hardware, then the emulated vehicle, then gains."""
    return ("rig", "residual_vehicle", "loop").index(str(field.keys[1]).partition(".")[0])


def without_case(example: Callable[[], Any]) -> Any:
    """The tab's content where no case is open."""
    return pn.Column(
        opening("Match", "Open a case under Files, or begin with the example.", example()), sizing_mode=WIDE
    )


# --- The tab *Validity*: an uncertainty budget and a fidelity case as tables that can be edited, with their figures.

DRAWS, SEED = 20_000, 1  # of the fidelity's uncertainty, as its command has them
BUDGET_DRAWS = 200_000  # 10⁴/(1 − 0.95) (JCGM 101, 7.2.2); to decide a check as well takes many seconds


class EditedTable:
    """A file as a table of fields, with what follows from it.

    Parameters
    ----------
    judge : callable
        The report (HTML) of what follows from the file's content.
    """

    def __init__(self, title: str, document: Document, same: Equivalent, judge: Callable[[dict[str, Any]], str]):
        self.title, self.document, self._judge = title, document, judge
        self.editing = Editing(self._enter, document.undo, document.redo, lambda: [document], self.refresh, width=230)
        self.rows, self._boxes = pn.Column(sizing_mode=WIDE), dict[str, Any]()
        self.answer = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        self.same = EquivalentBox(same)
        self._content: dict[str, Any] = {}  # what was judged last
        self._judged = ""
        self.editing.do(lambda: "")

    def panel(self) -> Any:
        """Fields, answer, command."""
        fields = [self.rows, self.editing.message, self.editing.buttons()]
        return pn.Column(heading(self.title), beside([self.answer], fields), self.same, sizing_mode=WIDE)

    def refresh(self) -> None:
        """Show the file as it is, and what follows from it."""
        self.answer.object = report_frame(self.title, page=self._judged_once(self.document.content))
        form = fields(self.document)
        by_table: dict[str, list[Any]] = {}
        for field, widget in zip(form, self.editing.entries.show(map(_entry, form)), strict=True):
            by_table.setdefault(field.table, []).append(widget)
        boxes = {name: self._boxes.get(name) or pn.FlexBox() for name in by_table}
        self._boxes = boxes
        for name, members in by_table.items():
            lay_out(boxes[name], members)
        lay_out(self.rows, list(boxes.values()))

    def _enter(self, keys: Keys, text: str) -> str:
        set_field(self.document, keys, text, self._judged_once)
        name = _entry(next(each for each in fields(self.document) if each.keys == keys)).label
        return f"{name} is {text}. {'Changed; not saved yet' if self.document.changed else 'As in the file'}"

    def _judged_once(self, content: dict[str, Any]) -> str:
        """The report; judging takes a second, and entering and showing both ask."""
        if content != self._content:
            self._judged = self._judge(content)
            self._content = content
        return self._judged


def _entry(field: Field) -> Entry:
    words = KEYS_IN_WORDS.get(field.key, spaced(field.key))
    label = f"{spaced(field.table.rpartition(' ')[2])} {words}".strip()
    return Entry(field.keys, label, field.text)


def _page_of(result: Any) -> str:
    *_, others = files(result, "")
    return next(str(text) for name, text in others.items() if name.endswith(".html"))


def validity(workspace: Workspace, example: Callable[[], Any]) -> Any:
    """The tab's content."""
    lead = "How far a result can be trusted: measurement uncertainty (GUM) and fidelity of the bed (XiL)."
    parts = [opening("Validity", lead, *([] if workspace.budget or workspace.fidelity else [example()]))]
    if workspace.budget is not None:
        path = workspace.budget.path

        def judge_budget(content: dict[str, Any]) -> str:
            return _page_of(evaluate(budget_from_tables(content, str(path)), draws=BUDGET_DRAWS))

        command = same("uncertainty", str(path), out=workspace.out / "uncertainty", draws=BUDGET_DRAWS)
        parts.append(EditedTable("Uncertainty budget", workspace.budget, command, judge_budget).panel())
    if workspace.fidelity is not None:
        case = workspace.fidelity.path

        def judge_fidelity(content: dict[str, Any]) -> str:
            return _page_of(xil_fidelity(*fidelity_from_tables(content, case), DRAWS, SEED))

        command = same("fidelity", str(case), out=workspace.out / "fidelity")
        parts.append(EditedTable("XiL fidelity", workspace.fidelity, command, judge_fidelity).panel())
    if len(parts) == 1:
        parts.append(paragraph("Open a budget or a fidelity case under Files, or begin with the example."))
    return pn.Column(*parts, sizing_mode=WIDE)


# --- The line above the tabs: new files, files to open, copies.


class FilesBar:
    """Files of the folder that the page was started in; ``opened`` is called when another file is open, with the step
    that stays open (empty: the first)."""

    def __init__(self, workspace: Workspace, opened: Callable[[str], None]):
        self.workspace, self._opened = workspace, opened
        self.file = pn.widgets.Select(name="File of this folder", options=listed(workspace.home), width=225)
        self.kind = pn.widgets.Select(name="Kind", options=[*TEMPLATES, EMPTY], width=225)
        self.name = pn.widgets.TextInput(name="Name in this folder", width=225)
        self.open, self.new, self.copy = (plain_button(name) for name in ("Open", "New", "Save as"))
        self.message = Message()
        self.open.on_click(lambda _: self._do(lambda: self.workspace.home / self.file.value))
        self.new.on_click(lambda _: self._do(lambda: new_file(workspace.home, self.kind.value, self.name.value)))
        self.copy.on_click(lambda _: self._do(lambda: save_as(workspace, self.kind.value, self.name.value)))

    def panel(self) -> Any:
        """What is open, and the fields."""
        names = [document.path.name for document in self.workspace.documents]
        names += [path.name for path in self.workspace.recordings]
        fields = pn.Card(
            self.file, self.open, self.kind, self.name, pn.FlexBox(self.new, self.copy), self.message,
            header=strong("Open, make or copy a file"), collapsed=bool(names), sizing_mode=WIDE, margin=(4, 0),
        )  # fmt: skip
        return pn.Column(heading("Files"), paragraph(", ".join(names) or "none is open"), fields, sizing_mode=WIDE)

    def example(self, kind: str, step: str) -> Any:
        """A button that opens the example of a kind, a new file of this folder; the step stays open."""
        button = pn.widgets.Button(name="Open the example", button_type="primary", width=190)
        button.on_click(lambda _: self._do(lambda: self._example(kind), step))
        return button

    def _example(self, kind: str) -> Path:
        name = f"example_{kind.replace(' ', '_')}"
        there = (self.workspace.home / name / TEMPLATES[kind], self.workspace.home / f"{name}.toml")
        return next((path for path in there if path.is_file()), None) or new_file(self.workspace.home, kind, name)

    def _do(self, make: Callable[[], Path], step: str = "") -> None:
        try:
            self.workspace.open(make())
        except InputError as error:
            self.message.say(str(error), wrong=True)
            return
        self._opened(step)


# --- Server

HOST = "127.0.0.1"
TOKEN_BYTES = 24
BEGIN_SECONDS = 60.0  # at most, until the page can be opened
FRAME_PX = 900  # height in a notebook
SIDEBAR_PX = 290
LOOK = {
    "palette": {"primary": {"main": "#00598c"}},
    "typography": {"fontFamily": "system-ui, 'Segoe UI', Arial, sans-serif"},
}
TASKS = {
    "Modes": ("Campbell diagram", "Response to orders"),
    "Road": ("Identify",),
    "Match": ("Run the match", "Run the map", "Compute exactly"),
    "Bed": ("Go on",),
    "Measurement": ("Diagnose", "Simulate"),
}
SHOWN_FIRST_MS = 30  # until the browser has drawn that a tab is being prepared


class NoContent(RequestHandler):
    """Browsers ask for an icon; there is none. The page asks whether the program is alive; it is."""

    def get(self) -> None:
        """No content."""
        self.set_status(204)


class SafeHeaders(OutputTransform):
    """Nothing is loaded from elsewhere, nothing is sent there, and nobody learns the address with its secret."""

    # Bokeh makes functions of texts, Panel scripts of blobs, and styles stand in the page
    POLICY = (
        "default-src 'self'; script-src 'self' blob: 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self' blob: ws://{host}; object-src 'none'; "
        "base-uri 'self'; form-action 'self'"
    )

    def __init__(self, request: Any):
        super().__init__(request)
        self._host = request.host

    def transform_first_chunk(self, status_code: int, headers: Any, chunk: bytes, finishing: bool) -> Any:
        """The answer with the headers."""
        headers["Content-Security-Policy"] = self.POLICY.format(host=self._host)
        headers["Referrer-Policy"] = "no-referrer"
        headers["X-Content-Type-Options"] = "nosniff"
        return super().transform_first_chunk(status_code, headers, chunk, finishing)


def page(workspace: Workspace) -> Any:
    """The whole page; one that was opened before is emptied."""
    workspace.leave()
    own, alive = pn.state.curdoc, Alive()
    shell = pmui.Page(
        title="rigmatch",
        theme_toggle=False,
        sidebar_resizable=False,
        busy_indicator=None,
        sidebar_width=SIDEBAR_PX,
        theme_config=LOOK,
        sidebar=[],
        main=[],
    )

    def show_files(first: str = "") -> None:
        """Everything anew, as the open files are, with a step open."""
        bar = FilesBar(workspace, show_files)
        steps, content = _steps(workspace, bar, first, partial(show_files, "Match"))
        shell.title = f"rigmatch: {_project(workspace)}"
        shell.sidebar, shell.main = [pn.Column(steps, bar.panel(), sizing_mode=WIDE, margin=8)], [alive, content]

    def empty() -> None:
        lead = "These files are open in another window now. Reload to go on here."
        shell.sidebar, shell.main = [], [alive, opening("rigmatch", lead)]

    show_files()
    if own is None:
        workspace.leave = empty
        return shell
    workspace.leave = leave = partial(own.add_next_tick_callback, empty)

    def gone(_: Any) -> None:
        """The browser has left the page: there is nothing to empty."""
        if workspace.leave is leave:
            workspace.leave = lambda: None

    own.on_session_destroyed(gone)
    return shell


def _project(workspace: Workspace) -> str:
    """What is worked on, in a few words: the title of the case or model, else the name of its file."""
    first = next(iter([*filter(None, [workspace.case]), *workspace.documents]), None)
    if first is None:
        return workspace.home.name
    return str(first.content.get("title") or first.path.stem)


def _steps(
    workspace: Workspace, files_bar: FilesBar, first: str, to_match: Callable[[], None]
) -> tuple[StepBar, Any]:  # fmt: skip
    """The steps, and the content of the one that is open: the ``first`` one that is named, else the first of all."""
    makers = _makers(workspace, files_bar, to_match)
    names, made, own = list(makers), dict[str, Any](), pn.state.curdoc
    begin = names.index(first) if first in names else 0
    bar = StepBar(names=names, active=begin, sizing_mode=WIDE)
    content = pn.Column(sizing_mode=WIDE, styles={"padding": "6px 2vw"})

    def show(number: int) -> None:
        """Put a tab's content on the page; it is made when it is first opened, and until then the page says so."""
        name, server_page = names[number], pn.state.curdoc
        if name in made or server_page is None or not made:
            put(number)
            return
        content[:] = [paragraph(f"{name} is being prepared …")]
        server_page.add_timeout_callback(partial(put, number), SHOWN_FIRST_MS)

    def put(number: int) -> None:
        """The content itself, unless another tab was opened meanwhile."""
        name = names[number]
        if number == bar.active:
            if name not in made:
                made[name] = makers[name]()
            content[:] = [made[name]]

    def tell_states() -> None:
        states = [_state_of(name, workspace) for name in names]
        if states != bar.states:
            bar.states = states

    bar.param.watch(lambda event: show(event.new), "active")
    show(begin)
    tell_states()
    if own is not None:
        own.add_periodic_callback(tell_states, TICK_MS)
    return bar, content


def _state_of(step: str, workspace: Workspace) -> str:
    """Where a step stands, in a few words."""
    tasks = [workspace.tasks.get(name) for name in TASKS.get(step, ())]
    running = next((task for task in tasks if task is not None and task.ended is None), None)
    if running is not None:
        return f"running, {running.seconds:.0f} s"
    done = next((task.ended for task in tasks if task is not None and task.ended.answered), None)
    if step == "Drivetrain":
        changes = sum(document.unsaved for document in workspace.models.values())
        return f"{counted(changes, 'change')}, not saved" if changes else "saved"
    if step == "Measurement":
        waits = workspace.recordings[0].name if workspace.recordings else "needs a recording"
        return f"done: {done.result['verdict']}" if done is not None and "verdict" in done.result else waits
    if step == "Road":
        waits = "needs a case" if workspace.case is None else "needs a recording"
        if workspace.case is not None and workspace.recordings:
            waits = counted(len(workspace.recordings), "recording")
        return "done: identified" if done is not None else waits
    if step == "Bed":
        return _state_of_bed(done, "not run yet" if workspace.case is not None else "needs a case")
    if step == "Match":
        waits = "not run yet" if workspace.case is not None else "needs a case"
        if workspace.case is not None and workspace.case.changed:
            return f"{counted(workspace.case.unsaved, 'change')}, not saved"
        return f"done: {done.result['status']}" if done is not None and "status" in done.result else waits
    if step == "Validity":
        open_files = [file.path.name for file in (workspace.budget, workspace.fidelity) if file is not None]
        return ", ".join(open_files) or "needs a budget or a fidelity case"
    return "ready"


def _state_of_bed(done: Ended | None, waits: str) -> str:
    if done is None:
        return waits
    waiting = Path((done.result["waiting_for"] or "").partition(".csv: ")[0]).name
    return f"waits for {waiting}" if waiting else f"done: {spaced(done.result['status'] or 'ended')}"


def _makers(
    workspace: Workspace, files_bar: FilesBar, to_match: Callable[[], None] = lambda: None
) -> dict[str, Callable[[], Any]]:  # fmt: skip
    """What makes the content of each tab; a change of a model is told to the tabs that are there."""
    opened: list[MatchTab] = []
    makers: dict[str, Callable[[], Any]] = {}
    if workspace.models:
        modes = ModesTab(workspace)

        def entered() -> None:
            modes.open_model()
            for tab in opened:
                tab.models_changed()

        def kept() -> None:
            drivetrain.after_change()
            for tab in opened:
                tab.models_changed()

        def taken() -> None:
            drivetrain.after_change()
            modes.open_model()

        drivetrain = DrivetrainTab(workspace, entered)
        modes.after_keeping = kept
        makers = {"Drivetrain": drivetrain.panel, "Modes": modes.panel}

    def match() -> Any:
        if workspace.case is None:
            return without_case(partial(files_bar.example, "case", "Match"))
        opened.append(MatchTab(workspace, workspace.case, taken))
        return opened[0].panel()

    return makers | {
        "Road": partial(road, workspace, to_match, partial(files_bar.example, "case", "Road")),
        "Match": match,
        "Bed": partial(bed, workspace, partial(files_bar.example, "case", "Bed")),
        "Measurement": partial(measurement_tab, workspace),
        "Validity": partial(validity, workspace, partial(files_bar.example, "budget", "Validity")),
    }


def serve(make: Callable[[], Any], out: Path, port: int = 0) -> tuple[Any, str]:
    """A server that runs, not yet its event loop, and the address of the page; ``make`` has to be a Python function.

    Panel shows what any other callable (``functools.partial``) prints as, instead of calling it.
    """
    token = secrets.token_urlsafe(TOKEN_BYTES)
    out.mkdir(parents=True, exist_ok=True)
    settings.resources = "server"  # the page needs no internet, whatever BOKEH_RESOURCES says
    pn.extension("filedropper", raw_css=[elements.beside_this("page.css")])
    server = get_server(
        {"page": make}, address=HOST, port=port, prefix=f"/{token}",
        title="rigmatch", start=False, show=False, verbose=False, index=None,
        extra_patterns=[("/favicon.ico", NoContent), ("/alive", NoContent)], static_dirs={RESULTS: str(out.absolute())},
    )  # fmt: skip
    server._tornado.add_transform(SafeHeaders)
    server._tornado._websocket_origins = {f"{HOST}:{server.port}"}  # the port that it was given is known now alone
    return server, f"http://{HOST}:{server.port}/{token}/page"


class Explorer:
    """A page that is served to this machine until :meth:`stop`, or the end of the program.

    Attributes
    ----------
    address : str
        Of the page, with a secret in it.
    """

    def __init__(self, workspace: Workspace, port: int = 0):
        self.address = ""
        self._begun = Event()
        self._fault: BaseException | None = None
        self._server: Any = None
        self._thread = Thread(target=self._run, args=(workspace, port), name="rigmatch explore", daemon=True)
        self._thread.start()
        self._begun.wait(BEGIN_SECONDS)
        if self._fault is not None:
            raise self._fault

    def _run(self, workspace: Workspace, port: int) -> None:
        asyncio.set_event_loop(asyncio.new_event_loop())
        try:
            self._server, self.address = serve(lambda: page(workspace), workspace.out, port)
            self._server.start()
        except BaseException as fault:  # raised where the explorer was asked for
            self._fault = fault
            return
        finally:
            self._begun.set()
        self._server.io_loop.start()
        self._server.stop()

    def open(self) -> None:
        """Open the page in the browser: by a file that leads there and that only this user can read.

        All users of a machine see the command line of the browser.
        """
        self._leads_there = NamedTemporaryFile("w", prefix="rigmatch-", suffix=".html")  # noqa: SIM115  # kept; mode 600
        target = html(self.address)
        self._leads_there.write(f'<meta http-equiv="refresh" content="0; url={target}"><a href="{target}">rigmatch</a>')
        self._leads_there.flush()
        webbrowser.open(Path(self._leads_there.name).as_uri())

    def stop(self) -> None:
        """End the server."""
        if self._thread.is_alive():
            self._server.io_loop.add_callback(self._server.io_loop.stop)
            self._thread.join(BEGIN_SECONDS)

    def wait(self) -> None:
        """Wait until somebody else ends the server, e.g. by Ctrl-C: a program would end without it."""
        while self._thread.is_alive():
            self._thread.join(1.0)

    def __repr__(self) -> str:
        return f"explorer at {self.address}"

    def _repr_html_(self) -> str:
        frame = f'<iframe src="{escape.html(self.address)}" style="width:100%;height:{FRAME_PX}px;border:0"></iframe>'
        return f'{frame}<p><a href="{escape.html(self.address)}" target="_blank">Open in a window</a></p>'
