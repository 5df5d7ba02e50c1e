"""Makes the generated figures and notebooks of this repository anew: `python docs/figures.py [FILE …]`."""

from __future__ import annotations

import base64
import io
import lzma
import os
import re
import runpy
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
REFERENCE = ROOT / "examples" / "road_to_rig"
NOTEBOOK_TIMEOUT = 1200  # s a cell
COLOURS = 64  # of a picture in a notebook: a quarter of the bytes of true colours, and no difference to the eye
TABS = {"Drivetrain": ".part", "Modes": ".swing"}  # of the explorer that are shown, and what stands there when drawn
DRAWN_MS = 1500  # from then on, until fonts and figures stand too
ENGINE = ("600:6000 1/min", {"engine_torque:2": 150.0, "engine_torque:4": 40.0})
DEAD_TIMES = (0.5, 1, 2, 5, 10, 20)  # ms
STRUCTURES = {"pi": "case.toml", "model_based": "case.toml", "observer": "observer.toml"}  # and the case that it is in
LIVE = {  # reports on the site, and the lines that write them, after `python`
    "match": ("-m matching new first", "-m matching match first/case.toml --out out"),
    "diagnosis": (
        "drive/record.py recordings",
        "-m matching diagnose drive/model.toml recordings/play.csv --out out",
    ),
    "commissioning": (
        "-m matching export two/bed.toml --fmu bed.fmu",
        "-m matching commission two/case.toml --vehicle-recording two/road.csv --bed bed.fmu --rounds 1 --out out",
    ),
}
CARD = (3.1, 2.3)  # inches: a card is as wide at 1280 px
MATCHED_EXAMPLES = {  # whose cards show a response, and their cases
    "road_to_rig": "observer.toml",
    "adapter_only": "case.toml",
    "compact_bev": "case.toml",
    "fixed_controller": "case.toml",
    "four_wheel": "case.toml",
    "from_recordings": "case.toml",
    "simple_vehicle": "case.toml",
}
MAP_AXES = ("loop.dead_time=1 ms,3 ms,5 ms,8 ms,12 ms", "rig.shafts.flange_left.stiffness=4e4,2e5,1e6")


def generators() -> dict[str, Callable[[], Any]]:
    """What makes each file, by its path: a function that returns its figure, or a notebook's runner."""
    import rigmatch as rm
    from docs.physics import pictures
    from tests.virtual_bed.reference_circle import channels_picture, measure, picture

    made = {
        "drivetrain.png": lambda: rm.show(REFERENCE / "case.toml"),
        "overview.png": lambda: rm.match(REFERENCE / "observer.toml").plot(),
        "shuffle.svg": lambda: moving_modes(rm.match(REFERENCE / "observer.toml")),
        "map.png": lambda: rm.map(REFERENCE / "observer.toml", *MAP_AXES).plot(),
        "channels.png": channels_picture,
        "on_the_bed.png": lambda: picture(measure(ROOT / "out" / "reference_circle")),
    }
    figures = {f"examples/road_to_rig/{name}": make for name, make in made.items()}
    figures["examples/drive_away/tracked.png"] = tracked
    figures["docs/gallery/foreign_vehicle.svg"] = foreign_vehicle
    figures["docs/gallery/dead_time.svg"] = dead_time
    figures |= {f"docs/gallery/physics_{name}.svg": make for name, make in pictures().items()}
    figures |= {f"docs/gallery/explorer_{tab.lower()}.png": lambda tab=tab: explorer(tab) for tab in TABS}
    shown = {"channels": "play", "unseen": "play", "discrepancy": "shaken_from_outside"}
    figures |= {f"docs/gallery/diagnosis_{k}.png": lambda k=k, of=of: diagnosed(of, k) for k, of in shown.items()}
    figures |= {f"docs/gallery/card_{name}.svg": make for name, make in cards().items()}
    figures |= {f"docs/reports/{name}.html.xz": lambda name=name: live_report(name) for name in LIVE}
    figures |= {f"docs/gallery/report_{name}.png": lambda name=name: first_screen(name) for name in LIVE}
    notebooks = sorted((ROOT / "notebooks").glob("*.ipynb"))
    return figures | {f"notebooks/{path.name}": lambda path=path: run_notebook(path) for path in notebooks}


