"""The commands that faults are tried on, and how a run of one is begun and judged."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
REFERENCE, COMPACT = EXAMPLES / "road_to_rig", EXAMPLES / "compact_bev"
QUICK = {  # words; {out} is the folder of results, {inputs} that of tests.faults.inputs
    "modes": ["modes", str(REFERENCE / "vehicle.toml"), "--out", "{out}"],
    "uncertainty": ["uncertainty", str(EXAMPLES / "sensors" / "torque_M2.toml"), "--draws", "20000", "--out", "{out}"],
    "fidelity": ["fidelity", str(EXAMPLES / "fidelity" / "tab2.toml"), "--draws", "200", "--out", "{out}"],
    "export": ["export", str(REFERENCE / "case.toml"), "--fmu", "{out}/rvm.fmu"],
    "new": ["new", "{out}"],
    "simulate": ["simulate", "{inputs}/model.toml", "{inputs}/drive.csv", "--out", "{out}"],
    "show": ["show", "{inputs}/case.toml", "--out", "{out}"],
    "diagnose": ["diagnose", "{inputs}/model.toml", "{inputs}/drive.csv", "--out", "{out}"],
    "verify": ["verify", "{inputs}/case.toml", "{inputs}/bed_run.csv", "--out", "{out}"],
    "excite": ["excite", "{inputs}/case.toml", "--duration", "6", "--beds", "2", "--out", "{out}"],
    "commission": ["commission", "{inputs}/matched", "--bed", "{inputs}/bed", "--rounds", "1", "--out", "{out}"],
}
SLOW = {
    "match": ["match", str(COMPACT / "case.toml"), "--starts", "2", "--workers", "2", "--out", "{out}"],
    "map": ["map", str(COMPACT / "case.toml"), "--x", "loop.dead_time=1ms:2ms:2", "--y", "loop.inverter_lag=1ms:2ms:2",
            "--starts", "1", "--workers", "2", "--out", "{out}"],
    "tolerance": ["tolerance", str(COMPACT / "case.toml"), "--tolerance", "rig.*.stiffness=0.02", "-n", "300",
                  "--workers", "2", "--out", "{out}"],
}  # fmt: skip
SERVED = {"explore": ["explore", "{inputs}/model.toml", "--no-browser", "--out", "{out}"]}  # until it is ended
IN_STEPS = {"commission": ("commission.json", "report.html")}  # writes a folder a step; what is written last


@dataclass(frozen=True)
class End:
    """How a run ended: exit code, what it said, seconds from the signal (or its beginning), processes still there."""

    code: int
    said: str
    seconds: float
    left: tuple[int, ...]

    @property
    def is_clear(self) -> bool:
        """Answered, or one line that says why not."""
        own = [line for line in self.said.splitlines() if not line.startswith("OpenBLAS error")]  # it says that first
        return self.code == 0 or (self.code == 2 and len(own) == 1 and "a fault of" not in self.said)


def words_of(command: Sequence[str], out: Path, inputs: Path) -> list[str]:
    """The command line of a command."""
    return [sys.executable, "-m", "matching", *(word.format(out=out, inputs=inputs) for word in command)]


def run(
    words: Sequence[str], changed: Mapping[str, str | None], folder: Path, number: int = 0, after: float = 0.0,
    limit: str = "",
) -> End:  # fmt: skip
    """Run a command line in a folder, with a signal to it after some seconds, or under a limit of bash's ``ulimit``."""
    where = {k: v for k, v in {**os.environ, "PYTHONPATH": str(ROOT), **changed}.items() if v is not None}
    if limit:
        words = ["bash", "-c", f'ulimit {limit}; exec "$@"', "bash", *words]
    began = time.monotonic()
    process = subprocess.Popen(
        words, env=where, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    if number:
        try:
            process.wait(after)
        except subprocess.TimeoutExpired:
            began = time.monotonic()
            process.send_signal(number)
    said = process.communicate(timeout=900)[1]
    seconds = time.monotonic() - began
    if number == signal.SIGKILL:
        time.sleep(1.0)  # its processes see that it is gone
    return End(process.returncode, said, seconds, tuple(_left(str(changed.get("TMPDIR")))))


def _left(mark: str) -> list[int]:
    """Processes of a run that still go on, by the temporary folder in their environment."""
    found = []
    for place in Path("/proc").glob("[0-9]*/environ"):
        try:
            if mark.encode() in place.read_bytes() and b"matching" in place.with_name("cmdline").read_bytes():
                found.append(int(place.parent.name))
        except OSError:
            continue
    return found


def contents(out: Path) -> dict[str, bytes]:
    """Results by name."""
    return {
        str(path.relative_to(out)): path.read_bytes()
        for path in sorted(out.rglob("*"))
        if path.is_file() and ".partial." not in path.name
    }
