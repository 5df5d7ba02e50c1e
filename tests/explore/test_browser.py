"""The explorer in a real browser: by keyboard and mouse, at two widths, without complaints of console and axe-core."""

import math
import shutil
import urllib.error
import urllib.request
from contextlib import contextmanager
from pathlib import Path

import pytest
from explore.browser import browser_path, explored, opened_page, served, serving, step
from structure.imports import ROOT

BENCH = """\
title = "Bench"
[inertias.motor]
J = 0.1   # data sheet
[inertias.load]
J = 1.0
[shafts.link]
between = ["motor", "load"]
stiffness = { value = 200, tolerance = 0.2 }
damping = 0.5
[inputs.motor_torque]
on = "motor"
[sensors.motor_speed]
measures = "speed"
of = "motor"
uncertainty = 0.02
[sensors.link_torque]
measures = "torque"
of = "link"
uncertainty = 0.05
"""
MEASURED = """() => {  // data of the points on the figures of the responses
  for (const page of Bokeh.documents) for (const model of page.all_models)
    if (model.type === 'GlyphRenderer' && model.glyph.type === 'Scatter') {
      const data = model.data_source.data
      return { f: Array.from(data.f), size: Array.from(data.size) }
    }
}"""
TABS = {  # and the last heading of each: where it stands, the tab's content does
    "Drivetrain": "Values", "Modes": "Orders", "Road": "Recordings", "Match": "Map: what if …", "Bed": "Recordings",
    "Measurement": "Model against recording", "Validity": "XiL fidelity",
}  # fmt: skip


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    browser_path()
    folder = tmp_path_factory.mktemp("bench")
    (folder / "bench.toml").write_text(BENCH)
    recording(folder / "log.csv")
    with served(explored(folder / "bench.toml", folder / "log.csv"), out=folder / "out") as address:
        yield folder, address


def test_a_value_is_changed_tried_and_saved_by_keyboard_alone(bench):
    folder, address = bench
    with pytest.raises(urllib.error.HTTPError, match="404"):  # without the secret
        urllib.request.urlopen(address.rpartition("/")[0].rpartition("/")[0] + "/page", timeout=60)
    with opened_page(address) as (page, complaints):
        page.get_by_role("button", name="shaft link").focus()
        page.keyboard.press("Enter")
        field = page.get_by_label("stiffness [N·m/rad]")
        field.wait_for()
        field.focus()
        field.fill("much")
        page.keyboard.press("Enter")
        page.get_by_text("is no", exact=False).first.wait_for()
        field = page.get_by_label("stiffness [N·m/rad]")
        field.fill("400")
        page.keyboard.press("Enter")
        page.get_by_text("200 N·m/rad → 400 N·m/rad").wait_for()
        assert page.locator(".part.changed").get_attribute("data-part") == "shafts.link"
        page.get_by_role("tab", name="Drivetrain").focus()
        page.keyboard.press("ArrowRight")
        frequency = math.sqrt(400 * (1 / 0.1 + 1 / 1.0)) / (2 * math.pi)
        page.get_by_role("cell", name=f"{frequency:.2f}").first.wait_for()
        damped = page.get_by_role("table", name="Modes with damping").get_by_role("row").nth(2)
        ratio = 0.5 * (1 / 0.1 + 1 / 1.0) / (2 * 2 * math.pi * frequency)  # of link damper and critical damping
        assert damped.get_by_role("cell").nth(2).inner_text() == f"{ratio:.3g}"
        check_measured_response(page)
        page.get_by_role("slider").focus()
        page.keyboard.press("ArrowRight")
        page.get_by_text("tried:", exact=False).wait_for()
        page.get_by_role("tab", name="Modes").focus()
        page.keyboard.press("ArrowLeft")
        page.get_by_role("button", name="Save").focus()
        page.keyboard.press("Enter")
        page.get_by_text("Everything is saved.").wait_for()
        assert complaints == []
    assert (folder / "bench.toml").read_text() == BENCH.replace("value = 200", "value = 400")


@pytest.mark.long
def test_the_fields_of_channels_fit_on_a_phone(bench):
    _, address = bench
    with opened_page(address, 400) as (page, complaints):
        step(page, "Measurement")
        page.get_by_role("heading", name="Channels", exact=True).wait_for()
        page.get_by_label("unit of link torque").wait_for()
        edges = [
            page.get_by_label(label, exact=True).bounding_box()
            for label in ("link torque (torque)", "unit of link torque")
        ]
        assert edges[0]["y"] == edges[1]["y"]
        assert edges[1]["x"] + edges[1]["width"] <= 400
        assert page.evaluate("document.documentElement.scrollWidth") <= 400
        assert complaints == []


