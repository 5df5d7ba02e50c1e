"""Seeds for what is calculated from files: files of a drive seen through its case, recordings of several loggers and of
the controlled bed, records of studies, matrices and groups of binary recordings."""

from __future__ import annotations

import io
import json
import tomllib

import numpy as np
from scipy.io import savemat

from matching.api import simulate
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording
from tests.fuzz.seed import MODEL, RECORDINGS, ROOT, Seed, every_effect, recording

LOGGED_SECONDS, LOGGED_HZ = 0.8, 250  # of the loggers' and the bed's recordings
STUDY_ROWS = (
    {"study": "S", "chunk": "1", "result": [1.5, 2.0]},
    {"study": "S", "chunk": "2", "result": [0.25, None]},
)
STEP_ROW = {"step": "1_export", "inputs": "I", "files": {"controller.fmu": "0"}, "figures": {}}
MATRIX = """[channels]
torque = "data[:,1]"
speed = { channel = "data[:,2]", unit = "1/min", factor = 2 }
time = "data[:,0]"
"""
GROUPS = """[channels]
torque = { channel = "torque", group = 0 }
speed = { channel = "speed", group = 1, sign = -1 }
"""


def seeds_of_runs() -> list[Seed]:
    """In an order that does not change."""
    return [*_drives(), *_recorded(), *_studies(), *_channels(), *_of_models()]


def _drives() -> list[Seed]:
    """Models, a residual vehicle of the user's own and a trace of a torque as their case reads them."""
    made = []
    for folder in (ROOT / "matching" / "starter", ROOT / "examples" / "compact_bev", ROOT / "examples" / "road_to_rig"):
        files = {name: (folder / name).read_bytes() for name in ("case.toml", "vehicle.toml", "rig.toml")}
        made += [
            Seed("drive", f"{folder.name}_{role}", files[f"{role}.toml"], files | {"role.txt": role.encode()})
            for role in ("vehicle", "rig")
        ]
    starter = ROOT / "matching" / "starter"
    files = {name: (starter / name).read_bytes() for name in ("case.toml", "vehicle.toml", "rig.toml")}
    own = files["case.toml"].replace(b"[[targets]]", b'[residual_vehicle]\nmodel = "own.toml"\n[[targets]]', 1)
    behind = [b"wheels", b"body", b"tyres", b"road_torque", b"body_speed"]
    tables = (b"\n" + files["vehicle.toml"]).split(b"\n[")
    kept = [table for table in tables if table.split(b"]")[0].split(b".")[-1] in behind]
    made.append(Seed("drive", "own", b"".join(b"[" + table + b"\n" for table in kept), files | {
        "case.toml": own, "role.txt": b"own",
    }))  # fmt: skip
    before, rest = files["case.toml"].split(b"[manoeuvre.motor_torque]")
    traced = before + b'[manoeuvre.motor_torque]\nfile = "trace.csv"\n[limits]' + rest.split(b"[limits]")[1]
    made.append(Seed("trace", "trace", _columns("motor_torque [N*m]"), files | {"case.toml": traced}))
    return made


def _recorded() -> list[Seed]:
    """One motion by two loggers, and a recording of the controlled bed over a narrow band."""
    files = narrow_band_case()
    first, second = _columns("torque [N*m]", "speed [rad/s]"), _columns("link_torque [N*m]")
    bed = bed_recording()
    return [
        Seed("loggers", "second", second, {"model.toml": MODEL.encode(), "first.csv": first}),
        Seed("bed", "starter", bed, files),
        Seed("by_hand", "utf8", bed, files),
        Seed("diagnosed", "two_discs", recorded_motion(), {"model.toml": MODEL.encode()}),
    ]


def narrow_band_case() -> dict[str, bytes]:
    """The starter case, for which a recording of less than a second is long enough."""
    starter = ROOT / "matching" / "starter"
    files = {name: (starter / name).read_bytes() for name in ("case.toml", "vehicle.toml", "rig.toml")}
    return files | {"case.toml": files["case.toml"].replace(b"band = [0.5, 30]", b"band = [6, 30]")}


def bed_recording() -> bytes:
    """Signals with the names of the starter's bed."""
    return _columns("motor_torque", "motor_speed", "side_shaft_torque")


def _columns(*names: str) -> bytes:
    t = np.arange(round(LOGGED_SECONDS * LOGGED_HZ)) / LOGGED_HZ
    values = [5 / (n + 1) * np.sin((40 + 9 * n) * t * (1 + t)) for n in range(len(names))]
    rows = [",".join(f"{value:.5g}" for value in row) for row in np.stack([t, *values], axis=1)]
    return "\n".join([",".join(["time [s]", *names]), *rows, ""]).encode()


def recorded_motion() -> bytes:
    """The model's own motion with noise."""
    system = from_dict(tomllib.loads(MODEL))
    t = np.arange(200) / 200
    torque = 5 * np.sin(9 * t * (1 + 2 * t))
    found = simulate(system, Recording(t, {"torque": torque}), start="rest")
    noise = np.random.default_rng(1).normal(0, 0.1, len(t))
    rows = np.stack([t, torque, found.readings["speed"] + noise, found.readings["link_torque"] + noise[::-1]], axis=1)
    lines = [",".join(f"{value:.5g}" for value in row) for row in rows]
    return "\n".join(["time [s],torque,speed,link_torque", *lines, ""]).encode()


def _studies() -> list[Seed]:
    """What a study or a commissioning that was ended goes on from; checksums are put right after the change."""
    lines = [json.dumps(row) for row in STUDY_ROWS]
    return [
        Seed("record", "study", "\n".join(lines).encode()),
        Seed("record", "commission", json.dumps(STEP_ROW).encode()),
    ]


def _channels() -> list[Seed]:
    """Channel files for a column of a matrix (.mat) and for groups (MDF)."""
    buffer, t = io.BytesIO(), np.arange(60) / 100
    savemat(buffer, {"data": np.stack([t, np.sin(9 * t), np.cos(7 * t)], axis=1)})
    model = {"model.toml": MODEL.encode()}
    return [
        Seed("columns", "matrix", MATRIX.encode(), model | {"drive.mat": buffer.getvalue()}),
        Seed("groups", "mdf", GROUPS.encode(), model | {"drive.mf4": (RECORDINGS / "drive.mf4").read_bytes()}),
    ]


def _of_models() -> list[Seed]:
    """Models and cases that are simulated, drawn, exported, planned for and opened in the browser."""
    drive = {"drive.csv": recording()}
    starter = ROOT / "matching" / "starter"
    files = {path.name: path.read_bytes() for path in sorted(starter.glob("*.toml"))}
    return [
        Seed("simulated", "two_discs", MODEL.encode(), drive),
        Seed("written", "two_discs", MODEL.encode()),
        Seed("written", "every_effect", every_effect()),
        Seed("written", "starter", files["vehicle.toml"]),
        Seed("opened", "model", MODEL.encode(), drive),
        Seed("opened", "case", files["case.toml"], files),
        Seed("planned", "starter", files["case.toml"], files),
    ]
