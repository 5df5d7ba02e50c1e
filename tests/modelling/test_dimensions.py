"""Shafts by dimensions and gears by efficiency, against integrals over the cross-section and waves in a shaft."""

import itertools
import tomllib

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from modelling.effects.effect import Kind
from modelling.errors import InputError
from modelling.modal.modes import modes
from modelling.model_file import dumps, from_dict

GPA = 1e9


def model(shaft, J=(0.1, 0.4), **more):
    inertias = {"a": {"J": J[0]}, "b": {"J": J[1]}}
    return {"inertias": inertias, "shafts": {"s": {"between": ["a", "b"], **shaft}}, **more}


@pytest.mark.parametrize("seed", range(6))
def test_stiffness_inertia_and_their_ranges(seed):
    """Over every corner of the dimensions' ranges, area integrals at each."""
    rng = np.random.default_rng(seed)
    middle = {
        "length": rng.uniform(0.1, 2), "diameter": rng.uniform(0.02, 0.08), "shear_modulus": rng.uniform(20, 85) * GPA,
        "density": rng.uniform(1500, 8000),
    }  # fmt: skip
    middle["inner_diameter"] = rng.choice([0.0, 0.6]) * middle["diameter"]
    tolerance = {key: rng.choice([0.0, 0.02]) for key in middle}
    shaft = {key: {"value": value, "tolerance": tolerance[key]} for key, value in middle.items()}
    system = from_dict(model(shaft))

    def at(size):
        polar, _ = quad(lambda r: 2 * np.pi * r**3, size["inner_diameter"] / 2, size["diameter"] / 2, epsrel=1e-12)
        return size["shear_modulus"] * polar / size["length"], size["density"] * size["length"] * polar

    corners = [
        at({key: value * (1 + sign * tolerance[key]) for (key, value), sign in zip(middle.items(), signs, strict=True)})
        for signs in itertools.product((-1, 1), repeat=len(middle))
    ]
    (stiffness, inertia), (all_k, all_J) = at(middle), np.array(corners).T
    k, J = system.parameters["shafts.s.stiffness"], system.parameters["inertias.a.J"]
    assert k.value == pytest.approx(stiffness, rel=1e-9)
    assert J.value == pytest.approx(0.1 + inertia / 2, rel=1e-9)
    if any(tolerance.values()):
        assert (k.lower, k.upper) == pytest.approx((all_k.min(), all_k.max()), rel=1e-9)
        assert (J.lower, J.upper) == pytest.approx((0.1 + all_J.min() / 2, 0.1 + all_J.max() / 2), rel=1e-9)
    assert from_dict(tomllib.loads(dumps(system))) == system


@pytest.mark.parametrize(("parts", "largest"), [(1, 3e-2), (8, 1e-3)])
def test_frequency_comes_to_that_of_a_continuous_shaft(parts, largest):
    """Free shaft with discs at both ends, by its transcendental equation; the error falls with the square of parts."""
    length, diameter = 1.2, 0.05
    polar = np.pi / 32 * diameter**4
    J, speed = 7850 * length * polar, np.sqrt(79.3 * GPA / 7850)
    first, second = 5.0, 9.0  # times the inertia of the shaft

    def balance(x):  # x = frequency · length / speed of the wave
        return (first + second) * x * np.cos(x) + (1 - first * second * x**2) * np.sin(x)

    exact = brentq(balance, 0.05, 1.0) * speed / length / 2 / np.pi
    ends = {"a": {"J": first * J}, "b": {"J": second * J}}
    names = ["a", *(f"n{i}" for i in range(1, parts)), "b"]
    data = {
        "inertias": {name: ends.get(name, {"J": 1e-9}) for name in names},
        "shafts": {
            f"s{i}": {"between": list(pair), "length": length / parts, "diameter": "50 mm"}
            for i, pair in enumerate(itertools.pairwise(names))
        },
    }
    found = modes(from_dict(data)).frequencies[1]
    assert found == pytest.approx(exact, rel=largest)


def test_an_efficiency_is_the_effect():
    gears = {"g": {"between": ["b", "c"], "ratio": 3, "efficiency": 0.95}}
    data = model({"stiffness": 500.0}, gears=gears)
    data["inertias"]["c"] = {"J": 2.0}
    (loss,) = from_dict(data).effects
    assert isinstance(loss.law, Kind)
    assert (loss.kind, loss.at, loss.parameters[0][1].value) == ("gear_loss", "gears.g", 0.95)
    data["effects"] = [{"kind": "gear_loss", "at": "gears.g", "efficiency": 0.9}]
    with pytest.raises(InputError, match=r"gears.g.efficiency: is stated by an effect"):
        from_dict(data)


@pytest.mark.parametrize(
    ("shaft", "said"),
    [
        ({"length": 1, "diameter": 0.03, "stiffness": 5}, "stiffness: contradicts the shaft's dimensions"),
        ({"length": 1, "diameter": 0.03, "ratio": 5}, "ratio: contradicts"),
        ({"length": 1}, "'diameter' is missing"),
        ({"length": 0, "diameter": 0.03}, "length: 0 is not possible"),
        ({"length": 1, "diameter": 0.03, "inner_diameter": 0.03}, "inner_diameter: is not smaller"),
        ({"length": "1 kg", "diameter": 0.03}, "length"),
    ],
)
def test_impossible_dimensions(shaft, said):
    with pytest.raises(InputError, match=said):
        from_dict(model(shaft))
