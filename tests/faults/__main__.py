"""``python -m tests.faults``: ends commands at random moments and takes from them what they need; none may go wrong.

A run that was killed, interrupted or short of something has to end with its answer or with one line; results are whole,
marked or not there; the same command afterwards gives the same bytes as if nothing had been; nothing goes on or is left
in the temporary folder. Writes ``out/faults/report.md``; ends with 1 if anything went wrong.
"""

import argparse
import random
import signal
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from tests.faults.commands import QUICK, ROOT, SLOW, End, contents, run, words_of

SIGNALS = (signal.SIGKILL, signal.SIGINT, signal.SIGTERM)
PROMPT_SECONDS = 1.0
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
    """What was tried and what went wrong."""

    def __init__(self, folder: Path, commands: dict[str, list[str]]):
        self.folder, self.commands = folder, commands
        self.cache = str(folder / "cache")
        self.count, self.wrong = 0, list[str]()
        self.reference: dict[str, dict[str, bytes]] = {}
        self.seconds: dict[str, float] = {}
        for name in commands:
            for _ in range(2):  # the second time nothing is compiled
                end, out = self.run(name, f"{name} undisturbed")
                self.check(end.code == 0, name, f"ends with {end.code}: {end.said}")
                self.seconds[name], self.reference[name] = end.seconds, contents(out)

    def run(self, name: str, what: str, out: Path | None = None, **how: object) -> tuple[End, Path]:
        """Run a command into a folder of its own; complains of what is left of it."""
        self.count += 1
        out = out or self.folder / f"{self.count}"
        temporary = self.folder / f"temporary {self.count}"
        temporary.mkdir()
        changed = {"TMPDIR": str(temporary), "RIGMATCH_CACHE": self.cache} | how.pop("changed", {})  # type: ignore
        end = run(words_of(self.commands[name], out), changed, **how)  # type: ignore
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
            self.check(not out.exists() or not contents(out), what, f"leaves {out}")

    def ended(self, name: str, number: signal.Signals, after: float) -> None:
        """A command that is ended by a signal, then run again."""
        what = f"{name}, {number.name} after {after:.2f} s"
        end, out = self.run(name, what, number=number, after=after)
        if number != signal.SIGKILL:
            self.check(end.code in (0, 128 + number), what, f"ends with {end.code}: {end.said[:300]!r}")
            self.check(end.code == 0 or end.seconds < PROMPT_SECONDS, what, f"ends {end.seconds:.1f} s later")
        marked = out.exists() and any(out.glob("unfinished-*"))
        before = contents(out) if out.exists() else {}
        self.check(
            marked or not before or set(before) >= set(self.reference[name]) or "writing" in str(before), what, "half"
        )
        if name == "new" and before:
            return
        again, _ = self.run(name, f"{what}, again", out=out)
        self.check(again.code == 0, what, f"again: ends with {again.code}: {again.said[:300]!r}")
        self.same(name, out, what)


def disturb(trials: Trials, draw: random.Random) -> None:
    """What commands may be short of, and what they may meet."""
    shortages: dict[str, Callable[[], dict]] = {
        "files no longer than 1 kB": lambda: {"limit": "-f 1"},
        "little memory": lambda: {"limit": f"-v {draw.randrange(150_000, 1_500_000)}"},
        "few open files": lambda: {"limit": f"-n {draw.randrange(6, 40)}"},
        "no home": lambda: {"changed": {"HOME": "/proc/nowhere", "RIGMATCH_CACHE": None, "XDG_CACHE_HOME": None}},
        "C locale": lambda: {"changed": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}},
        "Turkish locale": lambda: {"changed": {"LC_ALL": "tr_TR.UTF-8", "LANG": "tr_TR.UTF-8"}},
    }
    for what, how in shortages.items():
        name = draw.choice(list(trials.commands))
        trials.clear(name, f"{name}, {what}", **how())
    for kind, script in BROKEN.items():
        compiler = trials.folder / f"cc {kind}"
        compiler.write_text(f'#!/bin/sh\n[ "$1" = --version ] && echo "{kind}" && exit\n{script}\n')
        compiler.chmod(0o755)
        trials.clear("export", f"export, a compiler that {kind}", changed={"CC": str(compiler)})
    for odd in ODD_NAMES:
        end, out = trials.run("modes", f"modes to {odd!r}", out=trials.folder / odd)
        trials.check(end.code == 0, f"modes to {odd!r}", f"ends with {end.code}: {end.said[:300]!r}")
        trials.same("modes", out, f"modes to {odd!r}")


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    parser.add_argument("--moments", type=int, default=100, help="random moments at which a command is ended")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="without match, map and tolerance")
    asked = parser.parse_args()
    draw = random.Random(asked.seed)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell ignores it in what it begins in the background
    with tempfile.TemporaryDirectory(prefix="faults-") as folder:
        trials = Trials(Path(folder), QUICK if asked.quick else QUICK | SLOW)
        for _ in range(asked.moments):
            name = draw.choice(list(trials.commands))
            trials.ended(name, draw.choice(SIGNALS), draw.uniform(0.0, 1.1 * trials.seconds[name]))
        disturb(trials, draw)
    report = ROOT / "out" / "faults" / "report.md"
    report.parent.mkdir(parents=True, exist_ok=True)
    head = f"{trials.count} runs, seed {asked.seed}, {asked.moments} moments: {len(trials.wrong)} went wrong\n"
    report.write_text("\n".join([head, *(f"- {line}" for line in trials.wrong)]), encoding="utf-8", errors="replace")
    print(head, end="")
    return bool(trials.wrong)


sys.exit(main())
