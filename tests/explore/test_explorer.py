"""The explorer from Python: served beside the program at an address with a secret, shown in a notebook, ended."""

from pathlib import Path
from urllib.error import HTTPError, URLError
from urllib.parse import urlsplit
from urllib.request import url2pathname, urlopen

import pytest
from structure.imports import ROOT

import rigmatch as rm
from modelling.errors import InputError


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")  # the words of Panel 2 need Panel 1.9
def test_a_program_goes_on_beside_the_page(tmp_path):
    pytest.importorskip("panel")
    explorer = rm.explore(ROOT / "examples" / "diagnosis" / "model.toml", out=tmp_path)
    try:
        assert explorer.address.startswith("http://127.0.0.1:")
        with urlopen(explorer.address) as answer:
            assert b"rigmatch" in answer.read()
            assert answer.headers["Referrer-Policy"] == "no-referrer"
            assert answer.headers["X-Content-Type-Options"] == "nosniff"
            assert answer.headers["Content-Security-Policy"].startswith("default-src 'self'; ")
        without_secret = explorer.address.rsplit("/", 2)[0] + "/page"
        with pytest.raises(HTTPError, match="404"):
            urlopen(without_secret)
        assert f'<iframe src="{explorer.address}"' in explorer._repr_html_()
    finally:
        explorer.stop()
    with pytest.raises(URLError):
        urlopen(explorer.address)


def test_the_command_line_of_the_browser_holds_no_secret(monkeypatch):
    pytest.importorskip("panel")
    from matching.explore.page import Explorer

    asked = []
    monkeypatch.setattr("webbrowser.open", asked.append)
    explorer = Explorer.__new__(Explorer)
    explorer.address = "http://127.0.0.1:1/secret/page"
    explorer.open()
    (leads_there,) = asked
    file = Path(url2pathname(urlsplit(leads_there).path))
    assert "secret" not in leads_there
    assert 'content="0; url=http://127.0.0.1:1/secret/page"' in file.read_text(encoding="utf-8")
    assert file.stat().st_mode & 0o077 == 0
    del explorer
    assert not file.exists()


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
def test_a_second_page_empties_the_first(tmp_path):
    """Its fields would still show, and save, what the second one has changed."""
    pytest.importorskip("panel")
    from matching.explore.files import opened
    from matching.explore.page import page

    workspace = opened([ROOT / "examples" / "diagnosis" / "model.toml"], tmp_path)
    first = page(workspace)
    assert len(first.sidebar) == 1  # steps and files
    second = page(workspace)
    assert len(second.sidebar) == 1
    assert first.sidebar == []
    assert "open in another window" in first.main[-1][0].object


def test_a_wrong_file_is_one_line(tmp_path):
    pytest.importorskip("panel")
    with pytest.raises(InputError, match=r"none\.toml"):
        rm.explore(tmp_path / "none.toml", out=tmp_path)


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
def test_a_tab_is_made_when_it_is_opened_and_kept(tmp_path):
    pytest.importorskip("panel")
    from matching.explore.files import opened
    from matching.explore.page import page

    model = ROOT / "examples" / "diagnosis" / "model.toml"
    whole = page(opened([model], tmp_path))
    bar, content = whole.sidebar[0][0], whole.main[-1]
    first = content[0]
    bar.active = 1
    assert content[0] is not first
    bar.active = 0
    assert content[0] is first


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
def test_a_value_that_a_slider_tries_is_kept_for_all_tabs(tmp_path):
    pytest.importorskip("panel")
    from matching.explore.files import opened
    from matching.explore.modes import ModesTab

    workspace = opened([ROOT / "examples" / "diagnosis" / "model.toml"], tmp_path)
    tab, told = ModesTab(workspace), []
    tab.after_keeping = lambda: told.append(True)
    (document,) = workspace.models.values()
    tab.quantity.value = "shafts.link.stiffness"
    wanted = 1.5 * document.system.parameters["shafts.link.stiffness"].value
    tab.slider.value = wanted
    assert tab.trial.now.modes.frequencies[1] > tab.trial.before.modes.frequencies[1]
    assert not told
    tab.keep.clicks += 1
    assert told == [True]
    assert document.system.parameters["shafts.link.stiffness"].value == pytest.approx(wanted, rel=1e-6)
    assert tab.trial.now.modes.frequencies[1] == tab.trial.before.modes.frequencies[1]


