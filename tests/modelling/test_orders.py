"""Campbell diagrams and forced responses, against matrices written down here and closed forms."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import minimize_scalar

import rigmatch as rm
from matching.cli import main
from modelling.errors import InputError
from modelling.modal.forced import extremes, order_response
from modelling.modal.orders import campbell
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
    assert set(speeds) <= set(found.speeds)  # closer ones about every resonance stand between
    for speed in speeds[::6]:
        at = int(np.searchsorted(found.speeds, speed))
        motion = []
        for j, order in enumerate(found.orders):
            s, push = 1j * order * speed, np.zeros(n, complex)
            push[0], push[-1] = torques.get(("first", order), 0), torques.get(("last", order), 0)
            angle = np.linalg.solve(s**2 * M + s * C + K, push)
            twist = angle[:-1] / ratio - angle[1:]
            np.testing.assert_allclose(found.angles[at, j], angle, rtol=1e-7, atol=1e-9 * np.abs(angle).max())
            torque = (k + s * c) * twist
            np.testing.assert_allclose(found.torques[at, j], torque, rtol=1e-7, atol=1e-9 * np.abs(torque).max())
            motion.append(torque)
        turn = np.linspace(0, 4 * np.pi, 20_001)
        together = sum((np.exp(1j * o * turn)[:, None] * m).real for o, m in zip(found.orders, motion, strict=True))
        np.testing.assert_allclose(found.peak_torques[at], np.abs(together).max(axis=0), rtol=1e-4, atol=1e-9)
        np.testing.assert_allclose(found.peak_to_peak[at], np.ptp(together, axis=0), rtol=1e-4, atol=1e-9)


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
    ratio = 0.3 * own / (2 * k)
    rings = own * np.sqrt(1 - ratio**2)
    assert met.speed == pytest.approx(rings / 2, rel=1e-9)
    assert met.frequency == pytest.approx(rings / 2 / np.pi, rel=1e-9)
    assert met.natural_frequency == pytest.approx(own / 2 / np.pi, rel=1e-9)
    assert met.damping_ratio == pytest.approx(ratio, rel=1e-9)
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
        ours = np.sort(found.natural_frequencies[i][np.isfinite(found.frequencies[i])])
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
        main(["response", engine, *words, "--torques", "engine_torque:4=150", "--phases", "engine_torque:4=9 deg"]) == 0
    )
    assert "critical speed" in capsys.readouterr().out
    names = {"campbell.json", "campbell.svg", "report.html", "response.json", "response.csv", "response.svg"}
    assert names == {path.name for path in out.iterdir()}
    assert rm.load_result(out / "campbell.json").crossings[0].order == 4.0
    (out / "campbell.json").unlink()
    assert rm.load_result(out).critical[0].order == 4.0  # its curves lie beside it


@pytest.mark.parametrize(
    ("speed", "torques", "said"),
    [
        ("600 1/min", {"engine_torque:2": 1}, "is no range"),
        ("600:6000", {"engine_torque:2": 1}, "has no unit"),
        ((600, 6000), {"engine_torque:2": 1}, "has no unit"),
        ("6000:600 1/min", {"engine_torque:2": 1}, "does not rise"),
        ("0:600 1/min", {"engine_torque:2": 1}, "does not rise from above 0"),
        ("6:60:1 rad/s", {"engine_torque:2": 1}, "no number of speeds"),
        ("6:60 rad/s", {"engine_torqe:2": 1}, "did you mean 'engine_torque'"),
        ("6:60 rad/s", {"engine_torque": 1}, "has no order"),
        ("6:60 rad/s", {"engine_torque:0": 1}, "is no order"),
        ("6:60 rad/s", {"engine_torque:2": "1 kg"}, "does not fit"),
        ("6:60 rad/s", {}, "there is none"),
        ("6:60 rad/s", {"engine_torque:2": "100*load"}, "is a formula over load"),
        ("6:60 rad/s", {"engine_torque:2": "100*rpm*speed"}, "'speed'"),
        ("6:60 rad/s", {"engine_torque:2": "100/(rpm - rpm)"}, "zoo|no value|divi"),
        ("6:60 rad/s", {"engine_torque:2": "sqrt(500 - rpm)**(1/0*rpm)"}, "no value|divi|zoo|number"),
    ],
)
def test_what_is_wrong_is_said(speed, torques, said):
    engine = ENGINE
    with pytest.raises(InputError, match=said):
        rm.order_response(engine, speed, torques)


def test_a_torque_as_a_formula_in_words_is_that_of_the_function(tmp_path):
    """Speed in 1/min and load as a share, against a function of the tests' own in rad/s."""
    rng = np.random.default_rng(65)
    a, b, c = rng.uniform(20, 200, 3)
    load = rng.uniform(0.2, 0.9)
    words = f"load*({a} + {b}*(rpm/1000)**2) + {c}*sqrt(rpm/600)"
    speeds = np.linspace(60, 620, 25)

    def own(at):
        n = at * 30 / np.pi
        return load * (a + b * (n / 1000) ** 2) + c * np.sqrt(n / 600)

    found = rm.order_response(ENGINE, speeds, {"engine_torque:2": words}, load=load)
    wanted = rm.order_response(ENGINE, speeds, {"engine_torque:2": own})
    np.testing.assert_allclose(np.abs(found.torques), np.abs(wanted.torques), rtol=1e-9)
    command = ["response", str(ENGINE), "--speed", "600:6000 1/min", "--out", str(tmp_path / "out"), "--load", "50 %"]
    assert main([*command, "--torques", "engine_torque:2=load*(100 + rpm/50)"]) == 0
    assert main([*command, "--torques", "engine_torque:2=100"]) == 2


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


