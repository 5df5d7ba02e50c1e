"""What the tabs of the explorer say and show, without a browser: words, labels, answers to a click, all of the data."""

import re
from types import SimpleNamespace

import pytest

pytest.importorskip("panel")

from structure.imports import ROOT

import rigmatch as rm
from matching.explore.files import opened, starter
from matching.explore.measurement import MeasurementTab
from matching.explore.page import FilesBar, MapView, MatchTab, _makers

pytestmark = pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
OWN_NAME = re.compile(r"[A-Za-z]+\d{5}")  # Panel's, of what has no name
FIELD = re.compile(r"@\{?(\w+)")  # of a hover text: a column of what is drawn
MAP = {
    "x": {"name": "loop.dead_time", "unit": "s", "values": [0.001, 0.004], "value_in_case": 0.003},
    "y": {"name": "loop.inverter_lag", "unit": "s", "values": [0.002, 0.008], "value_in_case": 0.002},
    "points": [
        {"error": 0.11 * (place + 1), "status": f"status <{place}>", "limits": [f"limit <{place}>"]}
        for place in range(4)
    ],
}


def files(folder):
    return [starter(folder)[0], ROOT / "examples" / "gum" / "mass.toml", ROOT / "examples" / "fidelity" / "tab2.toml"]


def makers(folder):
    """What makes each tab, with a file of every kind open."""
    workspace = opened(files(folder), folder / "out")
    return _makers(workspace, FilesBar(workspace, lambda: None))


def said(panel):
    """What stands on a tab, in its order: texts, names of fields and what can be chosen in them, titles and axes."""
    for part in panel.select():
        if not OWN_NAME.fullmatch(part.name):
            yield f"{type(part).__name__} {part.name}: {', '.join(map(str, getattr(part, 'options', ())))}."
        shown = getattr(part, "object", None)
        if isinstance(shown, str):
            yield re.sub(r"data:[^\"]*|<[^>]*>", " ", shown)
        elif hasattr(shown, "xaxis"):
            yield f"Figure {shown.title.text}: {shown.xaxis.axis_label or ''}, {shown.yaxis.axis_label or ''}."


def test_no_tab_shows_a_missing_value(tmp_path):
    for make in makers(tmp_path).values():
        text = " ".join(said(make()))
        assert "None" not in text


def test_every_tab_bears_all_that_its_page_holds_to_be_changed(tmp_path):
    """A field that is made but not put on the page cannot be reached."""
    import panel as pn

    for name, make in makers(tmp_path).items():
        owner = getattr(make, "__self__", None)
        if owner is None:
            continue
        there = set(map(id, make().select()))
        for key, value in vars(owner).items():
            assert not isinstance(value, pn.widgets.base.WidgetBase) or id(value) in there, f"{name}: {key}"


@pytest.fixture
def asked(tmp_path):
    workspace = opened(starter(tmp_path), tmp_path / "out")
    return MatchTab(workspace, workspace.case, lambda: None).map


def test_a_click_on_a_map_is_answered_by_the_nearest_point(asked: MapView):
    asked.show_map(MAP)
    for place, (i, j) in enumerate(((0, 0), (1, 0), (0, 1), (1, 1))):
        asked._tapped(i + 0.2 - 0.4 * i, j)
        assert f"status &lt;{place}&gt;" in asked.answer.object
        assert f"<li>limit &lt;{place}&gt;</li>" in asked.answer.object
        assert f"about {0.11 * (place + 1):.2g}" in asked.message.object


def test_what_a_map_shows_under_the_mouse_is_of_its_points(asked: MapView):
    asked.show_map(MAP)
    figure = asked.figure[0].object
    (tool,) = figure.hover
    (cells,) = tool.renderers
    assert {key for _, text in tool.tooltips for key in FIELD.findall(text)} <= cells.data_source.data.keys()
    assert list(cells.data_source.data["status"]) == [point["status"] for point in MAP["points"]]
    assert list(cells.data_source.data["error"]) == [point["error"] for point in MAP["points"]]


@pytest.mark.parametrize("as_dropped", [str, str.encode])
def test_a_recording_that_is_dropped_is_opened_be_it_text_or_bytes(tmp_path, as_dropped):
    tab = MeasurementTab(opened([ROOT / "examples" / "diagnosis" / "model.toml"], tmp_path))
    text = "time [s],motor_torque\n" + "".join(f"{t / 100},{t}\n" for t in range(50))
    tab._dropped(SimpleNamespace(new={"log.csv": as_dropped(text)}))
    assert "log.csv: 50 samples" in tab.message.object
    assert (tmp_path / "recordings" / "log.csv").read_text() == text


