"""Low modes beside very stiff shafts, and shafts that a rigid gear does not let twist."""

import numpy as np
import pytest
from mpmath import mp
from small_drives import chain

from modelling.errors import InputError
from modelling.linear.linearise import linearise
from modelling.modal.modes import damped_modes_of, modes
from modelling.model_file import from_dict


@pytest.mark.parametrize(("seed", "count"), [*((seed, 4) for seed in range(9)), (9, 20), (10, 60), (11, 160)])
def test_low_modes_are_those_of_the_chain_with_its_stiff_shafts_rigid(seed, count):
    """The largest has 320 degrees of freedom, of which the lowest modes are found by sparse matrices."""
    rng = np.random.default_rng(seed)
    soft_inertia, soft = 10 ** rng.uniform(-2, 1, count), 10 ** rng.uniform(-4, -1, count - 1)
    inertia, stiffness = [], []
    for J, k in zip(soft_inertia, [*soft, 0.0], strict=True):  # in two halves, on a shaft of 1e9 N·m/rad and more
        share = rng.uniform(0.01, 0.99)
        inertia += [share * J, (1 - share) * J]
        stiffness += [10 ** rng.uniform(9, 11), k]
    found = modes(chain(inertia, stiffness[:-1])).frequencies[1:count]
    twist = np.eye(count)[:-1] - np.eye(count)[1:]
    expected = np.linalg.svd(np.sqrt(soft)[:, None] * twist / np.sqrt(soft_inertia), compute_uv=False)[::-1]
    np.testing.assert_allclose(found, expected[: len(found)] / (2 * np.pi), rtol=1e-8)


def digits(inertia, ends, stiffness, ratios):
    """Frequencies with 50 digits; ``ratios`` of rigid gears by the index of the inertia behind them."""
    with mp.workdps(50):
        own = [i for i in range(len(inertia)) if i not in ratios]  # coordinates
        turns = mp.zeros(len(inertia), len(own))
        for i in range(len(inertia)):
            for column in range(len(own)):
                if i in ratios:  # turns i = turns of the one before over the ratio
                    turns[i, column] = turns[ends[i], column] / mp.mpf(ratios[i])
                elif own[column] == i:
                    turns[i, column] = mp.mpf(1)
        shafts = [i for i in ends if i not in ratios]
        twists = mp.matrix(len(shafts), len(own))
        for row, i in enumerate(shafts):
            for column in range(len(own)):
                twists[row, column] = turns[ends[i], column] - turns[i, column]
        mass = turns.T * mp.diag([mp.mpf(float(J)) for J in inertia]) * turns
        whole = twists.T * mp.diag([mp.mpf(float(stiffness[i])) for i in shafts]) * twists
        inverse = mp.inverse(mp.cholesky(mass))
        squares = mp.eigsy(inverse * whole * inverse.T, eigvals_only=True)
        return np.sqrt(np.maximum(np.array([float(value) for value in squares]), 0)) / (2 * np.pi)


@pytest.mark.parametrize("seed", range(10))
def test_modes_over_fourteen_decades_of_stiffness_in_geared_trees(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(4, 20))
    ends = {i: int(rng.integers(0, i)) for i in range(1, count)}
    ratios = {i: float(10 ** rng.uniform(-1, 1)) for i in ends if rng.random() < 0.2}
    J, k = 10 ** rng.uniform(-5, 2, count), 10 ** rng.uniform(-4, 10, count)
    between = {i: [f"i{end}", f"i{i}"] for i, end in ends.items()}
    found = modes(from_dict({
        "inertias": {f"i{i}": {"J": float(value)} for i, value in enumerate(J)},
        "gears": {f"g{i}": {"between": between[i], "ratio": ratio} for i, ratio in ratios.items()},
        "shafts": {f"s{i}": {"between": between[i], "stiffness": float(k[i]), "damping": 0.0}
                   for i in ends if i not in ratios},
    }))  # fmt: skip
    expected = digits(J, ends, k, ratios)
    np.testing.assert_allclose(found.frequencies[1:], expected[1:], rtol=1e-7)
    assert found.frequencies[0] == 0


def test_damped_modes_over_many_decades():
    """Against eigenvalues with 50 digits, in twists and speeds."""
    for seed in range(8):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(3, 7))
        J, k = 10 ** rng.uniform(-5, 2, n), 10 ** rng.uniform(-4, 10, n - 1)
        d = rng.choice([0, 2e-3, 0.04, 0.6], n - 1) * np.sqrt(k * J[1:] * J[:-1] / (J[1:] + J[:-1]))
        found = damped_modes_of(linearise(chain(J, k, d))).eigenvalues[1:]
        with mp.workdps(50):
            J, k, d = (mp.diag([mp.mpf(float(value)) for value in values]) for values in (J, k, d))
            twist = mp.matrix((np.eye(n)[:-1] - np.eye(n)[1:]).tolist())
            rates = mp.zeros(2 * n - 1)
            rates[: n - 1, n - 1 :] = twist
            rates[n - 1 :, : n - 1] = -(J**-1) * twist.T * k
            rates[n - 1 :, n - 1 :] = -(J**-1) * twist.T * d * twist
            expected = sorted((complex(value) for value in mp.eig(rates, right=False)), key=abs)[1:]
        apart = [np.abs(found - complex(value.real, abs(value.imag))).min() / abs(value) for value in expected]
        assert max(apart) < 1e-7


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
