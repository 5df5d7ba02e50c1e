"""The peer's part: modes of every variation by openTorsion; prints seconds and the mean second frequency."""

import json
import sys
import time

import numpy as np
import opentorsion as ot

sys.path.insert(0, sys.argv[1])
import drivetrain10 as shared


def build(inertia: np.ndarray, stiffness: np.ndarray) -> ot.Assembly:
    shafts = [ot.Shaft(a, b, k=k, I=0.0, c=c) for (a, b, _, c), k in zip(shared.SHAFTS, stiffness)]
    disks = [ot.Disk(i, J) for i, J in enumerate(inertia) if i not in (1, 2)]
    first = ot.Gear(1, inertia[1], 1.0)
    return ot.Assembly(
        shafts, disk_elements=disks, gear_elements=[first, ot.Gear(2, inertia[2], shared.RATIO, parent=first)]
    )


inertias, stiffnesses = shared.variations(int(sys.argv[2]))
second = 0.0
began = time.perf_counter()
for inertia, stiffness in zip(inertias, stiffnesses):
    squares = np.sort(np.abs(build(inertia, stiffness).undamped_modal_analysis()[0].real))
    second += np.sqrt(squares[1]) / (2 * np.pi)
print(json.dumps({"seconds": time.perf_counter() - began, "mean": second / len(inertias)}))
