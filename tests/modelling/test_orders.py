"""Campbell diagrams and forced responses, against matrices written down here and closed forms."""

import json
from pathlib import Path

import numpy as np
import pytest

import rigmatch as rm
from matching.cli import main
from modelling.errors import InputError
from modelling.modal.orders import campbell, order_response
from modelling.model_file import from_dict

RPM = np.pi / 30
ENGINE = Path(__file__).parents[2] / "examples" / "engine" / "engine.toml"


def drawn_chain(rng):
    """A model of 3 to 6 discs in a row with one shaft of a ratio, and its M, C, K by hand."""
    n = int(rng.integers(3, 7))
    J, k = rng.uniform(0.01, 2, n), rng.uniform(500, 2e4, n - 1)
    c, drag, ratio = 2e-4 * k * rng.uniform(0.5, 2, n - 1), rng.uniform(0.01, 0.2, n), np.ones(n - 1)
    ratio[rng.integers(n - 1)] = rng.uniform(0.3, 4)
    M, C, K = np.diag(J), np.diag(drag), np.zeros((n, n))
    for i in range(n - 1):
        row = np.zeros(n)
        row[i], row[i + 1] = 1 / ratio[i], -1
        C, K = C + c[i] * np.outer(row, row), K + k[i] * np.outer(row, row)
    data = {
        "inertias": {f"d{i}": {"J": J[i], "drag": drag[i]} for i in range(n)},
        "shafts": {
            f"s{i}": {"between": [f"d{i}", f"d{i + 1}"], "stiffness": k[i], "damping": c[i], "ratio": ratio[i]}
            for i in range(n - 1)
        },
        "inputs": {"first": {"on": "d0"}, "last": {"on": f"d{n - 1}"}},
        "sensors": {"late": {"measures": "speed", "of": "d0"}},
        "effects": [{"kind": "sensor_offset", "at": "sensors.late", "offset": 0.3}],
    }
    return data, M, C, K, k, c, ratio


@pytest.mark.parametrize("seed", range(4))
def test_a_drawn_chain_swings_as_its_matrices_say(seed):
    """Two inputs, three orders with phases: amplitudes of every order, and the peak of their sum in time."""
    rng = np.random.default_rng(seed)
    data, M, C, K, k, c, ratio = drawn_chain(rng)
    n, speeds = len(M), np.linspace(40, 400, 31)
    torques = {
        ("first", 0.5): 12 * np.exp(0.4j), ("first", 2.0): 30 * np.exp(-1.1j), ("last", 2.0): 9.0,
        ("last", 3.0): 5 * np.exp(2j),
    }  # fmt: skip
    found = order_response(from_dict(data), speeds, "d0", torques)
    assert found.orders == (0.5, 2.0, 3.0)
    for i, speed in enumerate(speeds[::6]):
        motion = []
        for j, order in enumerate(found.orders):
            s, push = 1j * order * speed, np.zeros(n, complex)
            push[0], push[-1] = torques.get(("first", order), 0), torques.get(("last", order), 0)
            angle = np.linalg.solve(s**2 * M + s * C + K, push)
            twist = angle[:-1] / ratio - angle[1:]
            np.testing.assert_allclose(found.angles[6 * i, j], angle, rtol=1e-7, atol=1e-9 * np.abs(angle).max())
            torque = (k + s * c) * twist
            np.testing.assert_allclose(found.torques[6 * i, j], torque, rtol=1e-7, atol=1e-9 * np.abs(torque).max())
            motion.append(torque)
        turn = np.linspace(0, 4 * np.pi, 20_001)
        together = sum((np.exp(1j * o * turn)[:, None] * m).real for o, m in zip(found.orders, motion, strict=True))
        np.testing.assert_allclose(found.peak_torques[6 * i], np.abs(together).max(axis=0), rtol=2e-3, atol=1e-9)


