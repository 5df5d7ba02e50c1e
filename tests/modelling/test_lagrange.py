"""The equations of motion against sympy.physics.mechanics, written a second time from the same model data."""

import numpy as np
import pytest
import scipy
import sympy as sm
import sympy.physics.mechanics as me

from modelling.equations.casadi_code import compiled
from modelling.equations.lagrange import derive
from modelling.errors import InputError
from modelling.modal.modes import damped_modes
from modelling.model_file import from_dict, load


def inertias(**J):
    return {name: {"J": value, "drag": 0.01 * (i + 1)} for i, (name, value) in enumerate(J.items())}


def shaft(first, second, stiffness, ratio=None):
    own = {"between": [first, second], "stiffness": stiffness, "damping": stiffness / 1000}
    return own if ratio is None else own | {"ratio": ratio}


SIDES = {
    "side_l": shaft("gear_l", "wheel_l", 9e3),
    "side_r": shaft("gear_r", "wheel_r", 9e3),
    "tyre_l": shaft("wheel_l", "body", 1.2e4),
    "tyre_r": shaft("wheel_r", "body", 1.1e4),
}
# name → model data, and how the dependent angles follow from the independent ones, worked out by hand
SYSTEMS = {
    "geared": (
        {
            "inertias": inertias(motor=0.05, axle=0.2, load=3.0),
            "gears": {"reduction": {"between": ["motor", "axle"], "ratio": 9.7}},
            "shafts": {"link": shaft("axle", "load", 800.0)},
            "inputs": {"torque": {"on": "motor"}},
        },
        {"motor": lambda q: 9.7 * q["axle"]},
    ),
    "branched": (
        {
            "inertias": inertias(motor=0.05, hub=0.2, left=1.0, right=1.2, far=4.0),
            "shafts": {
                "drive": shaft("motor", "hub", 5e3, ratio=7.0),
                "left": shaft("hub", "left", 700.0),
                "right": shaft("hub", "right", 750.0),
                "far": shaft("right", "far", 300.0, ratio=-1.5),
            },
            "inputs": {"torque": {"on": "motor"}, "brake": {"on": "far"}},
        },
        {},
    ),
    "looped": (
        {
            "inertias": inertias(axle=0.3, gear_l=0.1, gear_r=0.1, wheel_l=1.0, wheel_r=1.1, body=150.0),
            "shafts": SIDES | {"l": shaft("axle", "gear_l", 4e4), "r": shaft("axle", "gear_r", 4e4)},
            "inputs": {"torque": {"on": "axle"}},
        },
        {},
    ),
    "open differential": (
        {
            "inertias": inertias(motor=0.05, cage=0.1, gear_l=0.02, gear_r=0.03, wheel_l=1.0, wheel_r=1.1, body=150.0),
            "gears": {"reduction": {"between": ["motor", "cage"], "ratio": 9.0}},
            "differentials": {"open": {"cage": "cage", "left": "gear_l", "right": "gear_r"}},
            "shafts": SIDES,
            "inputs": {"torque": {"on": "motor"}, "brake": {"on": "wheel_l"}},
        },
        {"cage": lambda q: (q["gear_l"] + q["gear_r"]) / 2, "motor": lambda q: 9.0 * (q["gear_l"] + q["gear_r"]) / 2},
    ),
    "two gears round a shaft": (
        {
            "inertias": inertias(motor=0.05, counter=0.1, out=0.2, load=5.0),
            "gears": {
                "first": {"between": ["motor", "counter"], "ratio": -3.0},
                "second": {"between": ["counter", "out"], "ratio": -2.5},
            },
            "shafts": {"link": shaft("out", "load", 800.0), "round": shaft("motor", "load", 40.0, ratio=7.5)},
            "inputs": {"torque": {"on": "motor"}},
        },
        {"counter": lambda q: -2.5 * q["out"], "motor": lambda q: 7.5 * q["out"]},
    ),
    "nonlinear": (
        {
            "inertias": inertias(motor=0.05, axle=0.2, load=3.0),
            "gears": {"reduction": {"between": ["motor", "axle"], "ratio": 4.0}},
            "shafts": {"link": shaft("axle", "load", 800.0)},
            "inputs": {"torque": {"on": "motor"}},
            "effects": [
                {"kind": "hardening", "at": "shafts.link", "cubic": 5e3},
                {"kind": "quadratic_drag", "at": "inertias.load", "coefficient": 0.3},
                {"kind": "constant_torque", "at": "inertias.load", "torque": 7.0},
                {"kind": "torque_ripple", "at": "inertias.motor", "order": 6, "amplitude": 2.0, "phase": 0.4},
            ],
        },
        {"motor": lambda q: 4.0 * q["axle"]},
    ),
}


