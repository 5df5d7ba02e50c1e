"""``python -m tests.benchmarks.dead_times [--out DIR]``: what dead time costs the reference case, by structure.

Matches the reference case anew at every dead time and structure and writes ``dead_times.json`` and ``dead_times.md``,
the table of the README. The errors are those of the verification; 0.5–15 Hz is the same tuned rig over the lower half
of the band, and the bound is worked out for each band. Ten matches, some minutes; apart from the timed benchmarks.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

from tqdm import tqdm

from matching.frequency.case import Case, load_case
from matching.frequency.match import _errors, match
from matching.frequency.verification import error_figures

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "case.toml"
DEAD_TIMES = (0.0005, 0.001, 0.003, 0.005, 0.008)  # s
STRUCTURES = ("model_based", "pi")
BANDS = ((0.5, 30.0), (0.5, 15.0))  # Hz; the first is tuned over
HEAD = (
    "| dead time | structure | status | free rig | **matched** | dead time leaves | not announced "
    "| free rig, 15 Hz | **matched, 15 Hz** | leaves, 15 Hz | not announced, 15 Hz "
    "| margin | R_XiL free | R_XiL matched |"
)


def measured(case: Case, dead_time: float, structure: str) -> dict:
    """One match, its errors over both bands."""
    loop = replace(case.loop.with_values({"dead_time": dead_time}), structure=structure)
    found = match(replace(case, loop=loop, band=BANDS[0]))
    over = []
    for band in BANDS:
        tuned = replace(found.tuned, band=band)
        seen = replace(found.verification, errors=error_figures(tuned))
        over.append(_errors(replace(case, band=band), tuned, seen).to_dict())
    fidelity = None if found.fidelity is None else found.fidelity.to_dict()
    return {
        "dead_time": dead_time, "structure": structure, "status": found.status, "limits": list(found.limits),
        "response_error": over, "modulus_margin": found.verification.modulus_margin, "seconds": found.seconds,
        "targets": [own.to_dict() for own in found.targets],
        "R_XiL": None if fidelity is None else [fidelity[when]["R_XiL"] for when in ("before", "after")],
        "values": {own.name: own.tuned for own in found.parameters},
    }  # fmt: skip


def line(row: dict) -> str:
    """A row of the table."""
    cells = [f"{1e3 * row['dead_time']:g} ms", f"`{row['structure']}`", row["status"]]
    for over in row["response_error"]:
        cells += [f"{over['before']:.3f}", f"**{over['after']:.4f}**", f"{over['bound']:.4f}"]
        cells.append(f"{over['unannounced']:.3f}")
    cells.append(f"{row['modulus_margin']:.3f}")
    cells += ["–", "–"] if row["R_XiL"] is None else [f"{100 * own:.2f} %" for own in row["R_XiL"]]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, default=Path("out/dead_times"))
    out = parser.parse_args().out
    case, rows = load_case(CASE), []
    out.mkdir(parents=True, exist_ok=True)
    wanted = [(dead_time, structure) for dead_time in DEAD_TIMES for structure in STRUCTURES]
    for dead_time, structure in tqdm(wanted, disable=None):
        rows.append(measured(case, dead_time, structure))
        (out / "dead_times.json").write_text(json.dumps(rows, indent=2))
        text = "\n".join([HEAD, "|" + "---|" * HEAD.count(" |"), *map(line, rows)])
        (out / "dead_times.md").write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
