"""The three doors in the browser, without a shell: recording to verdict, own numbers to order sheet, engine to orders.

The bed is the virtual one of the example from two recordings: the truth plant, which shares no code with rigmatch. What
it records under the exported controllers is put into the page as a person would, with a logger's name and unit.
"""

import json
import math
import shutil
import tomllib
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from explore.browser import browser_path, explored, opened_page, served, step
from needs import compiles
from plant.engine import compiler
from structure.imports import ROOT
from virtual_bed.bed import Actuator, VirtualBed
from virtual_bed.two_recordings import HELD, STEP, readers, true_drive

from matching.bed.channels import channel_recording, plan_channels
from matching.bed.commission import CommissionOrder, plan_speed
from matching.bed.excite import bed_inputs, plan_excitation
from matching.bed.proof import plan_proof
from matching.bed.simulated_bed import FmuBed, FmuController, excited_recording, proof_recording
from matching.export import tuned_case
from matching.match.case_file import load_case
from matching.match.exported import exported_controller

FOLDER = ROOT / "examples" / "from_recordings"
TRUTH = tomllib.loads((FOLDER / "truth.toml").read_text(encoding="utf-8"))
RUN_MS = 600_000  # at most, for a command: a match, a diagnosis
pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]


def true_bed(folder: Path) -> Path:
    """The bed as it is, as an FMU."""
    case = load_case(FOLDER / "case.toml")
    drive = true_drive("rig", folder, vehicle=TRUTH["car"], rig=TRUTH["bed"])
    actuator = Actuator(TRUTH["loop"]["dead_time"] - HELD, case.loop["inverter_lag"], TRUTH["loop"]["torque_gain"])
    sensing = readers(drive, case.rig)
    sensing["flange_torque"].lag = case.loop["torque_sensor_lag"]
    return VirtualBed(drive, [], {"dyno": actuator}, sensing, seed=2).write(folder / "bed.fmu", STEP)


def run(page, name: str) -> None:
    """Press a button that runs a command, and wait until it has ended well."""
    page.get_by_role("button", name=name, exact=True).click()
    cancel = page.locator("button.bk-btn:visible", has_text="Cancel").first  # a dropped file has one too
    cancel.wait_for()
    cancel.wait_for(state="hidden", timeout=RUN_MS)
    page.get_by_text("done", exact=True).first.wait_for()


class Bench:
    """A person at the bed, who records what the page asks for."""

    def __init__(self, bed: Path, out: Path):
        self.bed, self.out = bed, out

    def record(self, name: str) -> Path:
        """The recording that is asked for, with the logger's own name and unit for the motor's speed."""
        number, kind = name.split("_", 1)
        matched = self.out / "bed" / f"{number}_match"
        case = tuned_case(matched if matched.is_dir() else self.out / "match").tuned
        speed = plan_speed(case, CommissionOrder())
        with self._running(case, "0_export" if kind == "channels" else f"{number}_export") as (bed, controller, law):
            if kind == "channels":
                text, tripped = channel_recording(bed, case, law, controller, plan_channels(case))
                assert not tripped
            elif kind == "verify":
                text = proof_recording(bed, case, law, controller, plan_proof(case, speed), speed)
            else:
                text = excited_recording(bed, case, plan_excitation(case, CommissionOrder().excitation))
        lines = text.splitlines()
        table = np.loadtxt(lines[1:], delimiter=",")
        names = lines[0].split(",")
        table[:, names.index("motor_speed [rad/s]")] *= 30 / math.pi
        head = lines[0].replace("motor_speed [rad/s]", "n_EM [1/min]")
        path = self.out / f"logged {name}.csv"
        np.savetxt(path, table, delimiter=",", header=head, comments="", fmt="%.9g")
        return path

    @contextmanager
    def _running(self, case, exported: str):
        law = exported_controller(case).law
        with (
            FmuBed(self.bed, bed_inputs(case), [sensor.name for sensor in case.rig.sensors]) as bed,
            FmuController(self.out / "bed" / exported / "controller.fmu", law) as controller,
        ):
            yield bed, controller, law


