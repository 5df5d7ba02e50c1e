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
    assert f"{type(result).__name__}(" not in printed[0]
    assert pretty(result) == str(result)  # in IPython, too: not every field of every array
    assert repr(result).startswith(f"{type(result).__name__}(")
    assert len(repr(result)) <= 120
    content = result.to_dict()
    if name != "response":  # complex numbers, which JSON has not
        assert json.loads(strict_json(content))


@pytest.mark.parametrize("name", [name for name in RESULTS if name not in ("response", "simulate")])
def test_a_saved_result_is_read_again(name, recording, tmp_path):
    """Entries, table and text are those of the result; saved again, it has the same files."""
    result = RESULTS[name](recording)
    saved = rm.load_result(result.save(tmp_path / "out"))
    assert str(saved) == str(result)
    assert saved.to_dict() == json.loads(strict_json(result.to_dict())) | {"files": saved.files}
    assert saved.to_dataframe().equals(rm.load_result(saved.save(tmp_path / "again")).to_dataframe())
    assert sorted(path.name for path in (tmp_path / "again").iterdir()) == sorted(saved.files)


def test_tables_of_results_hold_their_numbers(recording, tmp_path):
    found = rm.modes(VEHICLE)
    frame = found.to_dataframe()
    np.testing.assert_array_equal(frame["frequency [Hz]"], found.frequencies)
    with pytest.raises(InputError, match="mode"):
        found.to_dataframe("shapes")
    motion = rm.simulate(EXAMPLES / "compact_bev" / "rig.toml", recording)
    frame = motion.to_dataframe()
    name = next(iter(motion.readings))
    whole = f"{name} [{motion.units[name]}]"
    np.testing.assert_array_equal(frame[whole], motion[name])
    assert frame.attrs["units"][whole] == motion.units[name]
    again = rm.load_result(motion.save(tmp_path / "simulated"))
    np.testing.assert_allclose(again[name], motion[name], rtol=1e-8)
    assert list(again.to_dataframe()) == list(frame)
    assert "<svg" in again.plot().svg
    with pytest.raises(InputError, match="did you mean"):
        again[name + "s"]
    responses = rm.response(VEHICLE, [1.0, 8.0])
    pair = responses.sensors[0], responses.inputs[0]
    frame = responses.to_dataframe()
    np.testing.assert_array_equal(frame[f"{' / '.join(pair)} [{responses.unit(*pair)}]"], responses[pair])
    again = rm.load_result(responses.save(tmp_path / "response"))
    np.testing.assert_allclose(again[f"{' / '.join(pair)} modulus"], np.abs(responses[pair]), rtol=1e-6)
    assert again.plot().path.name == "response.svg"


def test_a_saved_figure_is_the_one_that_was_drawn(tmp_path):
    saved = rm.load_result(rm.modes(VEHICLE).save(tmp_path))
    assert saved.plot().svg == (tmp_path / "energy_shares.svg").read_text()
    assert saved.plot("modes").path.name == "modes.svg"
    assert saved.plot()._repr_svg_().lstrip().startswith("<?xml")
    with pytest.raises(InputError, match="mode"):
        saved.plot("mode")
    (tmp_path / "modes.svg").unlink()
    with pytest.raises(InputError, match="is not there any more"):
        saved.plot("modes")


def test_progress_goes_to_the_log(caplog):
    caplog.set_level("INFO", logger="rigmatch")
    rm.tolerance(EXAMPLES / "road_to_rig" / "case.toml", draws=20)
    assert any(record.name == "rigmatch" and record.message.startswith("tolerance: ") for record in caplog.records)


def test_what_is_no_saved_result_is_said(tmp_path):
    for content, said in ((None, "is no result"), ("{", "is not JSON"), ("[]", "is no table")):
        if content:
            (tmp_path / "map.json").write_text(content)
        with pytest.raises(InputError, match=said):
            rm.load_result(tmp_path)
    (tmp_path / "modes.json").write_text("{}")
    with pytest.raises(InputError, match="holds 2 results"):
        rm.load_result(tmp_path)


