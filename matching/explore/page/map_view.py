"""A map of the response error over two quantities: click a point, ask between points, have one computed exactly."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import panel as pn
from bokeh.events import Tap
from bokeh.models import ColorBar, ColumnDataSource, HoverTool, LogColorMapper

from matching.explore import equivalents
from matching.explore.files.as_shown import case_path
from matching.explore.files.model_document import number_or_text
from matching.explore.files.workspace import Workspace
from matching.explore.job import Ended
from matching.explore.map_answers import grid, interpolated_error, nearest_point
from matching.explore.page.elements import PANE_STYLE, WIDE, EquivalentBox, Message, heading, paragraph
from matching.explore.page.figures import plain_figure
from matching.explore.page.running import Runner
from matching.frequency.case.case import Case
from matching.frequency.studies.map_axis import axis, quantities
from matching.report.common.wording import component, number
from matching.report.match.text import answer
from modelling.common.errors import InputError
from modelling.common.escape import html
from modelling.units import to_si

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
        self.ask = pn.widgets.Button(name="Answer from the map", width=180)
        self.runner = Runner("Run the map", self._words, self._show)
        self.exactly = Runner("Compute exactly", self._exact_words, self._show_exactly)
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

    def _equivalent(self) -> equivalents.Equivalent:
        x, y = (f"{name}{self._range(name)}" for name in (self.x.value, self.y.value))
        return equivalents.map_of(str(case_path(self.workspace)), x, y, str(self.out))

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
