"""``python -m tests.benchmarks``: runs every script of this folder, each in a process of its own with one BLAS thread.

A script prints one row a measurement by :func:`tests.benchmarks.row.row`; it says in one line why it cannot run where a
peer is not installed, and goes on where a peer fails (:func:`tests.benchmarks.row.peer_runs`). A script that fails by
itself is named at the end, when the others have run. Nothing here is a test: times depend on the machine, ratios within
one run hardly.
"""

import os
import subprocess
import sys
from pathlib import Path

from tests.benchmarks.row import HEAD

HERE = Path(__file__).parent
APART = {"row", "diagnosis_growth", "matches", "observer_variants"}  # no timings, or too long


def main() -> int:
    scripts = sorted({path.stem for path in HERE.glob("[!_]*.py")} - APART)
    print(HEAD, flush=True)
    alone = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    failed = [
        name
        for name in scripts
        if subprocess.run([sys.executable, "-m", f"tests.benchmarks.{name}"], env=alone).returncode
    ]
    if failed:
        print(f"failed: {', '.join(failed)}", flush=True)
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