def tracked() -> Any:
    """What the controller tracks on a bed that drifts: drawn by the tests' own bed."""
    sys.path.insert(0, str(ROOT / "tests"))  # as pytest finds its modules
    from driving.drifting_bed import tracked_picture

    return tracked_picture()


SECONDS = 2.4  # of a period of the vehicle's mode in the moving picture; other modes by the ratio of frequencies
ROW, LABEL, CELL, RADIUS, SWING = 118, 190, 96, 28, 60  # px of the moving picture; degrees of the largest amplitude


def moving_modes(result: Any) -> bytes:
    """The shuffle in the vehicle, on the rig and on the matched rig, slowed alike: SVG with SMIL, no script.

    Amplitudes are reduced to the motor (over those of the rigid motion); of two sides the left one is drawn.
    """
    from matching.report.common import MATCHED, RIG, VEHICLE

    target = max(result.targets, key=lambda one: one.vehicle)
    rows = [
        ("vehicle", VEHICLE, result.vehicle_modes, target.vehicle),
        ("rig without control", RIG, result.rig_modes, target.rig),
        ("matched rig", MATCHED, result.matched_modes, target.matched),
    ]
    drawn = []
    for place, (title, colour, modes, hertz) in enumerate(rows):
        mode = min(modes, key=lambda one: abs(one.frequency - hertz))
        rigid = next(one for one in modes if one.frequency == 0)
        reduced = {
            name.removeprefix("inertias."): (amplitude / rigid.shape[name]).real
            for name, amplitude in mode.shape.items() if not name.endswith("_right")
        }  # fmt: skip
        if title == "matched rig":  # its shape has the vehicle's name behind a cut, where an adapter turns like it
            ends = {cut.vehicle_end: cut.rig_end for cut in result.case.residual_vehicle.interfaces}
            reduced = {ends.get(name, name): amplitude for name, amplitude in reduced.items()}
        largest = max(reduced.values(), key=abs)
        top, seconds = place * ROW, SECONDS * target.vehicle / hertz
        drawn.append(
            f'<text x="14" y="{top + 50}" font-size="16" fill="{colour}" font-weight="bold">{title}</text>'
            f'<text x="14" y="{top + 74}" font-size="15" fill="#333">{hertz:.2f} Hz</text>'
        )
        sign = 1 if reduced["motor"] > 0 else -1
        for column, (name, amplitude) in enumerate(reduced.items()):
            angle = round(sign * SWING * amplitude / abs(largest), 1)
            words = name.removesuffix("_left").replace("_", " ")
            drawn.append(
                f'<g transform="translate({LABEL + CELL * column + CELL // 2},{top + 46})">'
                f'<circle r="{RADIUS}" fill="{colour}" fill-opacity="0.15" stroke="{colour}" stroke-width="1.5"/>'
                f'<line y2="-{RADIUS}" stroke="#bbb" stroke-dasharray="2 2"/>'
                f'<line y2="-{RADIUS}" stroke="#000" stroke-width="3"><animateTransform attributeName="transform" '
                f'type="rotate" dur="{seconds:.3f}s" repeatCount="indefinite" calcMode="spline" '
                f'values="{angle};{-angle};{angle}" keyTimes="0;0.5;1" '
                'keySplines="0.364 0 0.636 1;0.364 0 0.636 1"/></line>'
                f'<text y="{RADIUS + 16}" font-size="12" fill="#333" text-anchor="middle">{words}</text></g>'
            )
    width, height = LABEL + 6 * CELL + 10, len(rows) * ROW + 8
    words = "The shuffle mode, slowed: vehicle, rig without control, matched rig"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'role="img" aria-label="{words}" font-family="sans-serif">'
        '<rect width="100%" height="100%" rx="8" fill="#fff"/>'
        f"{''.join(drawn)}</svg>\n"
    ).encode()


