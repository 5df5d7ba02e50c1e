"""``python -m tests.mutants``: plants faults at random and counts how many the tests of ``make test`` notice.

First the tests are run once, to see which test runs which line (:mod:`tests.mutants.coverage_map`); then each fault of
a random sample (:mod:`tests.mutants.sample`) is planted in a copy of the project and the tests that run its line are
run against it, the most particular first, until one fails. ``out/mutants/`` keeps both, so that a stopped run goes on;
``--anew`` forgets. Ends with 1 if fewer faults are noticed than asked for.
"""

import argparse
import os
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tests.mutants.bench import FAILED, PASSED, Run, copy, warm
from tests.mutants.coverage_map import ROOT, Map
from tests.mutants.operators import Fault
from tests.mutants.rows import append, rows
from tests.mutants.sample import all_faults, sample
from tests.mutants.selection import further_tests_for, tests_for

SECOND_BUDGET = 5  # times the budget: what survives the first tests is tried with more of them
KILLED = ("test", "time", "import")  # by a test, by using far more time than before, before any test


def main() -> int:
    asked = arguments()
    folder = asked.out.resolve()
    if asked.anew:
        shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    if not asked.keep_map:
        record(folder, asked.workers)
    tests = Map(folder)
    if tests.failed:
        print(f"{len(tests.failed)} tests fail without any fault and are left out, e.g. {tests.failed[0]}")
    chosen = [
        fault
        for fault in sample(all_faults(begins=tuple(asked.only)), asked.count, asked.seed)
        if fault.kind not in asked.without
    ]
    results = folder / f"results-{asked.seed}.jsonl"
    done = {key(row): row for row in (rows(results) if results.exists() else [])}
    warm()
    for row in judged([fault for fault in chosen if key(facts(fault)) not in done], tests, folder, asked):
        done[key(row)] = row
        append(results, row)
        print(
            f"{len(done):4} of {len(chosen)}  {row['end']:8} {row['file']}:{row['line']}  {row['change']}", flush=True
        )
    return report([done[key(facts(fault))] for fault in chosen], folder / f"survivors-{asked.seed}.md", asked.least)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description="how many planted faults are noticed")
    parser.add_argument("--count", type=int, default=300, help="faults to plant (300)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2, help="processes (2)")
    parser.add_argument("--budget", type=float, default=60.0, help="s of tests against one fault (60)")
    parser.add_argument("--least", type=float, default=0.9, help="share that must be noticed (0.9)")
    parser.add_argument("--only", nargs="*", default=[""], help="files that begin so, e.g. modelling/modal")
    parser.add_argument("--without", nargs="*", default=[], help="kinds of fault to leave out, e.g. argument")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "mutants")
    parser.add_argument("--anew", action="store_true", help="forget what an earlier run found")
    parser.add_argument("--keep-map", action="store_true", help="do not look again which test runs which line")
    return parser.parse_args()


def record(folder: Path, workers: int) -> None:
    """Run all tests that have no row yet, traced."""
    command = [sys.executable, "-m", "pytest", "-q", "-n", str(workers), "-p", "tests.mutants.coverage_map"]
    slow = ["--timeout=1800", "-o", "faulthandler_timeout=1900", "tests"]
    with (folder / "map.log").open("w") as log:
        where = {**os.environ, "MUTANTS_MAP": str(folder), "PYTHONPATH": str(ROOT)}
        subprocess.run([*command, *slow], env=where, cwd=ROOT, stdout=log, stderr=log, check=False)


