"""The tab *Modes*: table, the mode with its energies swinging on the drawing, responses; a slider moves all of it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import panel as pn
import param

from matching.explore.elements import (
    PANE_STYLE,
    WIDE,
    DrivetrainView,
    Equivalent,
    EquivalentBox,
    Message,
    ResponseFigures,
    Slider,
    beside,
    heading,
    offer,
    opening,
    paragraph,
    plain_button,
    same,
    table,
)
from matching.explore.fields import Editing, Entry, Savable, lay_out
from matching.explore.files import Workspace, part_of, write_case, write_model
from matching.explore.live import WhatIf, largest_shares
from matching.explore.orders import OrdersView
from matching.explore.parts import (
    ADDABLE,
    add_effect,
    add_part,
    effects_for,
    free_name,
    remove_effect,
    remove_part,
    rename_part,
)
from matching.explore.signals import MeasuredCurves, measured_curves, read_as_suggested
from matching.report.common import amount, hertz, number, spaced, unit
from matching.report.drivetrain import LEGEND, Sketch, case_drawings, drawing, marks, sketch
from modelling.effects.effect import members
from modelling.errors import InputError
from modelling.escape import html
from modelling.units import of_input

# --- Drawings of the open models; those of a case with what the case says of them.


def sketches(workspace: Workspace) -> dict[str, Sketch]:
    """Drawing of every open model, by its role; values as edited, dynamometers and cut as the saved case has them."""
    systems = {role: document.system for role, document in workspace.models.items()}
    shifts = {role: workspace.places[role].shifts if role in workspace.places else {} for role in systems}
    if workspace.case is None:
        drawings = {role: drawing(system, shifts=shifts[role]) for role, system in systems.items()}
    else:
        of_case = dict(zip(("vehicle", "rig"), case_drawings(workspace.load_case()), strict=True))
        largest = max(part.J.value for system in systems.values() for part in system.inertias)
        drawings = {
            role: drawing(system, of_case[role].emphasis, largest, shifts=shifts[role])
            for role, system in systems.items()
        }
    known = workspace.sketches  # a drawing takes a fifth of a second
    workspace.sketches = {
        role: known[role] if role in known and known[role].drawing == drawn else sketch(drawn)
        for role, drawn in drawings.items()
    }
    return workspace.sketches


MOVES = {"Left": (-1, 0), "Right": (1, 0), "Up": (0, -1), "Down": (0, 1)}  # columns to the right, lanes downwards
TITLE = "title"  # of a model, among the fields of its parts

# --- The tab *Drivetrain*: the drawing, the values of a part, changes that are marked, undone and saved.


class DrivetrainTab:
    """Drawing and values of the open models; ``changed`` is called after every change."""

    def __init__(self, workspace: Workspace, changed: Callable[[], None]):
        self.workspace, self._changed = workspace, changed
        self._role, self._part = next(iter(workspace.models)), ""
        self._sketches: dict[str, Sketch] = {}
        self.views = {
            role: DrivetrainView(label=f"the {spaced(role)}", reacts=True, sizing_mode=WIDE)
            for role in workspace.models
        }
        self.titles = {role: heading(self._title(role)) for role in workspace.models}
        self.editing = Editing(self._enter, self._undo, self._redo, self._documents, self._after_change, width=300)
        self.chooser = pn.widgets.Select(name="Part", groups=self._groups(), width=300)
        self.values = pn.Column(sizing_mode=WIDE)
        self.changes = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        for role, view in self.views.items():
            view.param.watch(partial(self._picked, role), "picked")
            view.param.watch(partial(self._drawn, role), "drawn")
            view.param.watch(lambda _: self.editing.undo_last(), "undone")
        self.chooser.param.watch(lambda event: self.select(*event.new), "value")
        self.same = EquivalentBox(self._equivalent())
        self.kind = pn.widgets.Select(name="Add", options=list(ADDABLE), width=250)
        self.named = pn.widgets.TextInput(name="called", width=180)
        self.other = pn.widgets.Select(name="and, for a shaft or gear", width=250)
        self.third = pn.widgets.Select(name="and, for a gear of three members", width=250)
        self.new_name = pn.widgets.TextInput(name="New name", width=180)
        self.effect = pn.widgets.Select(name="Effect to add", width=250)
        self.effect_values = pn.Column(sizing_mode=WIDE)
        self.there = pn.widgets.Select(name="Effect of the part", width=250)
        self.effect.param.watch(lambda _: self._ask_for_values(), "value")
        self.add, self.remove, self.rename, self.add_effect, self.remove_effect = (
            self._button(name, act)
            for name, act in (
                ("Add", self._add), ("Remove the part", self._remove), ("Rename the part", self._rename),
                ("Add the effect", self._add_effect), ("Remove the effect", self._remove_effect),
            )
        )  # fmt: skip
        self.moves = [self._button(name, partial(self._move, *way)) for name, way in MOVES.items()]
        self.moving = pn.Column(paragraph("Move it in the drawing, with what hangs on it:"), pn.FlexBox(*self.moves))
        self.select(*self.chooser.value)

    def panel(self) -> Any:
        """The tab's content."""
        drawings = [part for role, view in self.views.items() for part in (self.titles[role], view)]
        how = paragraph(f"{LEGEND[0].upper()}{LEGEND[1:]}.")
        head = opening(
            "Drivetrain",
            "What turns, and what connects it. Click a part to change its values; save them to its file. Drag from a "
            "disc to another one for a shaft between them, or into the open for a new inertia.",
            self.editing.undo, self.editing.redo, self.editing.save,
        )  # fmt: skip
        fields = [
            heading("Values", 2), self.chooser, self.values, self.editing.message, self.changes, self.moving,
            heading("Parts", 2), paragraph("A new part sits at the chosen part. With a part goes what hangs on it."),
            self.kind, self.named, self.other, self.third, self.add, self.new_name,
            pn.FlexBox(self.rename, self.remove),
            heading("Effects", 2), paragraph("Free play, friction, delays and others, at the chosen part."),
            self.effect, self.effect_values, self.add_effect, self.there, self.remove_effect,
        ]  # fmt: skip
        return pn.Column(head, beside([*drawings, how], fields), self.same, sizing_mode=WIDE)

    def _button(self, name: str, act: Callable[[], str]) -> pn.widgets.Button:
        button = plain_button(name)
        button.on_click(lambda _: self.editing.do(act))
        return button

    def _offer_ends(self) -> None:
        """The inertias that a new part may connect."""
        names = {spaced(own.name): own.name for own in self.workspace.models[self._role].system.inertias}
        for chooser in (self.other, self.third):
            offer(chooser, names)

    def _offer_effects(self) -> None:
        """The effects that the chosen part may get, and those that it has."""
        system = self.workspace.models[self._role].system
        offer(self.effect, {spaced(kind): kind for kind in effects_for(system, self._part)})
        own = [effect for effect in system.effects if self._part in members(effect.at)]
        offer(self.there, {spaced(effect.kind): (effect.kind, effect.at) for effect in own})
        for shown, needed in ((self.effect, self.add_effect), (self.there, self.remove_effect)):
            shown.visible = needed.visible = bool(shown.options)
        self._ask_for_values()

    def _ask_for_values(self) -> None:
        """Fields for what the chosen effect needs."""
        needed = effects_for(self.workspace.models[self._role].system, self._part).get(self.effect.value, {})
        names = [f"{spaced(key)} [{unit(si) or '1'}]" for key, si in needed.items()]
        if [field.name for field in self.effect_values] != names:
            self.effect_values[:] = [pn.widgets.TextInput(name=name, width=180) for name in names]

    def _add_effect(self) -> str:
        document, kind = self.workspace.models[self._role], self.effect.value
        needed = effects_for(document.system, self._part).get(kind, {})
        typed = {key: field.value for key, field in zip(needed, self.effect_values, strict=True)}
        add_effect(document, kind, self._part, typed)
        return f"{spaced(kind)} was added to {spaced(self._part.replace('.', ' '))}; not saved yet"

    def _remove_effect(self) -> str:
        kind, at = self.there.value
        remove_effect(self.workspace.models[self._role], kind, at)
        return f"{spaced(kind)} was removed; not saved yet"

    def _add(self) -> str:
        at = self._part.partition(".")[2]
        ends = self.other.value or "", self.third.value or ""
        add_part(self.workspace.models[self._role], self.kind.value, self.named.value, at, *ends)
        return f"{self.named.value} was added to {self._role}; not saved yet"

    def _remove(self) -> str:
        gone = remove_part(self.workspace.models[self._role], self._part)
        return f"Removed from {self._role}, not saved yet: {', '.join(gone)}"

    def _rename(self) -> str:
        changed = rename_part(self.workspace, self._role, self._part, self.new_name.value)
        self._part = f"{self._part.partition('.')[0]}.{self.new_name.value.strip()}"
        return f"Renamed in {', '.join(changed)}; not saved yet"

    def _move(self, right: int, down: int) -> str:
        table, _, name = self._part.partition(".")
        if table != "inertias":
            raise InputError(spaced(self._part), "is no inertia", "choose an inertia, which takes its shafts along")
        self.workspace.places[self._role].move(self.workspace.models[self._role].system, name, right, down)
        return f"{spaced(name)} was moved in the drawing; not saved yet"

    def select(self, role: str, part: str) -> None:
        """Show the values of a part."""
        self._role, self._part = role, part
        self.moving.visible = part.startswith("inertias.")
        if self.chooser.value != (role, part):
            self.chooser.value = (role, part)
            return
        self._offer_ends()
        self._offer_effects()
        lay_out(self.values, self.editing.entries.show(self._entries()))
        self.refresh()

    def refresh(self) -> None:
        """Mark everything anew; drawings only where a value has changed."""
        self._sketches = self._sketches or sketches(self.workspace)
        for role, view in self.views.items():
            drawn, document = self._sketches[role], self.workspace.models[role]
            chosen = self._part if role == self._role else ""
            view.param.update(svg=drawn.svg, marks=marks(drawn, chosen, document.changed_parts))
            self.titles[role].object = f"<h2>{html(self._title(role))}</h2>"
        rows = [
            html(
                f"{spaced(role)}: {name}: {amount(before, document.unit_of(name))} → "
                f"{amount(after, document.unit_of(name))}"
            )
            for role, document in self.workspace.models.items()
            for name, (before, after) in document.changes.items()
        ]
        for role, document in self.workspace.models.items():
            for word, places in zip(("new", "removed"), document.other_parts, strict=True):
                rows += [html(f"{spaced(role)}: {word}: {place}") for place in places]
            if document.changed and not any(row.startswith(spaced(role)) for row in rows):
                rows.append(html(f"{spaced(role)}: its text"))
        rows += [f"{spaced(role)}: places in the drawing" for role, own in self.workspace.places.items() if own.changed]
        listed = "".join(f"<li>{row}</li>" for row in rows)
        self.same.set(self._equivalent())
        case = self.workspace.case
        saved = "Everything is saved." if case is None or not case.changed else "The models are saved, the case is not."
        self.changes.object = f"<p>Not saved:</p><ul>{listed}</ul>" if rows else f"<p>{saved}</p>"

    def after_change(self) -> None:
        """Show values that were changed here or elsewhere."""
        self._sketches = {}
        groups = self._groups()
        if groups != self.chooser.groups:
            parts = list(groups[self._role].values())
            self._part = self._part if (self._role, self._part) in parts else parts[0][1]
            with param.parameterized.discard_events(self.chooser):
                self.chooser.param.update(groups=groups, value=(self._role, self._part))
            self.chooser.param.trigger("groups", "value")
            self._offer_ends()
        self._offer_effects()
        lay_out(self.values, self.editing.entries.show(self._entries()))
        self.refresh()

    def _equivalent(self) -> Equivalent:
        has_case = self.workspace.case is not None
        file = write_case(self.workspace) if has_case else write_model(self.workspace, self._role)
        return same("show", str(file), out=self.workspace.out)

    def _groups(self) -> dict[str, dict[str, tuple[str, str]]]:
        groups = {}
        for role, document in self.workspace.models.items():
            names = dict.fromkeys([*map(part_of, document.system.parameters), *document.system.places()])
            groups[role] = {f"{role}: {spaced(name.replace('.', ' '))}": (role, name) for name in names}
        return groups

    def _title(self, role: str) -> str:
        title = self.workspace.models[role].system.title
        return f"{role.capitalize()}: {title}" if title else role.capitalize()

    def _entries(self) -> list[Entry]:
        document = self.workspace.models[self._role]
        entries = []
        for name, quantity in document.values_of(self._part).items():
            si = unit(document.unit_of(name))
            between = (
                f", uncertain: {amount(quantity.lower, '1')} … {amount(quantity.upper, document.unit_of(name))}"
                if quantity.uncertain
                else ""
            )
            label = f"{spaced(name.removeprefix(self._part + '.').replace('.', ' '))} [{si or '1'}]{between}"
            entries.append(Entry((self._role, name), label, document.written(name)))
        return [*entries, Entry((self._role, TITLE), f"title of the {self._role}", document.system.title)]

    def _enter(self, place: tuple[str, str], text: str) -> str:
        role, name = place
        document = self.workspace.models[role]
        if name == TITLE:
            document.set_title(text)
            return f"The title of the {role} is {text.strip() or 'empty'}"
        document.set_text(name, text)
        return f"{name} is {text}" + ("" if name in document.changes else ", as in the file")

    def _picked(self, role: str, event: Any) -> None:
        part = event.new.rpartition(" ")[0]
        self.select(role, part)
        if not any(part_of(name) == part for name in self.workspace.models[role].system.parameters):
            self.editing.message.say(f"{spaced(part)} has no values")

    def _drawn(self, role: str, event: Any) -> None:
        first, second, _ = event.new.split(" ")
        self.editing.do(partial(self._draw, role, first.partition(".")[2], second.partition(".")[2]))

    def _draw(self, role: str, first: str, second: str) -> str:
        """Add what was drawn: a shaft between two inertias, or a new inertia on a shaft at the first."""
        document = self.workspace.models[role]
        kind = "shaft between inertias" if second else "inertia on a shaft"
        name = free_name(document.system, "shaft" if second else "inertia")
        add_part(document, kind, name, first, second)
        self._role, self._part = role, f"{ADDABLE[kind]}.{name}"
        values = "the values of the first shaft" if second else f"the values of {spaced(first)} and of the first shaft"
        return f"{spaced(name)} was added to {role} with {values}; not saved yet"

    def _undo(self) -> bool:
        changed = [role for role, document in self.workspace.models.items() if document.changed]
        role = self._role if self._role in changed else (changed or [self._role])[0]
        return self.workspace.models[role].undo()

    def _redo(self) -> bool:
        undone = [role for role, document in self.workspace.models.items() if document.was_undone]
        role = self._role if self._role in undone else (undone or [self._role])[0]
        return self.workspace.models[role].redo()

    def _documents(self) -> list[Savable]:
        return [*self.workspace.models.values(), *self.workspace.places.values()]

    def _after_change(self) -> None:
        self.after_change()
        self._changed()