def diagnosed(recording: str, picture: str) -> Any:
    """A picture of the diagnosis of a recording of the example."""
    import rigmatch as rm
    from matching.report.diagnosis import pictures

    folder = ROOT / "out" / "diagnosis"
    if not (folder / f"{recording}.csv").exists():
        subprocess.run([sys.executable, str(ROOT / "examples" / "diagnosis" / "record.py"), str(folder)], check=True)
    found = rm.diagnose(ROOT / "examples" / "diagnosis" / "model.toml", folder / f"{recording}.csv")
    return pictures(found)[picture].draw()


def cards() -> dict[str, Callable[[], Any]]:
    """Results of examples as small pictures: one panel, few words, to be read at the size of a card."""
    return {name: lambda name=name: match_card(name) for name in MATCHED_EXAMPLES} | {
        "diagnosis": diagnosis_card,
        "drive_away": lambda: drive_card(ROOT / "examples" / "drive_away" / "case.toml", 0),
        "emps": emps_card,
        "engine": engine_card,
        "fidelity": fidelity_card,
        "foreign_vehicle": foreign_card,
        "gear_change": shift_card,
        "parts": clutch_card,
        "sensors": budget_card,
    }


def match_card(name: str) -> Any:
    """The first compared response: the vehicle, the rig without control, the matched rig."""
    import rigmatch as rm
    from matching.report.common import MATCHED, RIG, VEHICLE, styled

    result = rm.match(ROOT / "examples" / name / MATCHED_EXAMPLES[name])
    curves = result.curves
    with styled():
        fig, axes = card()
        axes.loglog(curves.frequencies, abs(curves.vehicle[:, 0]), color=VEHICLE, linewidth=4, alpha=0.4)
        axes.loglog(curves.frequencies, abs(curves.rig[:, 0]), color=RIG, linewidth=1.2, linestyle="--")
        axes.loglog(curves.frequencies, abs(curves.matched[:, 0]), color=MATCHED, linewidth=1.5)
        axes.set_xlim(result.response_error.band)
        error = result.response_error
        was = f"{error.before:.2g} → " if error.before is not None else ""
        entitled(axes, f"{result.status}: error {was}{error.after:.2g}", "frequency in Hz")
        named(fig, {"vehicle": VEHICLE, "rig": RIG, "matched rig": MATCHED})
    return fig


def drive_card(case: Path, number: int) -> Any:
    """A drive of the vehicle and of the bed: the worst sensor."""
    import rigmatch as rm
    from matching.report.common import MATCHED, VEHICLE, styled

    drive = rm.match(case).driving.drives[number]
    time, traces = drive.traces
    vehicle, bed, _ = traces[drive.worst_sensor]
    with styled():
        fig, axes = card()
        axes.plot(time, vehicle, color=VEHICLE, linewidth=4, alpha=0.4)
        axes.plot(time, bed, color=MATCHED, linewidth=1.5)
        entitled(axes, f"{100 * drive.errors.planned:.1f} % off, {drive.title}", "time in s")
        named(fig, {"vehicle": VEHICLE, "bed": MATCHED})
    return fig


def foreign_card() -> Any:
    """The vehicle of others as it drives away, and the bed with it at its cuts."""
    import rigmatch as rm

    folder = ROOT / "examples" / "foreign_vehicle"
    rm.export(folder / "car.toml", fmu=ROOT / "out" / "car.fmu")
    return drive_card(folder / "case.toml", 0)


def shift_card() -> Any:
    """The left rotor while the gearbox shifts, and the wheel that it emulates, by the example's own simulator."""
    from matching.report.common import MATCHED, VEHICLE, styled

    example = runpy.run_path(str(ROOT / "examples" / "gear_change" / "run.py"))
    with TemporaryDirectory() as folder:
        motion = example["main"](Path(folder))["unknown"]
    time = np.arange(len(motion.emulated["left.wheel_speed"])) * example["STEP"] - example["BEGIN"]
    shown = (time > -0.3) & (time < 1.0)
    with styled():
        fig, axes = card()
        axes.plot(time[shown], motion.emulated["left.wheel_speed"][shown, 0], color=VEHICLE, linewidth=4, alpha=0.4)
        axes.plot(time[shown], motion["rotor_left_speed"][shown, 0], color=MATCHED, linewidth=1.5)
        axes.axvspan(0, example["HANDING"] + example["TURNING"], color="#E6E6E6", zorder=0)
        entitled(axes, "wheel speed in rad/s in the shift (grey)", "time in s")
        named(fig, {"emulated wheel": VEHICLE, "rotor": MATCHED})
    return fig


