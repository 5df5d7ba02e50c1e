"""The command keeps OpenBLAS to one thread unless its user says otherwise."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

# What OpenBLAS will be told when a command imports NumPy.
SAID = """
import os, sys
from matching.cli import main
assert "numpy" not in sys.modules
assert main(["--version"]) == 0
print(os.environ.get("OPENBLAS_NUM_THREADS"), os.environ.get("OMP_NUM_THREADS"), file=sys.stderr)
"""


@pytest.mark.parametrize(
    ("own", "expected"),
    [
        ({}, "1 None"),
        ({"OPENBLAS_NUM_THREADS": "3", "OMP_NUM_THREADS": "2"}, "3 2"),
    ],
)
def test_one_thread_unless_the_user_has_set_something(own: dict[str, str], expected: str) -> None:
    bare = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    root = str(Path(__file__).parents[2])
    done = subprocess.run(
        [sys.executable, "-c", SAID], env=bare | {"PYTHONPATH": root} | own, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.split("\n")[-2] == expected