# --- Modes

STEPS = 200  # of a slider


class ModesTab:
    """Modes and responses of one of the open models; ``after_keeping`` is called when values were kept."""

    def __init__(self, workspace: Workspace):
        self.workspace, self._waiting = workspace, False
        self.after_keeping: Callable[[], None] = lambda: None
        roles = list(workspace.models)
        self.role = pn.widgets.Select(name="Model", options=roles, value=roles[-1], width=200)
        self.mode = pn.widgets.Select(name="Mode", width=300)
        self.view, self.table = (
            DrivetrainView(sizing_mode=WIDE),
            pn.pane.HTML(stylesheets=[PANE_STYLE], sizing_mode=WIDE),
        )
        self.quantity = pn.widgets.Select(name="Quantity to try", width=300)
        self.slider = Slider(width=300)
        self.reset, self.keep = (
            plain_button("Reset"),
            plain_button("Keep"),
        )
        self.input, self.sensor = (pn.widgets.Select(name=name, width=250) for name in ("Input", "Sensor"))
        self.responses, self.message = ResponseFigures(), Message()
        self.same = EquivalentBox(same("modes", "", out=""))
        self.orders = OrdersView(workspace, lambda: self.role.value)
        self.open_model()
        self.role.param.watch(lambda _: self.open_model(), "value")
        self.mode.param.watch(lambda _: self._show_mode(), "value")
        self.quantity.param.watch(lambda _: self._set_slider(), "value")
        self.slider.param.watch(lambda _: self._slide(), "value")
        for chooser in (self.input, self.sensor):
            chooser.param.watch(lambda _: self._show_responses(), "value")
        self.reset.on_click(lambda _: self.open_model())
        self.keep.on_click(lambda _: self._keep())

    def panel(self) -> Any:
        """The tab's content."""
        fields = [self.role, self.mode, self.quantity, self.slider, self.message]
        return pn.Column(
            opening(
                "Modes",
                "How the drivetrain swings by itself. The slider tries another value; Keep writes it into the model.",
                self.reset,
                self.keep,
            ),
            beside([self.view], fields),
            self.table,
            heading("Frequency response"),
            pn.FlexBox(self.input, self.sensor),
            pn.pane.Bokeh(self.responses.modulus, sizing_mode=WIDE),
            pn.pane.Bokeh(self.responses.phase, sizing_mode=WIDE),
            self.same,
            self.orders.panel(),
            sizing_mode=WIDE,
        )

    def open_model(self) -> None:
        """Take the chosen model with its values as edited, nothing tried."""
        document = self.workspace.models[self.role.value]
        try:
            self.trial = WhatIf(document)
            self._sketch = sketches(self.workspace)[self.role.value]
        except InputError as error:
            self.message.say(str(error), wrong=True)
            return
        modes = self.trial.before.modes
        elastic = [place for place in range(len(modes)) if modes.frequencies[place] > 0]
        numbers = {f"{place + 1}: {hertz(modes[place].frequency)} Hz": place for place in range(len(modes))}
        offer(self.mode, numbers, elastic[0] if elastic else 0)
        offer(self.quantity, {spaced(name.replace(".", " ")): name for name in self.trial.movable})
        offer(self.input, {part.name: part.name for part in document.system.in_gear(1).inputs})
        offer(self.sensor, {part.name: part.name for part in document.system.sensors})
        self.measured = self._measured()
        self.same.set(same("modes", str(write_model(self.workspace, self.role.value)), out=self.workspace.out))
        self.orders.model_changed()
        self._set_slider()
        self.show()

    def show(self) -> None:
        """Draw what is tried."""
        before, now = self.trial.before.modes, self.trial.now.modes
        rows = [
            {"mode": str(mode.number), "frequency [Hz]": hertz(mode.frequency),
             "in the file [Hz]": hertz(float(before.frequencies[mode.number - 1])),
             "symmetry": "" if mode.symmetry == "none" else mode.symmetry,
             "largest shares of energy": largest_shares(mode)}
            for mode in now
        ]  # fmt: skip
        damped = [
            {"mode": str(mode.number), "frequency [Hz]": hertz(mode.frequency),
             "damping ratio": number(mode.damping_ratio, 3), "largest shares of energy": largest_shares(mode)}
            for mode in self.trial.now.damped
        ]  # fmt: skip
        self.table.object = table(rows, "Modes without damping") + table(damped, "Modes with damping")
        self._show_mode()
        self._show_responses()

    def _show_mode(self) -> None:
        if self.mode.value is None or self.mode.value >= len(self.trial.now.modes):
            return
        mode = self.trial.now.modes[self.mode.value]
        tried = {part_of(name) for name in self.trial.values}
        self.view.param.update(svg=self._sketch.svg, marks=marks(self._sketch, changed=tried, mode=mode))

    def _show_responses(self) -> None:
        before, now = self.trial.before.response, self.trial.now.response
        if before is None or now is None or not self.sensor.value or not self.input.value:
            return
        pair = (self.sensor.value, self.input.value)
        if pair[0] not in now.sensors or pair[1] not in now.inputs:
            return
        figures = self.responses
        figures.show(figures.before, before.frequencies, before[pair])
        figures.show(figures.now, now.frequencies, now[pair])
        figures.show_measured(self.measured, *pair)
        of_sensor = next(part for part in self.trial.document.system.sensors if part.name == pair[0])
        per = unit(of_input(self.trial.document.system.input_units[pair[1]]))
        figures.modulus.yaxis.axis_label = f"modulus [{of_sensor.unit} / {per}]"

    def _measured(self) -> MeasuredCurves | None:
        for path in self.workspace.recordings:
            try:
                system = self.trial.document.system
                return measured_curves(read_as_suggested(path, system), system)
            except InputError:  # of another model
                continue
        return None

    def _set_slider(self) -> None:
        name = self.quantity.value
        if name not in self.trial.movable:
            return
        low, high = self.trial.movable[name]
        now = self.trial.values.get(name, self.trial.document.system.parameters[name].value)
        low, high = min(low, now), max(high, now)
        si = unit(self.trial.document.system.units[name])
        self._waiting = True  # no slide of the user's
        self.slider.param.update(
            start=low, end=high, step=(high - low) / STEPS, value=now, label=f"value [{si or '1'}]"
        )
        self._waiting = False

    def _slide(self) -> None:
        """Follow the slider: once for all its events that have come meanwhile."""
        if self._waiting:
            return
        self._waiting = True
        if pn.state.curdoc:
            pn.state.curdoc.add_next_tick_callback(self.follow)
        else:
            self.follow()

    def follow(self) -> None:
        """Show everything at the slider's value."""
        self._waiting = False
        name, value = self.quantity.value, self.slider.value
        try:
            self.trial.try_value(name, value)
        except InputError as error:
            self.message.say(str(error), wrong=True)
            return
        self.message.say(f"tried: {amount(value, self.trial.document.system.units[name])} for {name}")
        self.show()

    def _keep(self) -> None:
        try:
            self.trial.keep()
        except InputError as error:
            self.message.say(str(error), wrong=True)
            return
        self.message.say("Kept; save it in the tab Drivetrain")
        self.open_model()
        self.after_keeping()
