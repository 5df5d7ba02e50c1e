"""From a road recording to a tuned residual vehicle, as the page says: in a shell and in the browser."""

import json
import re
import shlex
import tomllib
from pathlib import Path

import pytest
from explore import road_drive
from explore.browser import browser_path, explored, opened_page, served
from structure.imports import ROOT

import rigmatch as rm
from matching.cli import main
from matching.report.bed import found_on_drivetrain

PAGE = ROOT / "docs" / "howto" / "road_recording.md"
TRUE = {
    "shafts.side_shafts.stiffness": road_drive.SIDE, "shafts.tyres.stiffness": road_drive.TYRES,
    "inertias.body.J": road_drive.BODY, "inertias.motor.J": road_drive.MOTOR,
}  # fmt: skip
UNKNOWN = {"stiffness = 15000": 0.3, "damping = 22": 0.5, "stiffness = 32000": 0.3, "J = 150": 0.2, "J = 0.04": 0.2}
LABELS = """() => { const found = []; const walk = (root) => { for (const one of root.querySelectorAll('*')) {
    if (one.shadowRoot) walk(one.shadowRoot);
    const field = one.tagName === 'LABEL' && one.parentElement.querySelector('input, select');
    const ends = (each) => [each.top, each.bottom, each.left, each.right];
    if (field && one.clientHeight)
        found.push([one.textContent, ends(one.getBoundingClientRect()), ends(field.getBoundingClientRect())]); } };
    walk(document); return found; }"""


def folder(path: Path) -> Path:
    """A case whose vehicle is not known, with the drive beside it."""
    rm.new(path)
    vehicle = (path / "vehicle.toml").read_text(encoding="utf-8")
    for stated, tolerance in UNKNOWN.items():
        key, value = stated.split(" = ")
        assert re.search(rf"{stated}\b(?!\.)", vehicle), stated
        vehicle = re.sub(rf"{stated}\b", f"{key} = {{ value = {value}, tolerance = {tolerance} }}", vehicle, count=1)
    (path / "vehicle.toml").write_text(vehicle, encoding="utf-8")
    road_drive.german(path / "strasse.csv")
    return path


def values(vehicle: Path) -> dict[str, float]:
    """What a vehicle's file states of the quantities that the drive tells."""
    known = rm.load(vehicle).parameters
    return {name: known[name].value for name in TRUE}


def check_found(vehicle: Path, content: dict) -> None:
    """Every value is told within its own half-width (k = 2, a half more), and is nearer than it was."""
    widths = {row["name"].partition(".")[2]: row for row in content["vehicle"]["values"]}
    for name, value in values(vehicle).items():
        row = widths[name]
        assert row["found"], name
        assert abs(value - TRUE[name]) <= 1.5 * row["half_width"], name
        assert abs(value - TRUE[name]) < abs(row["before"] - TRUE[name]), name


def commands() -> list[list[str]]:
    """The two commands of the page."""
    text = PAGE.read_text(encoding="utf-8")
    lines = re.search(r"^rigmatch identify .*\n.*", text, re.MULTILINE)[0]
    return [shlex.split(line)[1:] for line in lines.splitlines()]


@pytest.mark.long
@pytest.mark.timeout(600)
def test_two_commands_from_a_german_csv_to_a_tuned_residual_vehicle(tmp_path, monkeypatch):
    monkeypatch.chdir(folder(tmp_path / "first"))
    assert main(["show", "strasse.csv", "--model", "vehicle.toml", "--out", "."]) == 0
    both = commands()
    assert [words[0] for words in both] == ["identify", "match"]
    for words in both:
        assert main(words) == 0
    check_found(Path("out/identify/vehicle.toml"), json.loads(Path("out/identify/identification.json").read_text()))
    assert json.loads(Path("out/match/result.json").read_text())["status"] == "matched"
    tuned = tomllib.loads(Path("out/match/residual_vehicle.toml").read_text())
    assert set(tuned["inertias"]) == {"wheels", "body"}
    page = Path("out/identify/report.html").read_text(encoding="utf-8")
    assert "What the recordings tell of each part" in page


