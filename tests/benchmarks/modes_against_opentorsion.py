"""Modes of 10 000 variations of the shared drivetrain: ours with all energy shares, openTorsion's frequencies only.

openTorsion runs in the interpreter that ``OPENTORSION_PYTHON`` names (default: this one), so it may have a NumPy of its
own. Ours runs before and after it; the slower of the two minima counts.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from modelling.modal.modes import modes_batch
from modelling.modal.result import Modes
from modelling.model_file import from_dict
from modelling.system import System
from tests.benchmarks.row import row

SHARED = Path(__file__).parents[3] / "shared" / "bench"
COUNT = 10_000


def drivetrain(shared) -> tuple[System, list[str]]:
    """The shared drivetrain as a model, and the names of its inertias and stiffnesses in the shared order."""
    shafts = {
        f"s{i}": {"between": [f"n{a}", f"n{b}"], "stiffness": k, "damping": c}
        for i, (a, b, k, c) in enumerate(shared.SHAFTS)
    }
    inertias = {f"n{i}": {"J": float(J)} for i, J in enumerate(shared.INERTIA)}
    gear = {"mesh": {"between": ["n1", "n2"], "ratio": -shared.RATIO}}
    names = [f"inertias.{name}.J" for name in inertias] + [f"shafts.{name}.stiffness" for name in shafts]
    return from_dict({"inertias": inertias, "shafts": shafts, "gears": gear}), names


def ours(system: System, values: np.ndarray, names: list[str]) -> tuple[float, Modes]:
    times = []
    for _ in range(3):
        began = time.perf_counter()
        found = modes_batch(system, values, names)
        times.append(time.perf_counter() - began)
    return min(times), found


def main() -> None:
    if not SHARED.exists():
        print("modes against openTorsion: skipped, ../shared/bench is not here")
        return
    sys.path.insert(0, str(SHARED))
    import drivetrain10 as shared

    system, names = drivetrain(shared)
    values = np.hstack(shared.variations(COUNT))
    before, found = ours(system, values, names)
    python = os.environ.get("OPENTORSION_PYTHON", sys.executable)
    peer = subprocess.run(
        [python, str(Path(__file__).with_name("_opentorsion_peer.py")), str(SHARED), str(COUNT)],
        capture_output=True,
        text=True,
    )
    if peer.returncode:
        print(f"modes against openTorsion: the peer failed: {(peer.stderr.strip().splitlines() or ['no word'])[-1]}")
        return
    answer = json.loads(peer.stdout)
    after, _ = ours(system, values, names)
    mean = float(found.frequencies[:, 1].mean())
    if not abs(mean / answer["mean"] - 1) < 1e-8:
        raise SystemExit(f"the mean second frequencies differ: {mean} and {answer['mean']} Hz")
    print(row("10 000 modal analyses (ours with shares)", max(before, after), answer["seconds"], ">= 25"))


if __name__ == "__main__":
    main()
