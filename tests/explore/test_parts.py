"""Parts added, removed and renamed on the drawing: the file stays a model, and comments stay."""

import math
from pathlib import Path

import pytest

pytest.importorskip("tomlkit", reason="the packages of the explorer are not installed")


import rigmatch as rm
from matching.explore.files import (
    EMPTY,
    ModelDocument,
    case_tables,
    listed,
    new_file,
    number_or_text,
    opened,
    save_as,
    within,
    write_case,
)
from matching.explore.live import WhatIf
from matching.explore.parts import ADDABLE, add_effect, add_part, effects_for, remove_effect, remove_part, rename_part
from matching.match.case_file import case_from_tables, load_case
from modelling.errors import InputError

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    rm.new(tmp_path / "case")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "case"


@pytest.fixture
def rig(folder):
    return ModelDocument(folder / "rig.toml")


def test_an_inertia_on_a_shaft_is_added_and_removed_again(rig):
    before = rig.text
    add_part(rig, "inertia on a shaft", "flywheel", "rotor")
    assert rig.system["inertias.flywheel"].J.value == rig.system["inertias.rotor"].J.value
    assert rig.system["shafts.flywheel_shaft"].between == ("rotor", "flywheel")
    assert "# of the dynamometer" in rig.text
    assert rig.other_parts[0] == ["inertias.flywheel", "shafts.flywheel_shaft"]
    assert set(remove_part(rig, "inertias.flywheel")) == {"inertias.flywheel", "shafts.flywheel_shaft"}
    assert "inertias.flywheel" not in rig.system.places()
    assert rig.undo()
    assert rig.undo()
    assert rig.text == before


@pytest.mark.parametrize(("kind", "at", "other"), [
    ("shaft between inertias", "motor", "rotor"), ("gear between inertias", "motor", "rotor"),
    ("torque on an inertia", "adapter", ""), ("speed sensor of an inertia", "adapter", ""),
    ("torque sensor of a shaft", "rotor_shaft", ""),
])  # fmt: skip
def test_other_parts_are_added_or_refused_with_the_reason(rig, kind, at, other):
    before = rig.text
    if "between" in kind:  # it closes a loop over the reduction: nothing could turn
        with pytest.raises(InputError, match="locks"):
            add_part(rig, kind, "bypass", at, other)
        assert rig.text == before
        return
    add_part(rig, kind, "new_one", at, other)
    assert f"{ADDABLE[kind]}.new_one" in rig.system.places()
    with pytest.raises(InputError, match="exists"):
        add_part(rig, kind, "new_one", at, other)
    with pytest.raises(InputError, match="is no name"):
        add_part(rig, kind, "new one", at, other)


def test_an_effect_is_added_with_its_values_and_removed_again(rig):
    before = rig.text
    assert effects_for(rig.system, "shafts.rotor_shaft")["backlash"] == {"gap": "rad"}
    with pytest.raises(InputError, match="is empty"):
        add_effect(rig, "backlash", "shafts.rotor_shaft", {"gap": " "})
    with pytest.raises(InputError, match=r"gap"):
        add_effect(rig, "backlash", "shafts.rotor_shaft", {"gap": "3 N*m"})
    assert rig.text == before
    add_effect(rig, "backlash", "shafts.rotor_shaft", {"gap": "0,5 deg"})
    add_effect(rig, "coulomb_friction", "inertias.rotor", {"torque": "2"})
    assert rig.system.parameters["shafts.rotor_shaft.backlash.gap"].value == pytest.approx(math.radians(0.5))
    assert rig.other_parts[0] == ["shafts.rotor_shaft.backlash", "inertias.rotor.coulomb_friction"]
    assert "backlash" not in effects_for(rig.system, "shafts.rotor_shaft")
    rig.set_text("shafts.rotor_shaft.backlash.gap", "0.02")
    remove_effect(rig, "backlash", "shafts.rotor_shaft")
    assert [effect.kind for effect in rig.system.effects] == ["coulomb_friction"]
    remove_effect(rig, "coulomb_friction", "inertias.rotor")
    assert "effects" not in rig.content
    while rig.undo():
        pass
    assert rig.text == before