@pytest.mark.long
@pytest.mark.timeout(900)
def test_the_same_in_the_browser(tmp_path):
    browser_path()
    case = folder(tmp_path / "first") / "case.toml"
    with (
        served(explored(case), out=tmp_path / "first" / "out") as address,
        opened_page(address) as (page, complaints),
    ):
        page.get_by_role("tab", name="Road").click()
        page.locator("input[type=file]").set_input_files(case.parent / "strasse.csv")
        page.get_by_text("5500 samples", exact=False).wait_for()
        assert page.get_by_label("body speed (speed)").input_value() == "n_Rad"
        page.get_by_role("button", name="Identify").click()
        page.get_by_role("link", name="Open the report").wait_for(timeout=300_000)
        frame = page.frame_locator("iframe[title=Identification]")
        frame.locator("#figure-drivetrain").wait_for()
        page.get_by_role("button", name="Go on to Match").click()
        page.get_by_role("button", name="Run the match").wait_for()
        for text, label, field in page.evaluate(LABELS):  # a label stands on the frame, not over the value
            assert label[1] - field[0] < 0.4 * (field[1] - field[0]), text
            assert label[3] <= field[3] + 1, text
        page.get_by_role("button", name="Run the match").click()
        page.get_by_role("link", name="Open the report").wait_for(timeout=300_000)
        assert complaints == []
    content = json.loads((tmp_path / "first" / "out" / "identify" / "identification.json").read_text())
    check_found(tmp_path / "first" / "identified" / "vehicle.toml", content)
    result = json.loads((tmp_path / "first" / "out" / "match" / "result.json").read_text())
    assert result["status"] == "matched"


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
def test_the_identified_case_goes_to_match_in_a_folder_of_its_own(tmp_path, monkeypatch):
    pytest.importorskip("panel")
    from matching.explore.files import opened
    from matching.explore.road import RoadTab

    monkeypatch.chdir(tmp_path)
    rm.new(tmp_path / "first")
    rm.new(tmp_path / "out" / "identify")
    vehicle = tmp_path / "out" / "identify" / "vehicle.toml"
    vehicle.write_text(vehicle.read_text(encoding="utf-8").replace("J = 150", "J = 158"), encoding="utf-8")
    went = []
    workspace = opened([tmp_path / "first" / "case.toml"], tmp_path / "out")
    tab = RoadTab(workspace, lambda: went.append(workspace.case.path))
    tab.identify.start()
    assert "no recording is open" in tab.identify.message.object
    tab._show_identified(None)
    assert tab.case_as.value == "identified"
    tab.case_as.value = "first"
    tab._hand_over()
    assert "exists" in tab.handed.object
    tab.case_as.value = "../outside"
    tab._hand_over()
    assert "lies outside" in tab.handed.object
    tab.case_as.value = "identified"
    tab._hand_over()
    assert went == [tmp_path / "identified" / "case.toml"]
    assert workspace.models["vehicle"].system.parameters["inertias.body.J"].value == 158.0
    assert not (tmp_path / "first" / "out").exists()


def test_values_are_drawn_at_their_parts():
    """Of a stand-in for an identification: told values with their half-widths, and those that are not told."""
    from types import SimpleNamespace

    folder_ = ROOT / "examples" / "from_recordings"
    rows = [
        {"name": "vehicle.inertias.body.J", "before": 100.0, "after": 123.456, "half_width": 1.2, "found": True},
        {"name": "rig.shafts.side.stiffness", "before": 1.0, "after": 4260.0, "half_width": 34.0, "found": True},
        {"name": "rig.inertias.motor.J", "before": 1.0, "after": 2.0, "half_width": 0.1, "found": False},
    ]
    case = rm.load_case(folder_ / "case.toml")
    known = SimpleNamespace(case=case, to_dict=lambda: {"bed": None, "vehicle": {"values": rows}})
    texts = [text.get_text() for axes in found_on_drivetrain(known).axes for text in axes.texts]
    assert any("J: 123.5 ± 1.2" in text for text in texts)
    assert any("k: 4260 ± 34" in text for text in texts)
    assert any("J: not told" in text for text in texts)


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
def test_the_step_stays_open_where_an_example_is_opened(tmp_path, monkeypatch):
    pytest.importorskip("panel")
    from matching.explore.files import opened
    from matching.explore.page import FilesBar

    monkeypatch.chdir(tmp_path)
    steps = []
    bar = FilesBar(opened([], tmp_path / "out"), steps.append)
    bar.example("budget", "Validity").clicks += 1
    bar.example("case", "Bed").clicks += 1
    assert steps == ["Validity", "Bed"]
