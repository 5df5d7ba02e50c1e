"""Two loggers of one motion: the offset of the second one's clock, against an offset put in."""

import re
from dataclasses import replace

import numpy as np
import pytest

import rigmatch as rm
from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.loggers import joined, with_clocks
from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.read import csv_text
from modelling.recordings.recording import Recording
from modelling.simulation.simulate import simulate

NOISE = {"motor_speed": 0.02, "load_speed": 0.02}
LATE = 0.4653  # s, no multiple of either sampling interval


def drive():
    return from_dict({
        "inertias": {"motor": {"J": 0.1, "drag": {"value": 0.02, "tolerance": 0.5}}, "load": {"J": 1.0}},
        "shafts": {
            "link": {"between": ["motor", "load"], "stiffness": {"value": 200, "tolerance": 0.2}, "damping": 0.5}
        },
        "inputs": {"torque": {"on": "motor"}},
        "sensors": {name: {"measures": "speed", "of": name[:-6], "uncertainty": u} for name, u in NOISE.items()},
    })  # fmt: skip


@pytest.fixture(scope="module")
def loggers():
    """The truth is 10 % stiffer than the model says; the second logger samples at another rate."""
    rng = np.random.default_rng(3)
    truth = drive().with_values({"shafts.link.stiffness": 220.0})
    time = np.arange(3000) * 2e-3
    torque = 6 * np.sign(np.sin(2 * np.pi * 0.7 * time)) + 3 * np.sin(2 * np.pi * (1 + 0.8 * time) * time)
    fine = simulate(truth, time, {"torque": torque})
    other = np.arange(1800) * 3e-3 + 0.2
    speed = np.interp(other, time, fine["load_speed"]) + NOISE["load_speed"] * rng.standard_normal(len(other))
    first = fine["motor_speed"] + NOISE["motor_speed"] * rng.standard_normal(len(time))
    return [
        Recording(time, {"torque": torque, "motor_speed": first}, source="a.csv"),
        Recording(other + LATE, {"load_speed": speed}, source="b.csv"),
    ]


def test_offset_is_found_before_anything_is_fitted(loggers):
    whole = joined(drive(), loggers)
    assert whole.clock_groups == (("load_speed",),)
    assert (whole.time[0], whole.time[-1]) == pytest.approx((0.2, 5.597), abs=0.02)
    measured = np.isfinite(whole["load_speed"])
    assert measured.mean() == pytest.approx(2 / 3, abs=0.01)  # every 3 ms of every 2 ms: no noise counts twice
    (note,) = whole.notes
    late = float(note.split("clock is ")[1].split(" s")[0])
    assert late == pytest.approx(LATE, abs=0.02)  # of a model that is not fitted yet


@pytest.mark.parametrize("logger", [0, 1])
def test_the_reference_of_a_controller_is_handed_on_whichever_logger_has_it(loggers, logger):
    """A reference of 3·t on the motion's clock stays that, on the further logger's clock as well."""
    controlled = drive()
    controlled = replace(controlled, inputs=tuple(replace(part, reference="wanted") for part in controlled.inputs))
    late = (0.0, LATE)[logger]
    parts = list(loggers)
    wanted = {"wanted": 3 * (parts[logger].time - late)}
    parts[logger] = replace(parts[logger], channels=parts[logger].channels | wanted)
    whole = joined(controlled, parts)
    assert whole.clock_groups == (("load_speed",),)
    np.testing.assert_allclose(whole["wanted"], 3 * whole.time, atol=3 * 0.02)


def test_files_of_two_loggers_are_read_with_the_reference(loggers, tmp_path):
    model = drive()
    model = replace(model, inputs=tuple(replace(part, reference="wanted") for part in model.inputs))
    units = {"torque": "N*m", "motor_speed": "rad/s", "load_speed": "rad/s", "wanted": "1/min"}
    extra = {"wanted": 300 * np.sin(loggers[0].time)}
    for logger, more in zip(loggers, (extra, {}), strict=True):
        text = csv_text(logger.time, logger.channels | more, units)
        (tmp_path / logger.source).write_text(text, encoding="utf-8")
    whole = rm.read_recording(f"{tmp_path / 'a.csv'}+{tmp_path / 'b.csv'}", model)
    np.testing.assert_allclose(whole["wanted"], np.pi / 30 * 300 * np.sin(whole.time), rtol=1e-6, atol=1e-6)


def test_what_the_correlation_leaves_is_fitted_and_no_cause(loggers):
    whole = joined(drive(), loggers)
    taken_out = float(whole.notes[0].split("clock is ")[1].split(" s")[0])
    found = diagnose(drive(), [whole])
    assert (found.verdict, found.causes) == ("adequate", [])
    (name,) = set(found.parameters) - set(drive().uncertain)
    left = found.parameters[name]
    assert left.value == pytest.approx(LATE - taken_out, abs=max(4 * left.standard_uncertainty, 2e-4))
    assert left.standard_uncertainty < 1e-3
    assert found.parameters["shafts.link.stiffness"].value == pytest.approx(220.0, rel=0.01)
    assert found.extended.effects == ()