# --- Peaks, orders and modes of drawn engines, by complex equations and rigid accelerations written down here.


def drawn_engine(rng, least_damping):
    """A chain of 4 to 7 discs with one gear: its file, and (J, k, c, ratio, rows) for own equations."""
    n = int(rng.integers(4, 8))
    J, k = 10 ** rng.uniform(-2.5, 0.3, n), 10 ** rng.uniform(3.5, 5.5, n - 1)
    ratio = np.ones(n - 1)
    ratio[rng.integers(n - 1)] = rng.uniform(0.4, 3)
    rows = np.zeros((n - 1, n))
    for i in range(n - 1):
        rows[i, i], rows[i, i + 1] = 1 / ratio[i], -1
    squares = eigh(rows.T @ (k[:, None] * rows), np.diag(J), eigvals_only=True)
    lowest = np.sqrt(squares[1])
    c = 2 * least_damping / lowest * k * rng.uniform(0.7, 1.4, n - 1)
    data = {
        "inertias": {f"d{i}": {"J": float(J[i])} for i in range(n)},
        "shafts": {
            f"s{i}": {"between": [f"d{i}", f"d{i + 1}"], "stiffness": k[i], "damping": c[i], "ratio": ratio[i]}
            for i in range(n - 1)
        },
        "inputs": {"push": {"on": "d1"}},
    }
    return data, J, k, c, rows, np.sqrt(np.maximum(squares, 0))


def own_torque(omega, push, J, k, c, rows):
    """Complex torque amplitudes (n − 1,) of the shafts at one frequency, rad/s."""
    s = 1j * omega
    system = s**2 * np.diag(J) + rows.T @ ((k + s * c)[:, None] * rows)
    force = np.zeros(len(J), complex)
    force[1] = push
    return (k + s * c) * (rows @ np.linalg.solve(system, force))


def own_static(push, J, rows):
    """Torques (n − 1,) if all discs turned as one: each shaft accelerates what lies beyond it."""
    turns = np.linalg.svd(rows)[2][-1]
    acceleration = turns * (turns[1] * push) / np.sum(J * turns**2)
    force = np.zeros(len(J))
    force[1] = push
    return np.abs(np.linalg.lstsq(rows.T, force - J * acceleration, rcond=None)[0])


