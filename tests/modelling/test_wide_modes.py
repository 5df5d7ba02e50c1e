"""Low modes beside very stiff shafts, and shafts that a rigid gear does not let twist."""

import numpy as np
import pytest
from scipy.linalg import eigh

from modelling.errors import InputError
from modelling.linear.linearise import linearise
from modelling.modal.modes import damped_modes_of, modes
from modelling.model_file import from_dict


def chain(inertia, stiffness):
    shafts = {
        f"s{i}": {"between": [f"i{i}", f"i{i + 1}"], "stiffness": float(k), "damping": 0.0}
        for i, k in enumerate(stiffness)
    }
    return from_dict({"inertias": {f"i{i}": {"J": float(J)} for i, J in enumerate(inertia)}, "shafts": shafts})


@pytest.mark.parametrize("seed", range(12))
def test_low_modes_are_those_of_the_chain_with_its_stiff_shafts_rigid(seed):
    rng = np.random.default_rng(seed)
    soft_inertia, soft = 10 ** rng.uniform(-2, 1, 4), 10 ** rng.uniform(-4, -1, 3)
    inertia, stiffness = [], []
    for i, J in enumerate(soft_inertia):  # every inertia in two halves, on a shaft of 1e9 N·m/rad and more
        share = rng.uniform(0.01, 0.99)
        inertia += [share * J, (1 - share) * J]
        stiffness += [10 ** rng.uniform(9, 11), soft[i] if i < 3 else 0.0]
    found = modes(chain(inertia, stiffness[:-1])).frequencies[1:4]
    twist = np.eye(4)[:-1] - np.eye(4)[1:]
    expected = np.sqrt(eigh((twist.T * soft) @ twist, np.diag(soft_inertia), eigvals_only=True)[1:]) / (2 * np.pi)
    np.testing.assert_allclose(found, expected, rtol=1e-8)


@pytest.mark.parametrize("ratio", [1.0, 3.0, -0.7])
def test_a_shaft_beside_a_rigid_gear(ratio):
    tables = {
        "inertias": {"a": {"J": 1.0}, "b": {"J": 2.0}, "c": {"J": 0.5}},
        "gears": {"g": {"between": ["a", "b"], "ratio": ratio}},
        "shafts": {
            "beside": {"between": ["a", "b"], "stiffness": 100.0, "damping": 1.0, "ratio": ratio},
            "link": {"between": ["b", "c"], "stiffness": 50.0, "damping": 0.1},
        },
    }
    found = damped_modes_of(linearise(from_dict(tables)))
    at_b = 2.0 + ratio**2
    assert found.frequencies[-1] == pytest.approx(np.sqrt(50 * (1 / at_b + 1 / 0.5)) / (2 * np.pi), rel=1e-3)
    assert np.isfinite(found.modal_mass).all()


@pytest.mark.parametrize("keys", [["torque_2"], ["torque_1", "torque_3"]])
def test_a_gap_in_a_list_is_told(keys):
    effect = {"kind": "recording_friction", "at": "inertias.i0", **dict.fromkeys(keys, 0.5)}
    with pytest.raises(InputError, match="torque: has a gap"):
        from_dict({"inertias": {"i0": {"J": 1.0}}, "effects": [effect]})


@pytest.mark.parametrize(("kind", "at"), [("coulomb_friction", "shafts.s0"), ("backlash", "inertias.i0")])
def test_an_effect_at_the_wrong_kind_of_place(kind, at):
    shafts = {"s0": {"between": ["i0", "i1"], "stiffness": 1.0, "damping": 0.0}}
    tables = {"inertias": {"i0": {"J": 1.0}, "i1": {"J": 1.0}}, "shafts": shafts}
    with pytest.raises(InputError, match=f"{kind} does not act at '{at}', but at .*; there act"):
        from_dict(tables | {"effects": [{"kind": kind, "at": at}]})
