"""Every command that takes a model or a case, on every shipped one, with defaults: an answer, or one line for a user.

What a command refuses here is a sentence about this input (exit 2), never a fault of the program (exit 1). Commands
that take minutes are run as far as ``--check`` goes; tests of their own run them whole.
"""

import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from structure.imports import ROOT

from matching.cli import main
from modelling.model_file import load

EXAMPLES = sorted((ROOT / "examples").rglob("*.toml"))


def _of(kind: str) -> list[Path]:
    """Shipped files with a table that only this kind has."""
    return [path for path in EXAMPLES if kind in tomllib.loads(path.read_text(encoding="utf-8"))]


MODELS, CASES = _of("inertias"), _of("dynamometers")
OF_CASES = [path for path in CASES if "vehicle" in tomllib.loads(path.read_text(encoding="utf-8"))]


def _named(path: Path) -> str:
    return f"{path.parent.name}-{path.stem}"


def _recording(model: Path, folder: Path) -> Path:
    """Half a second of a recording that names every channel of a model: chirps in, decaying swings out."""
    system, time = load(model), np.arange(500) / 1000
    channels = {"time [s]": time}
    for number, part in enumerate(system.inputs):
        sweep = np.sin(2 * np.pi * (1 + number) * time * (1 + 8 * time))
        # a brake and a clutch pull one way; a motion that is imposed is small
        one_way = part.name in (*system.brakes, *system.capacities)
        channels[part.name] = 20 * np.abs(sweep) if one_way else 2 + sweep
    for number, sensor in enumerate(system.sensors):
        channels[sensor.name] = 0.1 * np.exp(-3 * time) * np.sin(2 * np.pi * (3 + number) * time)
    file = folder / "recording.csv"
    rows = np.stack(list(channels.values()), axis=1)
    np.savetxt(file, rows, delimiter=",", header=",".join(channels), comments="", fmt="%.6f")
    return file


def _calls_of_a_model(model: Path, folder: Path) -> Iterator[list[str]]:
    system, recording = load(model), str(_recording(model, folder))
    of = ["--of", system.inertias[0].name]
    yield ["show", str(model)]
    yield ["modes", str(model)]
    yield ["modes", str(model), "--damped"]
    yield ["campbell", str(model), "--speed", "60:3000 1/min", *of, "--out", str(folder / "campbell")]
    torques = [name for name, quantity in system.input_quantities.items() if quantity == "torque"]
    for name in torques[:1]:
        speeds = ["--speed", "60:3000:20 1/min", "--torques", f"{name}:2=1"]
        yield ["response", str(model), *speeds, *of, "--out", str(folder / "response")]
    yield ["simulate", str(model), recording, "--out", str(folder / "simulated")]
    yield ["simulate", str(model), recording, "--start", "rest", "--out", str(folder / "at_rest")]
    yield ["diagnose", str(model), recording, "--out", str(folder / "diagnosis"), "--check"]
    yield ["export", str(model), "--fmu", str(folder / "model.fmu")]


def _calls_of_a_case(case: Path, folder: Path) -> Iterator[list[str]]:
    out, recording = ["--out", str(folder / "out")], str(_recording(_rig_of(case), folder))
    yield ["show", str(case)]
    for command in ("match", "tolerance", "excite"):
        yield [command, str(case), *out, "--check"]
    yield ["map", str(case), "--x", "loop.dead_time", "--y", "loop.inverter_lag", *out, "--check"]
    for command in ("verify", "learn"):
        yield [command, str(case), recording, *out, "--check"]
    yield ["identify", str(case), "--bed", recording, *out, "--check"]
    yield ["commission", str(case), "--bed", str(folder), *out, "--check"]
    yield ["excite", str(case), "--out", str(folder / "excitation")]
    yield ["excite", str(case), "--channel-check", "--out", str(folder / "channel_check")]
    yield ["verify", str(case), recording, "--channel-check", "--out", str(folder / "channels")]
    yield ["export", str(case), "--fmu", str(folder / "residual_vehicle.fmu")]
    yield ["export", str(case), "--controller", str(folder / "controller.fmu")]


def _rig_of(case: Path) -> Path:
    return case.parent / tomllib.loads(case.read_text(encoding="utf-8"))["rig"]


def _answers(calls: Iterator[list[str]], capsys: pytest.CaptureFixture[str]) -> None:
    answered = 0
    for call in calls:
        code = main(call)
        said = capsys.readouterr()
        assert code in (0, 2), f"{' '.join(call)}\n{said.err}"
        lines = [line for line in said.err.splitlines() if line.startswith("rigmatch: ") and "note:" not in line]
        assert code == 0 or len(lines) == 1, f"{' '.join(call)}\n{said.err}"
        answered += code == 0
    assert answered > 3


@pytest.mark.long
@pytest.mark.parametrize("model", MODELS, ids=_named)
def test_every_command_answers_every_model(model, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _answers(_calls_of_a_model(model, tmp_path), capsys)


@pytest.mark.long
@pytest.mark.parametrize("case", OF_CASES, ids=_named)
def test_every_command_answers_every_case(case, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _answers(_calls_of_a_case(case, tmp_path), capsys)


@pytest.mark.long
@pytest.mark.parametrize("case", ["drive_away/case", "road_to_rig/observer"])
def test_every_command_answers_a_specimen_that_is_not_known(case, tmp_path, capsys, monkeypatch):
    source = ROOT / "examples" / f"{case}.toml"
    folder = tmp_path / "example"
    shutil.copytree(source.parent, folder)
    text = source.read_text(encoding="utf-8").replace("[loop]", '[loop]\nspecimen = "unknown"')
    (folder / source.name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    _answers(_calls_of_a_case(folder / source.name, tmp_path), capsys)