def own_summits(size, low, high, centres):
    """Maxima of ``size`` over speed: (speed, height, height over the larger minimum before a higher one)."""
    near = [centre + half * np.linspace(-12, 12, 97) for centre, half in centres]
    grid = np.unique(np.concatenate([np.linspace(low, high, 500), *near]).clip(low, high))
    values = np.array([size(one) for one in grid])
    found = []
    for i in range(1, len(grid) - 1):
        if not values[i - 1] < values[i] >= values[i + 1]:
            continue
        best = minimize_scalar(lambda one: -size(one), bounds=(grid[i - 1], grid[i + 1]), method="bounded",
                               options={"xatol": 1e-9 * grid[i]})  # fmt: skip
        sides = []
        for side in (values[i::-1], values[i:]):
            higher = np.flatnonzero(side > values[i])
            sides.append(side[: higher[0] + 1].min() if len(higher) else 0.0)
        found.append((best.x, -best.fun, values[i] / max(*sides, 1e-300)))
    return found


MOST_ENGINES = [pytest.param(seed, marks=pytest.mark.long) for seed in range(3, 20)]


@pytest.mark.parametrize("seed", [0, 1, 2, *MOST_ENGINES])
def test_peaks_orders_and_modes_of_a_drawn_engine(seed):
    """Within 0.1 % at damping ratios from 0.01 %, whatever the grid; and nothing else is called critical."""
    rng = np.random.default_rng([6503, seed])
    damping = 10 ** rng.uniform(-4, -2)
    data, J, k, c, rows, natural = drawn_engine(rng, damping)
    orders = sorted(rng.choice([0.5, 1, 1.5, 2, 2.5, 3, 4, 6], 3, replace=False).tolist())
    pushes = dict(zip(orders, rng.uniform(20, 300, 3).tolist(), strict=True))
    low, high = 0.4 * natural[1] / orders[-1], 1.3 * natural[3] / orders[0]
    found = order_response(
        from_dict(data), np.linspace(low, high, 60), "d1", {("push", order): push for order, push in pushes.items()}
    )
    half = damping * natural[1:] ** 2 / natural[1]
    apart = np.array([np.delete(np.abs(natural - natural[m]), m).min() for m in range(1, len(J))])
    alone = {m + 2 for m in np.flatnonzero(apart > 6 * half)}  # modes that no other one overlaps
    checked = 0
    for order, push in pushes.items():
        static = own_static(push, J, rows)
        centres = [(w / order, h / order) for w, h in zip(natural[1:], half, strict=True)]
        for j in range(len(k)):
            own = own_summits(
                lambda one, order=order, push=push, j=j: abs(own_torque(order * one, push, J, k, c, rows)[j]),
                low, high, centres,
            )  # fmt: skip
            said = [one for one in found.critical if (one.shaft, one.order) == (f"s{j}", order)]
            for speed, size, prominence in own:
                near = [one for one in said if abs(one.speed - speed) < 1e-3 * speed]
                mode = int(np.abs(natural - order * speed).argmin()) + 1
                off = abs(natural[mode - 1] - order * speed)
                if mode > 1 and off < 3 * half[mode - 2] and size > 1.5 * static[j] and prominence > 1.2:
                    assert len(near) == 1
                    assert near[0].amplitude == pytest.approx(size, rel=1e-3)
                    assert near[0].static == pytest.approx(static[j], rel=1e-3)
                    assert near[0].mode == mode or mode not in alone
                    checked += mode in alone
            for one in said:
                known = [size for speed, size, _ in own if abs(one.speed - speed) < 1e-3 * speed]
                assert any(size == pytest.approx(one.amplitude, rel=1e-3) for size in known)
                assert one.amplitude > 1.4 * static[j]
    assert checked >= 3
    turn = np.exp(1j * np.outer(np.linspace(0, 4 * np.pi, 3000), orders))
    near = np.unique(np.concatenate([np.linspace(low, high, 100), [one.speed for one in found.critical]]))
    motion = np.array([[own_torque(order * n, push, J, k, c, rows) for order, push in pushes.items()] for n in near])
    peaks = np.array([np.abs((turn @ one).real).max(axis=0) for one in motion])  # speed, shaft
    for j, one in enumerate(found.largest):
        assert one.torque > 0.999 * peaks[:, j].max()
        there = np.array([own_torque(order * one.speed, push, J, k, c, rows)[j] for order, push in pushes.items()])
        assert one.torque == pytest.approx(np.abs((turn @ there).real).max(), rel=1e-3)


