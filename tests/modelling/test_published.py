"""Natural frequencies printed in Friswell, Penny, Garvey, Lees: Dynamics of Rotating Machines (2010), chapter 9.

The same values stand in the tests of openTorsion. They are compared to the digits printed.
"""

import math
from itertools import pairwise

import pytest
from scipy.optimize import brentq

import rigmatch as rm
from modelling.model_file import from_dict


def frequencies(model):
    return [mode.frequency for mode in rm.modes(from_dict(model)) if mode.frequency > 1e-3]


def test_a_compressor_with_three_stages():
    """Example 9.7.1: five discs on four shafts."""
    J, stiffness = (3.5e-3, 3.5e-3, 3.5e-3, 0.15, 0.05), (12e3, 12e3, 14e3, 10e3)
    shafts = dict(enumerate(zip(pairwise("abcde"), stiffness, strict=True)))
    model = {
        "inertias": {name: {"J": each} for name, each in zip("abcde", J, strict=True)},
        "shafts": {f"s{i}": {"between": list(ends), "stiffness": own} for i, (ends, own) in shafts.items()},
    }
    assert frequencies(model) == pytest.approx([81.21, 141.21, 378.95, 536.36], abs=0.005)


def test_two_geared_shafts():
    """Two shafts in mesh one to one, with small gears: the highest frequency is that of the gears."""
    model = {
        "inertias": {"motor": {"J": 400e-6}, "first": {"J": 25e-6}, "second": {"J": 25e-6}, "left": {"J": 700e-6},
                     "right": {"J": 700e-6}},
        "gears": {"mesh": {"between": ["first", "second"], "ratio": -1}},
        "shafts": {"drive": {"between": ["motor", "first"], "stiffness": 10e3},
                   "one": {"between": ["second", "left"], "stiffness": 5e3},
                   "other": {"between": ["first", "right"], "stiffness": 5e3}},
    }  # fmt: skip
    assert frequencies(model) == pytest.approx([425.4, 634.1, 3247.2], abs=0.05)


def test_a_turbine_that_drives_two_propellers_by_shafts_of_their_drawing():
    """Example 9.6.3: two gears of 0.5 m in mesh, each with one of 0.8 m; shafts stated by their dimensions."""
    driven = {"length": 3.5, "diameter": 0.25, "shear_modulus": 68e9, "density": 0}
    model = {
        "inertias": {"turbine": {"J": 3200}, "gear_1": {"J": 200}, "gear_2": {"J": 200}, "gear_3": {"J": 800},
                     "gear_4": {"J": 800}, "propeller_1": {"J": 450}, "propeller_2": {"J": 450}},
        "gears": {"mesh": {"between": ["gear_1", "gear_2"], "ratio": -1},
                  "left": {"between": ["gear_1", "gear_3"], "ratio": -0.8 / 0.5},
                  "right": {"between": ["gear_2", "gear_4"], "ratio": -0.8 / 0.5}},
        "shafts": {"input": {"between": ["turbine", "gear_1"], "length": 2.5, "diameter": 0.2, "shear_modulus": 68e9,
                             "density": 0},
                   "output_1": {"between": ["gear_3", "propeller_1"], **driven},
                   "output_2": {"between": ["gear_4", "propeller_2"], **driven}},
    }  # fmt: skip
    assert frequencies(model) == pytest.approx([10.304, 20.479, 24.423], abs=5e-4)


def test_a_drill_string_in_pieces_of_its_drawing():
    """Example 9.9: a tube of 800 m with two discs, in 50 pieces; the exact frequencies are those of a continuous rod.

    Half of a piece's inertia at each end errs by −(π·n/pieces)²/24 in mode n, the book's finite elements by as much up.
    """
    pieces, discs, G, density = 50, (200.0, 10.0), 75e9, 8000.0
    piece = {"length": 800 / pieces, "diameter": 0.78, "inner_diameter": 0.65, "shear_modulus": G, "density": density}
    model = {
        "inertias": {f"n{i}": {"J": discs[bool(i)] if i % pieces == 0 else 1e-6} for i in range(pieces + 1)},
        "shafts": {f"s{i}": {"between": [f"n{i}", f"n{i + 1}"], **piece} for i in range(pieces)},
    }
    stiff = G * math.pi * (0.78**4 - 0.65**4) / 32

    def end_torque(hertz):
        omega = 2 * math.pi * hertz
        k = omega * math.sqrt(density / G)
        B = -(omega**2) * discs[0] / (stiff * k)
        turned = math.cos(800 * k) + B * math.sin(800 * k)
        return stiff * k * (B * math.cos(800 * k) - math.sin(800 * k)) - omega**2 * discs[1] * turned

    for n, (found, printed) in enumerate(zip(frequencies(model)[:4], (1.9106, 3.8232, 5.7394, 7.6613), strict=True), 1):
        exact = brentq(end_torque, 0.98 * printed, 1.02 * printed)
        error = (math.pi * n / pieces) ** 2 / 24
        assert found == pytest.approx(exact * (1 - error), rel=0.05 * error)
        assert printed == pytest.approx(exact * (1 + error), rel=0.05 * error + 3e-5)