def test_quantities_that_are_zero_have_no_slider_and_a_value_is_tried_before_it_is_kept(tmp_path):
    from matching.explore.files import ModelDocument
    from matching.explore.live import WhatIf

    path = tmp_path / "rig.toml"
    path.write_text(
        "[inertias]\na = { J = 1 }\nb = { J = 1, drag = 0 }\n"
        '[shafts]\nlink = { between = ["a", "b"], stiffness = 200, damping = 0 }\n'
    )
    tried = WhatIf(ModelDocument(path))
    assert tried.movable["shafts.link.stiffness"] == pytest.approx((200 / 3, 600))
    assert not {"inertias.b.drag", "shafts.link.damping"} & tried.movable.keys()
    tried.try_value("shafts.link.stiffness", 800.0)
    assert tried.now.modes.frequencies[1] == pytest.approx(2 * tried.before.modes.frequencies[1], rel=1e-9)
    tried.reset()
    assert tried.now is tried.before


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
def test_a_budget_in_the_explorer_shows_its_result_and_is_saved_with_what_was_entered(tmp_path):
    pytest.importorskip("panel")
    from matching.explore.elements import Equivalent
    from matching.explore.files import fields, opened
    from matching.explore.page import EditedTable

    path = tmp_path / "budget.toml"
    path.write_text('[measurand]\nname = "Z"\nformula = "R"\n[inputs.R]\nunit = "ohm"\nvalue = 1.0\nhalf_width = 0.1\n')
    budget = opened([path], tmp_path).budget
    table = EditedTable("Budget", budget, Equivalent("", ""), lambda content: f"<p>a < b, {len(content)}")
    assert f'<iframe title="Budget" srcdoc="&lt;p&gt;a &lt; b, {len(budget.content)}"' in table.answer.object
    assert table.editing._save() == "Everything is saved"
    before = path.read_text()
    keys = next(field.keys for field in fields(budget) if "half_width" in field.keys)
    table.editing.do(lambda: table._enter(keys, "0.5"))
    assert path.read_text() == before
    assert "R half-width is 0.5. Changed; not saved yet" in str(table.editing.message.object)
    assert table.editing._save() == "Saved: budget.toml"
    assert path.read_text() != before
    assert table.editing._save() == "Everything is saved"


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
def test_the_name_of_a_column_is_no_formula(tmp_path):
    """For a text with $$ the page would fetch a library from the network."""
    pytest.importorskip("panel")
    from bokeh.models import PlainText

    from matching.explore.files import opened
    from matching.explore.measurement import MeasurementTab

    hostile = r"$$\href{x}{y}$$ <img src=x>"
    recording = tmp_path / "log.csv"
    recording.write_text(f"time [s],motor_torque,{hostile}\n" + "".join(f"{t / 100},1,{t}\n" for t in range(50)))
    tab = MeasurementTab(opened([ROOT / "examples" / "diagnosis" / "model.toml", recording], tmp_path))
    tab.signal.value = hostile
    assert isinstance(tab.figure.yaxis.axis_label, PlainText)
    assert tab.figure.yaxis.axis_label.text == f"{hostile} [SI]"


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
def test_a_slider_that_is_moved_outside_a_server_shows_its_value_at_once(tmp_path):
    pytest.importorskip("panel")
    from matching.explore.files import opened, starter
    from matching.explore.modes import ModesTab

    tab = ModesTab(opened(starter(tmp_path), tmp_path / "out"))
    low, high = tab.slider.start, tab.slider.end
    tab.slider.value = (low + high) / 2
    assert tab.trial.values == {tab.quantity.value: (low + high) / 2}
    assert not tab._waiting


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
@pytest.mark.parametrize(("unit", "size"), [("s", 1.0), ("ms", 1e-3), ("min", 60.0), ("", 1.0)])
def test_the_axis_of_a_recording_says_the_unit_of_its_data(tmp_path, unit, size):
    """Half a second of motion, whatever the file counts in; the simulation, in s, is drawn over the same axis."""
    pytest.importorskip("panel")
    from matching.explore.files import opened
    from matching.explore.measurement import MeasurementTab
    from modelling.recordings.readers import read_table
    from modelling.units import factor

    header = f"time [{unit}]" if unit else "time"
    log = tmp_path / "log.csv"
    rows = "".join(f"{t / 100 / size!r},{t % 7},{t}\n" for t in range(50))
    log.write_text(f"{header},motor_torque [N*m],motor_speed [rad/s]\n{rows}")
    tab = MeasurementTab(opened([ROOT / "examples" / "diagnosis" / "model.toml", log], tmp_path))
    (tmp_path / "simulated.csv").write_text(
        "time [s],motor_speed [rad/s]\n" + "".join(f"{t / 50},{t}\n" for t in range(25))
    )
    tab._table = read_table(tmp_path / "simulated.csv")
    tab.signal.value = "motor_speed"
    tab.show_signal()
    said = tab.figure.xaxis.axis_label.text
    drawn = tab.source.data["t"], tab.simulated.data["t"]
    assert said == f"time [{unit or 's'}]"
    for times, last in zip(drawn, (0.49, 0.48), strict=True):
        assert max(times) * factor(said[6:-1], "s") == pytest.approx(last)
