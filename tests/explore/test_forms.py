"""Files as forms: fields, bounds, what is wrong; answers between the points of a map; channels by name."""

import shutil
import tomllib
from functools import partial

import numpy as np
import pytest

pytest.importorskip("tomlkit", reason="the packages of the explorer are not installed")

from structure.imports import ROOT

from matching.channel_names import suggestions
from matching.explore.files import (
    CaseForm,
    Document,
    case_tables,
    fields,
    opened,
    write_case,
    write_case_at,
    write_model,
)
from matching.explore.live import interpolated_error, nearest_point
from matching.explore.signals import opened_measurement, read_as_suggested
from matching.match.case_file import load_case
from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.read import read_channels, read_recording


@pytest.fixture
def form(tmp_path):
    shutil.copytree(ROOT / "matching" / "starter", tmp_path / "case")
    return CaseForm(Document(tmp_path / "case" / "case.toml"))


def field(form, *keys):
    return next(each for table in form.fields.values() for each in table if each.keys == keys)


def test_a_case_is_changed_by_its_fields_and_stays_a_case(form):
    before = form.document.text
    form.set(("loop", "dead_time"), "5 ms")
    assert form.case.loop["dead_time"] == 0.005
    assert form.document.text == before.replace("dead_time = 0.003  ", 'dead_time = "5 ms"  ')
    with pytest.raises(InputError, match="dead_time"):
        form.set(("loop", "dead_time"), "-1")
    assert form.case.loop["dead_time"] == 0.005
    assert form.undo()
    assert form.document.text == before


def test_a_quantity_begins_to_move_and_stays_again(form):
    name = "rig.inertias.adapter.J" if "rig.inertias.adapter.J" in form.addable else form.addable[-1]
    names = [move.name for move in form.case.moves]
    form.move(name)
    assert [move.name for move in form.case.moves] == [*names, name]
    form.hold(name)
    assert [move.name for move in form.case.moves] == names
    with pytest.raises(InputError, match="did you mean"):
        form.move("rig.inertias.adapter.drg")
    assert not {"loop.dead_time", "loop.sample_time"} & set(form.addable)  # what the bed has


def test_a_limit_is_stated(form):
    assert form.statable["shafts.flange.twist"] == "rad"
    form.limit("shafts.flange.twist", "1 deg")
    assert form.case.limits["shafts.flange.twist"] == pytest.approx(np.pi / 180)
    assert "shafts.flange.twist" not in form.statable
    with pytest.raises(InputError, match="not possible"):
        form.limit("shafts.side_shafts.torque", "0")
    assert "shafts.side_shafts.torque" in form.statable


def test_a_case_at_other_values_holds_them(form, tmp_path):
    path = write_case_at(form.case, {"loop.dead_time": 0.001, "rig.shafts.flange.stiffness": 3e5}, tmp_path / "there")
    there = load_case(path)
    assert there.loop["dead_time"] == 0.001
    assert there.rig.parameters["shafts.flange.stiffness"].value == 3e5
    assert "rig.shafts.flange.stiffness" not in [move.name for move in there.moves]


def test_a_run_reads_the_files_as_they_are_shown_and_leaves_them_alone(tmp_path):
    folder = shutil.copytree(ROOT / "matching" / "starter", tmp_path / "case")
    text = (folder / "case.toml").read_text()
    head, _, tail = text.partition('kind = "tip_in"')
    (folder / "case.toml").write_text(f'{head}file = "trace.csv"\n[limits]{tail.partition("[limits]")[2]}')
    (folder / "trace.csv").write_text("time [s],motor_torque [N*m]\n0,0\n0.5,0\n0.6,80\n3,80\n")
    workspace = opened([folder / "case.toml"], tmp_path / "out")
    assert write_case(workspace) == folder / "case.toml"  # nothing is changed
    form = CaseForm(workspace.case, partial(case_tables, workspace))
    workspace.models["rig"].set_text("shafts.flange.stiffness", "3e5")
    form.set(("loop", "dead_time"), "5 ms")
    before = {path: path.read_bytes() for path in folder.iterdir()}
    there = load_case(write_case(workspace))
    for case in (form.case, there):
        assert case.loop["dead_time"] == 0.005
        assert case.rig.parameters["shafts.flange.stiffness"].value == 3e5
        assert "0.6,80" in case.manoeuvre["motor_torque"].csv("motor_torque")
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
    assert "# s, measured torque" in (tmp_path / "out" / "as_shown" / "case.toml").read_text()
    assert write_model(workspace, "vehicle") == folder / "vehicle.toml"