def test_the_grid_does_not_matter():
    """A field report: four shafts, damping ratios of 0.035 to 0.12 %; three speeds are as good as a thousand."""
    J, k, c = (0.02, 0.35, 1.1, 2.4), (9e4, 8e5, 2.2e4), (0.12, 0.8, 0.36)
    data = {
        "inertias": {f"d{i}": {"J": one} for i, one in enumerate(J)},
        "shafts": {f"s{i}": {"between": [f"d{i}", f"d{i + 1}"], "stiffness": k[i], "damping": c[i]} for i in range(3)},
        "inputs": {"push": {"on": "d1"}},
    }
    torques = {("push", 3.0): 250.0, ("push", 6.0): 60.0}
    few, many = (order_response(from_dict(data), np.linspace(300, 3000, n) * RPM, "d1", torques) for n in (3, 1000))
    assert len(few.critical) == len(many.critical) > 3
    for one, other in zip(few.critical, many.critical, strict=True):
        assert (one.shaft, one.order, one.mode) == (other.shaft, other.order, other.mode)
        assert one.amplitude == pytest.approx(other.amplitude, rel=1e-6)
    for one, other in zip(few.largest, many.largest, strict=True):
        assert one.torque == pytest.approx(other.torque, rel=1e-4)


def test_a_mode_that_nothing_damps_has_no_bound(tmp_path):
    data = {
        "inertias": {"a": {"J": 0.2}, "b": {"J": 0.3}, "c": {"J": 0.1}},
        "shafts": {
            "bare": {"between": ["a", "b"], "stiffness": 4000.0}, "second": {"between": ["b", "c"], "stiffness": 9e5}
        },
        "inputs": {"push": {"on": "a"}},
    }  # fmt: skip
    found = order_response(from_dict(data), np.linspace(60, 300, 40), "a", {("push", 1.0): 5.0})
    assert {one.shaft for one in found.critical} == {"bare", "second"}
    assert all(one.torque == np.inf for one in (*found.critical, *found.largest))
    written = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert written["critical"][0]["torque"] is None
    assert "without bound" in str(found)
    found.save(tmp_path)


def test_an_end_of_the_range_is_told_and_a_bump_is_no_critical_speed():
    """The engine of the examples: its crank carries most at 6000 1/min; only order 4 meets a mode that stands out."""
    torques = {"engine_torque:2": 150, "engine_torque:4": 40}
    found = rm.order_response(ENGINE, "600:6000 1/min", torques, phases={"engine_torque:4": "30 deg"})
    assert {(one.order, one.mode) for one in found.critical} == {(4.0, 4)}
    crank = next(one for one in found.largest if one.shaft == "crank")
    assert crank.at_end
    assert crank.speed == pytest.approx(6000 * RPM)
    assert crank.fatigue == crank.peak_to_peak / 2
    assert "an end of the range" in str(found)


def test_extremes_over_a_common_period_and_without_one():
    rng = np.random.default_rng(2)
    orders = (0.5, 1.0, 2.5)
    amplitudes = rng.normal(size=(4, 3, 2)) + 1j * rng.normal(size=(4, 3, 2))
    high, low = extremes(amplitudes, orders)
    turn = np.linspace(0, 4 * np.pi, 200_001)
    for i, one in enumerate(amplitudes):
        values = (np.exp(1j * np.outer(turn, orders)) @ one).real
        np.testing.assert_allclose(high[i], values.max(axis=0), rtol=1e-4)
        np.testing.assert_allclose(low[i], values.min(axis=0), rtol=1e-4)
    high, low = extremes(amplitudes[:, :2], (1.0, np.sqrt(2)))
    np.testing.assert_allclose(high, np.abs(amplitudes[:, :2]).sum(axis=1))
    np.testing.assert_allclose(low, -high)


