"""Seeds of the fuzzer: the examples, a model with every effect, and small recordings, with the files beside them."""

from __future__ import annotations

import functools
import json
import tomllib
from collections.abc import Iterator
from pathlib import Path

from matching.match.case_file import load_case
from tests.fuzz.seed import MODEL, RECORDINGS, ROOT, Seed, every_effect, recording

CHANNELS = """[channels]
torque = "T_EM"
speed = { channel = "n_EM", unit = "1/min", sign = -1 }
link_torque = { channel = "M_link", factor = 1.02 }
time = "t"
"""
SIGNALS = """title = "signals"
f_max = "30 Hz"
[weights]
system_dynamics = 1.0
[recordings]
reference = "road.csv"
test = "bed.csv"
[system_dynamics.speed]
reference = "speed"
test = "speed"
"""
WORDS = (
    "modes\nmodel.toml\n--damped\n--reduced\n--out\no",
    "modes\nmodel.toml\n--change\nshafts.link.stiffness=700 N*m/rad\n--json\n--out\no",
    "uncertainty\nbudget.toml\n--draws\n2000\n--wanted\n0.5\n--out\no",
    "fidelity\nfidelity.toml\n--draws\n200\n--arithmetic\npublished\n--out\no",
    "new\nbed",
    "simulate\nmodel.toml\ndrive.csv\n--start\nsteady\n--check",
    "diagnose\nmodel.toml\ndrive.csv\n--holdout\ndrive.csv\n--json\n--check",
    "show\nmodel.toml\n--out\no",
    "match\ncase.toml\n--seed\n3\n--starts\n2\n--workers\n1\n--beds\n9\n--out\no\n--check",
    "map\ncase.toml\n--x\nloop.dead_time=1 ms,2 ms\n--y\nrig.shafts.flange.stiffness=2e5:8e5:3\n--out\no\n--check",
    "tolerance\ncase.toml\n-n\n200\n--tolerance\nrig.shafts.flange.stiffness=0.1\n--out\no\n--check",
    "verify\ncase.toml\ndrive.csv\n--out\no\n--check",
    "excite\ncase.toml\n--duration\n20\n--margin\n0.3\n--limit\ndyno=300 N*m\n--out\no\n--check",
    "commission\ncase.toml\n--bed\no\n--rounds\n1\n--speed\n5\n--out\no\n--check",
)


@functools.cache
def seeds() -> tuple[Seed, ...]:
    """All seeds, in an order that does not change."""
    model, drive = {"model.toml": MODEL.encode()}, {"drive.csv": recording()}
    starter = {path.name: path.read_bytes() for path in sorted((ROOT / "matching" / "starter").glob("*.toml"))}
    fidelity = (ROOT / "examples/fidelity/tab2.toml").read_bytes()
    budgets = [*sorted(ROOT.glob("examples/gum/*.toml")), *sorted(ROOT.glob("examples/sensors/*.toml"))]
    beside = model | drive | starter | {"budget.toml": budgets[0].read_bytes(), "fidelity.toml": fidelity}
    commas = recording().replace(b",", b";").replace(b".", b",")
    renamed = {"drive.csv": recording(("t [s]", "T_EM [N*m]", "n_EM", "M_link [N*m]"))}
    return (
        *_of_drives(),
        *(Seed("model", path.parent.name, path.read_bytes()) for path in sorted(ROOT.glob("examples/*/model.toml"))),
        Seed("model", "two_discs", MODEL.encode()),
        Seed("model", "every_effect", every_effect()),
        *(Seed("budget", path.stem, path.read_bytes()) for path in budgets),
        Seed("fidelity", "tab2", fidelity),
        Seed("fidelity", "signals", SIGNALS.encode(), {"road.csv": recording(), "bed.csv": recording()}),
        Seed("recording", "drive", recording(), model),
        Seed("recording", "commas", commas, model),
        Seed("channels", "renamed", CHANNELS.encode(), model | renamed),
        *(Seed("words", words.split("\n")[0] + str(i), words.encode(), beside) for i, words in enumerate(WORDS)),
        Seed("result", "starter", tuned_result(ROOT / "matching" / "starter" / "case.toml"), beside),
        *(
            Seed("binary", path.name.replace(".", "_"), path.read_bytes(), model | {"suffix.txt": path.suffix.encode()})
            for path in sorted(RECORDINGS.iterdir())
        ),
    )


def _of_drives() -> Iterator[Seed]:
    """Cases and models of the examples, and their models as the case reads them."""
    yield Seed("model", "gear_change_gearbox", (ROOT / "examples" / "gear_change" / "gearbox.toml").read_bytes())
    for folder in (*(path.parent for path in sorted(ROOT.glob("examples/*/rig.toml"))), ROOT / "matching" / "starter"):
        named = (*folder.glob("*.toml"), *folder.glob("stop_and_go.csv"))  # a speed profile, which a case names
        files = {path.name: path.read_bytes() for path in sorted(named)}
        for name, content in files.items():
            if b"\nrig = " in content:
                yield Seed("case", folder.name if name == "case.toml" else f"{folder.name}_{name[:-5]}", content, files)
            elif name.endswith(".toml") and "inertias" in tomllib.loads(content.decode()):
                yield Seed("model", f"{folder.name}_{name[:-5]}", content)
        for role in ("vehicle", "rig"):
            role_of = {"role.txt": role.encode()}
            yield Seed("drive", f"{folder.name}_{role}", files[f"{role}.toml"], files | role_of)


def tuned_result(case: Path) -> bytes:
    """As much of a match's result as is read again: every quantity tuned to its start value."""
    rows = [{"name": move.name, "start": move.start, "tuned": move.start} for move in load_case(case).moves]
    return json.dumps({"status": "matched", "parameters": rows}, indent=1).encode()