def second_derivation(data, dependent, coordinates):
    """Mass matrix and forcing by LagrangesMethod, as functions of (q, q̇, u), in the order of ``coordinates``."""
    t, N = me.dynamicsymbols._t, me.ReferenceFrame("N")
    free = {name: me.dynamicsymbols(f"phi_{name}") for name in coordinates}
    angle = free | {name: follow(free) for name, follow in dependent.items()}
    torque = dict.fromkeys(angle, sm.Integer(0))
    u = sm.symbols(f"u0:{len(data['inputs'])}")
    T = sum(part["J"] * angle[name].diff(t) ** 2 for name, part in data["inertias"].items()) / 2
    V = sm.Integer(0)
    for name, part in data["inertias"].items():
        torque[name] -= part["drag"] * angle[name].diff(t)
    effects = {effect["kind"]: effect for effect in data.get("effects", [])}
    for part in data["shafts"].values():
        first, second = part["between"]
        twist = angle[first] / part.get("ratio", 1) - angle[second]
        V += part["stiffness"] * twist**2 / 2
        if "hardening" in effects:
            V += effects["hardening"]["cubic"] * twist**4 / 4
        viscous = part["damping"] * twist.diff(t)
        torque[first] -= viscous / part.get("ratio", 1)
        torque[second] += viscous
    for symbol, part in zip(u, data["inputs"].values()):
        torque[part["on"]] += symbol
    if "quadratic_drag" in effects:
        speed = angle["load"].diff(t)
        torque["load"] += -effects["quadratic_drag"]["coefficient"] * speed * sm.Abs(speed)
        torque["load"] -= effects["constant_torque"]["torque"]
        ripple = effects["torque_ripple"]
        torque["motor"] += ripple["amplitude"] * sm.sin(ripple["order"] * angle["motor"] + ripple["phase"])
    loads = []
    for name, value in torque.items():
        frame = me.ReferenceFrame(f"F_{name}")
        frame.set_ang_vel(N, angle[name].diff(t) * N.z)
        loads.append((frame, value * N.z))
    method = me.LagrangesMethod(T - V, list(free.values()), forcelist=loads, frame=N)
    method.form_lagranges_equations()
    plain = {q.diff(t): sm.Symbol(f"d{i}") for i, q in enumerate(free.values())}
    plain |= {q: sm.Symbol(f"q{i}") for i, q in enumerate(free.values())}
    mass, forcing = (
        part.xreplace({q.diff(t): plain[q.diff(t)] for q in free.values()}).xreplace(plain)
        for part in (method.mass_matrix, method.forcing)
    )
    n = len(free)
    arguments = [sm.symbols(f"q0:{n}"), sm.symbols(f"d0:{n}"), u]
    return sm.lambdify(arguments, [mass, forcing])


