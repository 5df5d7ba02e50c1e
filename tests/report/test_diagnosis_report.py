"""Page, figures, terminal and JSON of a diagnosis, from one recording that SciPy made of a flywheel in thick air."""

import argparse
import contextlib
import io
import json
import re
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from axis_units import check
from result_schema import check_schema
from scipy.integrate import solve_ivp

from matching.cli import main
from matching.commands import made_of
from matching.diagnosis.diagnose import diagnose
from matching.report.diagnosis import CAPTIONS, _cause, answer, measured, pictures, report, to_correct
from matching.report.page import page

INERTIA, DRAG, AIR, NOISE = 0.2, 0.05, 0.004, 0.02
MODEL = """title = "Flywheel"
[inertias.wheel]
J = 0.2
drag = { value = 0.06, tolerance = 0.5 }
[inputs.motor_torque]
on = "wheel"
[sensors.wheel_speed]
measures = "speed"
of = "wheel"
uncertainty = 0.02
"""


def torque(time):
    return 6 + 5 * np.sin(2 * np.pi * 0.4 * time) + 3 * np.sin(2 * np.pi * (0.2 * time + 0.15 * time**2))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flywheel")
    time = np.arange(0, 10, 0.005)
    given = torque(time)

    def motion(t, speed):
        return (np.interp(t, time, given) - DRAG * speed - AIR * speed * abs(speed)) / INERTIA

    speed = solve_ivp(motion, (0, 10), [5.0], t_eval=time, rtol=1e-9, atol=1e-9, max_step=0.01).y[0]
    speed = speed + NOISE * np.random.default_rng(1).standard_normal(len(time))
    speed[400:440] = speed[400]  # a channel that stood still for 0.2 s
    rows = np.delete(np.column_stack([time, given, speed]), slice(900, 912), axis=0)  # and a short gap
    header = "time [s],motor_torque [N*m],wheel_speed [rad/s]"
    np.savetxt(folder / "recording.csv", rows, delimiter=",", header=header, comments="", fmt="%.9g")
    (folder / "model.toml").write_text(MODEL)
    return folder


@pytest.fixture(scope="module")
def run(folder: Path) -> tuple[str, list]:
    """What the command prints; the diagnosis that it draws, with the figures by name."""
    drawn: list = []

    def kept(system, *arguments, **options):
        found = diagnose(system, *arguments, **options)
        drawn.extend((found, {name: picture.draw() for name, picture in pictures(found).items()}))
        return found

    words = ["diagnose", folder / "model.toml", folder / "recording.csv", "--out", folder / "out"]
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as out:
        patch.setattr("matching.diagnosis.diagnose.diagnose", kept)
        assert main([str(word) for word in words]) in (0, None)
    return out.getvalue(), drawn


@pytest.fixture(scope="module")
def said(run: tuple[str, list]) -> str:
    return run[0]


@pytest.fixture(scope="module")
def result(folder: Path, said: str) -> dict:
    return json.loads((folder / "out" / "diagnosis.json").read_text())


def test_terminal_and_page_lead_with_the_same_sentence(folder: Path, said: str, result: dict) -> None:
    first = said.splitlines()[1]
    assert said.startswith("EXPLAINED")
    assert first == result["answer"] == answer(result)
    check_schema("diagnose", result)
    found = re.fullmatch(
        r"The inertia wheel has drag that grows with the square of speed by (\S+) ± (\S+) N·m·s²/rad²; with it the "
        r"error of wheel_speed falls from (\S+) to (\S+) times the noise on held-out data\.",
        first,
    )
    assert found is not None
    value, u, before, after = (float(text) for text in found.groups())
    assert abs(value - AIR) < 4 * u < 0.1 * AIR
    assert before > 10
    assert after < 1.1
    page = (folder / "out" / "report.html").read_text()
    assert page.index(first) < page.index("<h3")
    error = result["errors"]["wheel_speed"]
    in_times_the_noise = float(re.search(r"<td>wheel_speed</td>.*?([\d.]+)</td></tr>", page, re.DOTALL).group(1))
    assert in_times_the_noise == pytest.approx(error["after_holdout"] / error["noise"], rel=5e-3)


