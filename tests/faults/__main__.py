"""``python -m tests.faults``: ends commands at random moments and takes from them what they need; none may go wrong.

A run that was killed, interrupted or short of something has to end with its answer or with one line; results are whole,
marked or not there; the same command afterwards gives the same bytes as if nothing had been; nothing goes on or is left
in the temporary folder. Writes ``out/faults/report.md``; ends with 1 if anything went wrong.
"""

import argparse
import itertools
import random
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from tests.faults.commands import IN_STEPS, QUICK, ROOT, SERVED, SLOW, End, contents, run, words_of
from tests.faults.inputs import written

SIGNALS = (signal.SIGKILL, signal.SIGINT, signal.SIGTERM)
PROMPT_SECONDS = 1.0
DAY = 0  # s since 1970: of every result, whatever midnight passes
SERVED_SECONDS = 8.0  # until the page is served, at most
Trial = Callable[[], None]
BROKEN = {
    "fails": "exit 1",
    "makes nothing": "exit 0",
    "hangs": "sleep 1000",
    "makes garbage": "head -c 999 /dev/zero > made.so",
}
ODD_NAMES = (
    "two words",
    "-leading dash",
    "quote'\"$(touch x)`",
    "new\nline",
    "Prüfstand Ω 轴",
    "\udcff not UTF-8",
    "n" * 200,
)


class Trials:
    """What was tried and what went wrong; trials may run side by side in threads."""

    def __init__(self, folder: Path, commands: dict[str, list[str]]):
        self.folder, self.commands = folder, commands
        self.cache, self.inputs = str(folder / "cache"), written(folder / "inputs")
        self.numbers, self.wrong = itertools.count(1), list[str]()
        self.reference: dict[str, dict[str, bytes]] = {}
        self.seconds: dict[str, float] = {}
        for name in commands:
            for _ in range(2):  # the second time nothing is compiled
                end, out = self.run(name, f"{name} undisturbed")
                self.check(end.code == 0, name, f"ends with {end.code}: {end.said}")
                self.seconds[name], self.reference[name] = end.seconds, contents(out)

    def run(self, name: str, what: str, out: Path | None = None, **how: object) -> tuple[End, Path]:
        """Run a command into a folder of its own; complains of what is left of it."""
        number = next(self.numbers)
        out = out or self.folder / f"{number}" / "results"
        out.parent.mkdir(exist_ok=True)
        temporary = self.folder / f"temporary {number}"
        temporary.mkdir()
        same = {"TMPDIR": str(temporary), "RIGMATCH_CACHE": self.cache, "SOURCE_DATE_EPOCH": str(DAY)}
        changed = same | how.pop("changed", {})  # type: ignore
        shown = Path(out.name) if name in IN_STEPS else out  # it stands in results of steps
        words = words_of((self.commands | SERVED)[name], shown, self.inputs)
        end = run(words, changed, out.parent, **how)  # type: ignore
        killed = how.get("number") == signal.SIGKILL
        self.check(not end.left, what, f"processes {end.left} go on")
        self.check(killed or not list(temporary.iterdir()), what, f"leaves {[*temporary.iterdir()]}")
        return end, out

    def check(self, holds: bool, what: str, wrong: str) -> None:
        """Note what does not hold."""
        if not holds:
            self.wrong.append(f"{what}: {wrong}")
            print("WRONG", self.wrong[-1], flush=True)

    def same(self, name: str, out: Path, what: str) -> None:
        """The results of a command are those of the run that nothing disturbed."""
        found, wanted = contents(out), self.reference[name]
        self.check(
            found == wanted, what, f"differs in {sorted(k for k in found | wanted if found.get(k) != wanted.get(k))}"
        )

    def clear(self, name: str, what: str, **how: object) -> None:
        """A command short of something ends with its answer or with one line."""
        end, out = self.run(name, what, **how)
        self.check(end.is_clear, what, f"ends with {end.code}: {end.said[:300]!r}")
        if end.code == 0:
            self.same(name, out, what)
        else:
            left = set(contents(out)) & self.last(name) if out.exists() else set()
            self.check(not left, what, f"leaves {sorted(left)}")

    def last(self, name: str) -> set[str]:
        """Results that are written together, at a command's end."""
        return set(IN_STEPS.get(name, self.reference[name]))

    def ended(self, name: str, number: signal.Signals, after: float) -> None:
        """A command that is ended by a signal, then run again."""
        what = f"{name}, {number.name} after {after:.2f} s"
        end, out = self.run(name, what, number=number, after=after)
        if number != signal.SIGKILL:
            # a signal before Python has come to the program's first line ends Python, in its own way
            early = str(ROOT) not in end.said
            early &= end.code == -number or (end.code == 1 and "Could not import runpy" in end.said)
            self.check(early or end.code in (0, 128 + number), what, f"ends with {end.code}: {end.said[:300]!r}")
            self.check(end.code == 0 or end.seconds < PROMPT_SECONDS, what, f"ends {end.seconds:.1f} s later")
        marked = out.exists() and any(out.glob("unfinished-*"))
        before = contents(out) if out.exists() else {}
        last = self.last(name)
        self.check(marked or not last & set(before) or last <= set(before) or "writing" in str(before), what, "half")
        if name == "new" and before:
            return
        again, _ = self.run(name, f"{what}, again", out=out)
        self.check(again.code == 0, what, f"again: ends with {again.code}: {again.said[:300]!r}")
        self.same(name, out, what)

    def served(self, number: signal.Signals, after: float) -> None:
        """The page's server, which goes on until it is ended."""
        what = f"explore, {number.name} after {after:.2f} s"
        end, _ = self.run("explore", what, number=number, after=after)
        self.check(end.code in (128 + number, -number), what, f"ends with {end.code}: {end.said[:300]!r}")
        self.check(end.seconds < PROMPT_SECONDS, what, f"ends {end.seconds:.1f} s later")

    def odd(self, name: str) -> None:
        """A folder of results with an odd name."""
        end, out = self.run("modes", f"modes to {name!r}", out=self.folder / name)
        self.check(end.code == 0, f"modes to {name!r}", f"ends with {end.code}: {end.said[:300]!r}")
        self.same("modes", out, f"modes to {name!r}")