@pytest.mark.parametrize("name", SYSTEMS)
def test_against_lagranges_method(name):
    data, dependent = SYSTEMS[name]
    model = compiled(from_dict(data))
    assert set(model.coordinates) == set(data["inertias"]) - set(dependent)
    second = second_derivation(data, dependent, model.coordinates)
    rng = np.random.default_rng(1)
    for _ in range(5):
        q, qd = rng.normal(0, 0.3, model.n), rng.normal(0, 20, model.n)
        u = rng.normal(0, 50, len(model.inputs))
        mass, forcing = second(q, qd, u)
        np.testing.assert_allclose(model.mass(model.p0).full(), mass, rtol=1e-12, atol=1e-12)
        force = model.force(np.concatenate([q, qd]), u, model.p0).full().ravel()
        np.testing.assert_allclose(force, np.ravel(forcing), rtol=1e-9, atol=1e-8)
        rates = model.rates(np.concatenate([q, qd]), u, model.p0).full().ravel()
        np.testing.assert_allclose(rates[: model.n], qd)
        np.testing.assert_allclose(rates[model.n :], np.linalg.solve(mass, np.ravel(forcing)), rtol=1e-9)


@pytest.mark.parametrize("name", ["geared", "open differential", "nonlinear"])
def test_jacobians_by_finite_differences(name):
    model = compiled(
        from_dict(
            SYSTEMS[name][0] | {"sensors": {"m": {"measures": "torque", "of": next(iter(SYSTEMS[name][0]["shafts"]))}}}
        )
    )
    rng = np.random.default_rng(2)
    x, u = rng.normal(0, 0.3, len(model.states)), rng.normal(0, 5, len(model.inputs))

    def both(x, u):
        return np.concatenate(
            [model.rates(x, u, model.p0).full().ravel(), model.readings(x, u, model.p0, 0).full().ravel()]
        )

    A, B, C, D = (part.full() for part in model.jacobians(x, u, model.p0, 0))
    numeric = np.column_stack([(both(x + h, u) - both(x - h, u)) / 2e-6 for h in 1e-6 * np.eye(len(x))])
    np.testing.assert_allclose(np.vstack([A, C]), numeric, rtol=1e-6, atol=1e-4)
    numeric = np.column_stack([(both(x, u + h) - both(x, u - h)) / 2e-3 for h in 1e-3 * np.eye(len(u))])
    np.testing.assert_allclose(np.vstack([B, D]), numeric, rtol=1e-6, atol=1e-7)


def test_constraints_hold_in_the_sensors():
    data = SYSTEMS["open differential"][0]
    speeds = {f"w_{name}": {"measures": "speed", "of": name} for name in data["inertias"]}
    model = compiled(from_dict(data | {"sensors": speeds}))
    x = np.random.default_rng(0).normal(0, 1, len(model.states))
    read = dict(zip(data["inertias"], model.readings(x, [0, 0], model.p0, 0).full().ravel()))
    assert 2 * read["cage"] == pytest.approx(read["gear_l"] + read["gear_r"])
    assert read["motor"] == pytest.approx(9.0 * read["cage"])


def test_every_parameter_is_a_symbol_under_its_name():
    system = from_dict(SYSTEMS["nonlinear"][0])
    names = {str(symbol) for symbol in derive(system).assembly.parameters.values()}
    assert set(system.parameters) <= names
    assert set(system.parameters) == set(system.units)


def test_equations_are_kept_for_other_values():
    system = from_dict(SYSTEMS["branched"][0])
    assert derive(system.with_values({"inertias.hub.J": 0.7})) is derive(system)
    changed = compiled(system.with_values({"inertias.hub.J": 0.7}))
    np.testing.assert_allclose(changed.mass(changed.p0).full()[1, 1], 0.7)


def test_equations_read_as_latex():
    from pathlib import Path

    system = load(Path(__file__).parents[2] / "examples" / "road_to_rig" / "rig.toml")
    page = system._repr_html_()
    assert page.count(r"\\") == 9  # T, V, D and seven equations
    assert r"J_{\mathrm{motor}}" in page
    assert r"c_{\mathrm{side\_left}}" in page
    assert "Powertrain test bed" in page


