"""Forms and map in a real browser: what is typed while the page answers is kept, a click on a map is answered."""

import shutil
import tomllib
from pathlib import Path

import pytest
from explore.browser import browser_path, opened_page, served
from structure.imports import ROOT

FORMS = (  # tab, labels of two fields that follow each other, where their values stand in which file
    ("Drivetrain", ("J [kg·m²]", "drag [N·m·s/rad]"), "case/vehicle.toml", ("inertias", "motor"), ("J", "drag")),
    ("Match", ("dead time [s]", "inverter lag [s]"), "case/case.toml", ("loop",), ("dead_time", "inverter_lag")),
    ("Validity", ("R value", "R half-width"), "budget.toml", ("inputs", "R"), ("value", "half_width")),
)
BUDGET = """\
[measurand]
name = "Z"
formula = "R + L"
[inputs.R]
value = 1.0
half_width = 0.1
[inputs.L]
value = 2.0
half_width = 0.1
"""
MAP = {
    "x": {"name": "loop.dead_time", "unit": "s", "values": [0.001, 0.004], "value_in_case": 0.003},
    "y": {"name": "loop.inverter_lag", "unit": "s", "values": [0.002, 0.008], "value_in_case": 0.002},
    "points": [{"error": error, "status": "matched", "limits": []} for error in (0.11, 0.22, 0.33, 0.44)],
}
ANSWERED = """
import sys
import rigmatch as rm
from matching.explore import page
from matching.explore.jobs import Ended

class ComputedMap(page.MapView):
    def panel(self):
        self.show_map({map})
        return super().panel()

class AnsweredMatch(page.MatchTab):
    def panel(self):
        self._show(Ended(0, {{"adapters": [{{"name": "rig.shafts.flange.stiffness", "ordered": {order}}}]}}, ""))
        return super().panel()

page.MapView = ComputedMap
page.report_frame = lambda *_, **__: ""
page.MatchTab = AnsweredMatch
explorer = rm.explore(*sys.argv[1:-1], out=sys.argv[-1])
print(explorer.address, file=sys.stderr, flush=True)
explorer.wait()
"""
FIRST, SECOND = 0.00375, 0.00225
ORDERED = 312_500.0  # N·m/rad


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    browser_path()
    folder = tmp_path_factory.mktemp("typing")
    shutil.copytree(ROOT / "matching" / "starter", folder / "case")
    (folder / "budget.toml").write_text(BUDGET)
    files = (folder / "case" / "case.toml", folder / "budget.toml")
    script = ("-c", ANSWERED.format(map=MAP, order=ORDERED), *map(str, files))
    with served(script, out=folder / "out") as address, opened_page(address) as (page, complaints):
        yield folder, page, complaints


@pytest.mark.parametrize(("tab", "labels", "file", "tables", "keys"), FORMS)
def test_of_two_values_typed_quickly_none_is_lost(opened, tab, labels, file, tables, keys):
    """The answer to the first value comes in the middle of typing the second, however fast the machine is."""
    folder, page, complaints = opened
    page.get_by_role("tab", name=tab).click()
    page.get_by_label(labels[0]).first.fill(str(FIRST))
    page.keyboard.press("Tab")
    typed = str(SECOND)
    page.keyboard.type(typed[:4])
    page.get_by_text(f" is {FIRST}").wait_for()
    page.keyboard.type(typed[4:])
    page.get_by_role("button", name="Save").first.click()
    page.get_by_text(f"Saved: {Path(file).name}").wait_for()
    table = tomllib.loads((folder / file).read_text())
    for name in tables:
        table = table[name]
    assert [table[key] for key in keys] == [FIRST, SECOND]
    assert complaints == []


def test_a_wrong_text_is_marked_and_not_saved_until_it_is_right(opened):
    folder, page, complaints = opened
    page.get_by_role("tab", name="Match").click()
    before = (folder / "case" / "case.toml").read_text()
    field = page.get_by_label("sample time [s]")
    field.fill("-1")
    page.get_by_role("button", name="Save").first.click()
    page.get_by_text("sample time [s]: was not taken").wait_for()
    assert (folder / "case" / "case.toml").read_text() == before
    assert field.input_value() == "-1"
    page.get_by_role("button", name="Undo").click()
    page.get_by_text("The value in the file is shown again").wait_for()
    assert field.input_value() == "0.001"
    assert complaints == []


def test_a_click_on_a_point_of_the_map_is_answered(opened):
    _, page, complaints = opened
    page.reload()  # the page as it is first opened, whatever was done on it before
    page.get_by_role("tab", name="Match").click()
    page.get_by_role("button", name="Answer from the map").wait_for()  # the tab is there, not the one before it
    figure, answer = page.locator(".bk-Canvas").first, page.get_by_text("From the map: response error about 0.33")
    for _ in range(30):  # what lies above the figure may still grow and move it while the mouse is on its way
        figure.scroll_into_view_if_needed()
        box = figure.bounding_box()
        figure.click(position={"x": 0.3 * box["width"], "y": 0.3 * box["height"]})  # upper left of two by two
        page.wait_for_timeout(500)
        if answer.is_visible():
            break
    answer.wait_for()
    assert page.get_by_label("dead time [s]").last.input_value() == "0.001"
    assert page.get_by_label("inverter lag [s]").last.input_value() == "0.008"
    assert complaints == []


def test_the_order_is_taken_into_the_rig_and_saved_with_it(opened):
    folder, page, complaints = opened
    page.get_by_role("tab", name="Match").click()
    page.get_by_role("button", name="Take the order into the rig").click()
    page.get_by_text("Taken into rig.toml, not saved yet: flange, stiffness").wait_for()
    before = (folder / "case" / "rig.toml").read_text()
    assert tomllib.loads(before)["shafts"]["flange"]["stiffness"]["value"] == 360_000
    page.get_by_role("tab", name="Drivetrain").click()
    page.get_by_text("360000 N·m/rad →").wait_for()
    page.get_by_role("button", name="Save").first.click()
    page.get_by_text("Saved: rig.toml").wait_for()
    assert (folder / "case" / "rig.toml").read_text() == before.replace("value = 360000", "value = 312500.0")
    assert complaints == []


def test_the_structure_is_a_choice(opened):
    _, page, complaints = opened
    page.get_by_role("tab", name="Match").click()
    structure = page.get_by_role("combobox", name="structure")
    structure.wait_for()
    assert sorted(structure.locator("option").all_inner_texts()) == ["model_based", "observer", "pi"]
    structure.select_option("pi")
    page.get_by_text("structure is pi").wait_for()
    page.get_by_role("button", name="Undo").click()
    page.get_by_text("The last change is taken back").wait_for()
    assert structure.input_value() == "model_based"
    assert complaints == []