def test_an_imposed_speed_is_no_torque():
    """A disc that is turned at 1 rad/s of order 1 by its motion: the shaft carries k·|θ| of a spring to a free disc."""
    data = {
        "inertias": {"turned": {"J": 1.0}, "free": {"J": 0.1}},
        "shafts": {"s": {"between": ["turned", "free"], "stiffness": 1000.0, "damping": 0.5}},
        "inputs": {"speed": {"on": "turned", "measures": "speed"}},
        "effects": [{"kind": "imposed_motion", "at": "inertias.turned"}],
    }
    found = rm.order_response(from_dict(data), np.linspace(40, 90, 30), {"speed:1": "60 deg/s"})
    assert found.excited_by == {"speed": "speed"}
    w = found.speeds
    twist = np.pi / 3 / (1j * w) * -0.1 * w**2 / (1000 + 0.5j * w - 0.1 * w**2)
    np.testing.assert_allclose(found.peak_torques[:, 0], np.abs((1000 + 0.5j * w) * twist), rtol=1e-6)
    assert "the speed of speed is imposed" in str(found)
    with pytest.raises(InputError, match="does not fit"):
        rm.order_response(from_dict(data), np.linspace(40, 90, 30), {"speed:1": "5 N*m"})


# --- Torques by order over speed and load.


def test_a_table_over_speed_and_load(tmp_path):
    """Linear between rows, in its own units; the same as the function of speed that made it."""
    table = tmp_path / "order_2.csv"
    rows = [f"{n},{load},{1e-3 * load * n:.6f},{n / 100}" for load in (50, 100) for n in (500, 2000, 7000)]
    table.write_text("speed [1/min],load [%],torque [daN*m],phase [deg]\n" + "\n".join(rows) + "\n")

    def stated(speeds):
        n = speeds / RPM
        ends = np.array([500, 2000, 7000.0])
        values = 10 * 1e-3 * 75 * ends * np.exp(1j * np.radians(ends / 100))
        return np.interp(n, ends, values.real) + 1j * np.interp(n, ends, values.imag)

    one = rm.order_response(ENGINE, "600:6000:50 1/min", {"engine_torque:2": str(table)}, load="75 %")
    other = rm.order_response(ENGINE, "600:6000:50 1/min", {"engine_torque:2": stated})
    asked = np.linspace(600, 6000, 50) * RPM
    values = [found.peak_torques[np.searchsorted(found.speeds, asked)] for found in (one, other)]
    np.testing.assert_allclose(*values, rtol=1e-6)
    same = rm.order_response(ENGINE, "600:6000:50 1/min", {"engine_torque:2": str(table)}, load=1.0)
    assert same.peak_torques.max() > 1.2 * one.peak_torques.max()


@pytest.mark.parametrize(
    ("text", "speed", "load", "said"),
    [
        ("speed,torque [N*m]\n600,1\n6000,2\n", "600:6000 1/min", None, "speed.*has no unit"),
        ("speed [1/min],force\n600,1\n6000,2\n", "600:6000 1/min", None, "has no column 'torque'"),
        ("speed [1/min],torque [kg]\n600,1\n6000,2\n", "600:6000 1/min", None, "does not fit"),
        ("speed [1/min],torque [N*m]\n600,1\n3000,2\n", "600:6000 1/min", None, "covers 600 to 3000 1/min"),
        ("speed [1/min],torque,load\n600,1,1\n6000,2,1\n", "600:6000 1/min", None, "is a table over load"),
        ("speed [1/min],torque,load\n600,1,1\n6000,2,1\n", "600:6000 1/min", 2, "2 is not in"),
        ("speed [1/min],torque\n600,1\n600,2\n", "600:6000 1/min", None, "one speed twice"),
    ],
)
def test_what_is_wrong_in_a_table_is_said(tmp_path, text, speed, load, said):
    table = tmp_path / "order.csv"
    table.write_text(text)
    with pytest.raises(InputError, match=said):
        rm.order_response(ENGINE, speed, {"engine_torque:2": str(table)}, load=load)


def test_check_finds_what_the_run_would(capsys):
    """An unknown inertia, order or input is found before anything is computed."""
    words = ["--speed", "600:6000 1/min", "--check"]
    for command, more, said in (
        ("campbell", ["--of", "crankshat"], "did you mean 'crankshaft'"),
        ("campbell", ["--orders", "0"], "are no orders"),
        ("response", ["--torques", "engine:2=5"], "did you mean 'engine_torque'"),
        ("response", ["--torques", "engine_torque:2=5", "--of", "crank_shaft"], "did you mean 'crankshaft'"),
        ("response", ["--torques", "engine_torque:2=no_such.csv"], "no_such.csv"),
    ):
        assert main([command, str(ENGINE), *words, *more]) == 2
        assert said in capsys.readouterr().err
