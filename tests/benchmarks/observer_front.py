"""What the observer's limits cost: `python -m tests.benchmarks.observer_front [ROW] [--beds N] [--only NAME]`.

The reference drive at one dead time (12 ms unless stated, rows as in observer_table), once as asked and then with one
limit or one lever changed at a time: command noise, the frequency of the roll-off, how much dead time is uncertain, the
modulus margin, sample time. Printed as a table in Markdown; half a minute of one core a point.
"""

import argparse
import time
from dataclasses import replace

from independent.dynamic_stiffness import quantile

from matching.match.attempt import question_of
from matching.match.case import Case
from matching.match.match import match_with_observer
from matching.match.tune_observer import TuningEffort
from tests.benchmarks.observer_table import case_of

POINTS = {
    "as asked": ({}, {}, 1.0),
    "noise at most 10 N·m": ({"command_noise": 10.0}, {}, 1.0),
    "noise at most 15 N·m": ({"command_noise": 15.0}, {}, 1.0),
    "noise at most 30 N·m": ({"command_noise": 30.0}, {}, 1.0),
    "noise at most 60 N·m": ({"command_noise": 60.0}, {}, 1.0),
    "rolled off from 60 Hz": ({"rolled_off_from": 60.0}, {}, 1.0),
    "rolled off from 200 Hz": ({"rolled_off_from": 200.0}, {}, 1.0),
    "no roll-off, noise at most 60 N·m": ({"rolled_off_from": 1e4, "command_noise": 60.0}, {}, 1.0),
    "modulus margin 0.3": ({"modulus_margin": 0.3}, {}, 1.0),
    "half the box": ({}, {}, 0.5),
    "the bed as planned alone": ({}, {}, 0.02),
    "sampled at 2 kHz": ({}, {"sample_time": 0.0005}, 1.0),
}
HEAD = "| | as planned | beds: median, 95 % | damped | margin | T rolled off | noise, N·m | processor s |"


def shrunk(case: Case, share: float) -> Case:
    """The case with a share of every half-width of its box."""
    box = case.uncertainty
    narrow = tuple(replace(one, half_width=share * one.half_width) for one in box.uncertain)
    return replace(case, uncertainty=replace(box, uncertain=narrow))


def line(name: str, case: Case, beds: int) -> str:
    """One row of the table."""
    begin = time.process_time()
    result = match_with_observer(question_of(case), 0, lambda _: None, TuningEffort(fresh=beds))
    checked, loop = result.robust.beds, result.robust.loop
    return (
        f"| {name} | {result.response_error.unmeasured:.3f} "
        f"| {quantile(checked.unmeasured, 0.5):.3f}, {quantile(checked.unmeasured, 0.95):.3f} "
        f"| {checked.damped} of {checked.drawn} | {loop.modulus_margin:.2f} | {loop.largest_rolled_off:.2f} "
        f"| {max(loop.command_noise):.1f} | {time.process_time() - begin:.0f} |"
    )


def main() -> None:
    """Print the table, row by row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("row", nargs="?", default="12")
    parser.add_argument("--beds", type=int, default=400)
    parser.add_argument("--only", default="", help="the point of this name alone")
    arguments = parser.parse_args()
    print(HEAD, "|" + "---|" * 8, sep="\n", flush=True)
    for name, (limits, values, share) in POINTS.items():
        if arguments.only in ("", name):
            print(line(name, shrunk(case_of(arguments.row, limits, values), share), arguments.beds), flush=True)


if __name__ == "__main__":
    main()