def clutch_card() -> Any:
    """Engine and car at the example's clutch, which slips under twice its torque."""
    import rigmatch as rm
    from matching.report.common import RIG, VEHICLE, styled

    time = np.arange(0, 1, 1e-3)
    run = rm.simulate(
        ROOT / "examples" / "parts" / "clutch.toml",
        rm.Recording(time, {"engine_torque": np.where(time < 0.5, 200, 60)}),
    )
    with styled():
        fig, axes = card()
        axes.plot(time, run["engine_speed"], color=VEHICLE, linewidth=2)
        axes.plot(time, run["car_speed"], "--", color=RIG, linewidth=2)
        entitled(axes, "speeds in rad/s: 200, then 60 N·m", "time in s")
        named(fig, {"engine": VEHICLE, "car": RIG})
    return fig


def emps_card() -> Any:
    """The errors of the page's table: its data belong to others."""
    from matching.report.common import MATCHED, RIG, styled

    text = (ROOT / "examples" / "emps" / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"\| (fitted|held-out) [\d.]+ s \| ([\d.]+) mm \| ([\d.]+) mm", text)
    with styled():
        fig, axes = card()
        for row, (_, before, after) in enumerate(rows):
            axes.barh(row - 0.2, float(before), 0.38, color=RIG)
            axes.barh(row + 0.2, float(after), 0.38, color=MATCHED)
        axes.set_yticks(range(len(rows)), [name for name, *_ in rows])
        axes.invert_yaxis()
        axes.set_xscale("log")
        entitled(axes, "error of a measured drive", "position in mm")
        named(fig, {"linear model": RIG, "with the friction found": MATCHED})
    return fig


def diagnosis_card() -> Any:
    """Errors on unseen data of the model as given and with the free play, in times the noise."""
    import rigmatch as rm
    from matching.report.common import MATCHED, RIG, styled

    with TemporaryDirectory() as folder:
        example = ROOT / "examples" / "diagnosis"
        subprocess.run([sys.executable, example / "record.py", folder], check=True)
        errors = rm.diagnose(example / "model.toml", Path(folder) / "play.csv").errors
    with styled():
        fig, axes = card()
        for row, one in enumerate(errors.values()):
            axes.barh(row - 0.2, one.before_holdout / one.noise, 0.38, color=RIG)
            axes.barh(row + 0.2, one.after_holdout / one.noise, 0.38, color=MATCHED)
        axes.set_yticks(range(len(errors)), [name.replace("_", " ") for name in errors])
        axes.set_xscale("log")
        entitled(axes, "error on unseen data", "times the noise")
        named(fig, {"model as given": RIG, "with free play": MATCHED})
    return fig


def engine_card() -> Any:
    """Torque of the damper over speed, with the critical speed."""
    import rigmatch as rm
    from matching.report.common import LIMIT, VEHICLE, styled

    result = rm.order_response(ROOT / "examples" / "engine" / "engine.toml", *ENGINE)
    turns, at = result.speeds * 30 / np.pi, result.shafts.index("damper")
    with styled():
        fig, axes = card()
        axes.plot(turns, result.peak_torques[:, at], color=VEHICLE, linewidth=1.5)
        for one in result.critical:
            axes.axvline(one.speed * 30 / np.pi, color=LIMIT, linewidth=0.8, linestyle="--")
        entitled(axes, "torque of the damper in N·m", "speed in 1/min; dashed: critical")
    return fig


def fidelity_card() -> Any:
    """Fidelity of the three domains, and the total."""
    import rigmatch as rm
    from matching.report.common import MATCHED, VEHICLE, styled

    result = rm.fidelity(ROOT / "examples" / "fidelity" / "tab2.toml").to_dict()
    shares = {**result["domains"], "R_XiL": result["R_XiL"]}
    with styled():
        fig, axes = card()
        colours = [VEHICLE] * (len(shares) - 1) + [MATCHED]
        axes.barh(range(len(shares)), [100 * one for one in shares.values()], 0.6, color=colours)
        axes.set_yticks(range(len(shares)), [name.replace("_", " ").removesuffix(" model") for name in shares])
        axes.invert_yaxis()
        entitled(axes, f"R_XiL = {100 * result['R_XiL']:.1f} %", "fidelity in %")
    return fig