def test_an_absorber_stands_still_and_its_shaft_carries_the_torque():
    """Den Hartog, Mechanical Vibrations, section 3.2: at the absorber's own frequency the main disc does not move."""
    data = {
        "inertias": {"main": {"J": 1.0}, "absorber": {"J": 0.05}, "ground": {"J": 1e9}},
        "shafts": {
            "spring": {"between": ["ground", "main"], "stiffness": 1e4},
            "small": {"between": ["main", "absorber"], "stiffness": 500.0},
        },
        "inputs": {"push": {"on": "main"}},
    }
    tuned = np.sqrt(500.0 / 0.05)  # rad/s
    found = order_response(from_dict(data), np.array([0.9, 1.0, 1.1]) * tuned, "main", {("push", 1.0): 7.0})
    main, small = found.inertias.index("main"), found.shafts.index("small")
    assert np.abs(found.angles[1, 0, main]) < 1e-9 * np.abs(found.angles[0, 0, main])
    assert np.abs(found.torques[1, 0, small]) == pytest.approx(7.0, rel=1e-9)


def test_a_critical_speed_is_where_the_order_meets_the_mode():
    J, k = (0.2, 0.3), 4000.0
    own = np.sqrt(k * (1 / J[0] + 1 / J[1]))
    data = {
        "inertias": {"a": {"J": J[0]}, "b": {"J": J[1]}},
        "shafts": {"s": {"between": ["a", "b"], "stiffness": k, "damping": 0.3}},
        "inputs": {"torque": {"on": "a"}},
    }
    system, speeds = from_dict(data), np.linspace(0.2 * own, 0.8 * own, 2001)
    (met,) = campbell(system, speeds, "a", [2]).crossings
    assert (met.mode, met.order) == (2, 2.0)
    assert met.speed == pytest.approx(own / 2, rel=1e-9)
    assert met.frequency == pytest.approx(own / 2 / np.pi, rel=1e-9)
    (critical,) = order_response(system, speeds, "a", {("torque", 2.0): 10.0}).critical
    assert critical.speed == pytest.approx(own / 2, rel=1e-3)
    share = J[1] / sum(J)
    s = 1j * own
    exact = abs(10 * share * (k + 0.3 * s) / (s**2 * J[0] * share + 0.3 * s + k))
    assert critical.torque == pytest.approx(exact, rel=1e-3)


def test_modes_of_a_model_that_depends_on_speed_are_followed():
    """Drag that grows with the square of speed damps by 2·c·v, which takes one mode through others' damping."""
    c = 0.01
    J, k = np.array([0.1, 0.4, 0.25]), np.array([3000.0, 1500.0])
    data = {
        "inertias": {name: {"J": value} for name, value in zip("abc", J, strict=True)},
        "shafts": {
            "one": {"between": ["a", "b"], "stiffness": k[0], "damping": 0.5},
            "two": {"between": ["b", "c"], "stiffness": k[1], "damping": 0.5},
        },
        "inputs": {"torque": {"on": "a"}},
        "effects": [{"kind": "quadratic_drag", "at": "inertias.c", "coefficient": c}],
    }
    speeds = np.linspace(20, 600, 30)
    found = campbell(from_dict(data), speeds, "a", [1])
    K = np.array([[k[0], -k[0], 0], [-k[0], k[0] + k[1], -k[1]], [0, -k[1], k[1]]])
    D = 0.5 / k[0] * np.array([[k[0], -k[0], 0], [-k[0], k[0], 0], [0, 0, 0]]) + 0.5 / k[1] * np.array(
        [[0, 0, 0], [0, k[1], -k[1]], [0, -k[1], k[1]]]
    )
    for i, speed in enumerate(found.speeds):
        C = D + np.diag([0, 0, 2 * c * speed])
        A = np.block([[np.zeros((3, 3)), np.eye(3)], [-K / J[:, None], -C / J[:, None]]])
        poles = np.linalg.eigvals(A)
        swinging = np.sort(np.abs(poles[poles.imag > 1e-6])) / 2 / np.pi
        ours = np.sort(found.frequencies[i][np.isfinite(found.frequencies[i])])
        for one in swinging:
            assert np.abs(ours - one).min() < 1e-5 * one
    steps = np.abs(np.diff(found.frequencies[:, 1:3], axis=0))
    assert np.nanmax(steps) < 1.0  # Hz: no column jumps to another mode, 10 Hz away


