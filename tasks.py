"""What `make` does, where there is no make or bash: ``python tasks.py run``, ``test``, ``docs``, …

Sets up ``.venv`` from the locks as the Makefile does, then runs the lines of the target as they stand there.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
import venv
from pathlib import Path

HERE = Path(__file__).resolve().parent
ENVIRONMENT = HERE / ".venv"
BIN = ENVIRONMENT / ("Scripts" if os.name == "nt" else "bin")
VARIABLES = {"WORKERS": "2", "FUZZ": "", "MUTANTS": "--anew", "FAULTS": "", "FIGURES": ""}
ALL_CORES = ("run", "explore")  # one process each; the others begin as many as there are cores
FIXED = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg", "PYTHONNOUSERSITE": "1"}
DROPPED = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "PYTHONDONTWRITEBYTECODE")  # as the Makefile's unexport


def targets() -> dict[str, tuple[str, list[str]]]:
    """By target of the Makefile the lock that it needs, and the lines that it runs."""
    found: dict[str, tuple[str, list[str]]] = {}
    text = (HERE / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ")
    for block in re.finditer(r"^([a-z-]+): \.venv/(\w+)\.stamp[^\n]*\n((?:\t[^\n]*\n)+)", text, flags=re.M):
        lines = [line.strip() for line in block[3].splitlines()]
        if block[2] != "pip" and all(line.startswith("$(BIN)/") for line in lines):
            found[block[1]] = (block[2], lines)
    return found


def command(line: str) -> list[str]:
    """The words of a line of the Makefile, its program in the environment; what only a shell knows is left out."""
    line = re.sub(r"\$\((\w+)\)", lambda name: VARIABLES.get(name[1], name[0]), re.split(r"\s\|\|\s", line)[0])
    program, *words = shlex.split(line)
    name = program.removeprefix("$(BIN)/")
    return [shutil.which(name, path=str(BIN)) or str(BIN / name), *words]


def set_up(lock: str) -> None:
    """The environment with what a lock names and this program, unless it is newer than the lock."""
    stamp, wanted = ENVIRONMENT / f"{lock}.stamp", HERE / "locks" / f"{lock}.txt"
    if stamp.exists() and stamp.stat().st_mtime > wanted.stat().st_mtime:
        return
    if not (ENVIRONMENT / "pip.stamp").exists():
        venv.create(ENVIRONMENT, clear=True, with_pip=False)
        (wheel,) = (HERE / ".ci" / "bootstrap").glob("pip-*.whl")
        _run([*command("$(BIN)/python"), f"{wheel}/pip", "install", "--quiet", "--no-index", str(wheel)])
        (ENVIRONMENT / "pip.stamp").touch()
    install = [*command("$(BIN)/python"), "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
    _run([*install, "--no-compile", "--only-binary", ":all:", "--require-hashes", "--requirement", str(wanted)])
    _run([*install, "--no-deps", "--no-build-isolation", "--no-index", "--editable", "."])
    stamp.touch()


def _run(words: list[str], **more: str) -> None:
    kept = {name: value for name, value in os.environ.items() if name not in DROPPED}
    if code := subprocess.run(words, cwd=HERE, env=FIXED | kept | more, check=False).returncode:
        sys.exit(code)


def main() -> None:
    """Run the target that the command line names."""
    known = targets()
    if len(sys.argv) != 2 or sys.argv[1] not in known:
        sys.exit(f"usage: python tasks.py {'|'.join(known)}")
    lock, lines = known[sys.argv[1]]
    set_up(lock)
    more = {"OMP_NUM_THREADS": str(os.cpu_count() or 1)} if sys.argv[1] in ALL_CORES else {}
    for line in lines:
        _run(command(line), **more)


if __name__ == "__main__":
    main()