def check_measured_response(page):
    """The points laid over the responses have the resonance of the recorded bench: its shaft has 230 N·m/rad."""
    data = page.evaluate(MEASURED)
    antiresonance, resonance = (math.sqrt(230 * each) / (2 * math.pi) for each in (1 / 1.0, 1 / 0.1 + 1 / 1.0))
    above = [pair for pair in zip(data["size"], data["f"], strict=True) if pair[1] > antiresonance]
    assert max(above)[1] == pytest.approx(resonance, rel=0.1)  # the model shown: 1.32 times that


def recording(path: Path) -> None:
    """A sweep on the bench by the implicit midpoint rule, with a shaft of 230 N·m/rad."""
    speed, other, twist, step = 0.0, 0.0, 0.0, 0.0005
    rows = ["time [s],M_motor [N*m],n_motor [1/min],LinkTrq [N*m]"]
    for number in range(16_000):
        time = number * step
        torque = 5 * math.sin(2 * math.pi * (1 + time) * time)
        link = 230 * twist + 0.5 * (speed - other)
        if number % 8 == 0:
            rows.append(f"{time:.6f},{torque:.9f},{speed * 30 / math.pi:.9f},{link:.9f}")
        speed, other = speed + step * (torque - link) / 0.1, other + step * link
        twist += step * (speed - other)
    path.write_text("\n".join(rows))


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("width", [1366, 400])
def test_every_tab_runs_and_is_accessible(tmp_path, width):
    browser_path()
    import axe_core_python

    axe = (Path(axe_core_python.__file__).parent / "axe.min.js").read_text()
    shutil.copytree(ROOT / "matching" / "starter", tmp_path / "case")
    files = [tmp_path / "case" / "case.toml", ROOT / "examples" / "gum" / "impedance.toml",
             ROOT / "examples" / "fidelity" / "tab2.toml"]  # fmt: skip
    with (
        served(explored(*files), out=tmp_path / "out") as address,
        opened_page(address, width) as (page, complaints),
    ):
        page.evaluate(axe)
        for tab, last in TABS.items():
            step(page, tab)
            page.get_by_role("heading", name=last, exact=True).wait_for()
            if width == 1366 and tab == "Match":
                page.get_by_label("Starting points").fill("2")
                page.get_by_role("button", name="Run the match").click()
                page.get_by_role("link", name="Open the report").wait_for(timeout=300_000)
            serious = [
                (tab, width, found["id"], found["nodes"][0]["html"])
                for found in page.evaluate("axe.run()")["violations"]
                if found["impact"] in ("serious", "critical")
            ]
            assert serious == [], "\n".join(map(str, serious))
            assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert complaints == []
    assert (tmp_path / "out" / "match" / "result.json").exists() == (width == 1366)


LONGEST_CURVE = """() => Math.max(0, ...Bokeh.documents.flatMap(one => [...one._all_models.values()])
    .filter(model => model.type === 'ColumnDataSource')
    .map(source => (source.data instanceof Map ? source.data.get('y') : source.data.y)?.length ?? 0))"""


@pytest.mark.long
def test_a_recording_named_by_its_path_is_drawn(bench, tmp_path):
    _, address = bench
    rows = (bench[0] / "log.csv").read_text().split("\n")
    (tmp_path / "shorter.csv").write_text("\n".join(rows[:1001]))
    with opened_page(address) as (page, complaints):
        page.get_by_role("tab", name="Measurement").click()
        field = page.get_by_label("Recording: its path on this machine")
        field.fill(str(tmp_path / "shorter.csv"))
        field.press("Enter")
        page.get_by_text("1000 samples", exact=False).wait_for()
        page.wait_for_function(f"({LONGEST_CURVE})() >= 500")
        assert complaints == []


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_file_is_dropped_simulated_and_diagnosed_and_the_extended_model_kept(tmp_path):
    browser_path()
    (tmp_path / "bench.toml").write_text(BENCH)
    recording(tmp_path / "log.csv")
    with (
        served(explored(tmp_path / "bench.toml"), out=tmp_path / "out") as address,
        opened_page(address) as (page, complaints),
    ):
        page.get_by_role("tab", name="Measurement").click()
        page.locator("input[type=file]").set_input_files(tmp_path / "log.csv")
        page.get_by_text("2000 samples", exact=False).wait_for()
        assert page.get_by_label("motor speed (speed)").input_value() == "n_motor"
        page.get_by_role("button", name="Simulate").click()
        page.get_by_text("done", exact=True).wait_for()
        page.get_by_role("button", name="Diagnose").click()
        page.get_by_role("link", name="Open the report").wait_for(timeout=300_000)
        page.get_by_role("button", name="Keep").click()
        page.get_by_text("written:", exact=False).wait_for()
        assert complaints == []
    assert (tmp_path / "bench_extended.toml").exists()