def test_result_holds_the_contract_and_the_gain_in_fidelity(result: dict) -> None:
    assert set(result) >= {"verdict", "causes", "errors", "gain", "next_recording", "extended_model", "fidelity"}
    assert set(result["gain"]) == {"nrmse_before", "nrmse_after", "noise_floor"}
    fidelity = result["fidelity"]
    assert fidelity["before"]["R_RVM"] < fidelity["after"]["R_RVM"] <= 1
    assert fidelity["after"]["R_RVM"] == pytest.approx(fidelity["noise_floor"]["R_RVM"], abs=2e-3)
    signal = fidelity["before"]["signals"][0]
    assert signal["name"] == "wheel_speed"
    assert {"R_NRMSE", "R_tau", "delay"} <= set(signal)
    best = min(result["candidates"], key=lambda one: one["chi_square"])
    assert (best["kind"], best["at"]) == ("quadratic_drag", "inertias.wheel")


def test_terminal_tells_the_fidelity_and_every_sensor(said: str, result: dict) -> None:
    rows = {line.split()[0]: line.split()[1:] for line in said.splitlines() if line}
    assert rows["R_RVM"][0] == f"{100 * result['fidelity']['before']['R_RVM']:.2f}"
    error = result["errors"]["wheel_speed"]
    assert float(rows["wheel_speed"][-1]) == pytest.approx(error["after_holdout"] / error["noise"], rel=5e-3)


def test_page_and_terminal_tell_what_was_mended(folder: Path, said: str, result: dict) -> None:
    assert any("from 2 to 2.195 s: it is stuck" in note for note in result["notes"])
    page = (folder / "out" / "report.html").read_text()
    for note in result["notes"]:
        assert note in page
        assert f"note: {note}" in said


def test_page_is_whole_and_needs_nothing_else(folder: Path, said: str) -> None:
    page = (folder / "out" / "report.html").read_text()
    links: list[str] = []
    closed: list[str] = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag, attributes):
            given = dict(attributes)
            links.extend(given[key] for key in ("src", "href") if key in given)

        def handle_endtag(self, tag):
            closed.append(tag)

    Reader().feed(page)
    assert all(link.startswith("#") for link in links)
    anchors = [link[1:] for link in links if link.startswith("#")]
    assert all(f'id="{name}"' in page for name in anchors)
    assert closed[-1] == "html"
    assert "nan" not in re.sub(r"<svg.*?</svg>|<script.*?</script>", "", page, flags=re.DOTALL).lower().split()
    for word in ("Instead of", "Fit report", "Notes", "What to do next"):
        assert word in page
    for name in ("errors", "unseen", "balance", "time", "where", "spectrum"):
        own = folder / "out" / "figures" / f"{name}.svg"
        assert own.read_text().lstrip().startswith("<?xml")
        assert f'id="figure-{name}"' in page


@pytest.mark.parametrize(
    ("value", "u", "said"),
    [
        (0.0213456, 0.0011, "0.0213 ± 0.0011 rad"),
        (1234.5, 130.0, "1230 ± 130 rad"),
        (-2.0, 0.0996, "-2.00 ± 0.10 rad"),
        (6.285e7, 1.2e4, "6.2850e7 ± 0.0012e7 rad"),
        (3.0, None, "3 rad"),
    ],
)
def test_values_are_rounded_to_two_digits_of_their_uncertainty(value: float, u: float | None, said: str) -> None:
    assert measured({"value": value, "standard_uncertainty": u, "unit": "rad"}) == said


def errors(before: float, after: float) -> dict:
    return {"torque": {"noise": 0.5, "before_holdout": 0.5 * before, "after_holdout": 0.5 * after}}