@pytest.mark.parametrize(
    ("gears", "message"),
    [
        ({"a": (["m", "n"], 2.0), "b": (["m", "n"], 2.0)}, "says again"),
        ({"a": (["m", "n"], 2.0), "b": (["m", "n"], 3.0)}, "locks"),
        ({"a": (["m", "n"], 2.0), "b": (["n", "o"], 3.0), "c": (["o", "m"], 1.0)}, "locks"),
        ({"a": (["m", "n"], 2.0), "b": (["n", "o"], 3.0), "c": (["m", "o"], 6.0)}, "locks the drivetrain"),
    ],
)
def test_gears_that_lock_or_repeat(gears, message):
    data = {"inertias": inertias(m=1.0, n=1.0, o=1.0), "shafts": {"s": shaft("n", "o", 1.0)}}
    data["gears"] = {name: {"between": ends, "ratio": ratio} for name, (ends, ratio) in gears.items()}
    with pytest.raises(InputError, match=message):
        compiled(from_dict(data))


def test_operations_grow_with_the_chain_not_its_square():
    """Structure, not time: a chain four times as long takes four times the operations."""

    def operations(count):
        parts = {f"i{i}": {"J": 1.0} for i in range(count)}
        shafts = {f"s{i}": shaft(f"i{i}", f"i{i + 1}", 10.0) for i in range(count - 1)}
        model = compiled(from_dict({"inertias": parts, "shafts": shafts}))
        return model.rates.n_instructions(), model.jacobians.n_instructions()

    few, many = operations(15), operations(60)
    assert all(large < 4.6 * small for small, large in zip(few, many))


@pytest.mark.parametrize("held", ["sun", "front_ring", "output", "rear_carrier"])
def test_any_member_of_coupled_planetary_gears_may_be_held(held):
    """Damped modes against the null space of the constraints: a Simpson set; a brake on its carrier is first gear."""
    rng = np.random.default_rng([651, len(held)])
    names = ["engine", "sun", "front_ring", "output", "rear_carrier", "car"]
    J = 10 ** rng.uniform(-2, 0.5, 6)
    ratios, k, c = rng.uniform(1.5, 4, 2), 10 ** rng.uniform(2.5, 3.5, 2), rng.uniform(1, 5, 2)
    data = {
        "inertias": {name: {"J": value} for name, value in zip(names, J.tolist(), strict=True)},
        "planetary_gears": {
            "front": {"sun": "sun", "carrier": "output", "ring": "front_ring", "ratio": ratios[0]},
            "rear": {"sun": "sun", "carrier": "rear_carrier", "ring": "output", "ratio": ratios[1]},
        },
        "shafts": {
            "converter": {"between": ["engine", "front_ring"], "stiffness": k[0], "damping": c[0]},
            "side": {"between": ["output", "car"], "stiffness": k[1], "damping": c[1]},
        },
        "inputs": {"torque": {"on": "engine"}},
        "effects": [{"kind": "imposed_motion", "at": f"inertias.{held}"}],
    }
    e = dict(zip(names, np.eye(6), strict=True))
    rows = [
        (1 + ratios[0]) * e["output"] - e["sun"] - ratios[0] * e["front_ring"],
        (1 + ratios[1]) * e["rear_carrier"] - e["sun"] - ratios[1] * e["output"],
        e[held],
    ]
    free = scipy.linalg.null_space(np.array(rows))
    twists = np.array([e["engine"] - e["front_ring"], e["output"] - e["car"]]) @ free
    M, K, C = free.T @ np.diag(J) @ free, twists.T @ np.diag(k) @ twists, twists.T @ np.diag(c) @ twists
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    own = np.linalg.eigvals(A)
    own = own[np.abs(own) > 1e-5 * np.abs(own).max()]
    found = damped_modes(from_dict(data)).eigenvalues
    for value in own[own.imag >= 0]:
        assert np.abs(found - value).min() < 1e-6 * abs(value)
