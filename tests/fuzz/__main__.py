"""``python -m tests.fuzz [--count 100000] [--seed 1] [--workers 2]``: the fuzzer.

Inputs are worked through in batches, each in a forked process that has the libraries loaded: a crash, a hang or
a full memory ends a batch and not the run. Finished batches are kept in ``out/fuzz/seed-N.jsonl``; started again, a run
goes on after them. A failing one is made small and kept in ``tests/fuzz/found/``, where the tests try it from then on.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import sys
import tempfile
import time
import zlib
from collections.abc import Iterator
from multiprocessing.connection import Connection, wait
from pathlib import Path

from tests.fuzz.corpus import seeds
from tests.fuzz.inputs import fuzz_input
from tests.fuzz.minimise import minimised
from tests.fuzz.seed import FOUND, ROOT, Seed
from tests.fuzz.targets import TARGETS, failure

BATCH = 250
SILENT_SECONDS = 300.0  # a batch that says nothing for so long hangs in native code
MEMORY_BYTES = 4 * 2**30
FORK = multiprocessing.get_context("fork")


def main() -> int:
    """Run, resume, report; exit code 1 if an input failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="Fuzz every kind of input.")
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    seeds()
    record = ROOT / "out" / "fuzz" / f"seed-{arguments.seed}.jsonl"
    record.parent.mkdir(parents=True, exist_ok=True)
    done = _finished(record)
    todo = [first for first in range(0, arguments.count, BATCH) if first not in done]
    began, failures = time.monotonic(), [entry for entries in done.values() for entry in entries]
    with record.open("a", encoding="utf-8") as file:
        for finished, (first, failed) in enumerate(
            _worked(arguments.seed, todo, arguments.count, arguments.workers), 1
        ):
            file.write(json.dumps({"first": first, "failures": failed}) + "\n")
            file.flush()
            failures += failed
            left = (time.monotonic() - began) / finished * (len(todo) - finished) / 60
            print(f"{(len(done) + finished) * BATCH} inputs, {len(failures)} failures, {left:.0f} min left", flush=True)
    kept = _kept(arguments.seed, failures)
    for name, how in kept.items():
        print(f"{name}: {how}")
    print(f"{arguments.count} inputs of seed {arguments.seed}: {len(failures)} failures of {len(kept)} kinds")
    return int(bool(failures))


def _finished(record: Path) -> dict[int, list]:
    """Failures by first input of every finished batch; a line that was cut off does not count."""
    done = {}
    for line in record.read_text(encoding="utf-8").splitlines() if record.exists() else ():
        try:
            entry = json.loads(line)
        except json.JSONDecodeError:
            continue
        done[entry["first"]] = entry["failures"]
    return done


def _worked(run: int, todo: list[int], count: int, workers: int) -> Iterator[tuple[int, list]]:
    """Batches as they finish: first input, failures as (number, what)."""
    waiting = [(first, first) for first in reversed(todo)]  # a batch, and the input to go on with
    running: dict[Connection, tuple[int, int, object, float]] = {}
    found: dict[int, list] = {}
    while waiting or running:
        while waiting and len(running) < workers:
            first, start = waiting.pop()
            ours, theirs = FORK.Pipe(duplex=False)
            process = FORK.Process(target=_batch, args=(theirs, run, start, min(first + BATCH, count)))
            process.start()
            theirs.close()
            running[ours] = first, start, process, time.monotonic()
        for line in wait(list(running), timeout=5):
            first, number, process, _ = running[line]
            try:
                number, what = line.recv()
            except EOFError:
                process.join()
                del running[line]
                if process.exitcode:
                    found.setdefault(first, []).append([number, f"died with {process.exitcode}"])
                    if number + 1 < min(first + BATCH, count):
                        waiting.append((first, number + 1))
                        continue
                yield first, found.pop(first, [])
                continue
            running[line] = first, number, process, time.monotonic()
            if what:
                found.setdefault(first, []).append([number, what])
        for _, _, process, heard in running.values():
            if time.monotonic() - heard > SILENT_SECONDS:
                process.kill()


def _batch(line: Connection, run: int, start: int, end: int) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    sys.stdout = sys.stderr = open("/dev/null", "w")  # noqa: SIM115
    with tempfile.TemporaryDirectory() as folder:
        for number in range(start, end):
            line.send((number, ""))
            changed = fuzz_input(run, number)
            place = Path(folder) / changed.seed.target / changed.seed.name
            place.mkdir(parents=True, exist_ok=True)
            if what := failure(changed.seed, changed.content, place, deep=True):
                line.send((number, what))


def _kept(run: int, failures: list) -> dict[str, str]:
    """One small input of each way to fail, written to ``tests/fuzz/found``; how it fails, by file name."""
    kept, known = {}, set()
    for number, what in failures:
        changed = fuzz_input(run, number)
        if (changed.seed.target, what) in known:
            continue
        known.add((changed.seed.target, what))
        small = minimised(changed.content, lambda content, c=changed, w=what: _apart(c.seed, content) == w)
        suffix = TARGETS[changed.seed.target].suffix
        name = f"{changed.seed.target}-{changed.seed.name}-{zlib.crc32(small):08x}{suffix}"
        FOUND.mkdir(exist_ok=True)
        (FOUND / name).write_bytes(small)
        kept[name] = what
    return kept


def _apart(seed: Seed, content: bytes) -> str:
    """How an input fails, tried in a process of its own."""
    ours, theirs = FORK.Pipe(duplex=False)
    process = FORK.Process(target=_single, args=(theirs, seed, content))
    process.start()
    theirs.close()
    try:
        what = ours.recv() if ours.poll(SILENT_SECONDS) else "died with -9"
    except EOFError:
        process.join()
        what = f"died with {process.exitcode}"
    process.kill()
    process.join()
    return what


def _single(line: Connection, seed: Seed, content: bytes) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    sys.stdout = sys.stderr = open("/dev/null", "w")  # noqa: SIM115
    with tempfile.TemporaryDirectory() as folder:
        line.send(failure(seed, content, Path(folder), deep=True))


if __name__ == "__main__":
    sys.exit(main())