def test_a_diagnosis_that_was_ended_early_does_not_rule_out_what_it_has_not_tried() -> None:
    errors = {"speed": {"noise": 0.1, "before": 2.0, "after": 2.0, "before_holdout": 2.0, "after_holdout": 2.0}}
    result = {"verdict": "unexplained", "causes": [], "errors": errors, "notes": []}
    assert answer(result).startswith("None of the known effects explains")
    ended = answer(result | {"notes": ["interrupted: the best answer so far"]})
    assert "that were tried before the end" in ended
    assert "known" not in ended


def test_several_sensors_have_a_pooled_figure_and_those_that_gain_and_lose_most() -> None:
    shared = {"kind": "lag", "at": ["sensors.a", "sensors.b"], "alternatives": [],
              "parameters": {"time_constant": {"value": 8e-3, "standard_uncertainty": 1e-4, "unit": "s"}}}  # fmt: skip
    ranges = {"a": {"noise": 0.02, "before_holdout": 3.0, "after_holdout": 0.5},
              "b": {"noise": 0.02, "before_holdout": 0.5, "after_holdout": 0.6}}  # fmt: skip
    gain = {"nrmse_before": 0.7, "nrmse_after": 0.09}
    assert answer({"verdict": "unexplained", "causes": [shared], "errors": ranges, "gain": gain}) == (
        "Each of the sensors a and b follows with a first-order lag of 0.00800 ± 0.00010 s; with it the error of all "
        "sensors falls from 70.00 % to 9.00 % of their range, that of a falls from 150 to 25 and that of b rises "
        "from 25 to 30 times the noise on held-out data, and an unexplained error remains."
    )


@pytest.mark.parametrize("causes", [True, False])
def test_candidates_in_no_causes_place_stand_on_the_page_with_the_reason(result: dict, causes: bool) -> None:
    """A page of several causes, or of none, has candidates that were fitted alone and compete with no cause."""
    alone = {
        "kind": "sensor_gain", "at": ["sensors.a", "sensors.b"], "instead_of": None, "misfit": 47.11,
        "misfit_holdout": None, "chi_square": 1.0, "confidence": 0.0, "not_taken": "worse_unseen",
    }  # fmt: skip
    kept = {} if causes else {"causes": [], "verdict": "unexplained"}
    candidates = [*(result["candidates"] if causes else []), alone]
    text = page(report(result | kept | {"candidates": candidates}), {}, {})
    row = next(line for line in text.split("<tr>") if "47.11" in line)
    assert "sensors.a and sensors.b" in row
    assert "held-out data are met worse with it" in row
    assert "No candidate was worth a fit" not in text


def test_figures_hold_the_residuals_of_the_diagnosis(folder: Path, run: tuple[str, list]) -> None:
    diagnosis, drawn = run[1]
    assert set(drawn) == set(CAPTIONS) - {"discrepancy"}
    html = (folder / "out" / "report.html").read_text()
    for name in drawn:
        part = unescape(html.split(f'id="figure-{name}"')[1].split("</figure>")[0])
        assert f"<figcaption>{CAPTIONS[name]}" in part
        assert "<svg" in part
    (axes,) = drawn["errors"].axes
    error = diagnosis.errors["wheel_speed"]
    widths = [bar.get_x() + bar.get_width() for bar in axes.patches]
    assert widths == pytest.approx([error.before_holdout / NOISE, error.after_holdout / NOISE])
    data = diagnosis.plot_data
    for name, column, times, before, after in (
        ("time", slice(0, 4), data.before.time, data.residual_before, data.residual_after),
        ("unseen", slice(0, 2), data.holdout.time, data.holdout.before, data.holdout.after),
    ):
        lines = drawn[name].axes[-1].get_lines()[column]
        lines = lines[::2] if name == "time" else lines  # every other is the running mean
        for line, residual in zip(lines, (before, after), strict=True):
            ratio = residual[:, 0] / NOISE
            y = line.get_ydata()
            assert np.nanmax(y) == pytest.approx(np.nanmax(ratio))
            assert np.nanmin(y) == pytest.approx(np.nanmin(ratio))
            assert np.nansum(np.abs(y)) == pytest.approx(np.nansum(np.abs(ratio)))
            assert line.get_xdata()[0] == times[0]
            assert np.nanmax(line.get_xdata()) <= times[-1] + 1e-9


