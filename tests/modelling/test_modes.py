"""Modes against closed forms, independent eigenvalue solutions and the published figures."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from small_drives import chain

from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.modal.modes import damped_modes, modes, modes_batch, reduced, reduced_values, speed_ratios
from modelling.modal.pairing import mac
from modelling.modal.sensitivity import sensitivities, track, what_if
from modelling.model_file import from_dict, load

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig"
VEHICLE, RIG = load(CASE / "vehicle.toml"), load(CASE / "rig.toml")


RIGID_TYRES = dataclasses.replace(VEHICLE, effects=())  # no slip: every spring twists with the angles


BRANCHED = from_dict(
    {
        "inertias": {"hub": {"J": 0.2}, "left": {"J": 1.3}, "right": {"J": 1.3}},
        "shafts": {
            "l": {"between": ["hub", "left"], "stiffness": 900.0},
            "r": {"between": ["hub", "right"], "stiffness": 900.0},
        },
        "mirror": {"pairs": [["left", "right"]]},
    }
)
DIFFERENTIAL = from_dict(
    {
        "inertias": {
            "motor": {"J": 0.05}, "cage": {"J": 0.1}, "gl": {"J": 0.01}, "gr": {"J": 0.01},
            "wl": {"J": 1.0}, "wr": {"J": 1.0}, "body": {"J": 150.0},
        },
        "gears": {"reduction": {"between": ["motor", "cage"], "ratio": 9.0}},
        "differentials": {"open": {"cage": "cage", "left": "gl", "right": "gr"}},
        "shafts": {
            "sl": {"between": ["gl", "wl"], "stiffness": 9e3, "damping": 3.0},
            "sr": {"between": ["gr", "wr"], "stiffness": 9e3, "damping": 3.0},
            "tl": {"between": ["wl", "body"], "stiffness": 1.2e4, "damping": 50.0},
            "tr": {"between": ["wr", "body"], "stiffness": 1.2e4, "damping": 50.0},
        },
        "mirror": {"pairs": [["wl", "wr"], ["gl", "gr"]]},
        "reference": "motor",
    }
)  # fmt: skip


def test_two_masses_closed_form():
    found = modes(chain([0.1, 0.7], [350.0]))
    assert found.frequencies[0] == 0.0
    np.testing.assert_allclose(found.frequencies[1], np.sqrt(350.0 * (1 / 0.1 + 1 / 0.7)) / (2 * np.pi), rtol=1e-12)
    np.testing.assert_allclose(found.kinetic[1], [0.7 / 0.8, 0.1 / 0.8], rtol=1e-12)  # as the other's inertia
    np.testing.assert_allclose(found.potential[1], [1.0])
    np.testing.assert_allclose(found.potential[0], [0.0])


@pytest.mark.parametrize("system", [RIGID_TYRES, RIG, BRANCHED, DIFFERENTIAL, chain([1, 2, 3, 4], [10, 20, 30])])
def test_against_scipy_on_the_compiled_equations(system):
    model = compiled(system)
    undamped = {name: 0.0 for name in model.parameters if name.endswith(("damping", "drag"))}
    p, x = model.vector(undamped), np.zeros(len(model.states))
    mass = model.mass(p).full()
    stiffness = -mass @ model.jacobians(x, np.zeros(len(model.inputs)), p, 0)[0].full()[model.n :, : model.n]
    squares = scipy.linalg.eigh((stiffness + stiffness.T) / 2, mass, eigvals_only=True)
    found = modes(system)
    elastic = found.frequencies > 0
    np.testing.assert_allclose((2 * np.pi * found.frequencies[elastic]) ** 2, squares[elastic], rtol=1e-9)
    shapes = found.shapes
    np.testing.assert_allclose(np.diag(shapes.T @ mass @ shapes), found.modal_mass, rtol=1e-9)
    np.testing.assert_allclose(
        np.diag(shapes.T @ stiffness @ shapes)[elastic], found.modal_stiffness[elastic], rtol=1e-8
    )
    off = shapes.T @ mass @ shapes / np.sqrt(np.outer(found.modal_mass, found.modal_mass))
    np.testing.assert_allclose(off, np.eye(len(found)), atol=1e-9)
    np.testing.assert_allclose(np.abs(shapes).max(axis=0), 1.0)


def test_published_modal_figures():
    vehicle, rig = modes(VEHICLE), modes(RIG)
    assert [mode.symmetry[0] for mode in vehicle] == list("sassassas")
    assert [mode.symmetry[0] for mode in rig] == list("sasssas")
    shuffle, felt, gearbox = vehicle[1], vehicle[2], vehicle[5]

    def share(energy, *names):
        return sum(value for name, value in energy.items() if name.split(".")[1].rsplit("_", 1)[0] in names)

    assert share(shuffle.kinetic, "wheel", "tyre", "body") > 0.99
    assert share(shuffle.potential, "side") > 0.8
    assert felt.kinetic["inertias.motor"] == pytest.approx(0.82, abs=0.005)
    assert gearbox.kinetic["inertias.gearbox"] > 0.8
    assert rig[3].kinetic["inertias.gearbox"] > 0.8
    assert share(rig[1].kinetic, "rotor") > 0.9
    assert share(rig[1].potential, "side") > 0.9


@pytest.mark.parametrize("system", [VEHICLE, RIG, DIFFERENTIAL])
def test_shares_are_the_relative_sensitivities(system):
    """Eqs. 6–8: p/f·∂f/∂p is half the potential share of a stiffness and minus half the kinetic share of an inertia."""
    found = sensitivities(system)
    elastic = found.modes.frequencies > 0
    for i, name in enumerate(found.names):
        place, _, key = name.rpartition(".")
        if key == "stiffness":
            share = found.modes.potential[elastic, found.modes.springs.index(place)] / 2
        elif key == "J":
            share = -found.modes.kinetic[elastic, found.modes.masses.index(place)] / 2
        else:
            continue
        np.testing.assert_allclose(found.relative[elastic, i], share, atol=1e-12)


@pytest.mark.parametrize("system", [VEHICLE, RIG, DIFFERENTIAL])
def test_sensitivities_by_finite_differences(system):
    found, model = sensitivities(system), compiled(system)
    for name, value in zip(model.parameters, model.p0):
        h = 3e-5 * max(abs(value), 1e-3)
        up, down = (modes(system, {name: value + side * h}) for side in (1, -1))
        # near neighbours (124.745/124.746 Hz) mix when one side changes: compare the sum over such a pair
        numeric = (up.frequencies - down.frequencies) / (2 * h)
        groups = np.cumsum(np.diff(found.modes.frequencies, prepend=-1) > 0.01)
        for group in np.unique(groups):
            own = groups == group
            scale = found.modes.frequencies[own].max() / max(abs(value), 1e-3)
            expected = found.gradients[own, found.names.index(name)].sum()
            assert numeric[own].sum() == pytest.approx(expected, rel=2e-5, abs=2e-7 * scale)


def test_eq_8_stands_beside_the_exact_solution():
    """Facts: J_R doubled, exact −29 %, Eq. 8 −50 %; ×109, −90 % against −5400 % (a rotor that held all the energy)."""
    for factor, exact, predicted in ((2, -0.284, -0.476), (109, -0.90, -51.4)):
        rows = what_if(RIG, {f"inertias.rotor_{side}.J": 0.895 * factor for side in ("left", "right")})
        assert rows[1].exact_change == pytest.approx(exact, abs=0.005)
        assert rows[1].predicted_change == pytest.approx(predicted, abs=0.05)
        share = sum(modes(RIG)[1].kinetic[f"inertias.rotor_{side}"] for side in ("left", "right"))
        assert rows[1].predicted_change == pytest.approx(-share * (factor - 1) / 2, rel=1e-9)
        fresh = modes(RIG, {f"inertias.rotor_{side}.J": 0.895 * factor for side in ("left", "right")})
        assert rows[1].exact == pytest.approx(fresh.frequencies[rows[1].number_after - 1])
    small = what_if(RIG, {"shafts.side_left.stiffness": 1.092e4 * 1.001})
    for row in small:
        assert row.exact_change == pytest.approx(row.predicted_change, abs=2e-6)


def test_repeated_modes_are_split_by_symmetry():
    system = from_dict(
        {
            "inertias": {"ground": {"J": 1e9}, "left": {"J": 1.0}, "right": {"J": 1.0}},
            "shafts": {
                "l": {"between": ["left", "ground"], "stiffness": 50.0},
                "r": {"between": ["right", "ground"], "stiffness": 50.0},
            },
            "mirror": {"pairs": [["left", "right"]]},
        }
    )
    found = modes(system)
    assert sorted(found.symmetries[1:]) == ["antisymmetric", "symmetric"]
    np.testing.assert_allclose(found.kinetic[1:, 1:], 0.5, atol=1e-6)
    two_rigid = modes(DIFFERENTIAL, {"shafts.tl.stiffness": 0.0, "shafts.tr.stiffness": 0.0})
    assert list(two_rigid.frequencies[:3]) == [0.0, 0.0, 0.0]
    assert {"symmetric", "antisymmetric"} <= set(two_rigid.symmetries[:3])


def test_symmetry_needs_the_mirror_and_a_clear_shape():
    assert set(modes(chain([1, 2, 1], [5, 5])).symmetries) == {"none"}
    lopsided = modes(VEHICLE, {"inertias.tyre_left.J": 0.6})
    assert lopsided[6].symmetry == lopsided[7].symmetry == "none"  # each tyre for itself
    assert lopsided[1].symmetry == "antisymmetric"


def test_rigid_modes_are_exactly_zero_at_any_scale():
    for scale in (1e-6, 1.0, 1e6):
        found = modes(chain([scale, 2 * scale, 1e3 * scale], [1e-3 * scale, 1e6 * scale]))
        assert found.frequencies[0] == 0.0
        assert np.all(found.frequencies[1:] > 0)


def test_batch_equals_one_by_one():
    rng = np.random.default_rng(3)
    names = ["inertias.motor.J", "shafts.side_left.stiffness", "shafts.gear_output.ratio", "inertias.rotor_right.J"]
    start = np.array([RIG.parameters[name].value for name in names])
    values = start * rng.uniform(0.7, 1.3, (20, 4))
    batch = modes_batch(RIG, values, names)
    for i in range(len(values)):
        one = modes(RIG, dict(zip(names, values[i])))
        np.testing.assert_allclose(batch.frequencies[i], one.frequencies, rtol=1e-10)
        np.testing.assert_allclose(batch.kinetic[i], one.kinetic, atol=1e-8)
        np.testing.assert_allclose(batch.potential[i], one.potential, atol=1e-8)
    assert batch.kinetic.shape == (20, 7, 7)
    np.testing.assert_allclose(batch.potential[:, 1:].sum(axis=2), 1.0)


def test_bad_values():
    with pytest.raises(InputError, match=r"side_lefd.*did you mean"):
        modes(VEHICLE, {"shafts.side_lefd.stiffness": 1.0})
    with pytest.raises(InputError, match="not finite"):
        modes(VEHICLE, {"shafts.side_left.stiffness": np.nan})
    with pytest.raises(InputError, match="motor is not positive"):
        modes(VEHICLE, {"inertias.motor.J": 0.0})
    with pytest.raises(InputError, match="negative"):
        modes(VEHICLE, {"shafts.side_left.stiffness": -1e4})
    with pytest.raises(InputError, match="does not fit"):
        modes_batch(VEHICLE, np.zeros((3, 2)), ["inertias.motor.J"])


def test_mac_is_normalised_and_knows_orthogonal_modes():
    found, mass = modes(VEHICLE), compiled(VEHICLE).mass(compiled(VEHICLE).p0).full()
    score = mac(found.shapes * np.arange(1, 10), -3 * found.shapes, mass)
    np.testing.assert_allclose(score, np.eye(9), atol=1e-12)


def test_tracking_follows_shapes_through_a_crossing():
    """Two oscillators that share nothing but a huge body: making one stiffer takes it past the other."""
    system = chain([1.0, 1e6, 1.0], [100.0, 144.0])
    stiffness = np.linspace(100.0, 200.0, 60)
    followed = track(system, [{"shafts.s0.stiffness": k} for k in stiffness])
    np.testing.assert_allclose(followed.frequencies[:, 1], np.sqrt(stiffness) / (2 * np.pi), rtol=1e-4)
    np.testing.assert_allclose(followed.frequencies[:, 2], 12.0 / (2 * np.pi), rtol=1e-4)
    assert list(followed.order[-1]) == [0, 2, 1]


def test_damped_two_masses_closed_form():
    Ja, Jb, k, d = 0.1, 0.7, 350.0, 1.5
    found = damped_modes(chain([Ja, Jb], [k], [d]))
    inverse = 1 / Ja + 1 / Jb
    omega = np.sqrt(k * inverse)
    assert len(found) == 2
    assert found.frequencies[0] == 0.0
    assert found.frequencies[1] == pytest.approx(omega / (2 * np.pi), rel=1e-12)
    assert found.damping_ratios[1] == pytest.approx(d * inverse / (2 * omega), rel=1e-10)
    np.testing.assert_allclose(found.kinetic[1], [0.7 / 0.8, 0.1 / 0.8], rtol=1e-9)
    mass, stiffness = modes(chain([Ja, Jb], [k])).modal_mass, modes(chain([Ja, Jb], [k])).modal_stiffness
    np.testing.assert_allclose(found.modal_mass[1], mass[1], rtol=1e-9)
    np.testing.assert_allclose(found.modal_stiffness[1], stiffness[1], rtol=1e-9)


def test_overdamped_modes_are_real():
    Ja, Jb, k, d = 0.1, 0.7, 350.0, 50.0
    found = damped_modes(chain([Ja, Jb], [k], [d]))
    inverse = 1 / Ja + 1 / Jb
    poles = np.sort(np.roots([1, d * inverse, k * inverse]))[::-1]
    np.testing.assert_allclose(found.eigenvalues[1:], poles, rtol=1e-9)
    np.testing.assert_allclose(found.damping_ratios[1:], 1.0)
    np.testing.assert_allclose(found.frequencies[1:], np.abs(poles) / (2 * np.pi), rtol=1e-9)


def test_drag_and_rigid_mode():
    system = from_dict({"inertias": {"a": {"J": 2.0, "drag": 0.5}}})
    found = damped_modes(system)
    assert found.to_dict()["modes"][0]["frequency"] == 0.0
    assert found.eigenvalues[0] == pytest.approx(-0.25)


def test_slip_is_rigid_undamped_and_included_damped():
    """Maxwell element between two masses: s³ + (c/d)·s² + c/J·s + 0 … against its characteristic polynomial."""
    Ja, Jb, k, series = 0.3, 0.9, 200.0, 12.0
    system = chain([Ja, Jb], [k], effects=[{"kind": "slip", "at": "shafts.s0", "coefficient": series}])
    inverse = 1 / Ja + 1 / Jb
    assert modes(system).frequencies[1] == pytest.approx(np.sqrt(k * inverse) / (2 * np.pi))
    poles = np.roots([1, k / series, k * inverse])
    found = damped_modes(system)
    oscillating = found.eigenvalues[found.eigenvalues.imag > 0]
    np.testing.assert_allclose(oscillating, poles[poles.imag > 0], rtol=1e-9)


def test_nonlinear_springs_are_tangent():
    system = chain([0.3, 0.9], [200.0], effects=[{"kind": "hardening", "at": "shafts.s0", "cubic": 1e3}])
    inverse = 1 / 0.3 + 1 / 0.9
    state = np.array([0.2, -0.1, 0.0, 0.0])
    tangent = 200.0 + 3 * 1e3 * 0.3**2
    assert modes(system, state=state).frequencies[1] == pytest.approx(np.sqrt(tangent * inverse) / (2 * np.pi))
    assert damped_modes(system, state=state).frequencies[1] == pytest.approx(np.sqrt(tangent * inverse) / (2 * np.pi))
    assert modes(system).frequencies[1] == pytest.approx(np.sqrt(200 * inverse) / (2 * np.pi))
    with pytest.raises(InputError, match="negative"):
        modes(system, {"shafts.s0.hardening.cubic": -1e5}, state=state)


def test_lash_is_closed_unless_the_state_says_otherwise():
    system = chain([0.3, 0.9], [200.0], effects=[{"kind": "backlash", "at": "shafts.s0", "gap": 0.02}])
    closed = np.sqrt(200 * (1 / 0.3 + 1 / 0.9)) / (2 * np.pi)
    assert modes(system).frequencies[1] == pytest.approx(closed)
    assert damped_modes(system).frequencies[1] == pytest.approx(closed)
    assert list(modes(system, state=np.zeros(4)).frequencies) == [0.0, 0.0]


def test_compliance_holds_energy_under_its_own_name():
    effect = {"kind": "compliance", "at": "shafts.s0", "stiffness": 800.0, "J": 0.05}
    system = chain([0.3, 0.9], [200.0], effects=[effect])
    plain = modes(chain([0.3, 0.05, 0.9], [200.0, 800.0]))
    found = modes(system)
    np.testing.assert_allclose(found.frequencies, plain.frequencies, rtol=1e-9)
    assert found[1].potential["shafts.s0.compliance"] == pytest.approx(plain[1].potential["shafts.s1"])
    assert found[1].kinetic["shafts.s0.compliance"] == pytest.approx(plain[1].kinetic["inertias.i1"])


def test_reduced_values():
    values = reduced_values(VEHICLE)
    assert values["inertias.wheel_left.J"] == pytest.approx(0.69 / 10.05**2)
    assert values["shafts.side_left.stiffness"] == pytest.approx(1.092e4 / 10.05**2)
    assert values["inertias.gearbox.J"] == pytest.approx(0.0099)
    assert values["shafts.gear_mesh.stiffness"] == pytest.approx(1710)
    ratios = speed_ratios(DIFFERENTIAL)
    assert ratios["inertias.wl"] == pytest.approx(9.0)
    assert ratios["inertias.gl"] == pytest.approx(9.0)
    plain, at_motor = modes(VEHICLE), reduced(modes(VEHICLE), speed_ratios(VEHICLE))
    np.testing.assert_allclose(at_motor.modal_stiffness / at_motor.modal_mass, (2 * np.pi * plain.frequencies) ** 2)
    one_rigid_motion = sum(value for name, value in values.items() if name.endswith(".J"))
    assert at_motor.modal_mass[0] == pytest.approx(one_rigid_motion)
    with pytest.raises(InputError, match="reference"):
        speed_ratios(BRANCHED)


def test_shape_of_modes_json():
    assert damped_modes(VEHICLE).to_dict()["modes"][1]["damping_ratio"] > 0
    entry = modes(VEHICLE).to_dict()["modes"][1]
    assert entry["damping_ratio"] is None  # the vehicle is damped; it was not calculated
    assert list(entry) == ["number", "frequency", "damping_ratio", "symmetry", "kinetic", "potential"]
    assert entry["number"] == 2
    assert set(entry["kinetic"]) == {f"inertias.{part.name}" for part in VEHICLE.inertias}
    assert set(entry["potential"]) == {f"shafts.{part.name}" for part in VEHICLE.shafts}


@pytest.mark.parametrize("held", ["carrier", "ring", "sun"])
def test_a_held_member_of_a_planetary_gear_is_no_mode(held):
    """The other two turn by a fixed ratio: one rigid motion and two elastic modes, of the tests' own chain of three."""
    J = {"sun": 0.02, "ring": 0.3, "carrier": 0.15, "engine": 0.2, "car": 4.0}
    teeth, k = 2.4, (900.0, 2500.0)
    free = [name for name in ("sun", "ring", "carrier") if name != held]
    shafts = {"in": ("engine", free[0], k[0]), "out": (free[1], "car", k[1])}
    data = {
        "inertias": {name: {"J": value} for name, value in J.items()},
        "planetary_gears": {"gear": {"sun": "sun", "carrier": "carrier", "ring": "ring", "ratio": teeth}},
        "shafts": {name: {"between": [a, b], "stiffness": c, "damping": 0.5} for name, (a, b, c) in shafts.items()},
        "inputs": {"pull": {"on": "engine"}},
        "effects": [{"kind": "imposed_motion", "at": f"inertias.{held}"}],
    }
    weights = {"sun": 1.0, "ring": teeth, "carrier": -(1 + teeth)}
    turn = -weights[free[0]] / weights[free[1]]  # of the second member for each of the first
    shared = J[free[0]] + turn**2 * J[free[1]]
    M = np.diag([J["engine"], shared, J["car"]])
    K = np.array([[k[0], -k[0], 0], [-k[0], k[0] + turn**2 * k[1], -turn * k[1]], [0, -turn * k[1], k[1]]])
    wanted = np.sqrt(np.maximum(scipy.linalg.eigh(K, M, eigvals_only=True), 0)) / 2 / np.pi
    found = modes(from_dict(data))
    np.testing.assert_allclose([mode.frequency for mode in found], wanted, rtol=1e-9, atol=1e-5)
    assert [mode.number for mode in found] == [1, 2, 3]
    assert all(abs(mode.shape[f"inertias.{held}"]) < 1e-12 for mode in found)
    damped = damped_modes(from_dict(data))
    assert len([mode for mode in damped if mode.frequency == 0]) == 1
    np.testing.assert_allclose([mode.frequency for mode in damped][1:], wanted[1:], rtol=1e-2)