def test_an_empty_model_is_drawn_from_its_first_inertia_on_and_gets_a_title(folder, tmp_path):
    drawn = ModelDocument(new_file(tmp_path, EMPTY, "drawn"))
    drawn.set_title("Two masses")
    assert drawn.unsaved == 1
    add_part(drawn, "inertia on a shaft", "flywheel", "motor")
    add_part(drawn, "torque sensor of a shaft", "torque", "flywheel_shaft")
    drawn.save()
    saved = rm.load(tmp_path / "drawn.toml")
    assert saved.title == "Two masses"
    assert len([*rm.modes(saved)]) == 2
    drawn.set_title("")
    assert "title" not in drawn.content


def test_what_hangs_on_a_part_goes_with_it(rig):
    gone = remove_part(rig, "inertias.rotor")
    assert set(gone) == {
        "inertias.rotor",
        "shafts.flange",
        "inputs.dyno",
        "sensors.rotor_speed",
        "sensors.flange_torque",
    }
    assert not set(gone) & set(rig.system.places())


@pytest.mark.parametrize(("place", "new"), [
    ("shafts.side_shafts", "half_shafts"), ("inputs.motor_torque", "drive"), ("sensors.motor_speed", "n_motor"),
    ("inertias.motor", "engine"), ("shafts.flange", "hub"), ("inputs.dyno", "machine"), ("gears.reduction", "gear"),
])  # fmt: skip
def test_a_renamed_part_is_renamed_in_every_file_of_the_case(folder, place, new):
    """The case stays the same problem: the same moves and targets, and the renamed part where the old one was."""
    workspace = opened([folder / "case.toml"], folder / "out")
    texts = [document.text for document in workspace.documents]
    rename_part(workspace, "rig", place, new)
    case = case_from_tables(case_tables(workspace, workspace.case.content), str(workspace.case.path))
    table = place.partition(".")[0]
    assert f"{table}.{new}" in case.rig.places()
    assert place not in (*case.rig.places(), *case.vehicle.places())
    before = load_case(folder / "case.toml")
    assert len(case.moves) == len(before.moves)
    assert len(case.compared) == len(before.compared)
    assert load_case(write_case(workspace)).limits.keys() == case.limits.keys()
    assert workspace.models["rig"].undo()  # once, and every file is as before
    assert [document.text for document in workspace.documents] == texts


def test_files_are_made_opened_and_copied_within_the_folder_only(folder, tmp_path):
    home = tmp_path
    for name in ("../x", "/etc/passwd", "", ".", "a/../.."):
        with pytest.raises(InputError, match="outside"):
            within(home, name)
    workspace = opened([folder / "case.toml"], folder / "out")
    for kind in ("model", "budget", "fidelity case"):
        path = new_file(home, kind, f"my_{kind[:5].strip()}")
        workspace.open(path)
        with pytest.raises(InputError, match="exists"):
            new_file(home, kind, f"my_{kind[:5].strip()}")
    assert workspace.case is None
    workspace.open(new_file(home, "case", "second"))
    workspace.models["rig"].set_text("inertias.rotor.J", "2,5")
    with pytest.raises(InputError, match="not saved"):
        workspace.open(folder / "case.toml")
    copied = save_as(workspace, "case", "third")
    assert load_case(copied).rig.parameters["inertias.rotor.J"].value == 2.5
    assert load_case(home / "second" / "case.toml").rig.parameters["inertias.rotor.J"].value != 2.5
    assert {"my_model.toml", "second/case.toml", "third/case.toml"} <= set(listed(home))


@pytest.mark.parametrize(("text", "value"), [
    ("0,05", 0.05), ("1,5 kN*m", "1.5 kN*m"), ("-2,25", -2.25), ("0,125", 0.125), ("1,000", "1,000"),
    ("1,5 t vehicle", "1,5 t vehicle"), ("3", 3), ("30 km/h", "30 km/h"),
])  # fmt: skip
def test_decimal_commas_are_understood_where_they_are_one(text, value):
    assert number_or_text(text) == value