def budget_card() -> Any:
    """The shares of the four largest inputs in the variance."""
    import rigmatch as rm
    from matching.report.common import VEHICLE, styled

    result = rm.uncertainty(ROOT / "examples" / "sensors" / "torque_M2.toml", draws=10_000).measurands[0]
    rows = sorted(result.rows, key=lambda row: -row.share)[:4]
    with styled():
        fig, axes = card()
        axes.barh(range(len(rows)), [100 * row.share for row in rows], 0.6, color=VEHICLE)
        axes.set_yticks(range(len(rows)), [row.name.replace("_", " ") for row in rows])
        axes.invert_yaxis()
        entitled(
            axes, f"U = {result.expanded:.2g} N·m (k = {result.coverage_factor:.2g})", "share of the variance in %"
        )
    return fig


def card() -> Any:
    """Figure and axes of a card."""
    from matching.report.common import figure

    fig = figure(*CARD)
    return fig, fig.subplots()


def entitled(axes: Any, title: str, below: str) -> None:
    """Title and label in letters that are read at the size of a card."""
    axes.set_title(title, fontsize=9)
    axes.set_xlabel(below, fontsize=8)
    axes.tick_params(labelsize=8)


def named(fig: Any, colours: dict[str, str]) -> None:
    """The names of the curves in their colours, in one line below."""
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=colour, linewidth=2.5, label=name) for name, colour in colours.items()]
    fig.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8, handlelength=1, columnspacing=0.8)


def foreign_vehicle() -> Any:
    """Drives of the vehicle of others, and of the bed with it at its cuts."""
    import rigmatch as rm
    from matching.report.driving import drives_figure

    folder = ROOT / "examples" / "foreign_vehicle"
    rm.export(folder / "car.toml", fmu=ROOT / "out" / "car.fmu")
    result = rm.match(folder / "case.toml")
    of_the_case = result.driving.drives[: len(result.case.operating_range.drives)]
    return drives_figure(replace(result.driving, drives=of_the_case), result.case)


def dead_time() -> Any:
    """Response error of the reference match over the dead time: every structure, measured and unmeasured torques."""
    from matching.report.common import LIMIT, curve, figure, styled
    from modelling.resources import cores

    points = [(name, ms) for ms in sorted(DEAD_TIMES, reverse=True) for name in STRUCTURES]
    with ProcessPoolExecutor(cores()) as pool:  # a quarter of an hour of processor time
        found = dict(zip(points, pool.map(_at_dead_time, *zip(*points, strict=True)), strict=True))
    with styled():
        fig = figure(7.4, 3.4)
        panels = fig.subplots(1, 2, sharey=True)
        for axes, title, error, allowed in (
            (panels[0], "torques that are measured", "measured", 0.1),
            (panels[1], "torques that are not measured", "unmeasured", 0.3),
        ):
            for place, name in enumerate(STRUCTURES):
                look = curve(place)
                axes.plot(DEAD_TIMES, [found[name, ms][error] for ms in DEAD_TIMES], label=name, **look)
                for ms in DEAD_TIMES:
                    full = look["color"] if found[name, ms]["status"] == "matched" else "none"
                    axes.plot(ms, found[name, ms][error], "o", color=look["color"], markerfacecolor=full, markersize=5)
            axes.axhline(allowed, color=LIMIT, linewidth=0.8, linestyle="--")
            axes.set(xscale="log", yscale="log", title=title, xlabel="dead time in ms")
            axes.set_xticks(DEAD_TIMES, [f"{ms:g}" for ms in DEAD_TIMES])
            axes.minorticks_off()
        panels[0].set_ylabel("response error of the bed as planned")
        fig.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return fig