@pytest.mark.parametrize("name", ["page.html", "run.sh", "drawing.svg", "../model.toml", "log"])
def test_what_is_dropped_and_is_no_recording_is_not_kept(tmp_path, name):
    tab = MeasurementTab(opened([ROOT / "examples" / "diagnosis" / "model.toml"], tmp_path))
    tab._dropped(SimpleNamespace(new={name: "time [s],motor_torque\n0,0\n1,1\n"}))
    assert "is no recording; known are .csv" in tab.message.object
    assert not (tmp_path / "recordings").exists()


def test_an_unsaved_case_is_told_after_a_reload_too(tmp_path, monkeypatch):
    """In the step Match, at its name, and in the step Drivetrain."""
    from matching.explore.modes import DrivetrainTab
    from matching.explore.page import _state_of

    rm.new(tmp_path / "first")
    monkeypatch.chdir(tmp_path)
    workspace = opened([tmp_path / "first" / "case.toml"], tmp_path / "out")
    tab = MatchTab(workspace, workspace.case, lambda: None)
    assert "Everything is saved." in DrivetrainTab(workspace, lambda: None).changes.object
    assert tab.unsaved.object == ""
    assert tab.editing.do(lambda: tab._enter(("loop", "dead_time"), "4 ms"))
    assert "dead time is 4 ms. Changed; not saved yet" in tab.editing.message.object
    again = MatchTab(workspace, workspace.case, lambda: None)  # as a page that is loaded again
    assert "1 change, not saved." in again.unsaved.object
    assert _state_of("Match", workspace) == "1 change, not saved"
    said = DrivetrainTab(workspace, lambda: None).changes.object
    assert "Everything" not in said
    assert "the case is not" in said
    assert again.editing.do(again.editing._undo)
    assert _state_of("Match", workspace) == "not run yet"
    assert again.editing.do(again.editing._redo)
    assert again.form.case.loop["dead_time"] == 0.004
    again.editing.do(again.editing._save)
    assert again.unsaved.object == ""
    assert "0.003" not in (tmp_path / "first" / "case.toml").read_text(encoding="utf-8").partition("inverter")[0]


def test_the_planned_value_stands_above_its_bounds(tmp_path):
    rm.new(tmp_path / "first")
    workspace = opened([tmp_path / "first" / "case.toml"], tmp_path / "out")
    tab = MatchTab(workspace, workspace.case, lambda: None)
    said = [each.object for each in tab._cards["move"][0] if hasattr(each, "object")]
    assert "<p><b>flange, stiffness: planned 360000 N·m/rad</b></p>" in said
    assert "<p><b>torque feed forward: planned 0, at a bound</b></p>" in said
    assert len(said) == len(tab.form.case.moves)


def test_paths_in_messages_are_those_of_the_folder(tmp_path, monkeypatch):
    from matching.explore.elements import with_short_paths

    monkeypatch.chdir(tmp_path)
    (tmp_path / "first").mkdir()
    (tmp_path / "first" / "rig.toml").write_text("", encoding="utf-8")
    said = with_short_paths(f"{tmp_path}/first/rig.toml: J: 5 N·m/rad/s is no kg·m²/2; {tmp_path}/none.toml; 1/min")
    assert said == "first/rig.toml: J: 5 N·m/rad/s is no kg·m²/2; none.toml; 1/min"
    monkeypatch.chdir(tmp_path / "first")
    assert with_short_paths(f"{tmp_path}/none.toml: does not exist") == "none.toml: does not exist"
    assert with_short_paths("/no/such/folder/file: /a/b") == "/no/such/folder/file: /a/b"


@pytest.mark.parametrize(("error", "said"), [
    ("b.toml: inputs.R.half_width: -5 is too small", "R, half-width: -5 is too small"),
    ("move.'loop.dead_time'.lower: 'x' is no quantity", "Dead time, lower: 'x' is no quantity"),
    ("c.toml: targets[2].mode: is no mode number", "Targets, 2, mode: is no mode number"),
    ("response.compare.0.input: '-5' is a number", "Response, compare, 1, input: '-5' is a number"),
    ("c.toml: f_max: -5 is not positive", "Largest relevant frequency [Hz]: -5 is not positive"),
    ("log.csv: column 'time': has no unit", "log.csv: column 'time': has no unit"),
    ("log.csv: is no recording", "log.csv: is no recording"), ("rig.toml: does not exist", "rig.toml: does not exist"),
])  # fmt: skip
def test_the_place_of_an_error_is_said_as_the_page_calls_its_field(error, said):
    from matching.explore.elements import Message

    message = Message()
    message.say(error, wrong=True)
    assert message.object.replace("&#x27;", "'") == f'<p role="status" class="wrong">{said}</p>'