def test_speeds_with_units_and_the_commands(tmp_path, capsys):
    engine = str(ENGINE)
    for text in ("600:6000:7 1/min", "600 1/min:6000 1/min:7", "0.6e3:6000 1/min:7"):
        np.testing.assert_allclose(rm.campbell(engine, text).speeds, np.linspace(600, 6000, 7) * RPM)
    out = tmp_path / "out"
    words = ["--speed", "600:6000 1/min", "--out", str(out)]
    assert main(["campbell", engine, *words, "--orders", "2,4"]) == 0
    assert (
        main(["response", engine, *words, "--torques", "engine_torque:2=150", "--phases", "engine_torque:2=9 deg"]) == 0
    )
    assert "critical speed" in capsys.readouterr().out
    names = {"campbell.json", "campbell.svg", "report.html", "response.json", "response.csv", "response.svg"}
    assert names == {path.name for path in out.iterdir()}
    assert rm.load_result(out / "campbell.json").crossings[0].order == 4.0
    (out / "campbell.json").unlink()
    assert rm.load_result(out).critical[0].order == 2.0  # its curves lie beside it


@pytest.mark.parametrize(
    ("speed", "torques", "said"),
    [
        ("600", {"engine_torque:2": 1}, "is no range"),
        ("6000:600 1/min", {"engine_torque:2": 1}, "does not rise"),
        ("0:600 1/min", {"engine_torque:2": 1}, "does not rise from above 0"),
        ("6:60:1", {"engine_torque:2": 1}, "no number of speeds"),
        ("6:60", {"engine_torqe:2": 1}, "did you mean 'engine_torque'"),
        ("6:60", {"engine_torque": 1}, "has no order"),
        ("6:60", {"engine_torque:0": 1}, "is no order"),
        ("6:60", {"engine_torque:2": "1 kg"}, "does not fit"),
        ("6:60", {}, "there is none"),
    ],
)
def test_what_is_wrong_is_said(speed, torques, said):
    engine = ENGINE
    with pytest.raises(InputError, match=said):
        rm.order_response(engine, speed, torques)


BRAKED = {
    "inertias": {"sun": {"J": 15.0}, "ring": {"J": 0.3}, "carrier": {"J": 20.0}},
    "planetary_gears": {"one": {"sun": "sun", "carrier": "carrier", "ring": "ring", "ratio": 2.6}},
    "inputs": {"pull": {"on": "carrier"}}, "sensors": {"speed": {"measures": "speed", "of": "sun"}},
    "effects": [{"kind": "brake", "at": "inputs.pull", "deflection": 0.007}],
}  # fmt: skip


def test_a_model_in_which_nothing_swings_meets_no_order(tmp_path):
    found = campbell(from_dict(BRAKED), np.linspace(60, 600, 30), "carrier", [1.0, 2.0])
    assert found.crossings == ()
    json.dumps(found.to_dict(), allow_nan=False)
    found.save(tmp_path)


def test_a_mode_that_is_overdamped_at_some_speeds_is_there_at_the_others(tmp_path):
    """The tyres of the driving example swing at low speed alone: crossings are numbers, and the gap is in the file."""
    vehicle = rm.load(Path(__file__).parents[2] / "examples" / "drive_away" / "vehicle.toml")
    found = campbell(vehicle, np.linspace(30, 400, 60), "motor", [0.5, 1.0, 2.0, 4.0])
    assert found.crossings
    assert all(np.isfinite([one.speed, one.frequency]).all() for one in found.crossings)
    assert (np.abs(found.damping_ratios[np.isfinite(found.damping_ratios)]) < 1).all()
    assert np.isfinite(found.frequencies).any(axis=0).all()
    assert np.isnan(found.frequencies).any()
    written = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert any(value is None for row in written["frequencies"] for value in row)


def test_one_inertia_without_a_shaft_answers_with_its_angle(tmp_path):
    """J = 0.1, drag 0.5 under 1 N·m of order 2: |θ| = T/(ω·√((Jω)² + d²))."""
    system = from_dict({
        "inertias": {"rotor": {"J": 0.1, "drag": 0.5}}, "inputs": {"torque": {"on": "rotor"}},
        "sensors": {"speed": {"measures": "speed", "of": "rotor"}},
    })  # fmt: skip
    speeds = np.linspace(60, 300, 15)
    found = order_response(system, speeds, "rotor", {("torque", 2.0): 1.0})
    omega = 2 * speeds
    np.testing.assert_allclose(found.peak_angles[:, 0], 1 / (omega * np.hypot(0.1 * omega, 0.5)), rtol=1e-9)
    found.save(tmp_path)
    assert (tmp_path / "report.html").exists()
