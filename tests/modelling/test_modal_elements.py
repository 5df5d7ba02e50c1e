"""Which quantities change the rows of masses and springs: ratios, linear in a row or not; no inertia, no stiffness."""

import numpy as np

from modelling.equations.casadi_code import compiled
from modelling.model_file import from_dict

DRIVE = {
    "inertias": {"motor": {"J": 0.1}, "axle": {"J": 0.5, "drag": 0.1}, "body": {"J": 40.0}},
    "gears": {"reduction": {"between": ["motor", "axle"], "ratio": {"value": 9.0, "tolerance": 0.1}}},
    "shafts": {"half": {"between": ["axle", "body"], "stiffness": 5000.0, "ratio": {"value": 2.0, "tolerance": 0.1}}},
}


def test_ratios_alone_change_rows():
    model = compiled(from_dict(DRIVE))
    p = model.vector()
    in_rows = np.array(model.elements(np.zeros(len(model.states)), p)[5]).ravel().astype(bool)
    changing = {name for name, changes in zip(model.parameters, in_rows, strict=True) if changes}
    assert changing == {"gears.reduction.ratio", "shafts.half.ratio"}