def test_quantities_may_be_texts_with_units():
    """The same as numbers in SI, wherever a quantity is an argument."""
    name = "shafts.side_left.stiffness"
    np.testing.assert_array_equal(
        rm.modes(VEHICLE, {name: "8 kN*m/rad"}).frequencies, rm.modes(VEHICLE, {name: 8e3}).frequencies
    )
    assert rm.load(VEHICLE).with_values({name: "8 kN*m/rad"}).parameters[name].value == 8e3
    np.testing.assert_allclose(rm.response(VEHICLE, ["60 1/min", "10 Hz"]).frequencies, [1.0, 10.0])
    assert rm.TipIn(amplitude="0.1 kN*m", rise_time="50 ms") == rm.TipIn(amplitude=100.0, rise_time=0.05)
    for wrong in ({name: "8 kg"}, {name: "8,5 kN*m/rad"}):
        with pytest.raises(InputError, match=name):
            rm.modes(VEHICLE, wrong)
    with pytest.raises(InputError, match="rise_time"):
        rm.TipIn(amplitude=100.0, rise_time="50 N")
    for arguments, said in (({"duration": "20 N"}, "duration"), ({"speed": "4 m"}, "speed")):
        with pytest.raises(InputError, match=said):
            rm.excite(EXAMPLES / "compact_bev" / "case.toml", **arguments)


def test_every_command_has_its_function_and_every_function_is_offered():
    assert set(COMMANDS) - {"new"} <= set(rm.__all__)
    assert dir(rm) == sorted([*rm.__all__, "__version__"])
    assert all(callable(getattr(rm, name)) and getattr(rm, name).__doc__ for name in rm.__all__)
    with pytest.raises(AttributeError, match="it has BackOut, Campbell, Case, Controller"):
        getattr(rm, "matches")  # noqa: B009


def test_the_error_of_bad_input_is_public_and_no_other_error_passes_for_it():
    with pytest.raises(rm.InputError, match=r"inertias\.motor"):
        rm.load(VEHICLE)["inertias.moter"]
    assert not issubclass(rm.InputError, ValueError)  # a fault of the program would pass for a mistake of the user
    with pytest.raises(rm.InputError, match=r"motor_torque: 5 is no manoeuvre; write one, such as rm.Step"):
        rm.simulate(VEHICLE, {"motor_torque": 5})


def test_a_quantity_is_found_under_its_name():
    vehicle = rm.load(VEHICLE)
    assert vehicle["inertias.motor.J"] is vehicle["inertias.motor"].J


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
    """A rotor with drag, excited by a sine: what is held out is another file and has 1.2 times the noise."""
    J, drag = 0.5, 0.3
    (tmp_path / "rotor.toml").write_text(
        f"[inertias]\nrotor = {{ J = {J}, drag = {drag} }}\n[inputs]\nmotor = {{ on = 'rotor' }}\n"
        "[sensors]\nspeed = { measures = 'speed', of = 'rotor', uncertainty = 0.01 }\n"
    )
    time, rate = np.arange(0, 4, 5e-3), 2 * np.pi
    wave = np.exp(1j * rate * time)
    for name, noise in (("fitted", 0.01), ("judged", 0.012)):
        speed = (wave / (1j * rate * J + drag)).real + noise * np.random.default_rng(len(name)).normal(size=len(time))
        rows = np.stack([time, wave.real, speed], axis=1)
        header = "time [s],motor [N*m],speed [rad/s]"
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header=header, comments="")
    found = rm.diagnose(tmp_path / "rotor.toml", tmp_path / "fitted.csv", [tmp_path / "judged.csv"])
    assert found.verdict == "adequate"
    assert found.errors["speed"].after == pytest.approx(0.01, rel=0.1)
    assert found.errors["speed"].after_holdout == pytest.approx(0.012, rel=0.05)


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