def test_gears_of_three_members_and_a_shaft_by_its_drawing(folder, tmp_path):
    """The stiffness is GJ/L, and a dimension is written in the unit that the file has for it."""
    names = ("motor", "ring", "carrier", "left", "right")
    text = "".join(f'[inertias.{name}]\nJ = 0.1\n[inputs.on_{name}]\non = "{name}"\n' for name in names)
    (tmp_path / "drawn.toml").write_text(text, encoding="utf-8")
    drawn = ModelDocument(tmp_path / "drawn.toml")
    before = drawn.text
    add_part(drawn, "shaft by its drawing", "bar", "left", "right")
    assert drawn.system.parameters["shafts.bar.stiffness"].value == pytest.approx(79.3e9 * math.pi / 32 * 0.03**4 / 0.3)
    assert "shafts.bar.diameter" in drawn.values_of("shafts.bar")
    assert "shafts.bar.stiffness" not in drawn.values_of("shafts.bar")
    drawn.set_text("shafts.bar.diameter", "40 mm")
    assert drawn.written("shafts.bar.diameter") == "40 mm"
    drawn.set_value("shafts.bar.diameter", 0.05)
    assert drawn.written("shafts.bar.diameter") == "50 mm"
    assert drawn.system.parameters["shafts.bar.stiffness"].value == pytest.approx(79.3e9 * math.pi / 32 * 0.05**4 / 0.3)
    assert drawn.other_parts[0] == ["shafts.bar"]
    while drawn.text != before:
        assert drawn.undo()
    add_part(drawn, "planetary gear", "gear", "motor", "carrier", "ring")
    part = drawn.system["planetary_gears.gear"]
    assert (part.sun, part.carrier, part.ring, part.ratio.value) == ("motor", "carrier", "ring", 2.0)
    with pytest.raises(InputError):
        add_part(drawn, "differential", "other", "carrier", "carrier", "left")
    add_part(drawn, "differential", "split", "carrier", "left", "right")
    assert drawn.system["differentials.split"].ends == ("carrier", "left", "right")


def test_what_was_taken_back_is_made_again(rig, folder):
    """Several changes, one of them in two files at once; a new change ends what could be made again."""
    texts = [rig.text]
    for value in ("300000", "310000", "320000"):
        rig.set_text("shafts.flange.damping", value[:2])
        rig.set_text("inertias.rotor.J", f"1.{value[1]}")
        texts.append(rig.text)
    assert not rig.redo()
    for _ in range(4):
        rig.undo()
    assert rig.text == texts[1]
    assert rig.system.parameters["inertias.rotor.J"].value == 1.0
    while rig.redo():
        pass
    assert rig.text == texts[3]
    assert rig.system.parameters["inertias.rotor.J"].value == 1.2
    rig.undo()
    rig.set_text("inertias.rotor.J", "1.5")
    assert not rig.was_undone
    with pytest.raises(InputError):
        rig.set_text("inertias.rotor.J", "-1")
    assert rig.system.parameters["inertias.rotor.J"].value == 1.5
    workspace = opened([folder / "case.toml"], folder / "out")
    before = [document.text for document in workspace.documents]
    rename_part(workspace, "rig", "shafts.side_shafts", "half_shafts")
    after = [document.text for document in workspace.documents]
    assert workspace.models["rig"].undo()
    assert [document.text for document in workspace.documents] == before
    assert workspace.case.redo()
    assert [document.text for document in workspace.documents] == after


def test_a_gearbox_is_opened_edited_renamed_and_removed(tmp_path):
    """Ratios are edited where they stand in their list; a clutch is renamed with what names it."""
    file = tmp_path / "rig.toml"
    file.write_text((EXAMPLES / "gear_change" / "gearbox.toml").read_text(encoding="utf-8"), encoding="utf-8")
    rig = ModelDocument(file)
    rig.set_value("gearboxes.box.ratio_2", 7.0)
    assert "ratios = [10.05, 7.0]" in rig.text
    assert "# rad that a clutch gives way" in rig.text
    tried = WhatIf(rig)
    assert "inertias.gearbox.J" in tried.movable
    assert tried.live.modes().frequencies == pytest.approx(rm.modes(rig.system.in_gear(1)).frequencies)
    workspace = opened([file], tmp_path / "out")
    rename_part(workspace, "model", "inputs.clutch_low", "first")
    rename_part(workspace, "model", "inertias.gearbox", "input")
    (rig,) = workspace.models.values()
    box = rig.system["gearboxes.box"]
    assert (box.capacities, box.between) == (("first", "clutch_high"), ("input", "behind"))
    with pytest.raises(InputError, match=r"gearboxes\.box\.capacities: 'first'"):
        remove_part(rig, "inputs.first")
    add_part(rig, "shaft between inertias", "bridge", "input", "behind")
    assert set(remove_part(rig, "gearboxes.box")) == {"gearboxes.box", "inputs.first", "inputs.clutch_high"}
    assert not rig.system.gearboxes