def _at_dead_time(structure: str, ms: float) -> dict[str, Any]:
    """Status and errors of the match of the reference case with a structure and a dead time in ms."""
    import rigmatch as rm
    from matching.match.case_file import case_from_tables
    from modelling.toml import read_toml

    file = REFERENCE / STRUCTURES[structure]
    tables = read_toml(file)
    tables["loop"] |= {"structure": structure, "dead_time": 1e-3 * ms}
    result = rm.match(case_from_tables(tables, str(file)))
    error = result.response_error
    return {"status": result.status, "measured": error.after, "unmeasured": error.unmeasured}


def explorer(tab: str) -> bytes:
    """A tab of the explorer with the reference case, as the browser shows it."""
    from playwright.sync_api import sync_playwright

    import rigmatch as rm

    page_of = rm.explore(REFERENCE / "case.toml", out=ROOT / "out" / "explorer_pictures")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1200, "height": 700})
        page.goto(page_of.address)
        page.get_by_role("tab", name=tab).click()
        page.locator(TABS[tab]).first.wait_for()
        page.wait_for_timeout(DRAWN_MS)
        taken = page.screenshot()
        browser.close()
    page_of.stop()
    return base64.b64decode(with_palette(base64.b64encode(taken).decode(), 256))


def live_report(name: str) -> bytes:
    """The page that commands write, typed in a folder of their own, packed."""
    with TemporaryDirectory() as folder:
        shutil.copytree(ROOT / "examples" / "from_recordings", Path(folder) / "two")
        shutil.copytree(ROOT / "examples" / "diagnosis", Path(folder) / "drive")
        for line in LIVE[name]:
            subprocess.run(
                [sys.executable, *line.split()], cwd=folder, check=True, env=os.environ | {"PYTHONPATH": str(ROOT)}
            )
        return lzma.compress((Path(folder) / "out" / "report.html").read_bytes(), preset=9 | lzma.PRESET_EXTREME)


def first_screen(name: str) -> bytes:
    """What a browser shows of a live report when it is opened, small."""
    from playwright.sync_api import sync_playwright
    from site_pages.reports import unpack

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 800, "height": 500})
        page.goto((unpack() / f"report_{name}.html").as_uri())
        page.wait_for_timeout(DRAWN_MS)
        taken = page.screenshot()
        browser.close()
    return base64.b64decode(with_palette(base64.b64encode(taken).decode()))


def run_notebook(path: Path) -> None:
    """Run a notebook from top to bottom and keep its outputs."""
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    resources = {"metadata": {"path": str(path.parent)}}
    done = NotebookClient(notebook, timeout=NOTEBOOK_TIMEOUT, kernel_name="python3", resources=resources).execute()
    done.metadata["language_info"] = {"name": "python"}
    for cell in done.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type == "code":  # progress passes by, and is no output
            cell.outputs = [output for output in cell.outputs if output.get("name") != "stderr"]
        for output in cell.get("outputs", []):
            if "image/png" in output.get("data", {}):
                output["data"]["image/png"] = with_palette(output["data"]["image/png"])
    nbformat.write(done, path)


def with_palette(picture: str, colours: int = COLOURS) -> str:
    """A PNG in base64 with a palette of the colours it uses most, instead of four bytes a pixel."""
    small = io.BytesIO()
    with Image.open(io.BytesIO(base64.b64decode(picture))) as opened:
        opened.convert("RGB").quantize(colours, dither=Image.Dither.NONE).save(small, "png", optimize=True)
    return base64.b64encode(small.getvalue()).decode("ascii")


def main(names: list[str]) -> None:
    """Make the named files, or all."""
    sys.path.insert(0, str(ROOT))
    from matching.report.common import image

    makers = generators()
    if wrong := [name for name in names if name not in makers]:
        raise SystemExit(f"{wrong[0]} is not a generated file; these are: {', '.join(makers)}")
    for name in names or makers:
        print(f"{name} …", flush=True)
        if (figure := makers[name]()) is not None:
            (ROOT / name).parent.mkdir(exist_ok=True)
            (ROOT / name).write_bytes(figure if isinstance(figure, bytes) else image(figure, name.rpartition(".")[2]))


if __name__ == "__main__":
    main(sys.argv[1:])