@pytest.mark.long
def test_a_case_is_made_changed_renamed_and_saved_without_a_file(tmp_path):
    """New, add, rename, undo, remove, save, a copy: with an empty folder at the beginning."""
    browser_path()
    import tomllib

    with served(explored(), out=tmp_path / "out") as address, opened_page(address) as (page, complaints):
        page.get_by_text("Open, make or copy a file").click()
        page.get_by_label("Name in this folder").fill("../mine")
        page.get_by_role("button", name="New", exact=True).click()
        page.get_by_text("lies outside", exact=False).wait_for()
        page.get_by_label("Name in this folder").fill("mine")
        page.get_by_role("button", name="New", exact=True).click()
        page.get_by_text(f"rigmatch show {tmp_path / 'mine'}", exact=False).first.wait_for()
        page.get_by_label("Part", exact=True).select_option("rig: inertias rotor")
        page.get_by_label("called").fill("flywheel")
        page.get_by_role("button", name="Add", exact=True).click()
        page.get_by_text("flywheel was added to rig", exact=False).wait_for()
        page.get_by_label("Part", exact=True).select_option("rig: inertias flywheel")
        page.get_by_label("J [kg·m²]").wait_for()
        page.get_by_label("New name").fill("disc")
        page.get_by_role("button", name="Rename the part").click()
        page.get_by_text("Renamed in rig.toml", exact=False).wait_for()
        field = page.get_by_label("J [kg·m²]")
        field.fill("0,25")
        field.press("Enter")
        page.get_by_text("inertias.disc.J is 0,25", exact=False).wait_for()
        page.get_by_role("button", name="Save", exact=True).click()
        page.get_by_text("Saved: rig.toml", exact=False).wait_for()
        rig = tomllib.loads((tmp_path / "mine" / "rig.toml").read_text())
        assert rig["inertias"]["disc"]["J"] == 0.25
        assert "disc" in rig["shafts"]["flywheel_shaft"]["between"]
        page.get_by_label("Effect to add").select_option("coulomb friction")
        page.get_by_label("torque [N·m]").fill("2")
        page.get_by_role("button", name="Add the effect").click()
        page.get_by_text("coulomb friction was added", exact=False).wait_for()
        page.get_by_label("coulomb friction torque [N·m]").wait_for()
        page.get_by_role("button", name="Remove the part").click()
        page.get_by_text("Removed from rig", exact=False).wait_for()
        page.get_by_role("button", name="Undo").click()
        page.get_by_text("rig: new: inertias.disc.coulomb_friction").wait_for()
        page.get_by_role("heading", name="Drivetrain", level=1).click()
        page.keyboard.press("Control+z")
        page.get_by_text("Everything is saved.").wait_for()
        assert complaints == []


@contextmanager
def starter(tmp_path):
    """The starter case in the browser: page, what its console complains of, address."""
    browser_path()
    shutil.copytree(ROOT / "matching" / "starter", tmp_path / "case")
    with (
        served(explored(tmp_path / "case" / "case.toml"), out=tmp_path / "out") as address,
        opened_page(address) as (page, complaints),
    ):
        yield page, complaints, address


def middle(page, part):
    box = page.locator(f"[data-part='{part}']").last.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def drag(page, start, end):
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(*end, steps=6)
    page.mouse.up()


@pytest.mark.long
def test_parts_are_drawn_by_dragging_and_taken_back(tmp_path):
    """From a disc into the open: a new inertia; from there to another disc: a shaft. Each is one step of Undo."""
    with starter(tmp_path) as (page, complaints, _):
        page.get_by_text("Everything is saved.").wait_for()
        x, y = middle(page, "inertias.rotor")
        drag(page, (x, y), (x + 8, y + 55))
        page.get_by_text("inertia 1 was added to rig", exact=False).wait_for()
        page.locator("[data-part='shafts.inertia_1_shaft']").wait_for()
        drag(page, middle(page, "inertias.inertia_1"), middle(page, "inertias.motor"))
        page.get_by_text("locks the drivetrain", exact=False).wait_for()  # around a gear: refused, with the reason
        drag(page, middle(page, "inertias.inertia_1"), middle(page, "inertias.adapter"))
        page.get_by_text("shaft 1 was added to rig", exact=False).wait_for()
        for gone in ("shafts.shaft_1", "inertias.inertia_1"):
            page.keyboard.press("Control+z")
            page.locator(f"[data-part='{gone}']").wait_for(state="detached")
        page.get_by_text("Everything is saved.").wait_for()
        assert complaints == []


