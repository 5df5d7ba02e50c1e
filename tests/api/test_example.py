"""The example of the Python face runs, with its asserted numbers, and leaves its figures."""

import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).parents[2] / "examples" / "python_api" / "run.py"


def test_the_example_runs(tmp_path):
    done = subprocess.run([sys.executable, SCRIPT, tmp_path], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"modes.png", "response.png", "fidelity.png", "shuffle.svg"}
    assert "side shafts twice as stiff" in done.stdout
