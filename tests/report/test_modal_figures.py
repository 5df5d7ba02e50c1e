"""The command ``rigmatch modes`` and its figures."""

import json
from pathlib import Path

import numpy as np
import pytest
from result_schema import check_schema

import rigmatch as rm
from matching.cli import main
from matching.report.common import RIG, VEHICLE, image
from matching.report.modes import Column, ModeAnimation, energy_figure, mode_table, shares_figure
from modelling.modal.modes import modes
from modelling.modal.result import Mode
from modelling.model_file import dumps, from_dict, load

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig"


def heights(axes):
    return [bar.get_height() for bar in axes.patches]


def test_bars_show_the_shares():
    vehicle, rig = (modes(load(CASE / f"{name}.toml")) for name in ("vehicle", "rig"))
    drawn = energy_figure([Column("Vehicle", VEHICLE, vehicle, (2,)), Column("Rig", RIG, rig, (2,))])
    frequencies, _, kinetic, other, potential, _ = drawn.axes
    np.testing.assert_allclose(heights(frequencies)[1:], vehicle.frequencies[1:])
    np.testing.assert_allclose(heights(kinetic), 100 * vehicle.kinetic[1])
    np.testing.assert_allclose(heights(other), 100 * rig.kinetic[1])
    np.testing.assert_allclose(heights(potential), 100 * vehicle.potential[1])
    assert all(axes.get_ylabel() for axes in (frequencies, kinetic, potential))


@pytest.mark.parametrize("count", [1, 2, 31])
def test_any_size_of_model_can_be_drawn(count):
    shafts = {f"s{i}": {"between": [f"i{i}", f"i{i + 1}"], "stiffness": 100.0 + i} for i in range(count - 1)}
    found = modes(from_dict({"inertias": {f"i{i}": {"J": 1.0} for i in range(count)}, "shafts": shafts}))
    for drawn in (energy_figure([Column("chain", VEHICLE, found)]), shares_figure(found)):
        assert image(drawn).startswith(b"<?xml")


def test_command_writes_modes_and_figures(tmp_path, capsys):
    assert main(["modes", str(CASE / "rig.toml"), "--out", str(tmp_path), "--reduced", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    written = json.loads((tmp_path / "modes.json").read_text())
    assert printed == written
    assert written["modes"][1]["frequency"] == pytest.approx(16.703, rel=1e-3)
    check_schema("modes", written)
    assert written["modes"][1]["symmetry"] == "antisymmetric"
    assert written["reduced"]["inertias.rotor_left.J"] == pytest.approx(0.895 / 10.05**2)
    assert {path.name for path in tmp_path.iterdir()} == {"modes.json", "modes.svg", "energy_shares.svg"}


def test_damped_command_and_table(tmp_path, capsys):
    assert main(["modes", str(CASE / "rig.toml"), "--out", str(tmp_path), "--damped"]) == 0
    line = capsys.readouterr().out.splitlines()[2].split()
    assert line[:3] == ["2", "16.7", "16.7"]  # rings at, natural
    assert 0.01 < float(line[3]) < 0.02
    check_schema("modes", json.loads((tmp_path / "modes.json").read_text()))
    rows = mode_table(modes(load(CASE / "rig.toml")).to_dict()["modes"])
    assert rows[1]["kinetic energy"] == "rotor left 48 %, rotor right 48 %"


def test_change_shows_eq_8_beside_the_exact_solution(tmp_path, capsys):
    command = ["modes", str(CASE / "rig.toml"), "--out", str(tmp_path)]
    changes = [f"--change=inertias.rotor_{side}.J=1.79 kg*m^2" for side in ("left", "right")]
    assert main([*command, *changes]) == 0
    out = capsys.readouterr().out
    assert "-47.6 %" in out
    assert "-28.4 %" in out
    result = json.loads((tmp_path / "modes.json").read_text())
    check_schema("modes", result)
    written = result["what_if"]["modes"][1]
    assert written["exact"] == pytest.approx(11.955, rel=1e-4)
    for change, said in (
        ("inertias.rotor_lefd.J=1", "did you mean 'inertias.rotor_left.J'"),
        ("inertias.rotor_left.J", "has no '='"),
        ("inertias.rotor_left.J=1 N*m", "does not fit"),
        ("inertias.rotor_left.J=-1", "-1 is not possible"),
    ):
        assert main([*command, "--change", change]) == 2
        error = capsys.readouterr().err
        assert said in error
        assert error.count("\n") == 1


def test_bad_model_is_one_line_and_nothing_is_written(tmp_path, capsys):
    bad = tmp_path / "bad.toml"
    bad.write_text("[inertias.a]\nJ = -1\n")
    out = tmp_path / "out"
    assert main(["modes", str(bad), "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "inertias.a.J" in error
    assert not out.exists()
    loose = tmp_path / "loose.toml"
    loose.write_text(dumps(from_dict({"inertias": {"a": {"J": 1.0}}})))
    assert main(["modes", str(loose), "--out", str(out), "--reduced"]) == 2
    assert f"{loose}: reference" in capsys.readouterr().err


def test_responses_are_drawn_with_amplitude_and_continuous_phase():
    """One inertia: speed per torque is 1/(iωJ + d), its phase from 0 to −90°; two sensors, two inputs."""
    J, drag, f = 2.0, 8.0, np.geomspace(0.05, 20, 30)
    system = from_dict({
        "inertias": {"a": {"J": J, "drag": drag}},
        "inputs": {"motor": {"on": "a"}, "brake": {"on": "a"}},
        "sensors": {"speed": {"measures": "speed", "of": "a"}, "angle": {"measures": "angle", "of": "a"}},
    })  # fmt: skip
    drawn = rm.response(system, f).plot()
    H = 1 / (2j * np.pi * f * J + drag)
    for place, wanted in ((0, H), (1, H / (2j * np.pi * f))):
        for column in (0, 1):
            amplitude, phase = (drawn.axes[row + column].get_lines()[place] for row in (0, 2))
            np.testing.assert_allclose(amplitude.get_ydata(), np.abs(wanted), rtol=1e-6)
            np.testing.assert_allclose(phase.get_ydata(), np.degrees(np.unwrap(np.angle(wanted))), atol=1e-4)


def test_a_disc_says_its_ratio_and_a_phase_where_it_has_one():
    shape = {"motor": 2.0, "load": -0.5, "wheel": 1j}
    drawn = ModeAnimation(Mode(1, 10.0, 0.1, "none", {}, {}, 1.0, 1.0, shape)).svg
    for label in ("+1.00", "-0.25", "0.50, +90°"):
        assert f">{label}<" in drawn
    assert drawn.count("°<") == 1
