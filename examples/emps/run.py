"""A real drive: diagnose the public EMPS recording.

python examples/emps/run.py DATA_EMPS.mat out/emps
"""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
HEADER = "time [s],drive_force [N*m],position [rad]"


def rows(path: Path) -> np.ndarray:
    """Time in s, force in N and position in m, (t, 3), of the authors' file: t, vir, gtau (N/V) and qm in it."""
    from scipy.io import loadmat

    data = loadmat(path)
    gain = float(np.asarray(data["gtau"]).squeeze())
    time, voltage, position = (np.asarray(data[name], dtype=float).ravel() for name in ("t", "vir", "qm"))
    return np.column_stack([time, gain * voltage, position])


def main(source: Path, folder: Path) -> None:
    """Write the recording as CSV (a CSV is taken as it is), diagnose it and check what must hold."""
    import json

    from matching.cli import main as rigmatch

    folder.mkdir(parents=True, exist_ok=True)
    recording = source
    if source.suffix == ".mat":
        recording = folder / "recording.csv"
        np.savetxt(recording, rows(source), delimiter=",", header=HEADER, comments="", fmt="%.10g")
    assert not rigmatch(["diagnose", str(HERE / "model.toml"), str(recording), "--out", str(folder)])
    found = json.loads((folder / "diagnosis.json").read_text())
    first = found["causes"][0]
    assert (first["kind"], first["at"]) == ("coulomb_friction", "inertias.carriage")
    for own in first["parameters"].values():
        assert 0 < own["standard_uncertainty"] < 0.1 * own["value"]
    errors = found["errors"]["position"]
    assert errors["after_holdout"] < 0.1 * errors["before_holdout"]
    assert found["verdict"] == "unexplained"  # millimetres remain, the encoder reads micrometres
    assert found["rest"]


if __name__ == "__main__":
    if len(sys.argv) < 2:
        raise SystemExit("usage: python examples/emps/run.py DATA_EMPS.mat [DIR]; see examples/emps/README.md")
    main(Path(sys.argv[1]), Path(sys.argv[2] if len(sys.argv) > 2 else "out/emps"))