def judged(faults: list[Fault], tests: Map, folder: Path, asked: argparse.Namespace) -> Iterator[dict]:
    """One row a fault, as they end."""
    free = [copy(folder / f"copy-{number}") for number in range(asked.workers)]
    waiting: list[tuple[Fault, tuple[str, ...]]] = [(fault, ()) for fault in faults]  # with the tests it survived
    running: dict[int, tuple[Fault, tuple[str, ...], Run]] = {}
    checked: dict[str, bool] = {}  # tests that failed with a fault: whether they pass without
    while waiting or running:
        while waiting and free:
            fault, survived = waiting.pop(0)
            chosen = choice(fault, survived, tests, asked.budget)
            if not chosen:
                end_so_far = "survived" if survived else "no test"
                yield {**facts(fault), "end": end_so_far, "tests": len(survived), "by": ""}
                continue
            seconds = 60 + 4 * sum(tests.seconds[name] for name in chosen)
            run = Run(free.pop(), chosen, seconds, fault.file, fault.source).start()
            running[run.pid] = (fault, survived, run)
        for fault, survived, run in list(running.values()):
            if (code := run.ended()) is None:
                continue
            del running[run.pid]
            free.append(run.tree)
            name = run.failure or (run.tests[0] if code > 0 else "")  # an import fails before any test
            if code > 0 and not passes_alone(name, run.tree, checked):
                tests.forget(name)
                waiting.insert(0, (fault, survived))
            elif code == PASSED and not survived:
                waiting.insert(0, (fault, tuple(run.tests)))
            else:
                yield {**facts(fault), "end": end(code), "tests": len(survived) + len(run.tests), "by": name}
        time.sleep(0.05)


def choice(fault: Fault, survived: tuple[str, ...], tests: Map, budget: float) -> list[str]:
    """The tests to run next against a fault: the most particular first, then what these left out."""
    if not survived:
        return tests.ordered(tests_for(fault, tests), budget)
    return tests.ordered(further_tests_for(fault, tests) - set(survived), SECOND_BUDGET * budget)


def end(code: int) -> str:
    """How a run ended: passed means that nobody noticed."""
    if code == PASSED:
        return "survived"
    return "test" if code == FAILED else "time" if code < 0 else "import"


def passes_alone(name: str, tree: Path, checked: dict[str, bool]) -> bool:
    """Whether a test passes here without a fault, so that its failure means something."""
    if name not in checked:
        run = Run(tree, [name], 600).start()
        while (code := run.ended()) is None:
            time.sleep(0.05)
        checked[name] = code == PASSED
    return checked[name]


def facts(fault: Fault) -> dict:
    return {
        "file": fault.file,
        "line": fault.line,
        "column": fault.column,
        "kind": fault.kind,
        "change": fault.change,
    }


def key(row: dict) -> tuple:
    return row["file"], row["line"], row["column"], row["kind"], row["change"]


def report(done: list[dict], path: Path, least: float) -> int:
    """Print the counts, write the table of survivors."""
    survivors = [row for row in done if row["end"] not in KILLED]
    share = 1 - len(survivors) / max(1, len(done))
    kinds, lost = Counter(row["kind"] for row in done), Counter(row["kind"] for row in survivors)
    rooms = Counter(str(Path(row["file"]).parent) for row in done)
    lost_rooms = Counter(str(Path(row["file"]).parent) for row in survivors)
    head = f"{len(done) - len(survivors)} of {len(done)} planted faults are noticed ({share:.1%})"
    lines = [f"# {head}", "", "| kind | planted | noticed |", "|---|---|---|"]
    lines += [f"| {kind} | {count} | {count - lost[kind]} |" for kind, count in sorted(kinds.items())]
    lines += ["", "| room | planted | noticed |", "|---|---|---|"]
    lines += [f"| {room} | {count} | {count - lost_rooms[room]} |" for room, count in sorted(rooms.items())]
    lines += ["", "| survivor | kind | change | tests run |", "|---|---|---|---|"]
    for row in sorted(survivors, key=lambda row: (row["file"], row["line"])):
        change = row["change"].replace("|", "\\|")
        lines.append(f"| {row['file']}:{row['line']} | {row['kind']} | `{change}` | {row['tests']} |")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"{head}; survivors: {path}")
    return int(share < least)


if __name__ == "__main__":
    sys.exit(main())