def moments(trials: Trials, draw: random.Random, count: int) -> Iterator[Trial]:
    """Commands that are ended, and some servers."""
    for _ in range(count):
        name = draw.choice(list(trials.commands))
        number, after = draw.choice(SIGNALS), draw.uniform(0.0, 1.1 * trials.seconds[name])
        yield partial(trials.ended, name, number, after)
    for number in SIGNALS:
        yield partial(trials.served, number, draw.uniform(0.0, SERVED_SECONDS))


def disturbances(trials: Trials, draw: random.Random) -> Iterator[Trial]:
    """What commands may be short of, and what they may meet."""
    for name in trials.commands:
        shortages: dict[str, dict] = {
            "files no longer than 1 kB": {"limit": "-f 1"},
            "little memory": {"limit": f"-v {draw.randrange(150_000, 1_500_000)}"},
            "few open files": {"limit": f"-n {draw.randrange(6, 40)}"},
            "no home": {"changed": {"HOME": "/proc/nowhere", "RIGMATCH_CACHE": None, "XDG_CACHE_HOME": None}},
            "C locale": {"changed": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}},
            "Turkish locale": {"changed": {"LC_ALL": "tr_TR.UTF-8", "LANG": "tr_TR.UTF-8"}},
        }
        chosen = shortages if name in QUICK else draw.sample(list(shortages), 2)
        for what in chosen:
            yield partial(trials.clear, name, f"{name}, {what}", **shortages[what])
    for kind, script in BROKEN.items():
        compiler = trials.folder / f"cc {kind}"
        compiler.write_text(f'#!/bin/sh\n[ "$1" = --version ] && echo "{kind}" && exit\n{script}\n')
        compiler.chmod(0o755)
        for name in {"export", "commission"} & set(trials.commands):
            yield partial(trials.clear, name, f"{name}, a compiler that {kind}", changed={"CC": str(compiler)})
    for name in ODD_NAMES:
        yield partial(trials.odd, name)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    parser.add_argument("--moments", type=int, default=100, help="random moments at which a command is ended")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="without match, map and tolerance")
    parser.add_argument("--at-once", type=int, default=2, help="trials side by side")
    asked = parser.parse_args()
    draw = random.Random(asked.seed)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell ignores it in what it begins in the background
    with tempfile.TemporaryDirectory(prefix="faults-") as folder, ThreadPoolExecutor(asked.at_once) as pool:
        trials = Trials(Path(folder), QUICK if asked.quick else QUICK | SLOW)
        todo = [*moments(trials, draw, asked.moments), *disturbances(trials, draw)]
        for done in [pool.submit(trial) for trial in todo]:
            done.result()
    report = ROOT / "out" / "faults" / "report.md"
    report.parent.mkdir(parents=True, exist_ok=True)
    head = (
        f"{next(trials.numbers) - 1} runs, seed {asked.seed}, {asked.moments} moments: {len(trials.wrong)} went wrong\n"
    )
    report.write_text("\n".join([head, *(f"- {line}" for line in trials.wrong)]), encoding="utf-8", errors="replace")
    print(head, end="")
    return bool(trials.wrong)


sys.exit(main())
