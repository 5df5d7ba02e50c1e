"""The exported controller in tools other than FMPy: a second of a tip-in on the linear bed, sample by sample."""

import os
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from fmu import importers
from fmu.linear_bed import LinearBed
from fmu.slave import slave
from needs import compiles

from matching.cli import main
from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from matching.match.loop import linear_bed
from modelling.controller.law import FAULTS

pytestmark = compiles

SAMPLES, HOLD_FROM, EMULATION_FROM, TIP_IN, BREAKS, ZERO_FROM = 1000, 5, 100, 200, 950, 980
TORQUE, SPEED, LIMIT = 400.0, 20.0, 400.0  # N·m, rad/s of the steady state; N·m of the left dynamometer's limit
PACKAGE = {"libcosim": "libcosimpy", "ecos": "ecospy"}


def lacks(tool):
    """Whether a tool cannot be used here: its package is not installed, or its library does not load."""
    if find_spec(PACKAGE[tool]) is None:
        return True
    tried = subprocess.run([sys.executable, "-c", f"import {PACKAGE[tool]}"], env=surroundings(), capture_output=True)
    return tried.returncode != 0


def surroundings():
    """Environment in which libraries of Python packages are found (Ecos needs oneTBB, the package `tbb`)."""
    places = (str(Path(sys.prefix) / "lib"), os.environ.get("LD_LIBRARY_PATH", ""))
    return {**os.environ, "LD_LIBRARY_PATH": os.pathsep.join(filter(None, places))}


@pytest.fixture(scope="module", params=["case.toml", "observer.toml"])
def run(request, reference_case):
    """Case file, inputs (t, i) and outputs (t, o) by name, parameters: rigmatch's own controller on the linear bed."""
    path = reference_case.with_name(request.param)
    case = load_case(path)
    controller, parts = exported_controller(case), linear_bed(case)
    k, settings = len(parts.dynamometers), controller.settings
    limit = np.array([LIMIT, *settings.torque_limit[1:]])
    running = replace(controller, settings=replace(settings, torque_limit=limit)).running()
    offset = np.concatenate([np.full(k, TORQUE), np.full(len(controller.law.sensors) - k, SPEED)])
    rng, bed = np.random.default_rng(7), LinearBed(parts, case.loop)
    motor = 60.0 * np.clip((np.arange(SAMPLES + 1) - TIP_IN) / 50, 0, 1)  # N·m: a ramp of 50 ms
    rows, answers = [], []
    for n in range(SAMPLES):
        mode = 0 if n < HOLD_FROM or n >= ZERO_FROM else 1 if n < EMULATION_FROM else 2
        readings = offset + bed.readings() + 1e-3 * rng.normal(size=len(offset))
        readings[0] *= not BREAKS <= n < ZERO_FROM
        known = np.array([motor[n] if name == "motor_torque" else 0.0 for name in controller.law.known])
        answer = running.step(readings, known, mode, np.full(k, SPEED), n)
        assert parts.drives == ("motor_torque",)
        bed.step(answer.commands, motor[n : n + 1], motor[n + 1 : n + 2])
        rows.append([*readings, *known, *np.full(k, SPEED), mode, n])
        answers.append([*answer.commands, answer.mode, answer.fault])
    law = controller.law
    return {
        "path": path, "step": law.sample_time, "values": np.array(rows, float), "answers": np.array(answers, float),
        "inputs": [*law.sensors, *law.known, *(f"{name}.hold_speed" for name in law.dynamometers), "mode", "life"],
        "outputs": [*(f"{name}.command" for name in law.dynamometers), "active_mode", "fault"],
        "parameters": [f"{law.dynamometers[0]}.torque_limit"], "settings": [LIMIT],
    }  # fmt: skip


def exported(run, folder, fmi):
    path = folder / "bed.fmu"
    assert main(["export", str(run["path"]), "--controller", str(path), "--fmi", fmi]) == 0
    return path


def by_fmpy(path, run):
    answers = []
    with slave(path) as fmu:
        fmu.begin(given=dict(zip(run["parameters"], run["settings"], strict=True)))
        for values in run["values"]:
            fmu.set(dict(zip(run["inputs"], values, strict=True)))
            fmu.step(run["step"])
            answers.append(fmu.get(run["outputs"]))
    return np.array(answers)


def by_tool(tool, path, run, folder):
    """In a process of its own: a library that crashes fails this test and no other."""
    np.savez(folder / "run.npz", **{name: value for name, value in run.items() if name not in ("path", "answers")})
    command = [sys.executable, importers.__file__, tool, str(path), str(folder / "run.npz"), str(folder / "out.npy")]
    ran = subprocess.run(command, capture_output=True, text=True, cwd=folder, env=surroundings())
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return np.load(folder / "out.npy")


def test_the_run_has_every_mode_a_limit_and_a_fault(run):
    left, right, mode, fault = run["answers"].T
    assert set(mode) == {0.0, 1.0, 2.0}
    assert FAULTS[int(fault[BREAKS])] == "torque gone"
    assert set(mode[BREAKS:ZERO_FROM]) == {1.0}
    assert 5 < np.sum(np.abs(left) == LIMIT) < SAMPLES / 2
    assert np.ptp(right[EMULATION_FROM:BREAKS]) > 50


@pytest.mark.parametrize(("tool", "fmi"), [("libcosim", "2.0"), ("ecos", "2.0"), ("ecos", "3.0")])
def test_a_second_tool_gives_what_fmpy_and_rigmatch_give(tool, fmi, run, tmp_path):
    if lacks(tool):
        pytest.skip(f"{PACKAGE[tool]} is not installed, or does not load")
    answers = by_tool(tool, exported(run, tmp_path, fmi), run, tmp_path)
    np.testing.assert_allclose(answers, run["answers"], rtol=1e-9, atol=1e-9 * LIMIT)
    if fmi == "2.0":
        np.testing.assert_allclose(answers, by_fmpy(tmp_path / "bed.fmu", run), rtol=0, atol=1e-9)
