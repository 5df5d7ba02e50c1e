"""Nothing that lies in the working folder is run or changes a result."""

import contextlib
import os
import subprocess
import sys

import numpy as np

from matching.cli import main

MODEL = """
[inertias.motor]
J = 0.1
[inertias.load]
J = 1
[shafts.link]
between = ["motor", "load"]
stiffness = 100
damping = 0.3
[inputs.torque]
on = "motor"
[sensors.speed]
measures = "speed"
of = "motor"
"""
SHADOWS = (
    "multiprocessing",
    "numpy",
    "json",
    "casadi",
    "asammdf",
    "pyarrow",
    "concurrent",
    "matching",
    "ctypes",
)
RUN = """
import sys
from matching.cli import main
from matching.worker_pool import LocalProcesses
if __name__ == "__main__":
    with LocalProcesses(1) as pool:
        assert pool.submit(abs, -3).result(timeout=100) == 3
    code = main(["modes", "model.toml", "--out", "shadowed"])
    sys.exit(code or main(["show", "run.parquet", "--model", "model.toml"]))
"""


def test_modules_and_settings_of_the_working_folder_do_not_count(tmp_path):
    import pyarrow
    from pyarrow import parquet

    folder, outside = tmp_path / "folder", tmp_path / "run.py"
    folder.mkdir()
    outside.write_text(RUN)
    (folder / "model.toml").write_text(MODEL)
    time = np.arange(300) * 0.002
    columns = {"time": time, "torque": np.sin(20 * time), "speed": np.cos(20 * time)}
    parquet.write_table(pyarrow.table(columns), folder / "run.parquet")

    with contextlib.chdir(folder):
        assert main(["modes", "model.toml", "--out", "plain"]) == 0
    for name in SHADOWS:
        (folder / f"{name}.py").write_text("open('executed', 'a').write(__name__)\n")
    (folder / "matplotlibrc").write_text("lines.linewidth: 9\naxes.facecolor: red\nfont.size: 30\naxes.grid: True\n")
    done = subprocess.run(
            [sys.executable, "-P", str(outside)], cwd=folder, capture_output=True, text=True, timeout=250,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}, check=False,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    plain, shadowed = ((folder / out / "modes.svg").read_text() for out in ("plain", "shadowed"))
    assert shadowed == plain
    assert not (folder / "executed").exists()
