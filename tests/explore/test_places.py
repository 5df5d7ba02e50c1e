"""Parts that were moved in the drawing: where they stand then, and the file beside the model that keeps it."""

import json

import pytest

pytest.importorskip("panel")

import rigmatch as rm
from matching.explore.files import opened
from matching.explore.modes import DrivetrainTab, sketches
from matching.explore.places import FURTHEST, Places
from modelling.errors import InputError

pytestmark = pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
TREE = """
[inertias.motor]
J = 0.1
[inertias.middle]
J = 0.2
[inertias.left]
J = 1
[inertias.right]
J = 1
[inertias.far]
J = 2
[shafts.a]
between = ["motor", "middle"]
stiffness = 100
[shafts.b]
between = ["middle", "left"]
stiffness = 100
[shafts.c]
between = ["middle", "right"]
stiffness = 100
[shafts.d]
between = ["right", "far"]
stiffness = 100
"""


@pytest.fixture
def model(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tree.toml").write_text(TREE)
    return tmp_path / "tree.toml"


def places(tab, names=("motor", "middle", "left", "right", "far")):
    """Column and lane of every inertia as it is drawn."""
    drawn = sketches(tab.workspace)["model"].drawing.layout
    return {name: (drawn.column[name], drawn.lane[name]) for name in names}


def press(tab, name):
    next(button for button in tab.moves if button.name == name).clicks += 1


def test_a_part_is_moved_with_what_hangs_on_it_and_stands_there_again(model, tmp_path):
    tab = DrivetrainTab(opened([model], tmp_path / "out"), lambda: None)
    before = places(tab)
    tab.select("model", "inertias.right")
    press(tab, "Right")
    press(tab, "Down")
    after = places(tab)
    for name in ("right", "far"):
        assert after[name] == (before[name][0] + 1, before[name][1] + 1)
    for name in ("motor", "middle", "left"):
        assert after[name] == before[name]
    assert "places in the drawing" in tab.changes.object
    assert not (tmp_path / "tree.places.json").exists()
    assert tab.editing._save() == "Saved: tree.places.json"
    assert json.loads((tmp_path / "tree.places.json").read_text()) == {"right": {"right": 1, "down": 1}}
    assert model.read_text() == TREE
    assert places(DrivetrainTab(opened([model], tmp_path / "out"), lambda: None)) == after
    press(tab, "Left")
    press(tab, "Up")
    assert places(tab) == before
    tab.editing._save()
    assert json.loads((tmp_path / "tree.places.json").read_text()) == {}


def test_a_part_does_not_lie_over_another_or_left_of_what_it_hangs_on(model, tmp_path):
    tab = DrivetrainTab(opened([model], tmp_path / "out"), lambda: None)
    before = places(tab)
    tab.select("model", "inertias.right")
    for way, said in (("Up", "would lie over another part"), ("Left", "left of what it hangs on")):
        press(tab, way)
        assert said in tab.editing.message.object
    tab.select("model", "inertias.motor")
    press(tab, "Right")  # all of the drawing: nothing is seen of it
    assert "does not move" in tab.editing.message.object
    assert places(tab) == before
    tab.select("model", "shafts.a")
    assert not tab.moving.visible
    with pytest.raises(InputError, match="is no inertia"):
        tab._move(1, 0)


def test_a_part_that_is_gone_is_no_fault_and_unsaved_places_are_not_lost(model, tmp_path):
    (tmp_path / "tree.places.json").write_text('{"gone": {"right": 1, "down": 0}}')
    workspace = opened([model], tmp_path / "out")
    tab = DrivetrainTab(workspace, lambda: None)
    assert places(tab)["motor"][0] == 0
    tab.select("model", "inertias.far")
    press(tab, "Down")
    rm.new(tmp_path / "other")
    with pytest.raises(InputError, match="not saved"):
        workspace.open(tmp_path / "other" / "case.toml")


@pytest.mark.parametrize("text", [
    "", "[]", '{"motor": 1}', '{"motor": {"right": 1}}', '{"motor": {"right": -1, "down": 0}}',
    '{"motor": {"right": 0.5, "down": 0}}', f'{{"motor": {{"right": {FURTHEST + 1}, "down": 0}}}}',
])  # fmt: skip
def test_a_file_that_holds_no_places_is_one_line(model, text):
    model.with_name("tree.places.json").write_text(text)
    with pytest.raises(InputError, match=r"tree\.places\.json.*write .*right.*down.*or delete the file"):
        Places(model)
