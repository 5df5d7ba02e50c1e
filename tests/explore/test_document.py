"""Files that are edited: comments stay, changes are undone byte by byte, what is wrong changes nothing."""

import pytest

pytest.importorskip("tomlkit", reason="the packages of the explorer are not installed")

from matching.explore.files import Document, ModelDocument
from modelling.errors import InputError

TEXT = """\
# A drive on a bench.
title = "Bench"            # shown in reports

[inertias.motor]
J = 0.1                    # from the data sheet
[inertias.load]
J = "1.0 kg*m^2"

[shafts.link]
between = ["motor", "load"]
stiffness = { value = "200 N*m/deg", tolerance = 0.1 }   # measured
damping = 0.5

[[effects]]                # found by diagnosis
kind = "backlash"
at = "shafts.link"
gap = 0.02                 # total
"""


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "model.toml"
    path.write_bytes(TEXT.encode())
    return ModelDocument(path)


def test_a_value_is_changed_where_it_stands_and_all_else_stays(model):
    model.set_text("inertias.motor.J", "0.12")
    model.set_text("shafts.link.backlash.gap", "0.5 deg")
    assert model.text == TEXT.replace("J = 0.1  ", "J = 0.12  ").replace("gap = 0.02  ", 'gap = "0.5 deg"  ')
    assert model.system.parameters["shafts.link.backlash.gap"].value == pytest.approx(0.5 * 3.141592653589793 / 180)


def test_a_slider_writes_in_the_unit_of_the_file_and_keeps_the_tolerance(model):
    model.set_value("shafts.link.stiffness", 12000.0)
    assert 'value = "209.44 N*m/deg", tolerance = 0.1 }   # measured' in model.text
    stiffness = model.system.parameters["shafts.link.stiffness"]
    assert stiffness.value == pytest.approx(12000, rel=1e-5)
    assert stiffness.upper == pytest.approx(13200, rel=1e-5)


def test_a_quantity_that_the_file_leaves_out_is_added(model):
    assert model.written("inertias.motor.drag") == "0"
    model.set_text("inertias.motor.drag", "0.01")
    assert model.system.parameters["inertias.motor.drag"].value == 0.01
    assert model.undo()
    assert model.text == TEXT


def test_changes_are_named_with_both_values_and_undone_one_by_one(model):
    model.set_text("inertias.motor.J", "0.12")
    model.set_text("inertias.motor.J", "0.13")
    model.set_text("inertias.load.J", "2")
    assert model.changes == {"inertias.motor.J": (0.1, 0.13), "inertias.load.J": (1.0, 2.0)}
    assert model.changed_parts == {"inertias.motor", "inertias.load"}
    model.undo()
    model.undo()
    assert model.changes == {"inertias.motor.J": (0.1, 0.12)}
    model.undo()
    assert not model.changed
    assert not model.undo()
    assert model.text == TEXT


@pytest.mark.parametrize(
    ("name", "text", "wrong"),
    [
        ("inertias.motor.J", "-1", "greater than 0"),
        ("inertias.motor.J", "3 N*m", "unit"),
        ("inertias.motor.J", "much", "is no"),
        ("inertias.motor.j", "1", "inertias.motor.J"),
    ],
)
def test_what_is_wrong_is_said_in_one_line_and_changes_nothing(model, name, text, wrong):
    with pytest.raises(InputError, match=wrong):
        model.set_text(name, text)
    assert model.text == TEXT
    assert not model.changes


def test_saving_writes_the_text_and_refuses_where_another_program_wrote(model):
    model.set_text("inertias.motor.J", "0.12")
    model.save()
    assert model.path.read_bytes().decode() == model.text != TEXT
    assert not model.changes
    model.path.write_text("# other\n" + TEXT)
    model.set_text("inertias.motor.J", "0.2")
    with pytest.raises(InputError, match="changed by another program"):
        model.save()
    assert model.path.read_text().startswith("# other")


def test_any_table_is_edited_by_its_keys(tmp_path):
    path = tmp_path / "budget.toml"
    path.write_text("[inputs.a]\nvalue = 1 # one\n[[list]]\nx = 1\n[[list]]\nx = 2 # two\n")
    budget = Document(path)
    budget.change(("list", 1, "x"), 3)
    assert budget.text == "[inputs.a]\nvalue = 1 # one\n[[list]]\nx = 1\n[[list]]\nx = 3 # two\n"


MAP = """
[inputs.pedal]
on = "motor"

[[effects]]
kind = "torque_map"
at = "inputs.pedal"
speed = ["0 1/min", "3000 1/min"]
pedal = [0, "50 %", 1]
torque = [[0, 60, 100], [-20, 50, 90]]   # of the engine
"""


def test_an_element_of_a_list_is_changed_where_it_stands(tmp_path):
    path = tmp_path / "model.toml"
    path.write_text(TEXT + MAP)
    model = ModelDocument(path)
    model.set_text("inputs.pedal.torque_map.torque_2_3", "95")
    model.set_text("inputs.pedal.torque_map.pedal_2", "40 %")
    assert "torque = [[0, 60, 100], [-20, 50, 95]]   # of the engine" in model.text
    assert 'pedal = [0, "40 %", 1]' in model.text
    assert model.system.parameters["inputs.pedal.torque_map.torque_2_3"].value == 95
    with pytest.raises(InputError, match="the values of pedal do not increase"):
        model.set_text("inputs.pedal.torque_map.pedal_2", "1")