@compiles
@pytest.mark.skipif(not (find_spec("fmpy") and compiler()), reason="needs FMPy, a C compiler")
def test_from_a_road_recording_to_the_verdict_of_the_bed(tmp_path):
    browser_path()
    home = tmp_path / "home"
    shutil.copytree(FOLDER, home / "case", ignore=shutil.ignore_patterns("truth.toml", "bed.toml", "out"))
    (tmp_path / "bed").mkdir()
    bench = Bench(true_bed(tmp_path / "bed"), home / "out")
    with (
        served(explored(home / "case" / "case.toml"), out=home / "out") as address,
        opened_page(address) as (page, complaints),
    ):
        step(page, "Road")
        page.locator("input[type=file]").set_input_files(home / "case" / "road.csv")
        page.get_by_text("5000 samples", exact=False).wait_for()
        run(page, "Identify")
        page.get_by_role("button", name="Go on to Match").click()
        run(page, "Run the match")
        step(page, "Bed")
        asked = []
        while len(asked) < 6:
            run(page, "Go on")
            wanted = page.get_by_role("heading", name="Record next:")
            verdict = page.frame_locator("iframe[title=Commissioning]")
            verdict.locator("h1").wait_for()
            if not wanted.count():
                break
            asked.append(wanted.inner_text().removeprefix("Record next: "))
            assert page.get_by_role("link", name=f"{asked[-1]}_excitation.csv").count() == 1
            page.locator("input[type=file]").set_input_files(bench.record(asked[-1]))
            page.get_by_text(f"is taken as {asked[-1]}.csv", exact=False).wait_for()
            assert page.get_by_label("motor speed (speed)").input_value() == "n_EM"
        said = json.loads((home / "out" / "bed" / "commission.json").read_text(encoding="utf-8"))
        assert asked[:2] == ["1_channels", "1_verify"]
        assert said["channels"]["right"]
        assert said["status"] == "as_predicted", said["end"]
        verdict.get_by_text("answers as the last match predicted", exact=False).first.wait_for()
        assert said["rounds"][0]["match"]["status"] == "as given"  # the one that was run in the step Match
        assert page.get_by_role("tab", name="Bed").inner_text().endswith("done: as predicted")
        assert complaints == []


def test_from_own_numbers_to_the_order_sheet(tmp_path):
    browser_path()
    with (
        served(explored(), out=tmp_path / "out") as address,
        opened_page(address) as (page, complaints),
    ):
        page.get_by_role("button", name="Open, make or copy a file").click()
        page.get_by_label("Kind").select_option("case")
        page.get_by_label("Name in this folder").fill("mine")
        page.get_by_role("button", name="New", exact=True).click()
        page.get_by_label("Command").filter(has_text="mine").first.wait_for()
        page.get_by_label("J [kg·m²]").first.fill("0.05")
        page.keyboard.press("Tab")
        page.get_by_text("is 0.05", exact=False).wait_for()
        page.get_by_role("button", name="Save", exact=True).click()
        page.get_by_text("Saved: vehicle.toml", exact=False).wait_for()
        step(page, "Match")
        run(page, "Run the match")
        with page.context.expect_page() as sheet:
            page.get_by_role("link", name="Order sheet").click()
        sheet.value.get_by_role("heading", level=1).wait_for()
        text = sheet.value.locator("body").inner_text()
        assert "stiffness" in text
        assert "N·m/rad" in text
        assert complaints == []
    assert "J = 0.05" in (tmp_path / "mine" / "vehicle.toml").read_text(encoding="utf-8")


def test_from_an_engine_to_its_orders(tmp_path):
    """The critical speed of the page is the one of the engine's example: order 4 at the mode of the damper."""
    browser_path()
    shutil.copy(ROOT / "examples" / "engine" / "engine.toml", tmp_path)
    with (
        served(explored(tmp_path / "engine.toml"), out=tmp_path / "out") as address,
        opened_page(address) as (page, complaints),
    ):
        step(page, "Modes")
        page.get_by_label("Torques in N·m", exact=False).fill("engine_torque:2=150 engine_torque:4=40")
        run(page, "Campbell diagram")
        page.frame_locator("iframe[title=Orders]").locator("h1").wait_for()
        run(page, "Response to orders")
        page.frame_locator("iframe[title=Orders]").get_by_text("4090 1/min", exact=False).first.wait_for()
        assert complaints == []
    critical = json.loads((tmp_path / "out" / "response" / "response.json").read_text(encoding="utf-8"))["critical"]
    assert {one["order"] for one in critical} == {4}
    assert all(abs(one["speed"] * 30 / math.pi - 4090) < 10 for one in critical)
