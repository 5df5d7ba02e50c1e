"""Cases: sized as asked, repeatable, in the specification's formats, every kind possible in two systems at least."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from plant import OutOfReach, make_case
from plant.hidden import INSIDE, KINDS, OUTSIDE, SPOKEN, Hidden
from plant.scene import measured_worth, set_scene
from plant.systems import SYSTEMS

SHORT = 2.0  # s, enough here


def kinds_hidden(answer: dict) -> list[Hidden]:
    """Back from the specification's name to the plant's own, which parts the lag of an input from that of a sensor."""
    own = {(SPOKEN[kind], KINDS[kind].group): kind for kind in SPOKEN}
    return [
        Hidden(own.get((one["kind"], one["at"].split(".")[0]), one["kind"]), one["at"], one["parameters"])
        for one in answer["causes"]
    ]


@pytest.mark.parametrize(
    ("system", "kind", "closed_loop", "size"),
    [
        ("two_mass", "coulomb_friction", False, 30.0),
        ("two_mass", "coulomb_friction", False, 3.0),
        ("test_bed", "hysteresis", False, 3.0),
        ("vehicle", "wrong_parameter", False, 3.0),
        ("two_mass", "crosstalk", False, 3.0),
        ("two_mass", "backlash", True, 3.0),  # a wide gap's motion is chaotic: other processors, other worths
        ("test_bed", "dead_time", True, 3.0),
    ],
)
def test_an_effect_is_worth_what_was_asked(system: str, kind: str, closed_loop: bool, size: float) -> None:
    case = make_case(system, kind, size, seed=5, duration=2.5, rate=500.0, closed_loop=closed_loop)
    scene = set_scene(system, "normal", 5, 2.5, 500.0, closed_loop, False)
    assert measured_worth(scene, kinds_hidden(case.answer)) == pytest.approx(size, rel=0.1)


@pytest.mark.parametrize("kind", INSIDE + OUTSIDE)
def test_every_kind_can_be_hidden_in_two_systems(kind: str) -> None:
    made = 0
    for system in SYSTEMS:
        try:
            case = make_case(system, kind, "subtle", seed=2, duration=0.5, rate=500.0)
        except OutOfReach:
            continue
        assert case.answer["kind"] == SPOKEN.get(kind, kind)
        assert case.answer["outside"] == (kind in OUTSIDE)
        made += 1
        if made == 2:
            return
    pytest.fail(f"{kind} fits into {made} systems")


def test_files_are_in_the_specified_formats(tmp_path: Path) -> None:
    case = make_case("test_bed", ("backlash", "sensor_offset"), "plain", seed=1, duration=SHORT, missing=1, moving=True)
    folder = case.write(tmp_path / "case")
    model = tomllib.loads((folder / "model.toml").read_text())
    assert model["shafts"]["side_left"]["between"] == ["differential", "dyno_left"]
    assert model["shafts"]["side_left"]["stiffness"]["tolerance"] == 0.1
    for name in ("recording.csv", "holdout.csv"):
        header = (folder / name).read_text().splitlines()[0].split(",")
        assert header[:2] == ["time [s]", "motor_torque [N*m]"]
        assert len(header) == 1 + len(model["inputs"]) + len(model["sensors"]) - 1
        assert case.answer["missing"][0] not in {column.split(" ")[0] for column in header}
        data = np.loadtxt(folder / name, delimiter=",", skiprows=1)
        assert data.shape[0] == round(SHORT * 1000)
        assert np.all(np.isfinite(data))
        assert np.abs(data[0, header.index("motor_speed [1/min]")]) > 1  # starts in motion
    assert "shafts" in case.answer["causes"][0]["at"]
    assert "sensors" in case.answer["causes"][1]["at"]
    assert (folder / "recording.csv").read_text() != (folder / "holdout.csv").read_text()


def test_written_values_err_within_their_tolerance_and_known_ones_not_at_all() -> None:
    case = make_case("vehicle", (), seed=4, duration=SHORT)
    model = tomllib.loads(case.model)
    off = []
    for name, true in case.answer["base"].items():
        table, part, quantity = name.split(".")
        given = model[table][part][quantity]
        if isinstance(given, dict):
            off.append(abs(true / given["value"] - 1) / given["tolerance"])
        else:
            assert given == pytest.approx(true, rel=1e-5)
    assert max(off) <= 0.71
    assert np.mean(off) > 0.1


def test_a_wrong_parameter_is_written_as_known_and_told_as_it_is() -> None:
    case = make_case("two_mass", [("wrong_parameter", "inertias.load.J")], "plain", seed=4, duration=SHORT)
    written = tomllib.loads(case.model)["inertias"]["load"]["J"]
    true = case.answer["parameters"]["value"]
    assert abs(written / true - 1) > 0.005
    assert case.answer["base"]["inertias.load.J"] == true


def test_noise_is_as_stated_and_a_seed_repeats() -> None:
    first, again, other = (make_case("two_mass", (), seed=s, duration=2 * SHORT) for s in (6, 6, 7))
    assert first.recording == again.recording
    assert first.holdout == again.holdout
    assert first.model == again.model
    assert first.recording != other.recording
    sigma = tomllib.loads(first.model)["sensors"]["load_speed"]["uncertainty"]
    speed = np.loadtxt(first.recording.splitlines(), delimiter=",", skiprows=1)[:, 4] * np.pi / 30
    assert np.diff(speed, 4).std() / np.sqrt(70) == pytest.approx(sigma, rel=0.05)


def test_places_that_only_a_torque_sensor_could_part_are_told() -> None:
    case = make_case("vehicle", [("constant_torque", "inertias.body")], "plain", seed=3, duration=SHORT, rivals=True)
    assert {"inertias.wheel_left", "inertias.wheel_right"} <= set(case.answer["equivalent"])
    clear = make_case("two_mass", [("backlash", "shafts.link")], "plain", seed=3, duration=SHORT, rivals=True)
    assert clear.answer["equivalent_causes"] == []


@pytest.mark.long
def test_other_kinds_at_other_places_are_told_where_both_look_alike() -> None:
    """Always forwards, friction is a constant torque; behind a stiff gearbox it may sit on either side."""
    case = make_case(
        "test_bed", [("coulomb_friction", "inertias.motor")], "plain", "low", 2073528951, 8.0,
        closed_loop=True, moving=True, rivals=True,
    )  # fmt: skip
    alike = {(one["kind"], one["at"]) for one in case.answer["equivalent_causes"]}
    assert ("constant_torque", "inertias.differential") in alike
    assert all(at not in ("inertias.dyno_left", "inertias.dyno_right") for _, at in alike)


def test_some_systems_are_geared() -> None:
    for system in ("test_bed", "vehicle"):
        drives = [SYSTEMS[system](np.random.default_rng(seed)) for seed in range(20)]
        geared = [drive.speed_ratio("motor") for drive in drives if drive.speed_ratio("motor") != 1]
        assert 2 <= len(geared) <= 12
        assert 6 <= min(geared) <= max(geared) <= 12
    seed = next(seed for seed in range(20) if "\nratio" in make_case("vehicle", (), seed=seed, duration=0.3).model)
    case = make_case("vehicle", (), "plain", "low", seed, SHORT, moving=True)
    data = np.loadtxt(case.recording.splitlines(), delimiter=",", skiprows=1)
    ratio = tomllib.loads(case.model)["shafts"]["side_left"]["ratio"]
    assert np.polyfit(data[:, 5], data[:, 2], 1)[0] == pytest.approx(ratio, rel=0.1)  # motor over body speed


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown kind 'wobble'"):
        make_case("two_mass", "wobble", duration=1.0)
