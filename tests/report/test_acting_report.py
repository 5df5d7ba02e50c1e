"""Reports that act: curves to save, figures to zoom, where the result comes from; offline and small."""

import csv
import hashlib
import io
import re

import numpy as np
import pytest

from matching.cli import _fitted
from matching.report import curves as moving
from matching.report.common import provenance
from matching.report.curves import curve_data
from matching.report.match import content, page, summary

LARGEST_PAGE = 5_000_000  # bytes, as asked


@pytest.fixture(scope="module")
def data(hand_made):
    return curve_data(hand_made)


def test_saved_curves_are_those_of_the_figures(hand_made, data):
    head, *rows = csv.reader(io.StringIO(data["responses"]))
    numbers = np.array(rows, float)
    assert head[0] == "frequency [Hz]"
    assert numbers[:, 0] == pytest.approx(hand_made.curves.frequencies, rel=1e-6)
    pair = hand_made.case.compared[1]
    units = {"speed": "rad/s", "torque": "N·m", "angle": "rad", "acceleration": "rad/s²"}
    sensor = next(part for part in hand_made.case.vehicle.sensors if part.name == pair.sensor)
    column = head.index(f"{pair.sensor} / {pair.input} matched modulus [{units[sensor.measures]} per N·m]")
    assert head[column + 1].endswith("phase [deg]")
    values = numbers[:, column] * np.exp(1j * np.radians(numbers[:, column + 1]))
    assert values == pytest.approx(hand_made.curves.matched[:, 1], rel=1e-5)
    traces = hand_made.verification.traces
    head, *rows = csv.reader(io.StringIO(data["manoeuvre"]))
    column = next(number for number, name in enumerate(head) if name.startswith("Motor speed vehicle ["))
    assert np.array(rows, float)[:, column] == pytest.approx(traces.vehicle["motor_speed"], rel=1e-6, abs=1e-9)


def test_a_result_names_its_files_with_checksums_and_its_day(case, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    made = provenance(case, 7).to_dict()
    assert (made["date"], made["seed"]) == ("1970-01-02", 7)
    assert made["case"] == case.path
    assert [entry["file"].rpartition("/")[2] for entry in made["files"]] == ["case.toml", "vehicle.toml", "rig.toml"]
    for entry in made["files"]:
        with open(entry["file"], "rb") as file:
            assert entry["sha256"] == hashlib.sha256(file.read()).hexdigest()
    assert made["sha256"] == made["files"][0]["sha256"]


def test_the_page_holds_everything_and_asks_nobody(hand_made, data, case):
    pytest.importorskip("bokeh", reason="Bokeh is not installed: reports have pictures alone")
    acting = moving.moving_figures(hand_made)
    drawn = {"responses": b"<svg/>", "manoeuvre": b"<svg/>"}
    text = page(hand_made, drawn, provenance(case, 0), acting, data)
    assert len(text.encode()) < LARGEST_PAGE
    outside_scripts = re.sub(r"(<script[^>]*>).*?</script>", r"\1</script>", text, flags=re.DOTALL)
    assert re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', outside_scripts) == []
    assert text.count('download="') == 2
    assert text.count('class="moving"') == 2
    assert 'id="made"' in text
    assert "# Reference case" in text or case.title.split()[0] in text


def test_without_bokeh_the_pictures_remain(hand_made, monkeypatch):
    monkeypatch.setattr(moving, "find_spec", lambda _: None)
    assert moving.moving_figures(hand_made) == {}
    text = page(hand_made, {"responses": b"<svg/>"}, None, {})
    assert 'class="moving"' not in text
    assert 'class="printed"' not in text
    assert 'id="made"' not in text


def test_the_terminal_names_every_quantity_that_moved_and_wraps_at_its_width(hand_made):
    result = content(hand_made)
    named = summary(result)
    moved = [row["name"] for row in result["parameters"] if row["tuned"] != row["start"]]
    many = [
        dict(result["parameters"][0], name=f"loop.quantity_{n}", fixed=False, start=1.0, tuned=2.0) for n in range(30)
    ]
    crowded = summary(result | {"parameters": many})
    assert moved
    assert all(name in named for name in moved)
    assert all(row["name"] in crowded for row in many)
    assert len(crowded.splitlines()) <= 19
    wrapped = _fitted(crowded, 60)
    assert max(map(len, wrapped.splitlines())) <= 60
    assert wrapped.split() == crowded.split()