def test_the_clock_of_each_logger_is_uncertain_once(loggers):
    whole = joined(drive(), loggers)
    (effect,) = with_clocks(drive(), [whole, whole]).effects
    assert effect.at == "sensors.load_speed"
    assert with_clocks(drive(), [loggers[0]]).effects == ()


def test_loggers_that_cannot_be_joined_are_named(loggers):
    with pytest.raises(InputError, match="no logger recorded all inputs"):
        joined(drive(), loggers[1:])
    with pytest.raises(InputError, match=r"a\.csv: has no sensor that the other logger lacks"):
        joined(drive(), [loggers[0], replace(loggers[0])])


def steady_load(time):
    """A drive under a load that repeats every 0.25 s, from its own closed form: J·s + d with a sum of sines."""
    torque, speed = np.zeros_like(time), np.zeros_like(time)
    for order in (1, 2, 3):
        w = 2 * np.pi * 4 * order
        response = 1 / (0.5 + 1j * w * 0.02)
        torque += np.sin(w * time)
        speed += np.imag(response * np.exp(1j * w * time))
    return torque, speed


ROTOR = {
    "inertias": {"rotor": {"J": 0.02, "drag": 0.5}},
    "inputs": {"torque": {"on": "rotor"}},
    "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": 0.02}},
}


def test_a_clock_that_a_periodic_load_leaves_open_is_not_taken_out():
    """Two offsets a period apart correlate alike: both are said, and the second logger stays where it is."""
    time = np.arange(2000) * 2e-3
    torque, speed = steady_load(time)
    parts = [Recording(time, {"torque": torque}, source="a"), Recording(time + 0.02, {"speed": speed}, source="b")]
    whole = joined(from_dict(ROTOR), parts)
    (note,) = whole.notes
    assert "nothing is taken out" in note
    said = [
        float(value) * (1 if late == "late" else -1) for value, late in re.findall(r"([\d.e-]+) s (late|early)", note)
    ]
    assert len(said) == 2
    for value in said:  # 0.02 s late, or so many periods of 0.25 s more or less
        assert abs((value - 0.02 + 0.125) % 0.25 - 0.125) < 3e-3
    there = np.isfinite(whole["speed"]) & (whole.time > 0.1)
    np.testing.assert_allclose(whole["speed"][there], steady_load(whole.time[there] - 0.02)[1], atol=0.02)


def test_one_clock_that_is_stated_is_neither_found_nor_fitted(loggers):
    whole = joined(drive(), loggers, same_clock=True)
    assert whole.clock_groups == ()
    assert with_clocks(drive(), [whole]).effects == ()
    assert "by the channel file" in whole.notes[0]
    there = np.isfinite(whole["load_speed"])
    kept = np.interp(whole.time[there], loggers[1].time, loggers[1]["load_speed"])
    np.testing.assert_allclose(whole["load_speed"][there], kept)


@pytest.mark.parametrize("times", [("time", "time"), ("t", "t"), ("Zeit", "time"), ("t", "Zeit")])
@pytest.mark.parametrize("turned", [False, True])
def test_two_files_with_names_of_their_own(loggers, tmp_path, times, turned):
    names = ({"torque": "T real", "motor_speed": "n EM"}, {"load_speed": "n mech"})
    for path, logger, own, time in zip(("a.csv", "b.csv"), loggers, names, times, strict=True):
        columns = {own[name]: values for name, values in logger.channels.items()}
        units = dict.fromkeys(columns, "rad/s") | {"T real": "N*m"}
        text = csv_text(logger.time, {name: columns[name] for name in columns}, units)
        (tmp_path / path).write_text(text.replace("time [s]", f"{time} [s]", 1))
    rows = "".join(f'{name} = "{own}"\n' for part in names for name, own in part.items())
    (tmp_path / "channels.toml").write_text(f'[channels]\ntime = "{times[0]}"\n{rows}')
    files = "+".join(str(tmp_path / name) for name in (("b.csv", "a.csv") if turned else ("a.csv", "b.csv")))
    got = rm.read_recording(files, drive(), tmp_path / "channels.toml")
    assert {"torque", "motor_speed", "load_speed"} <= set(got.channels)
    assert got.clock_groups == (("load_speed",),)


def test_a_name_that_no_file_has_or_both_have_is_one_line(loggers, tmp_path):
    for path, logger in zip(("a.csv", "b.csv"), loggers, strict=True):
        columns = logger.channels | {"n": logger.time}
        (tmp_path / path).write_text(csv_text(logger.time, columns, dict.fromkeys(columns, "")))
    files = f"{tmp_path / 'a.csv'}+{tmp_path / 'b.csv'}"
    for name, line in (("speed", "is in none of"), ("n", "is in .*a.csv and .*b.csv; rename")):
        (tmp_path / "channels.toml").write_text(f'[channels]\nload_speed = "{name}"\n')
        with pytest.raises(InputError, match=line):
            rm.read_recording(files, drive(), tmp_path / "channels.toml")
