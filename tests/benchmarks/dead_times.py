"""``python -m tests.benchmarks.dead_times [--out DIR]``: what dead time costs the reference case, by structure.

Matches the reference case anew at every dead time and structure and writes ``dead_times.json`` and ``dead_times.md``,
the table of the README. The errors are those of the verification; 0.5–15 Hz is the same tuned rig over the lower half
of the band, and the bound is worked out for each band. Ten matches, some minutes; apart from the timed benchmarks.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

from tqdm import tqdm

from matching.match.adapters import errors_with_bounds
from matching.match.case import Case
from matching.match.case_file import load_case
from matching.match.match import match
from matching.match.responses import error_figures
from modelling.bed.controllers import STRUCTURES

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "case.toml"
DEAD_TIMES = (0.0005, 0.001, 0.003, 0.005, 0.008)  # s
COMPARED = ("model_based", "pi")  # of `observer`: tests.benchmarks.observer_table
BANDS = ((0.5, 30.0), (0.5, 15.0))  # Hz; the first is tuned over
HEAD = (
    "| dead time | structure | status | rig without control | matched, 0.5–30 Hz | bound at 1 kHz "
    "| bound without sampling | unmeasured torques | rig without control, 0.5–15 Hz | matched, 0.5–15 Hz "
    "| bound at 1 kHz | processor time |"
)


def measured(case: Case, dead_time: float, structure: str) -> dict:
    """One match, its errors over both bands."""
    loop = replace(case.loop.with_values({"dead_time": dead_time}), structure=STRUCTURES[structure])
    began = time.process_time()
    found = match(replace(case, loop=loop, band=BANDS[0]))
    spent = time.process_time() - began
    over = []
    for band in BANDS:
        tuned = replace(found.tuned, band=band)
        over.append(errors_with_bounds(tuned, error_figures(tuned)).to_dict())
    fidelity = None if found.fidelity is None else found.fidelity.to_dict()
    return {
        "dead_time": dead_time, "structure": structure, "status": found.status, "limits": list(found.limits),
        "response_error": over, "modulus_margin": found.verification.modulus_margin, "processor_time": spent,
        "targets": [own.to_dict() for own in found.targets],
        "R_XiL": None if fidelity is None else [fidelity[when]["R_XiL"] for when in ("before", "after")],
        "values": {own.name: own.tuned for own in found.parameters},
    }  # fmt: skip


def line(row: dict) -> str:
    """A row of the table."""
    wide, narrow = row["response_error"]
    cells = [f"{1e3 * row['dead_time']:g} ms", f"`{row['structure']}`", row["status"]]
    cells += [digits(wide["before"]), f"**{digits(wide['after'])}**"]
    cells += [digits(wide[key]) for key in ("bound", "bound_unsampled", "unmeasured_after")]
    cells += [digits(narrow["before"]), f"**{digits(narrow['after'])}**", digits(narrow["bound"])]
    cells.append(f"{row['processor_time']:.1f} s")
    return f"| {' | '.join(cells)} |"


def digits(value: float) -> str:
    """Two digits after the leading zeros, four places at most."""
    return f"{value:.2f}" if value >= 0.1 else f"{value:.3f}" if value >= 0.01 else f"{value:.4f}"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, default=Path("out/dead_times"))
    out = parser.parse_args().out
    case, rows = load_case(CASE), []
    out.mkdir(parents=True, exist_ok=True)
    wanted = [(dead_time, structure) for dead_time in DEAD_TIMES for structure in COMPARED]
    for dead_time, structure in tqdm(wanted, disable=None):
        rows.append(measured(case, dead_time, structure))
        (out / "dead_times.json").write_text(json.dumps(rows, indent=2))
        text = "\n".join([HEAD, "|" + "---|" * HEAD.count(" |"), *map(line, rows)])
        (out / "dead_times.md").write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
