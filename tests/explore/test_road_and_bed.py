"""The steps Road and Bed without a browser: several recordings, cursors, computed signals, what a run is asked for."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("panel")

from structure.imports import ROOT

from matching.explore.bed import BedTab
from matching.explore.files import opened
from matching.explore.jobs import Ended
from matching.explore.road import RoadTab
from matching.explore.signals import Computed
from modelling.errors import InputError

pytestmark = pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
FOLDER = ROOT / "examples" / "from_recordings"
TIME = np.arange(0, 2, 0.01)
SPEED, TORQUE = 600 + 90 * TIME, 20 - 5 * TIME  # 1/min, N·m


def log(path: Path, head: str = "time [s],M_EM [N*m],n EM [1/min]", shift: float = 0.0) -> Path:
    rows = "\n".join(f"{t:.3f},{m:.9g},{n + shift:.9g}" for t, m, n in zip(TIME, TORQUE, SPEED, strict=True))
    path.write_text(f"{head}\n{rows}\n", encoding="utf-8")
    return path


@pytest.fixture
def road(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tab = RoadTab(opened([FOLDER / "case.toml"], tmp_path / "out"))
    tab.open(log(tmp_path / "first.csv"))
    return tab


def test_recordings_with_the_same_columns_are_drawn_and_identified_together(road, tmp_path):
    second = log(tmp_path / "second.csv", shift=60.0)
    road.open(second)
    assert road.used.value == [second, tmp_path / "first.csv"]
    road.signal.value = "n EM"
    assert [np.max(source.data["y"]) for source in road.sources[:2]] == pytest.approx([SPEED[-1] + 60, SPEED[-1]])
    words = road._words()
    assert words[2:5] == ["--vehicle", str(second), str(tmp_path / "first.csv")]
    assert f"--vehicle {second} {tmp_path / 'first.csv'}" in road.same.object
    other = log(tmp_path / "other.csv", "time [s],M_EM [N*m],n EM [rad/s]")
    road.open(other)  # of another unit: it is used alone
    assert road.used.value == [other]
    road.used.value = [other, second]
    assert "second.csv has other columns or units than other.csv" in road.message.object
    assert road.used.value == [other]
    road.used.value = [second]
    road.role.value = "rig"
    assert road._words()[2] == "--bed"


def test_cursors_read_the_differences_of_every_recording(road, tmp_path):
    road.open(log(tmp_path / "second.csv", shift=60.0))
    road.signal.value = "n EM"
    road.at[0].value = "500 ms"
    road.at[1].value = "1.5"
    assert road.cursors == (0.5, 1.5)
    assert "Δt = 1 s, 1/Δt = 1 Hz" in road.read.object
    rows = [row for row in road.read.object.split("<tr>") if ".csv" in row]
    for row, shift in zip(rows, (60, 0), strict=True):
        assert all(f">{value + shift * (k < 2):g}<" in row for k, value in enumerate((645, 735, 90)))
    road._tapped(1.2)  # nearer to B
    assert road.cursors == (0.5, 1.2)
    road._tapped(0.1)
    assert road.cursors == (0.1, 1.2)
    road.at[0].value = "5 N*m"
    assert "Cursor A" in road.said.object
    assert road.cursors == (0.1, 1.2)
    road._tapped(3.0)
    assert "–" in road.read.object  # outside the recording there is no value


def test_a_computed_signal_is_in_si_and_drawn_as_any_other(road):
    road.formula.value = "M_EM * {n EM} + 2"
    road.compute.clicks += 1
    assert road.signal.value == "M_EM * {n EM} + 2"
    power = TORQUE * SPEED * np.pi / 30 + 2
    assert np.interp(TIME, road.source.data["t"], road.source.data["y"]) == pytest.approx(power)
    assert road.figure.yaxis.axis_label.text.endswith("[SI]")
    road.open(road.file.path)
    assert "M_EM * {n EM} + 2" in road.signal.options


@pytest.mark.parametrize(("text", "said"), [
    ("__import__('os').getcwd()", "is not mathematics|is no function|not among"), ("M_EM.real", "is not mathematics"),
    ("torque + 1", "'torque' is not among the columns; columns are M_EM, \\{n EM\\}"), ("3 + 4", "names no column"),
    ("M_EM +", "is no formula"), ("{n EX} * 2", "formula"), ("", "is no formula"),
])  # fmt: skip
def test_a_text_that_is_no_formula_of_columns_is_refused(text, said):
    with pytest.raises(InputError, match=said):
        Computed.of(text, {"M_EM": "N*m", "n EM": "1/min"})


def test_a_computed_signal_has_no_value_where_its_formula_has_none():
    made = Computed.of("log(a) / (a - 1)", {"a": ""})
    found = made.values({"a": np.array([-1.0, 1.0, 2.0])})
    assert np.isnan(found).tolist() == [True, True, False]
    assert found[2] == pytest.approx(np.log(2))


@pytest.fixture
def bed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return BedTab(opened([FOLDER / "case.toml"], tmp_path / "out"))


def test_the_bed_begins_with_the_match_as_long_as_the_case_is_the_same(bed, tmp_path):
    workspace, match = bed.workspace, str(tmp_path / "out" / "match")
    assert bed._words()[1] == str(FOLDER / "case.toml")
    workspace.tasks["Run the match"] = SimpleNamespace(ended=Ended(0, {"status": "matched"}, ""))
    assert bed._words()[1] != match  # it was another case that was matched
    workspace.matched = workspace.texts
    assert bed._words()[1] == match
    workspace.models["rig"].set_text("inertias.rotor.J", "0.95")
    assert bed._words()[1] == str(tmp_path / "out" / "as_shown" / "case.toml")
    bed.fmu.value = "bed.fmu"
    assert bed._words()[2:4] == ["--bed", "bed.fmu"]


def test_what_is_dropped_is_put_where_the_bed_waits_for_it(bed, tmp_path):
    folder = tmp_path / "out" / "bed_recordings"
    bed._dropped(SimpleNamespace(new={"any.csv": b"x"}))
    assert "press Go on" in bed.message.object
    folder.mkdir(parents=True)
    (folder / "1_channels_excitation.csv").write_text("t\n")
    controller = tmp_path / "out" / "bed" / "0_export" / "controller.fmu"
    controller.parent.mkdir(parents=True)
    controller.write_bytes(b"")
    waiting = f"{folder}/1_channels.csv: at rest, run 0_export/controller.fmu; then run the same command again"
    bed._show(Ended(0, {"waiting_for": waiting, "status": "waiting"}, ""))
    assert "Record next: 1_channels" in bed.wanted.object
    for link in ("results/bed/0_export/controller.fmu", "results/bed_recordings/1_channels_excitation.csv"):
        assert f'href="{link}?at=' in bed.wanted.object
    head = "time [s],motor_torque [N*m],motor_speed [rad/s]"
    bed._dropped(SimpleNamespace(new={"My log 7.csv": log(tmp_path / "own.csv", head).read_bytes()}))
    assert "My log 7.csv is taken as 1_channels.csv" in bed.message.object
    assert (folder / "1_channels.csv").read_text() == (tmp_path / "own.csv").read_text()
    assert "--channels" not in bed._words()  # the channels have the rig's names
    other = log(tmp_path / "other.csv", "time [s],motor_torque [N*m],n_EM [1/min]")
    bed._dropped(SimpleNamespace(new={"other.csv": other.read_bytes()}))
    words = bed._words()
    assert (
        'motor_speed" = { channel = "n_EM", unit = "1/min" }' in Path(words[words.index("--channels") + 1]).read_text()
    )
    assert bed.workspace.recordings == []  # they are the bed's own
    again = BedTab(bed.workspace)  # as a page that is loaded again
    assert again.file.path == folder / "1_channels.csv"


def test_a_defect_that_the_check_finds_is_an_answer(bed):
    ended = Ended(3, {"waiting_for": None, "status": "wrong_channel"}, "")
    assert ended.answered
    assert not ended.cancelled
    bed.go._show_end(ended)
    assert "Commissioning" in bed.verdict.object
