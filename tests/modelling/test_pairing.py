"""Which mode is which: pairs against modes that the test makes itself, in drawn orders."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from modelling.modal.pairing import counterparts, followed, pairs, same_hardware, weighted_mac
from modelling.model_file import from_dict


@dataclass
class Shape:
    frequency: float
    shape: dict[str, complex] = field(default_factory=dict)


@pytest.mark.parametrize("seed", range(5))
def test_two_close_modes_are_never_taken_for_one(seed):
    """Both move towards each other, until one is nearer to the other's planned value than its own successor."""
    random = np.random.default_rng(seed)
    planned = 2j * np.pi * np.array([9.23, 9.49, 30.0]) * (1 + 0.04j)
    moved = planned * np.array([1.025, 1.005, 0.97])  # 9.46 and 9.54: both nearer to 9.49
    found = random.permutation(np.concatenate([moved, moved.conj(), [-3.0]]))
    np.testing.assert_allclose(followed(planned, found), moved)
    nearest = [moved[np.abs(np.log(moved / one)).argmin()] for one in planned]
    assert nearest[0] == nearest[1]  # what the nearest one would have said


def test_a_mode_that_is_gone_is_no_number():
    became = followed(2j * np.pi * np.array([5.0, 9.0]), 2j * np.pi * np.array([9.1]))
    assert np.isnan(became[0])
    assert became[1] == 2j * np.pi * 9.1


def test_pairs_have_the_largest_sum_and_none_below_the_least():
    score = np.array([[0.9, 0.8], [0.85, 0.1]])  # row by row, the first would take what the second needs
    assert sorted(pairs(score)) == [(0, 1), (1, 0)]
    assert list(pairs(np.array([[0.2, 0.0]]), least=0.3)) == []


def test_a_light_member_counts_as_much_as_its_inertia():
    heavy, light = Shape(1.0, {"a": 1.0, "b": 0.1}), Shape(1.0, {"a": -1.0, "b": 5.0})
    alike = weighted_mac([heavy], [light], {"a": 1.0, "b": 1e-6})[0, 0]
    assert alike == pytest.approx(1.0, abs=1e-4)
    assert weighted_mac([heavy], [light], {})[0, 0] < 0.1
    assert weighted_mac([heavy], [Shape(1.0, {"c": 1.0})], {}).tolist() == [[0.0]]


def chain(inertias, shafts):
    """Inertias by name, and shafts by name with their stiffness, in a row."""
    names = list(inertias)
    return from_dict({
        "inertias": {name: {"J": J} for name, J in inertias.items()},
        "shafts": {name: {"between": [a, b], "stiffness": k}
                   for a, b, (name, k) in zip(names[:-1], names[1:], shafts.items(), strict=True)},
    })  # fmt: skip


@pytest.mark.parametrize("seed", range(8))
def test_the_mode_of_the_bed_that_twists_the_shared_shaft(seed):
    """Motor and soft side shaft are shared; a light flange behind it has a fast mode of its own, by closed forms.

    The lower elastic mode of the bed is that of motor and rotor on side shaft and flange in series, nearly; the other
    one is the flange's.
    """
    random = np.random.default_rng(seed)
    motor, body, rotor = random.uniform([0.03, 60.0, 0.5], [0.3, 150.0, 2.0])
    flange, soft, stiff = random.uniform(0.005, 0.02), random.uniform(4e3, 9e3), random.uniform(2e5, 8e5)
    vehicle = chain({"motor": motor, "hub": 1.0, "body": body}, {"side": soft, "tyre": 4e4})
    bed = chain({"motor": motor, "flange": flange, "rotor": rotor}, {"side": soft, "adapter": stiff})
    _, modes, alike = same_hardware(vehicle, bed)
    elastic = [one for one in modes if one.frequency > 0]
    series = 1 / (1 / soft + 1 / stiff)
    shuffle = np.sqrt(series * (1 / motor + 1 / rotor)) / (2 * np.pi)
    assert elastic[0].frequency == pytest.approx(shuffle, rel=0.1)
    assert 0 <= alike.min() <= alike.max() <= 1
    found = counterparts(vehicle, bed, [2])
    assert found[2].frequency == elastic[0].frequency
    # the elastic modes of the bed share what the vehicle's mode does to the parts that both have
    assert alike[1].sum() <= 1 + 1e-9


def test_systems_that_share_nothing_have_no_counterparts():
    one, other = chain({"a": 1.0, "b": 2.0}, {"first": 50.0}), chain({"c": 1.0, "d": 2.0}, {"second": 50.0})
    assert counterparts(one, other, [2]) == {}
