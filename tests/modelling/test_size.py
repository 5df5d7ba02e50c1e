"""Models of many inertias: what is stored grows with the model, not its square, and the sparse way gives the same."""

import numpy as np
import pytest
from small_drives import chain

from modelling.equations.casadi_code import compiled
from modelling.equations.lagrange import derive
from modelling.errors import InputError
from modelling.linear.elements import sparse_elements
from modelling.linear.linearise import linearise
from modelling.modal.modes import lowest, modes
from modelling.model_file import from_dict
from modelling.system import MOST_COMPONENTS


def even_chain(count):
    """1 kg·m² each, on shafts of 1 N·m/rad."""
    return chain([1.0] * count, [1.0] * (count - 1))


def gear_train(count):
    """Gears of ratio 2 and 1/2 in turn, the last wheel on a shaft to a disc."""
    parts = {f"i{i}": {"J": 1.0} for i in range(count + 1)} | {"disc": {"J": 1.0}}
    gears = {f"g{i}": {"between": [f"i{i}", f"i{i + 1}"], "ratio": 2.0 if i % 2 else 0.5} for i in range(count)}
    shafts = {"s": {"between": [f"i{count}", "disc"], "stiffness": 100.0}}
    return from_dict({"inertias": parts, "gears": gears, "shafts": shafts})


@pytest.fixture
def few(monkeypatch):
    """The way of large models from 41 degrees of freedom on, with 20 modes: a small one costs less."""
    monkeypatch.setattr("modelling.modal.modes.LARGEST_WITH_ALL_MODES", 40)
    monkeypatch.setattr("modelling.modal.modes.LOWEST_MODES", 20)


def test_a_long_chain_against_the_closed_form(few):
    """n equal discs and springs, both ends free: ω = 2·sin(kπ/2n), k = 0 … (Dresig and Holzweissig)."""
    n = 90
    found = modes(even_chain(n))
    assert len(found) == 20
    exact = 2 * np.sin(np.arange(20) * np.pi / (2 * n)) / (2 * np.pi)
    np.testing.assert_allclose(found.frequencies, exact, rtol=1e-9, atol=0)
    assert found.frequencies[0] == 0.0
    shape = np.cos(np.pi * 7 * (np.arange(n) + 0.5) / n)
    np.testing.assert_allclose(np.abs(found.mass_amplitudes[:, 7]), np.abs(shape / np.abs(shape).max()), atol=1e-7)
    np.testing.assert_allclose(found.kinetic.sum(axis=1), 1.0)


def test_the_sparse_way_gives_the_modes_of_the_dense_way():
    """A train with gears, a differential and a torsionally stiff branch."""
    data = {
        "inertias": {name: {"J": J} for name, J in zip("abcdefgh", (1, 2, 0.3, 0.7, 0.8, 4, 5, 0.01), strict=True)},
        "gears": {"g": {"between": ["a", "b"], "ratio": 3.0}},
        "differentials": {"d": {"cage": "c", "left": "d", "right": "e"}},
        "shafts": {
            "bc": {"between": ["b", "c"], "stiffness": 1e4},
            "df": {"between": ["d", "f"], "stiffness": 2e3},
            "eg": {"between": ["e", "g"], "stiffness": 2.5e3},
            "ah": {"between": ["a", "h"], "stiffness": 1e6},
        },
        "effects": [{"kind": "backlash", "at": "shafts.bc", "gap": 0.02}],
    }  # fmt: skip
    system = from_dict(data)
    dense = modes(system)
    model = compiled(system)
    squares, shapes = lowest(sparse_elements(model, model.vector()), 3)
    np.testing.assert_allclose(np.sqrt(np.abs(squares[0])) / (2 * np.pi), dense.frequencies[:3], rtol=1e-9, atol=1e-4)
    scaled = shapes[0, :, 2] / shapes[0, np.abs(shapes[0, :, 2]).argmax(), 2]
    np.testing.assert_allclose(scaled, dense.shapes[:, 2], atol=1e-6)


def test_modes_repeated_more_often_than_iterations_can_tell_are_all_found(few):
    """A hub with n equal branches: n − 1 of its modes are equal, and two others are those of a chain of two."""
    n = 60
    parts = {"hub": {"J": 1.0}} | {f"b{i}": {"J": 1.0} for i in range(n)}
    shafts = {f"s{i}": {"between": ["hub", f"b{i}"], "stiffness": 1.0} for i in range(n)}
    found = modes(from_dict({"inertias": parts, "shafts": shafts}))
    assert len(found) == 20
    np.testing.assert_allclose(found.frequencies[1:], 1 / (2 * np.pi), rtol=1e-9)


def test_a_long_gear_train_moves_as_its_ratios_say():
    """All wheels move as one: J = Σ J·i², alternately 1 and 1/4 of the last wheel's inertia."""
    count = 60
    found = modes(gear_train(count))
    reduced = 31 * 1.0 + 30 * 4.0  # wheels 0, 2, … turn as fast as the last one, 60; those between twice as fast
    expected = np.sqrt(100.0 * (1 / reduced + 1.0)) / (2 * np.pi)
    assert found.frequencies[1] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("closing", [1.0, 3.0])
def test_a_long_loop_of_gears_that_closes_is_said_to_repeat_and_another_to_lock(closing):
    count = 60
    data = {
        "inertias": {f"i{i}": {"J": 1.0} for i in range(count + 1)},
        "gears": {f"g{i}": {"between": [f"i{i}", f"i{i + 1}"], "ratio": 2.0 if i % 2 else 0.5} for i in range(count)}
        | {"closing": {"between": ["i0", f"i{count}"], "ratio": closing}},
    }
    with pytest.raises(InputError, match="says again" if closing == 1.0 else "locks the drivetrain"):
        derive(from_dict(data))


def test_matrices_hold_only_what_is_not_zero():
    model = compiled(even_chain(60))
    assert model.elements.nnz_out(1) == 60
    assert model.elements.nnz_out(3) == 2 * 59
    assert model.mass.nnz_out(0) == 60
    parts = sparse_elements(model, model.vector())
    assert parts.stiffness_matrix().nnz == 60 + 2 * 59


def test_dense_calculations_state_their_limit(monkeypatch):
    monkeypatch.setattr("modelling.linear.elements.LARGEST_DENSE", 5)
    linearise(even_chain(5))
    with pytest.raises(InputError, match=r"6 degrees of freedom.*at most 5"):
        linearise(even_chain(6))


def test_a_model_of_too_many_components_is_one_line():
    with pytest.raises(InputError, match=f"at most {MOST_COMPONENTS}"):
        even_chain(MOST_COMPONENTS // 2 + 2)