def test_lists_and_texts_of_a_file_are_fields_too(form):
    assert field(form, "targets", 0, "mode").text == "2"
    assert not [each for each in fields(form.document) if each.key in ("vehicle", "rig")]


def test_a_map_answers_at_its_points_and_between_them():
    content = {
        "x": {"name": "loop.dead_time", "values": [1.0, 2.0, 4.0]}, "y": {"name": "k", "values": [10.0, 100.0]},
        "points": [{"error": error, "place": place} for place, error in enumerate([0.1, 0.2, 0.4, 0.2, 0.4, 0.8])],
    }  # fmt: skip
    assert interpolated_error(content, 2.0, 10.0) == pytest.approx(0.2)
    assert interpolated_error(content, 3.0, 55.0) == pytest.approx(0.4)  # 0.1·2^(steps in x + steps in y)
    assert nearest_point(content, 3.5, 90.0)["place"] == 5
    with pytest.raises(InputError, match="outside the map"):
        interpolated_error(content, 5.0, 10.0)
    content["points"][5]["error"] = None
    with pytest.raises(InputError, match="compute it exactly"):
        interpolated_error(content, 3.0, 55.0)


@pytest.fixture(scope="module")
def bench():
    return from_dict({
        "inertias": {"motor": {"J": 0.1}, "load": {"J": 1.0}},
        "shafts": {"link": {"between": ["motor", "load"], "stiffness": 200.0}},
        "inputs": {"motor_torque": {"on": "motor"}},
        "sensors": {"motor_speed": {"measures": "speed", "of": "motor"},
                    "load_speed": {"measures": "speed", "of": "load"},
                    "link_torque": {"measures": "torque", "of": "link"}},
    })  # fmt: skip


def test_columns_are_suggested_by_name_unit_and_kind(bench):
    columns = {"n_Motor": "1/min", "M_Motor_ist": "N*m", "n_Load": "1/min", "LinkTrq": "", "Oil temperature": "K"}
    found = suggestions(bench, columns)
    assert {name: each.column for name, each in found.items()} == {
        "motor_torque": "M_Motor_ist", "motor_speed": "n_Motor", "load_speed": "n_Load", "link_torque": "LinkTrq",
    }  # fmt: skip
    assert found["motor_speed"].unit == "1/min"
    assert found["link_torque"].unit == "N*m"
    assert suggestions(bench, {"a": "K"})["motor_torque"].column == ""


@pytest.mark.parametrize(("column", "found"), [("Mot", True), ("motr", True), ("Gearbox", False)])
def test_a_shortened_name_is_suggested_and_a_foreign_one_is_not(bench, column, found):
    """Twice the letters in common over all letters: of motor and Mot 0.75, of motor and Gearbox 0.17."""
    assert [each.column for each in suggestions(bench, {column: ""}).values()].count(column) == found


def test_a_channel_file_of_the_suggestions_reads_the_recording(bench, tmp_path):
    path = tmp_path / "log.csv"
    rows = [f"{t / 100},{t % 5},{60 * t}" for t in range(50)]
    path.write_text("\n".join(["t [s],M_Motor [N*m],n_Motor [1/min]", *rows]))
    file = opened_measurement(path)
    chosen = {name: (each.column, each.unit) for name, each in file.suggestions(bench).items()}
    channels = file.write_channels(chosen, tmp_path)
    recording = read_recording(path, bench, read_channels(channels))
    assert read_as_suggested(path, bench).channels.keys() == recording.channels.keys()
    assert recording["motor_speed"][10] == pytest.approx(600 * np.pi / 30)
    assert list(recording["motor_torque"][:6]) == [0, 1, 2, 3, 4, 0]
    chosen["load_speed"] = chosen["motor_speed"]
    with pytest.raises(InputError, match="stands for two channels"):
        file.write_channels(chosen, tmp_path)


def test_files_are_told_apart(tmp_path):
    shutil.copytree(ROOT / "matching" / "starter", tmp_path / "case")
    (tmp_path / "log.csv").write_text("time [s],a\n0,1\n1,2\n")
    budget, fidelity = ROOT / "examples" / "gum" / "mass.toml", ROOT / "examples" / "fidelity" / "tab2.toml"
    found = opened([tmp_path / "case" / "case.toml", tmp_path / "log.csv", budget, fidelity], tmp_path / "out")
    assert set(found.models) == {"vehicle", "rig"}
    assert found.recordings == [tmp_path / "log.csv"]
    assert found.budget.content == tomllib.loads(budget.read_text())
    assert found.fidelity.path == fidelity
    assert not any(document.changed for document in found.documents)
    with pytest.raises(InputError, match="second budget"):
        opened([budget, budget], tmp_path / "out")