@pytest.mark.long
def test_a_page_whose_program_has_ended_says_so_and_claims_nothing_any_more(tmp_path):
    browser_path()
    (tmp_path / "bench.toml").write_text(BENCH)
    with (
        serving(explored(tmp_path / "bench.toml"), out=tmp_path / "out") as (program, address),
        opened_page(address) as (page, _),
    ):
        page.get_by_text("Everything is saved.").wait_for()
        assert not page.get_by_role("alertdialog").is_visible()
        program.kill()
        page.get_by_role("alertdialog").wait_for(timeout=10_000)  # asked every second; the machine may be busy
        assert "Nothing that you change here is saved any more" in page.get_by_role("alertdialog").inner_text()
        assert page.evaluate("[...document.body.children].filter((each) => !each.inert).length") == 1


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_match_is_seen_after_a_reload_and_in_a_second_window_until_its_report(tmp_path):
    with starter(tmp_path) as (page, complaints, address):
        step(page, "Match")
        page.get_by_role("button", name="Run the match").click()
        page.get_by_role("button", name="Cancel").wait_for()
        page.reload()
        step(page, "Match")
        page.get_by_role("button", name="Cancel").wait_for()
        second = page.context.browser.new_page()
        second.goto(address)
        step(second, "Match")
        second.get_by_role("button", name="Cancel").wait_for()
        page.get_by_text("open in another window", exact=False).wait_for()
        second.get_by_role("link", name="Open the report").wait_for(timeout=300_000)
        second.reload()
        step(second, "Match")
        second.get_by_role("link", name="Open the report").wait_for()
        assert complaints == []


FOCUSED = """() => { let found = document.activeElement;
    while (found && found.shadowRoot && found.shadowRoot.activeElement) found = found.shadowRoot.activeElement;
    return (found && found.dataset && found.dataset.part) || ''; }"""


@pytest.mark.long
def test_a_chain_of_thirty_is_large_enough_to_read_and_its_discs_come_first_for_the_keyboard(tmp_path):
    """The drawing scrolls to the part that is chosen; behind the last shaft the keyboard leaves it."""
    browser_path()
    count = 30
    text = "".join(f"[inertias.i{k}]\nJ = 0.1\n" for k in range(count))
    text += "".join(f'[shafts.s{k}]\nbetween = ["i{k}", "i{k + 1}"]\nstiffness = 1000\n' for k in range(count - 1))
    (tmp_path / "chain.toml").write_text(text + '[inputs.pull]\non = "i0"\n')
    with (
        served(explored(tmp_path / "chain.toml"), out=tmp_path / "out") as address,
        opened_page(address) as (page, complaints),
    ):
        disc = page.locator("[data-part='inertias.i0']")
        disc.wait_for()
        assert disc.bounding_box()["height"] > 50  # px: with the page's width it was 28
        page.locator(".drawing").focus()
        wanted = [f"inertias.i{k}" for k in range(count)] + [f"shafts.s{k}" for k in range(count - 1)]
        reached = []
        for _ in (*wanted, "behind"):
            page.keyboard.press("Tab")
            reached.append(page.evaluate(FOCUSED))
        assert reached == [*wanted, ""]
        page.locator("[data-part='shafts.s1']").focus()
        page.keyboard.press("Shift+Tab")
        assert page.evaluate(FOCUSED) == "shafts.s0"
        page.get_by_label("Part", exact=True).select_option(label="model: inertias i25")
        page.wait_for_function(
            """() => { const walk = (root) => [...root.querySelectorAll('*')].flatMap(one =>
                [one, ...(one.shadowRoot ? walk(one.shadowRoot) : [])]);
                const all = walk(document), chosen = (one) => one.dataset && one.dataset.part === 'inertias.i25';
                const box = all.find(one => one.className === 'drawing').getBoundingClientRect();
                const part = all.find(chosen).getBoundingClientRect();
                return part.left >= box.left && part.right <= box.right; }"""
        )
        assert complaints == []
