"""The physics in six pictures: each shows what the tests' own equations say, and moves."""

import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import eigh

import rigmatch as rm

ROOT = Path(__file__).parents[2]
NAMES = ("bed", "cut", "dead_time", "observer", "drawn_beds", "diagnosis")
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def physics(tmp_path_factory):
    """The module that draws, with the starter as it is: no picture but that of the observer needs it tuned."""
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        import physics
    finally:
        sys.path.pop(0)
    folder = tmp_path_factory.mktemp("physics") / "first"
    rm.new(folder)
    kept, physics._tuned = physics._tuned, lambda _: SimpleNamespace(case=rm.load_case(folder / "case.toml"))
    yield physics
    physics._tuned = kept


def texts(svg: bytes) -> list[str]:
    return [each.text for each in ET.fromstring(svg).iter(f"{SVG}text")]


def curves(svg: bytes, colour: str) -> list[np.ndarray]:
    found = [each for each in ET.fromstring(svg).iter(f"{SVG}polyline") if each.get("stroke") == colour]
    return [np.array([pair.split(",") for pair in each.get("points").split()], float) for each in found]


@pytest.mark.parametrize("name", NAMES)
def test_a_picture_moves_says_what_it_shows_and_stands_on_the_page(name):
    file = ROOT / "docs" / "gallery" / f"physics_{name}.svg"
    root = ET.fromstring(file.read_bytes())
    assert root.get("role") == "img"
    assert len(root.get("aria-label")) > 20
    assert any(each.tag in (f"{SVG}animate", f"{SVG}animateTransform") for each in root.iter())
    assert not any(each.tag == f"{SVG}script" or "href" in "".join(each.keys()) for each in root.iter())
    assert file.stat().st_size < 80_000
    page = (ROOT / "docs" / "physics.md").read_text(encoding="utf-8")
    assert re.search(rf"!\[[^\]]{{20,}}\]\(gallery/physics_{name}\.svg\)", page)


def test_the_frequencies_are_those_of_the_chain(physics):
    def lowest(J, stiffness):  # reduced to the wheels' side: motor, pinion with differential, and what lies beyond
        K = np.zeros((len(J), len(J)))
        for i, k in enumerate(stiffness):
            K[i : i + 2, i : i + 2] += k * np.array([[1, -1], [-1, 1]])
        return np.sqrt(eigh(K, np.diag(J), eigvals_only=True)[1]) / 2 / np.pi

    drive, ratio = (0.04 * 9.7**2, 0.001 * 9.7**2 + 0.06), 9000 * 9.7**2
    car = lowest((*drive, 2.2, 150), (ratio, 15000, 32000))
    bed = lowest((*drive, 0.09, 1.1), (ratio, 15000, 360000))
    said = texts(physics.what_a_bed_changes())
    assert f"{car:.1f} Hz" in said
    assert f"{bed:.1f} Hz" in said
    page = (ROOT / "docs" / "physics.md").read_text(encoding="utf-8")
    assert f"in the car at {car:.1f} Hz, on the bed at {bed:.1f} Hz" in page


def test_what_lies_beyond_the_cut_is_the_model(physics):
    said = texts(physics.what_a_cut_is())
    assert said[2:] == ["motor", "pinion", "differential", "the cut", "wheels", "body", "adapter", "rotor"]


def test_the_error_rises_with_the_dead_time(physics):
    (bound,) = curves(physics.why_dead_time_costs(), physics.MATCHED)
    assert np.all(np.diff(bound[:, 0]) > 0)
    assert np.all(np.diff(bound[:, 1]) < 0)  # px from above


def test_the_error_is_least_at_the_free_play_of_the_machine(physics):
    (error,) = curves(physics.what_a_diagnosis_compares(), physics.MATCHED)
    assert error[:, 1].argmax() == physics.GAPS // 2


def test_beds_are_drawn_about_the_plan(physics):
    svg = physics.what_a_drawn_bed_is()
    drawn, (plan,) = np.array(curves(svg, physics.PALE)), curves(svg, physics.INK)
    assert len(drawn) == physics.BEDS
    middle = drawn[:, :, 1].mean(axis=0)
    spread = drawn[:, :, 1].std(axis=0)
    assert np.all(np.abs(middle - plan[:, 1]) < 3 * spread / np.sqrt(len(drawn)) + spread.max())
    assert spread.max() > 3  # px: somewhere they differ to the eye


@pytest.mark.long
@pytest.mark.timeout(600)
def test_the_observer_follows_the_car_where_the_feed_forward_does_not(physics, tmp_path):
    """Both controllers are tuned anew, and no one tells them of the kick."""
    rm.new(tmp_path / "first")
    file = tmp_path / "first" / "case.toml"
    text = file.read_text(encoding="utf-8")
    results = {"model_based": rm.match(file)}
    lines = [line for line in text.splitlines() if not line.startswith(('"loop.', '"res'))]
    file.write_text("\n".join(lines).replace('structure = "model_based"', 'structure = "observer"'), encoding="utf-8")
    results["observer"] = rm.match(file)
    errors = {}
    for name, result in results.items():
        _, vehicle, bed = physics._kicked(result)
        errors[name] = np.sqrt(np.mean((bed - vehicle) ** 2)) / np.ptp(vehicle)
    assert errors["observer"] < 0.03
    assert errors["model_based"] > 4 * errors["observer"]
