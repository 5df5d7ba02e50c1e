"""What peers make of recordings of a campaign with one hidden effect: PySINDy, least squares of the stated quantities.

``python -m tests.campaign.peers DIR`` reads the recordings of ``python -m tests.campaign make DIR`` and the answers on
record (``run DIR``). Errors are those of the speed sensor that is met worst, root mean square over unseen data in times
the noise; PySINDy is given what a careful user would give it (``tests/benchmarks/_sindy.py``).
"""

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from matching.diagnosis.data import prepare_data
from matching.diagnosis.descent import Fit
from matching.diagnosis.problem import base_problem
from matching.diagnosis.settings import DiagnosisSettings
from matching.diagnosis.unseen import blocks_for, unseen_errors
from modelling.model_file import load
from modelling.recordings.read import read_recording
from modelling.recordings.recording import Recording
from modelling.system import System
from tests.campaign.recordings import rows
from tests.campaign.score import matches, right

EVALUATIONS = 40  # of the residual by SciPy at most, its differences not counted


def by_least_squares(system: System, recording: Recording) -> list[float]:
    """Error of every sensor on unseen blocks, in times the noise, of the stated quantities fitted by SciPy's trf."""
    problem, v = base_problem(system, prepare_data(system, [recording])[0])
    done = least_squares(
        lambda v: problem.residuals(v[None])[0], np.clip(v, problem.lower, problem.upper),
        bounds=(problem.lower, problem.upper), x_scale="jac", max_nfev=EVALUATIONS,
    )  # fmt: skip
    fit = Fit(problem, done.x, done.fun, done.jac, 2 * float(done.cost))
    parts = unseen_errors(fit, blocks_for(fit, DiagnosisSettings()))
    return np.sqrt(np.nanmean(np.concatenate(parts) ** 2, axis=0)).tolist()


def compared(place: Path, row: dict[str, Any]) -> dict[str, Any]:
    """One recording by all three."""
    from tests.benchmarks._sindy import run

    system, answer = load(place / "model.toml"), row["answer"]
    recording = read_recording(place / "recording.csv", system)
    speeds = [j for j, sensor in enumerate(system.sensors) if sensor.measures == "speed"]
    names, out = [system.sensors[j].name for j in speeds], {"number": row["number"], "category": answer["category"]}
    errors = [row["found"]["errors"][name] for name in names]
    out["ours"] = max(float(one["after_holdout"]) / float(one["noise"]) for one in errors)
    out["ours right"], out["ours seconds"] = right(row), row["seconds"]
    clock = time.process_time()
    squares = by_least_squares(system, recording)
    out["least squares"] = max(squares[j] for j in speeds)
    out["least squares seconds"], clock = time.process_time() - clock, time.process_time()
    try:
        peer = run(system, recording)
        out["sindy"], named = peer.free, {"kind": peer.kind, "at": peer.at}
        out["sindy right"] = matches(named, answer)
    except Exception as fault:  # of a peer
        out["sindy"], out["sindy right"], out["sindy fault"] = np.inf, False, f"{type(fault).__name__}: {fault}"
    return out | {"sindy seconds": time.process_time() - clock}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seconds", type=float, default=1800.0, help="after which no further recording is begun")
    given = parser.parse_args()
    single = [row for row in rows(given.folder.with_suffix(".jsonl")) if "found" in row]
    single = sorted((r for r in single if r["answer"]["category"] in ("plain", "subtle")), key=lambda r: r["number"])
    done, end = list[dict[str, Any]](), time.monotonic() + given.seconds
    for row in single:
        if not (given.folder / row["number"] / "holdout.csv").exists() and time.monotonic() < end:
            done.append(compared(given.folder / row["number"], row))
            print(json.dumps(done[-1]), flush=True)
    for category in ("plain", "subtle"):
        some = [one for one in done if one["category"] == category]
        if not some:
            continue
        print(category, len(some), "recordings; named right: ours", sum(one["ours right"] for one in some),
              "PySINDy", sum(one["sindy right"] for one in some))  # fmt: skip
        for who in ("ours", "least squares", "sindy"):
            values = sorted(one[who] for one in some)
            spent = sorted(one[f"{who} seconds"] for one in some)
            print(f"  {who}: median {values[len(values) // 2]:.3g}, most {values[-1]:.3g} times the noise; "
                  f"{spent[len(spent) // 2]:.2g} s in the median")  # fmt: skip


if __name__ == "__main__":
    main()
