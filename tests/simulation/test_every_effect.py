"""Every effect of the vocabulary, at every kind of place, alone and without its optional parameters, in every command.

A model that is allowed by the files has an answer in every command; what a law cannot do is one line of bad input.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator

import numpy as np
import pytest

import rigmatch as rm
from matching.cli import main
from modelling.effects import EFFECTS
from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording
from modelling.simulation import compiled as build

BASE = """
[inertias.a]
J = 0.1
drag = 0.02
[inertias.b]
J = 1
drag = 0.5
[inertias.c]
J = 0.2
[shafts.s]
between = ["a", "b"]
stiffness = 100
damping = 0.1
[gears.g]
between = ["b", "c"]
ratio = 2
[inputs.t]
on = "a"
[sensors.w]
measures = "speed"
of = "a"
[sensors.phi]
measures = "angle"
of = "b"
[sensors.m]
measures = "torque"
of = "s"
"""
NUMBERS = {
    "gap": 0.02, "efficiency": 0.9, "order": 4, "delay": 0.003, "time_constant": 0.01, "factor": 1.1, "rate": 0.1,
    "period": 1.5, "change": 0.2, "cubic": 1e3, "angle": 0.01, "J": 0.01, "value": 1.5, "peak": 8.0,
    "slip_stiffness": 300.0, "stiffness": 300.0, "coefficient": 0.3,
}  # fmt: skip
AXES = {"shafts": ["twist"], "inertias": ["speed", "angle"]}
START = ("rest", "recorded", "steady")


def parameters(kind: str, place: str) -> Iterator[dict]:
    """What has to be stated of an effect, once for each way of stating it."""
    law = EFFECTS[kind]
    if kind == "table":
        for axis in AXES[place.split(".")[0]]:
            yield {axis: [-0.1, 0, 0.2], "torque": [-1, 0, 3]}
    elif law.pedal:
        yield {"speed": [-2, 0, 5], "pedal": [0, 0.5, 1], "torque": [[1, 2, 4], [0, 2, 3], [-1, 1, 2]]}
    elif law.arrays:
        yield {key: [0.4] for key in law.arrays}
    else:
        yield {key: NUMBERS.get(key, 0.7) for key, part in law.parameters.items() if not part.optional}


def models(every_place: bool) -> Iterator[tuple[str, dict]]:
    """Name and content of each model file; of places in one table, or of quantities of one name, else the first."""
    base = tomllib.loads(BASE)
    system = from_dict(base, "base")
    for kind, law in EFFECTS.items():
        places = [["inertias.b", "inertias.a"]] if law.follows else [[place] for place in law.places(system)]
        if kind == "load_friction":
            places = [["inertias.a"]]
        if not every_place:
            places = list(
                {(place[0].split(".")[0], *place[0].split(".")[2:]): place for place in places[::-1]}.values()
            )
        for place in places:
            for stated in parameters(kind, place[0]):
                at = place if len(place) > 1 else place[0]
                name = f"{kind} at {at} {next(iter(stated)) if kind == 'table' else ''}"
                yield name, base | {"effects": [{"kind": kind, "at": at, **stated}]}


def bare(data: dict) -> dict:
    """The same model without gear, inputs and sensors that its effect does not sit at."""
    at = json.dumps(data["effects"])
    kept = {"inertias.c", "gears.g"} if "inertias.c" in at or "gears.g" in at else set()
    kept |= {"inputs.t"} if "load_friction" in at else set()
    out = {}
    for table, parts in data.items():
        if table in ("gears", "inputs", "sensors"):
            parts = {name: part for name, part in parts.items() if f"{table}.{name}" in at or f"{table}.{name}" in kept}
        if table == "inertias" and "inertias.c" not in kept:
            parts = {name: part for name, part in parts.items() if name != "c"}
        if parts:
            out[table] = parts
    return out


ROTOR = {"J": 0.1, "drag": 0.02}
PLAIN = {
    "one inertia": {"inertias": {"a": ROTOR}},
    "no input": {"inertias": {"a": ROTOR}, "sensors": {"w": {"measures": "speed", "of": "a"}}},
    "no sensor": {"inertias": {"a": ROTOR}, "inputs": {"t": {"on": "a"}}},
    "two apart": {
        "inertias": {"a": ROTOR, "b": {"J": 1, "drag": 0.5}},
        "inputs": {"t": {"on": "a"}, "m": {"on": "b"}},
        "sensors": {"w": {"measures": "speed", "of": "b"}},
    },
}


def recording(samples: int = 12, size: float = 1.0) -> Recording:
    t = np.arange(samples) / 200
    return Recording(t, {"t": size * (1 + np.sin(9 * t)), "w": 0.1 + t, "phi": 0.3 + t**2 / 2, "m": np.cos(9 * t)})


@pytest.fixture
def without_compiler(monkeypatch):
    monkeypatch.setenv("RIGMATCH_COMPILE", "0")
    build.compiler.cache_clear()
    yield
    build.compiler.cache_clear()


def answers(system, data, folder) -> None:
    """Everything that is cheap: modes, simulation and an FMU without a compiler."""
    assert np.isfinite([mode.frequency for mode in rm.modes(system)]).all()
    assert np.isfinite([mode.frequency for mode in rm.modes(system, damped=True)]).all()
    for start in ("rest", "steady"):
        done = rm.simulate(system, recording(size=0.5 if system.pedals else 1.0), start=start)
        assert np.isfinite(done.states).all()
        assert np.abs(done.states).max() < 1e3, start
    (folder / "model.toml").write_text(toml(data))
    assert rm.export(folder / "model.toml", folder / "model.fmu").stat().st_size > 1000


def toml(data: dict) -> str:
    """A model as a file."""
    lines = []
    for table, parts in data.items():
        for head, keys in [("[effects]", part) for part in parts] if table == "effects" else parts.items():
            lines.append(f"[{head}]" if table == "effects" else f"[{table}.{head}]")
            lines += [f"{key} = {json.dumps(value)}" for key, value in keys.items()]
    return "\n".join(lines)


@pytest.mark.parametrize("third", [0, 1, 2])
def test_every_effect_alone_has_an_answer(tmp_path, without_compiler, third):
    for name, data in list(models(every_place=False))[third::3]:
        try:
            answers(from_dict(data, name), data, tmp_path)
        except InputError as refused:
            pytest.fail(f"{name}: {refused}")
        except Exception as fault:
            raise AssertionError(name) from fault


@pytest.mark.parametrize("name", PLAIN)
@pytest.mark.parametrize("start", START)
def test_a_plain_model_has_an_answer(name, start, without_compiler, monkeypatch):
    system = from_dict(PLAIN[name], name)
    interpreted = rm.simulate(system, recording(), start=start)
    assert np.isfinite(interpreted.states).all()
    monkeypatch.setenv("RIGMATCH_COMPILE", "1")
    build.compiler.cache_clear()
    compiled = rm.simulate(system, recording(), start=start)
    np.testing.assert_allclose(compiled.states, interpreted.states, rtol=1e-9, atol=1e-9)


def test_a_model_without_sensors_is_one_line_of_the_command(tmp_path, capsys):
    (tmp_path / "model.toml").write_text(toml(PLAIN["no sensor"]))
    (tmp_path / "run.csv").write_text("time [s],t\n0,1\n0.1,2\n0.2,1\n")
    assert (
        main(["simulate", str(tmp_path / "model.toml"), str(tmp_path / "run.csv"), "--out", str(tmp_path / "o")]) == 2
    )
    assert "has no sensor" in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


@pytest.mark.long
@pytest.mark.parametrize("compiler", ["0", "1"])
@pytest.mark.parametrize("shape", [dict, bare])
@pytest.mark.parametrize("part", range(4))
def test_every_effect_at_every_place_through_every_command(tmp_path, capsys, monkeypatch, shape, compiler, part):
    monkeypatch.setenv("RIGMATCH_COMPILE", compiler)
    build.compiler.cache_clear()
    monkeypatch.chdir(tmp_path)
    for file, size in (("run.csv", 1.0), ("pedal.csv", 0.5)):
        seen = recording(40, size)
        rows = np.column_stack([seen.time, *(seen[name] for name in ["t", "w", "phi", "m"])])
        np.savetxt(file, rows, "%.6f", ",", header="time [s],t,w [rad/s],phi [rad],m", comments="")
    failed = []
    for name, whole in [*models(every_place=True)][part::4]:
        data = shape(whole)
        (tmp_path / "model.toml").write_text(toml(data))
        commands = [["modes", "model.toml", "--json"], ["modes", "model.toml", "--damped", "--json"]]
        commands += [["export", "model.toml", "--fmu", "model.fmu"]]
        if "sensors" in data:
            run = "pedal.csv" if name.startswith("torque_map") else "run.csv"
            commands += [["simulate", "model.toml", run, "--out", "o", "--json", "--start", how] for how in START]
        for command in commands:
            code, told = main(command), capsys.readouterr()
            if code:
                failed.append(f"{name}: {' '.join(command)}: {code} {told.err}")
    build.compiler.cache_clear()
    assert not failed, "\n".join(failed)
