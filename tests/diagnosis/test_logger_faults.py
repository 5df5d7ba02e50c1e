"""A recording with one fault of a logger, drawn: held, lost, clipped, rounded, late or filtered values are named with
their size, by the test whose data show them. Two inertias, and filters by their poles, with own exact steps."""

import re
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from matching.diagnosis.audit import notes_on_times
from matching.diagnosis.base import fit_base
from matching.diagnosis.data import prepare_data
from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.settings import DiagnosisSettings
from matching.diagnosis.times import channel_times
from modelling.model_file import from_dict
from modelling.recordings.channel_faults import likeliest_fault
from modelling.recordings.read import read_recording

STEP, COUNT, FINE = 1e-3, 12000, 4
NOISE = {"first_speed": 0.02, "second_speed": 0.02, "torque": 0.3}
FAULTS = ("repeats every value", "lacks", "end of its range", "rounded", "is recorded", "passes a filter", "stuck")


@dataclass
class Drive:
    """Two inertias on a shaft, of which one sensor may be filtered."""

    J: tuple[float, float]
    k: float
    c: float
    drag: float

    def readings(self, torque, corner=0.0, order=0):
        """Speeds and torque (t, 3) under a torque (t,), straight between samples; the shaft's by a Butterworth filter
        of poles ω·exp(jπ(2i + n − 1)/2n), in sections of second order."""
        a = np.zeros((3 + order, 3 + order))
        a[0] = [-(self.c + self.drag) / self.J[0], self.c / self.J[0], -1 / self.J[0], *[0] * order]
        a[1] = [self.c / self.J[1], -(self.c + self.drag) / self.J[1], 1 / self.J[1], *[0] * order]
        a[2, :2] = self.k, -self.k
        b = np.zeros(3 + order)
        b[0] = 1 / self.J[0]
        shaft = np.zeros(3 + order)
        shaft[:3] = self.c, -self.c, 1.0
        signal, omega = shaft, 2 * np.pi * corner
        for i in range(order // 2):
            x = 3 + 2 * i
            own = np.zeros(3 + order)
            own[x] = 1.0
            a[x, x + 1] = 1.0
            a[x + 1] = omega**2 * (signal - own)
            a[x + 1, x + 1] = 2 * omega * np.cos(np.pi * (2 * i + order + 1) / (2 * order))
            signal = own
        if order % 2:
            own = np.zeros(3 + order)
            own[-1] = 1.0
            a[-1] = omega * (signal - own)
            signal = own
        n = len(a)
        whole = np.zeros((n + 2, n + 2))  # with the torque and its slope as states
        whole[:n, :n], whole[:n, n], whole[n, n + 1] = a, b, 1.0
        ahead = expm(whole * STEP)[:n]
        x, out = np.zeros(n), np.empty((len(torque), 3))
        slopes = np.append(np.diff(torque), 0.0) / STEP
        for t, (value, slope) in enumerate(zip(torque, slopes, strict=True)):
            out[t] = x[0], x[1], signal @ x
            x = ahead @ np.concatenate([x, [value, slope]])
        return out


def drawn(rng):
    J = tuple(rng.uniform(0.05, 0.2, 2))
    f = rng.uniform(20, 40)
    k = (2 * np.pi * f) ** 2 / (1 / J[0] + 1 / J[1])
    return Drive(J, k, 2 * 0.03 * k / (2 * np.pi * f), rng.uniform(0.05, 0.2))


def torque_of(rng):
    time = np.arange(COUNT) * STEP
    lines = rng.uniform(0.5, 120, 40)
    return sum(rng.uniform(3, 8) * np.sin(2 * np.pi * f * time + rng.uniform(0, 7)) for f in lines) * np.minimum(
        time / 0.5, 1
    )


def written(drive, rng, folder, change=None, corner=0.0, order=0):
    """A model that is up to 10 % off, and the recording as a file; ``change`` acts on columns in place."""
    torque = torque_of(rng)
    readings = drive.readings(torque, corner, order)
    columns = {"drive": torque} | dict(zip(NOISE, readings.T.copy(), strict=True))
    for name, size in NOISE.items():
        columns[name] = columns[name] + size * rng.standard_normal(COUNT)
    if change:
        change(columns)
    units = {"drive": "N*m", "torque": "N*m"}
    lines = [",".join(["time [s]", *(f"{name} [{units.get(name, 'rad/s')}]" for name in columns)])]
    for t, row in enumerate(np.column_stack(list(columns.values()))):
        lines.append(",".join([f"{t * STEP:.6g}", *("" if np.isnan(value) else f"{value:.7g}" for value in row)]))
    (folder / "r.csv").write_text("\n".join(lines))

    def off(value):
        value *= rng.uniform(0.9, 1.1)
        return {"value": value, "lower": 0.5 * value, "upper": 2 * value}

    system = from_dict({
        "inertias": {name: {"J": off(J), "drag": off(drive.drag)} for name, J in zip(("a", "b"), drive.J, strict=True)},
        "shafts": {"s": {"between": ["a", "b"], "stiffness": off(drive.k), "damping": off(drive.c)}},
        "inputs": {"drive": {"on": "a"}},
        "sensors": {"first_speed": {"measures": "speed", "of": "a", "uncertainty": 0.02},
                    "second_speed": {"measures": "speed", "of": "b", "uncertainty": 0.02},
                    "torque": {"measures": "torque", "of": "s", "uncertainty": 0.3}},
    })  # fmt: skip
    return system, read_recording(folder / "r.csv", system)


def said(system, recording, times=False):
    """What is said of faults, by the file and the preparation; with ``times`` by pairs of channels."""
    data, notes = prepare_data(system, [recording])
    notes = [*recording.notes, *notes]
    if times:
        fit = fit_base(system, data, DiagnosisSettings())
        notes += notes_on_times(system, channel_times(system, fit), [])
    return [note for note in notes if any(words in note for words in FAULTS)]


@pytest.fixture
def rng():
    return np.random.default_rng()


def test_a_clean_recording_has_no_fault(rng, tmp_path):
    assert said(*written(drawn(rng), rng, tmp_path), times=True) == []


def test_held_values_are_named_with_their_rows(rng, tmp_path):
    every = int(rng.integers(2, 8))

    def held(columns):
        columns["torque"] = np.repeat(columns["torque"][::every], every)[:COUNT]

    (note,) = said(*written(drawn(rng), rng, tmp_path, held))
    assert note.startswith(f"torque repeats every value over {every} rows")


def test_lost_values_are_counted(rng, tmp_path):
    lost = np.sort(rng.choice(np.arange(10, COUNT), int(rng.integers(1, 200)), replace=False))

    def drop(columns):
        columns["second_speed"][lost] = np.nan

    (note,) = said(*written(drawn(rng), rng, tmp_path, drop))
    assert note.startswith(f"second_speed lacks {len(lost)} value")
    assert f"first at {lost[0] * STEP:g} s" in note


def test_the_end_of_a_range_is_named_when_it_is_reached(rng, tmp_path):
    def clip(columns):
        torque = columns["torque"] = columns["torque"] + 60 * np.sin(2 * np.pi * 0.5 * np.arange(COUNT) * STEP)
        columns["torque"] = np.clip(torque, *(np.quantile(torque, [1 - share, share])))

    share = rng.uniform(0.7, 0.85)
    notes = said(*written(drawn(rng), rng, tmp_path, clip))
    assert notes
    assert all(note.startswith("torque is at the end of its range from") for note in notes)


@pytest.mark.parametrize("coarse", [True, False])
def test_a_coarse_step_is_named_with_the_uncertainty_it_needs(coarse, rng, tmp_path):
    step = 0.02 * np.sqrt(12) * (rng.uniform(1.3, 3) if coarse else rng.uniform(0.1, 0.8))

    def rounding(columns):
        columns["first_speed"] = step * np.round(columns["first_speed"] / step)

    notes = said(*written(drawn(rng), rng, tmp_path, rounding))
    assert len(notes) == coarse
    for note in notes:
        assert note.startswith("first_speed is rounded to steps of")
        assert float(note.rsplit("= ", 1)[1]) == pytest.approx(step / np.sqrt(12), rel=0.01)


def test_a_late_channel_is_named_with_its_delay_and_line(rng, tmp_path):
    late = int(rng.integers(2, 9))

    def delay(columns):
        columns["torque"] = np.concatenate([np.full(late, columns["torque"][0]), columns["torque"][:-late]])

    (note,) = said(*written(drawn(rng), rng, tmp_path, delay), times=True)
    value, uncertainty = map(float, re.match(r"torque is recorded (\S+) ± (\S+) s later than", note).groups())
    assert abs(value - late * STEP) < max(3 * uncertainty, 0.02 * late * STEP)
    assert '[[effects]] kind = "sensor_delay", at = "sensors.torque"' in note


@pytest.mark.long
@pytest.mark.parametrize("order", [2, 4])
def test_a_filter_is_named_with_its_order_and_corner(order, rng, tmp_path):
    """One of first order is a cause of its own, ``lag``."""
    corner = rng.uniform(15, 60)
    system, recording = written(drawn(rng), rng, tmp_path, corner=corner, order=order)
    (note,) = (note for note in diagnose(system, [recording]).notes if "passes a filter" in note)
    found, value = re.search(r"torque passes a filter of order (\d) with its corner near (\S+) Hz", note).groups()
    assert int(found) == order
    assert float(value) == pytest.approx(corner, rel=0.05)


KINDS = {
    "filter": lambda v, size, order: bilinear(v, size, order),
    "clipped": lambda v, size, _: np.clip(v, -size, size),
    "delay": lambda v, size, _: np.interp(np.arange(len(v)) * STEP - size, np.arange(len(v)) * STEP, v),
    "factor": lambda v, size, _: size * v,
    "zero": lambda v, size, _: v + size,
}


def bilinear(values, corner, order):
    """A Butterworth filter of even or first order, section by section, by the trapezoidal rule at its own equations."""
    omega = 2 / STEP * np.tan(np.pi * corner * STEP)
    for i in range(order // 2):
        damping = np.sin(np.pi * (2 * i + 1) / (2 * order))
        a = np.array([[0.0, 1.0], [-(omega**2), -2 * omega * damping]])
        inverse = np.linalg.inv(np.eye(2) - a * STEP / 2)
        ahead, b = inverse @ (np.eye(2) + a * STEP / 2), inverse @ np.array([0.0, omega**2]) * STEP / 2
        x, out = np.array([values[0], 0.0]), [values[0]]
        for before, now in pairwise(values):
            x = ahead @ x + b * (before + now)
            out.append(x[0])
        values = np.array(out)
    return values


@pytest.mark.parametrize(
    ("kind", "lowest", "highest", "order"),
    [("filter", 15, 100, 2), ("filter", 15, 100, 4), ("clipped", 0.3, 0.8, 1), ("delay", 2e-3, 9e-3, 1),
     ("factor", 0.3, 0.9, 1), ("zero", 5, 20, 1)],
)  # fmt: skip
def test_a_channel_next_to_its_truth_has_one_fault(kind, lowest, highest, order, rng):
    true = drawn(rng).readings(torque_of(rng)[:4000])[:, 2]
    size = rng.uniform(lowest, highest) * (np.abs(true).max() if kind == "clipped" else 1.0)
    read = KINDS[kind](true, size, order) + 0.3 * rng.standard_normal(len(true))
    found = likeliest_fault("torque", "N*m", [(true, read, STEP)], 0.3)
    assert (found.kind, found.order) == (kind, order)
    assert found.size == pytest.approx(size, rel=0.05)


def test_a_right_channel_and_one_with_another_fault_have_none(rng):
    true = drawn(rng).readings(torque_of(rng)[:4000])[:, 2]
    noise = 0.3 * rng.standard_normal(len(true))
    dead = np.sign(true) * np.maximum(np.abs(true) - 3, 0)
    assert likeliest_fault("torque", "N*m", [(true, true + noise, STEP)], 0.3) is None
    assert likeliest_fault("torque", "N*m", [(true, dead + noise, STEP)], 0.3) is None
