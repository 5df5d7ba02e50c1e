"""The mode of the rig without control that a target is compared with, on beds that once named the flanges' mode."""

from pathlib import Path

import numpy as np
import pytest
import scipy

from matching.match.case_file import load_case
from matching.match.targets import on_rig, target_modes

FOUND = Path(__file__).parent / "found"


@pytest.mark.parametrize(("folder", "expected"), [
    ("rig_alone_wrong_mode", 13.51), ("limited_by_a_slow_swing", 6.49), ("better_encoder_worse_verdict", 21.94),
])  # fmt: skip
def test_it_moves_the_shared_parts_as_the_vehicle_does(folder, expected):
    """Frequencies of an own calculation with all inertias (planetary gear, clutch, open differential)."""
    case = load_case(FOUND / folder / "case.toml")
    (mode,) = on_rig(case)
    assert mode.frequency == pytest.approx(expected, rel=5e-3)


def test_a_chain_by_its_own_matrices():
    """The truck's bed: eigenvalues of matrices that are written here from the file's numbers."""
    case = load_case(FOUND / "limited_by_a_slow_swing" / "case.toml")
    rig = case.rig
    names = [part.name for part in rig.inertias]
    ratio = dict.fromkeys(names, 1.0)
    assert not rig.differentials
    assert not rig.planetary_gears
    M = np.diag([part.J.value for part in rig.inertias])
    K = np.zeros_like(M)
    for shaft in rig.shafts:
        a, b = (names.index(end) for end in shaft.between)
        n = 1.0 if shaft.ratio is None else shaft.ratio.value
        row = np.zeros(len(names))
        row[a], row[b] = 1 / n, -1.0
        K += shaft.stiffness.value * np.outer(row, row)
    rigid = {}
    for gear in rig.gears:
        rigid[gear.between] = gear.ratio.value
    # coordinates that rigid gears leave: speed of the first end is the ratio times that of the second
    T = np.eye(len(names))
    for (first, second), n in rigid.items():
        T[names.index(first)] = n * T[names.index(second)]
    keep = [i for i, name in enumerate(names) if name not in {first for first, _ in rigid}]
    T = T[:, keep]
    squares = scipy.linalg.eigvalsh(T.T @ K @ T, T.T @ M @ T)
    frequencies = np.sqrt(np.clip(squares, 0, None)) / (2 * np.pi)
    (mode,) = on_rig(case)
    assert ratio  # every inertia is a coordinate
    assert np.abs(frequencies / mode.frequency - 1).min() < 1e-6
    assert target_modes(case)[0][0].frequency < 2
