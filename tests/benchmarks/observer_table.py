"""The observer on the reference drive over dead times: `python -m tests.benchmarks.observer_table [ROW…] [--beds N]`.

Rows are dead times in ms, with ``g`` where the gains of dynamometers and torque sensors are drawn as well and ``s``
where the motor's speed is not measured: ``1 3 3g 3s 5 8 12``. Every row is a match, judged on fresh beds and by the
worst bed of the box; printed as a table in Markdown. It takes about half a minute of one core a row.
``--limit command_noise=30`` changes a limit of the case, ``--loop sample_time=0.0005`` a value of its loop, SI: the
trades between error, noise, roll-off and sampling.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

from independent.dynamic_stiffness import quantile

from matching.match.attempt import question_of
from matching.match.case import Case
from matching.match.case_file import load_case
from matching.match.match import match_with_observer
from matching.match.tune_observer import TuningEffort

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "observer.toml"
ROWS = ["1", "3", "3g", "3s", "5", "8", "12"]
GAINS = ("dynamometers.", "sensors.")
HEAD = (
    "| row | nominal: motor, road | beds, six functions: median, 95 % | stable / damped | worst of the box: damping "
    "| margin | T rolled off | noise, N·m | ideal estimator | status | processor s |"
)


def case_of(row: str, limits: dict[str, float], values: dict[str, float]) -> Case:
    """The reference case of a row, with some limits and values of the loop changed."""
    case = load_case(CASE)
    case = replace(case, limits={**case.limits, **limits})
    loop = case.loop.with_values({"dead_time": float(row.rstrip("gs")) / 1e3, **values})
    if row.endswith("s"):
        loop = replace(loop, further_sensors=())
    box = case.uncertainty if row.endswith("g") else case.uncertainty.without(*GAINS)
    dead_time = next(one for one in box.uncertain if one.name == "loop.dead_time")
    moved = replace(dead_time, value=loop["dead_time"])
    box = replace(box, uncertain=tuple(moved if one is dead_time else one for one in box.uncertain))
    return replace(case, loop=loop, uncertainty=box)


def line(row: str, case: Case, beds: int) -> str:
    """One row of the table."""
    begin = time.process_time()
    result = match_with_observer(question_of(case), 0, lambda _: None, TuningEffort(fresh=beds))
    checked, loop, error = result.robust.beds, result.robust.loop, result.response_error
    by_input = {
        kind: (sum(f.unmeasured**2 for f in error.functions if f.input == kind) / 3) ** 0.5
        for kind in ("motor_torque", "road_left")
    }
    return (
        f"| {row} | {by_input['motor_torque']:.4f}, {by_input['road_left']:.4f} "
        f"| {quantile(checked.unmeasured, 0.5):.3f}, {quantile(checked.unmeasured, 0.95):.3f} "
        f"| {checked.stable} / {checked.damped} of {checked.drawn} | {checked.worst.damping_ratio:.4f} "
        f"| {loop.modulus_margin:.2f} | {loop.largest_rolled_off:.2f} | {max(loop.command_noise):.1f} "
        f"| {error.unmeasured_bound:.4f} | {result.status} | {time.process_time() - begin:.0f} |"
    )


def changed(text: str) -> tuple[str, float]:
    """Name and value of an option."""
    name, value = text.split("=")
    return name, float(value)


def main() -> None:
    """Print the table, row by row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", nargs="*", default=ROWS)
    parser.add_argument("--beds", type=int, default=2000)
    parser.add_argument("--limit", action="append", default=[], type=changed, metavar="NAME=VALUE")
    parser.add_argument("--loop", action="append", default=[], type=changed, metavar="NAME=VALUE")
    arguments = parser.parse_args()
    limits, values = dict(arguments.limit), dict(arguments.loop)
    print(HEAD, "|" + "---|" * 11, sep="\n", flush=True)
    for row in arguments.rows:
        print(line(row, case_of(row, limits, values), arguments.beds), flush=True)


if __name__ == "__main__":
    main()
