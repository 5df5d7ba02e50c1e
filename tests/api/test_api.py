"""The functions behind the commands: same names, results that show themselves, nothing heavy before it is needed."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from IPython.lib.pretty import pretty
from matplotlib.figure import Figure

import rigmatch as rm
from matching.commands import COMMANDS
from modelling.errors import InputError
from modelling.writing import strict_json

EXAMPLES = Path(__file__).parents[2] / "examples"
VEHICLE = EXAMPLES / "road_to_rig" / "vehicle.toml"


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    system = rm.load(EXAMPLES / "compact_bev" / "rig.toml")
    time = np.arange(0, 0.5, 1e-3)
    columns = {"time [s]": time} | {f"{part.name} [N*m]": 5.0 * (time > 0.1) for part in system.inputs}
    path = tmp_path_factory.mktemp("recording") / "step.csv"
    np.savetxt(path, np.stack(list(columns.values()), axis=1), delimiter=",", header=",".join(columns), comments="")
    return path


RESULTS = {
    "modes": lambda recording: rm.modes(VEHICLE),
    "damped modes": lambda recording: rm.modes(VEHICLE, damped=True),
    "response": lambda recording: rm.response(VEHICLE, np.geomspace(0.5, 30, 40)),
    "simulate": lambda recording: rm.simulate(EXAMPLES / "compact_bev" / "rig.toml", recording),
    "uncertainty": lambda recording: rm.uncertainty(EXAMPLES / "gum" / "end_gauge.toml", draws=20_000),
    "fidelity": lambda recording: rm.fidelity(EXAMPLES / "fidelity" / "tab2.toml"),
}


def test_a_recording_with_a_gap_is_not_simulated_across_it(recording, tmp_path):
    """0.2 s without rows: as the command, it says where to cut."""
    lines = recording.read_text().splitlines()
    path = tmp_path / "gap.csv"
    path.write_text("\n".join([*lines[:150], *lines[350:]]))
    with pytest.raises(InputError, match=r"has a gap from .* cut the recording there"):
        rm.simulate(EXAMPLES / "compact_bev" / "rig.toml", path)


@pytest.mark.parametrize("name", RESULTS)
def test_results_are_frozen_and_show_themselves(name, recording):
    result = RESULTS[name](recording)
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(result, dataclasses.fields(result)[0].name, None)
    assert isinstance(result.plot(), Figure)
    page = result._repr_html_()
    assert page.startswith(("<p>", "<table>", "<pre>"))
    assert "None" not in page[:200]
    printed = str(result).splitlines()
    assert len(printed) > 1
    assert max(map(len, printed)) < 250
    assert type(result).__name__ not in printed[0]
    assert pretty(result) == str(result)  # in IPython, too: not every field of every array
    content = result.to_dict()
    if name != "response":  # complex numbers, which JSON has not
        assert json.loads(strict_json(content))


def test_every_command_has_its_function_and_every_function_is_offered():
    assert set(COMMANDS) - {"new"} <= set(rm.__all__)
    assert set(rm.__all__) <= set(dir(rm))
    assert all(callable(getattr(rm, name)) and getattr(rm, name).__doc__ for name in rm.__all__)
    with pytest.raises(AttributeError, match="it has BackOut, DriveAway"):
        getattr(rm, "matches")  # noqa: B009


def test_labelled_arrays():
    found = rm.modes(VEHICLE)
    labelled = found.to_xarray()
    assert float(labelled.frequency.sel(mode=2)) == found[1].frequency
    np.testing.assert_allclose(labelled.kinetic.sum("mass"), 1.0)
    assert labelled.frequency.units == "Hz"
    assert "units" not in labelled.mode.attrs
    responses = rm.response(VEHICLE, np.array([1.0, 8.0]))
    own = responses.to_xarray().response.sel(sensor=responses.sensors[0], input=responses.inputs[0])
    np.testing.assert_array_equal(own, responses[responses.sensors[0], responses.inputs[0]])
    assert own.frequency.units == "Hz"


def test_without_xarray_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(InputError, match="xarray is not installed"):
        rm.modes(VEHICLE).to_xarray()


def test_nothing_heavy_is_imported_before_it_is_asked_for():
    heavy = "{'sympy', 'casadi', 'scipy', 'matplotlib', 'pint', 'numpy', 'jinja2'}"
    for statement in ("import rigmatch, modelling, matching", "from matching.cli import main; main(['--help'])"):
        words = f"import sys; {statement}; print(sorted({heavy} & set(sys.modules)), file=sys.stderr)"
        done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
        assert done.stderr.strip() == "[]"


def test_a_diagnosis_reads_the_files_of_both_parts(tmp_path):
    """A rotor with drag, excited by a sine: what is held out is another file and has twice the noise."""
    J, drag = 0.5, 0.3
    (tmp_path / "rotor.toml").write_text(
        f"[inertias]\nrotor = {{ J = {J}, drag = {drag} }}\n[inputs]\nmotor = {{ on = 'rotor' }}\n"
        "[sensors]\nspeed = { measures = 'speed', of = 'rotor', uncertainty = 0.01 }\n"
    )
    time, rate = np.arange(0, 4, 5e-3), 2 * np.pi
    wave = np.exp(1j * rate * time)
    for name, noise in (("fitted", 0.01), ("judged", 0.02)):
        speed = (wave / (1j * rate * J + drag)).real + noise * np.random.default_rng(len(name)).normal(size=len(time))
        rows = np.stack([time, wave.real, speed], axis=1)
        header = "time [s],motor [N*m],speed [rad/s]"
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header=header, comments="")
    found = rm.diagnose(tmp_path / "rotor.toml", tmp_path / "fitted.csv", [tmp_path / "judged.csv"])
    assert found.verdict == "adequate"
    assert found.errors["speed"].after == pytest.approx(0.01, rel=0.1)
    assert found.errors["speed"].after_holdout == pytest.approx(0.02, rel=0.1)


def test_mode_animation(tmp_path):
    mode = rm.modes(VEHICLE)[1]
    drawn = mode.animate()
    assert drawn.svg.count("<circle") == len(mode.shape)
    assert drawn._repr_html_() == drawn.svg
    assert "http" not in drawn.svg
    largest = max(abs(float(part.split(";")[0])) for part in drawn.svg.split('values="')[1:])
    assert largest == pytest.approx(70.0)
    damped = rm.modes(VEHICLE, damped=True)[2].animate()
    assert "damping ratio" in damped.svg
    assert isinstance(drawn.plot(), Figure)
    assert "begin" not in drawn.svg
    drawn.save(tmp_path / "mode.svg")
    assert ElementTree.parse(tmp_path / "mode.svg").getroot().tag == "{http://www.w3.org/2000/svg}svg"


def test_a_damped_mode_swings_out_of_step():
    """Pointers follow |x|·cos(ωt + φ) of the eigenvector, read off the drawing at a quarter of the period."""
    slipping = rm.load(EXAMPLES / "compact_bev" / "vehicle.toml")
    mode = max(rm.modes(slipping, damped=True), key=lambda own: max(abs(np.imag(list(own.shape.values())))))
    drawn = mode.animate()
    largest = max(mode.shape.values(), key=abs)
    root = ElementTree.fromstring(drawn.svg)
    turns = [disc.find("g") for disc in root.iter("g") if disc.find("circle") is not None]
    assert len(turns) == len(mode.shape)
    out_of_step = 0
    for turn, own in zip(turns, mode.shape.values(), strict=True):
        moving = turn.find("animateTransform")
        if moving is None:
            assert abs(own / largest) < 1e-3
            continue
        out_of_step += moving.get("begin") is not None
        size, begin = float(moving.get("values").split(";")[0]), float((moving.get("begin") or "0s")[:-1])
        for time in (0.0, 0.5):  # s of a period of 2 s
            seen = size * np.cos(np.pi * (time - begin))
            expected = 70 * abs(own / largest) * np.cos(np.pi * time + np.angle(own / largest))
            assert seen == pytest.approx(expected, abs=0.7)
    assert out_of_step >= 2
    axes = drawn.plot().axes
    assert [one.get_ylabel().split(" ")[0] for one in axes] == ["amplitude", "phase"]