def test_axes_of_the_figures_are_in_the_units_they_name(run: tuple[str, list]) -> None:
    """Ten seconds at 200 samples a second."""
    drawn = run[1][1]
    times = [check(drawn[name], seconds=10.0, hertz=(0.01, 100)) for name in ("time", "unseen", "spectrum")]
    assert all(times)


def test_files_of_a_diagnosis_are_the_model_the_channels_and_every_logger(folder: Path) -> None:
    """Two loggers of one drive are two files."""
    (folder / "channels.toml").write_text("[channels]\n")
    (folder / "second.csv").write_text("time [s]\n")
    model, first, second = (str(folder / name) for name in ("model.toml", "recording.csv", "second.csv"))
    channels = str(folder / "channels.toml")
    arguments = argparse.Namespace(model=model, recordings=[f"{first}+{second}"], holdout=[first], channels=channels)
    made = [file for file, _ in made_of(arguments).files]
    assert made == [model, channels, first, second, first]


def test_a_reversed_sign_and_a_range_that_is_too_narrow_are_corrected_first() -> None:
    bound, free = {"value": 0.95, "note": "at the bound of its range"}, {"value": 2.0}
    gains = [
        ("input_gain", "inputs.motor", -0.98, 0.02),
        ("sensor_gain", "sensors.speed", 0.9, 0.02),
        ("sensor_gain", "sensors.torque", 1.1, 0.02),
        ("sensor_gain", ["sensors.speed", "sensors.torque"], -0.035, 0.062),  # the magnitude of a speed: no sign
        ("sensor_gain", "sensors.torque", -0.4, 0.9),
    ]
    result = {
        "causes": [
            {"kind": kind, "at": at, "parameters": {"factor": {"value": value, "standard_uncertainty": u}}}
            for kind, at, value, u in gains
        ],
        "parameters": {"shafts.side.damping": bound, "inertias.rotor.J": free},
        "errors": {name: {"noise": 0.1, "after": 0.11} for name in ("speed", "torque")},
    }
    sign, widen = to_correct(result)
    assert sign == "the sign of inputs.motor is probably reversed: change it in the channel file, and run again"
    assert widen.startswith("shafts.side.damping ends at the bound of its range: widen that in the model file")
    result["errors"]["torque"]["after"] = 0.5  # the factor explains only part of it
    assert to_correct(result) == [widen]
    assert to_correct({"causes": [], "parameters": {"inertias.rotor.J": free}, "errors": {}}) == []


def test_a_cause_that_is_not_sure_of_its_kind_is_something_with_a_shape() -> None:
    weak = {"kind": "hysteresis", "at": "shafts.link", "parameters": {}, "confidence": 0.3, "place_confidence": 0.96,
            "in_model": False, "gain": 5.0}  # fmt: skip
    curves = [
        {"at": "inertias.load", "over": "speed", "share": 0.5},
        {"at": "shafts.link", "over": "twist", "share": 0.38},
    ]
    row = _cause(weak, curves)
    assert row["cause"] == "something, most like hysteresis"
    assert row["in extended.toml"] == "no: its kind or its size is not certain"
    assert row["shape"] == "torque over the twist, 38 % of the rest"
    assert (row["there"], row["kind"]) == ("0.96", "0.30")
    answered = weak | {"in_model": True, "confidence": 0.7, "there": 1.0, "left": {"a": {"without": 9.0, "with": 3.0}}}
    row = _cause(answered, curves)
    assert (row["cause"], row["there"], row["kind"]) == ("hysteresis", "1.00", "0.70")
    assert row["left, in times the noise"] == "a 9 → 3"
    assert row["in extended.toml"] == "yes"
    assert _cause(weak | {"why_not": "by_chance"}, curves[:1])["in extended.toml"].startswith("no: unseen data gain")
