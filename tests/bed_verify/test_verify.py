"""Recordings of a controlled bed, made by equations of this file: as predicted, short, undetermined."""

import csv
import hashlib
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import unquote

import numpy as np
import pytest
from result_schema import check_schema
from scipy.linalg import expm

from matching.bed.verify import judge, read_recordings, snapshots
from matching.cli import main
from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from matching.match.loop import disturbing, linear_bed
from matching.match.responses import error_figures
from modelling.bed.controllers import STRUCTURES
from modelling.errors import InputError

EXAMPLE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "case.toml"
FINE = 4  # steps a sample: torques change within a sample, as they do on a bed
RECORDED = ("motor_speed", "side_left_torque", "side_right_torque")


@pytest.fixture(scope="module")
def case():
    found = load_case(EXAMPLE)
    structure = STRUCTURES["model_based"]
    values = {name: quantity.start for name, quantity in structure.quantities.items()}
    loop = replace(found.loop, structure=structure, values={**values, **found.loop.values})
    compared = tuple(pair for pair in found.compared if pair.input == "motor_torque")
    return replace(found, loop=loop, compared=compared)


def controlled_bed(case, law, torque, noise=0.0, gain=1.0):
    """Readings (t, 3) of the bed under a law, motor torque (t·2·FINE,) at half steps; ``gain`` of both dynamometers.

    Bed, law and dead time as one linear map from sample to sample; torques change within a sample.
    """
    parts, step = linear_bed(case), case.loop["sample_time"]
    k, bed = len(parts.dynamometers), parts.bed
    B = np.hstack([bed.commands, bed.torques])
    n, m = B.shape
    block = expm(np.block([[bed.A, B], [np.zeros((m, n + m))]]) * step / FINE)
    fine, push = block[:n, :n], block[:n, n:]
    motor = k + disturbing(case).index("motor_torque")
    later = [np.linalg.matrix_power(fine, FINE - 1 - j) for j in range(FINE)]
    steps = round(case.loop["dead_time"] / step * FINE - FINE / 2)  # less the half sample of hold
    delay = -(-steps // FINE)
    old, new = (sum(later[j] @ push[:, :k] for j in span) for span in (range(steps % FINE), range(steps % FINE, FINE)))
    A = np.linalg.matrix_power(fine, FINE)
    torques = np.stack([power @ push[:, motor] for power in later], axis=1)
    C = bed.readings[: 2 * k]
    keep = np.eye(len(law.A)) - law.L @ law.E
    x, q = len(law.A), law.known.index("motor_torque")
    size = n + k * delay + x
    own = slice(n + k * delay, size)
    u, of_torque = np.zeros((k, size)), law.Dw[:, q]
    u[:, :n], u[:, own] = (law.K @ law.L + law.Dy) @ C, law.K @ keep
    M, N = np.zeros((size, size)), np.zeros((size, FINE + 1))  # inputs: the torque now, then in the middle of each step
    M[:n, :n], M[:n, n : n + 2 * k], N[:n, 1:] = A, gain * np.hstack([old, new]), torques
    M[n : n + k * (delay - 1), n + k : n + k * delay] = np.eye(k * (delay - 1))
    M[n + k * (delay - 1) : n + k * delay], N[n + k * (delay - 1) : n + k * delay, 0] = u, of_torque
    M[own] = law.Bs @ u
    M[own, :n] += (law.A @ law.L + law.By) @ C
    M[own, own] += law.A @ keep
    N[own, 0] = law.Bw[:, q] + law.Bs @ of_torque
    rig = parts.rig.space
    read = rig.C[[rig.outputs.index(name) for name in RECORDED]]
    z, out = np.zeros(size), []
    for now in torque.reshape(-1, 2 * FINE):
        out.append(read @ z[: len(rig.A)])
        z = M @ z + N[:, 0] * now[0] + N[:, 1:] @ now[1::2]
    readings = np.array(out)
    return readings + noise * np.random.default_rng(5).normal(size=readings.shape) * np.array([0.1, 1.0, 1.0])


def excitation(count, step, top=35.0):
    """Noise of even density up to ``top`` (Hz), N·m, at steps (s)."""
    rng = np.random.default_rng(7)
    f = np.fft.rfftfreq(count, step)
    lines = np.where((f > 0.2) & (f < top), np.exp(2j * np.pi * rng.random(len(f))), 0)
    torque = np.fft.irfft(lines, count)
    return 30 * torque / torque.std()


@pytest.fixture(scope="module")
def record(case, tmp_path_factory):
    folder = tmp_path_factory.mktemp("bed")
    law = exported_controller(case).law

    def make(name, seconds=24, **how):
        path = folder / f"{name}.csv"
        if not path.exists():
            step = case.loop["sample_time"]
            torque = excitation(round(seconds / step) * 2 * FINE, step / FINE / 2)
            readings = controlled_bed(case, law, torque, **how)
            every = 4
            with path.open("w", newline="", encoding="utf-8") as file:
                writer = csv.writer(file)
                writer.writerow(
                    ["time [s]", "motor_torque [N*m]", "motor_speed [rad/s]", *(f"{n} [N*m]" for n in RECORDED[1:])]
                )
                for i in range(0, len(readings), every):
                    row = [i * step, torque[2 * i * FINE], *readings[i]]
                    writer.writerow([f"{value:.9g}" for value in row])
        return path

    return make


def test_a_bed_like_its_model_answers_as_predicted(case, record):
    found = judge(case, read_recordings([record("good", noise=0.02)], case))
    assert found.status == "as_predicted"
    error = found.errors[0]
    assert error.name == "measured"
    assert error.value == pytest.approx(error.predicted, abs=0.002)
    assert error.predicted == pytest.approx(error_figures(case).after, abs=0.002)  # on the recording's frequencies
    for mode in found.modes:
        assert abs(mode.measured.frequency - mode.vehicle[0]) < 0.01 * mode.vehicle[0]
    assert 0.8 < found.fidelity[0].total <= 1
    assert str(found).startswith("AS PREDICTED")
    assert found._repr_html_().startswith("<p><b>as predicted</b>")
    drawn = found.plot()
    for axes, curve in zip(drawn.axes, found.curves, strict=True):
        lines = {line.get_label(): line for line in axes.get_lines()}
        np.testing.assert_allclose(lines["vehicle"].get_ydata(), np.abs(curve.vehicle))
        np.testing.assert_allclose(lines["predicted for the bed"].get_ydata(), np.abs(curve.predicted))
        known = np.isfinite(curve.measured) & np.isfinite(curve.uncertainty)
        np.testing.assert_allclose(lines["measured on the bed"].get_ydata(), np.abs(curve.measured[known]))
        assert lines["measured on the bed"].get_xdata()[-1] == curve.frequencies[known][-1]


def test_dynamometers_with_a_wrong_gain_fall_short(case, record):
    found = judge(case, read_recordings([record("short", noise=0.02, gain=0.8)], case))
    assert found.status == "short"
    assert found.errors[0].value > 0.1


def test_noise_over_everything_leaves_it_open(case, record):
    found = judge(case, read_recordings([record("noisy", noise=100.0)], case))
    assert found.status == "undetermined"


def with_tracked(path, target):
    """A recording with what the controller tracked: the left gain drifts, and it warns of it at the end."""
    rows = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))
    keys = [f"{what}{more}" for what in ("gain", "zero", "delay") for more in ("", "_uncertainty")]
    rows[0] += [
        f"{side}.{key}" for side in ("left", "right") for key in (*(f"tracked_{key}" for key in keys), "drifted")
    ]
    for n, row in enumerate(rows[1:]):
        part = n / (len(rows) - 2)
        row += [f"{1 + 0.048 * part:.6g}", "0.0012", "0.3", "0.1", "0.0001", "0.0001", "1" if part > 0.8 else "0"]
        row += ["1.001", "0.0012", "-0.3", "0.1", "0.0009", "0.0002", "0"]
    target.write_text("\n".join(",".join(row) for row in rows) + "\n", encoding="utf-8")
    return target


def test_the_command_writes_all_of_it(case, record, tmp_path, capsys):
    out = tmp_path / "out"
    text = EXAMPLE.read_text(encoding="utf-8")
    folder = tmp_path / "case"
    folder.mkdir()
    for name in ("vehicle.toml", "rig.toml"):
        (folder / name).write_text(EXAMPLE.with_name(name).read_text(encoding="utf-8"), encoding="utf-8")
    (folder / "case.toml").write_text(text.replace('"observer"', '"model_based"'), encoding="utf-8")
    recorded = with_tracked(record("good", noise=0.02), tmp_path / "good.csv")
    assert main(["verify", str(folder / "case.toml"), str(recorded), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert said.startswith("AS PREDICTED")
    told = "dynamometer left gives 1.0480 ± 0.0024 times what it is asked for: identify it anew"
    assert f"{told}, or write [dynamometers.left] torque_gain = 1.048" in said
    assert "dynamometer right answers" not in said, "no warning, no note"
    assert "road_left does not change in any recording" in said
    result = json.loads((out / "verification.json").read_text(encoding="utf-8"))
    assert result["status"] == "as_predicted"
    assert len(result["functions"]) == 3
    check_schema("verify", result)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "as predicted" in page
    assert hashlib.sha256(recorded.read_bytes()).hexdigest() in page
    assert told in page
    assert {one["quantity"]: one["value"] for one in result["tracked"] if one["drifted"]} == {"torque gain": 1.048}
    assert "8.442 Hz</td>" in page
    assert (out / "figures" / "responses.svg").stat().st_size > 1000
    assert said.splitlines()[-1] == f"report: {out / 'report.html'}"
    saved = unquote(page.split('download="responses.csv"')[1].split("charset=utf-8,")[1].split('"')[0])
    rows = list(csv.DictReader(saved.splitlines()))
    at = "motor_speed / motor_torque "
    for who in ("vehicle", "predicted", "measured"):
        curve = np.array([float(row[f"{at} {who} modulus [rad/s per N·m]".replace("  ", " ")]) for row in rows])
        f = np.array([float(row["frequency [Hz]"]) for row in rows])
        assert f[curve.argmax()] == pytest.approx(8.44, rel=0.02)  # the vehicle's mode


class Clock:
    """A clock that moves while somebody waits, when something may happen."""

    def __init__(self, *happens):
        self.now, self.happens = 0.0, list(happens)

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds
        if self.happens:
            self.happens.pop(0)()


def test_a_growing_recording_is_judged_as_soon_as_it_can_be(case, record, tmp_path, capsys, monkeypatch):
    whole = record("good", noise=0.02).read_bytes()
    growing, folder = tmp_path / "running.csv", tmp_path / "case"
    growing.write_bytes(whole[: len(whole) // 8])  # ends within a line
    monkeypatch.setattr("matching.bed.verify.time", Clock(lambda: growing.write_bytes(whole)))
    monkeypatch.setattr("matching.export.tuned_case", lambda _: SimpleNamespace(tuned=case))
    words = ["verify", str(folder), str(growing), "--follow", "5", "--out", str(tmp_path / "out"), "--json"]
    assert main(words) == 0
    printed, said = capsys.readouterr()
    first, second = said.splitlines()
    assert first.startswith(f"not yet: {growing}: lasts ")
    assert second.startswith("so far as_predicted: response error to measured torques 0.0")
    result = json.loads((tmp_path / "out" / "verification.json").read_text(encoding="utf-8"))
    assert result == json.loads(printed)
    assert result["fidelity"][0]["recording"] == str(growing)


def test_whole_lines_of_a_growing_recording_are_copied(tmp_path, monkeypatch):
    growing = tmp_path / "r.csv"
    growing.write_bytes(b"time,a\n1,2\n3,")
    clock = Clock(lambda: None, lambda: growing.write_bytes(b"time,a\n1,2\n3,4\n5"))
    monkeypatch.setattr("matching.bed.verify.time", clock)
    assert [copy.read_bytes() for (copy,) in snapshots([growing], 2.0, tmp_path / "copies")] == [
        b"time,a\n1,2\n",
        b"time,a\n1,2\n3,4\n",
    ]
    assert clock.now == 2.0 + 2 * 0.25
    with pytest.raises(InputError, match="is no file"):
        next(snapshots([tmp_path / "none.csv"], 2.0, tmp_path / "copies"))


def test_the_answer_is_that_of_the_files_as_they_are_in_the_end(case, record, tmp_path, capsys, monkeypatch):
    """A recording that is begun anew and stays too short has no answer, whatever stood there before."""
    whole = record("good", noise=0.02).read_bytes()
    growing, folder = tmp_path / "running.csv", tmp_path / "case"
    growing.write_bytes(whole)
    clock = Clock(lambda: growing.write_bytes(whole[: len(whole) // 8]))
    monkeypatch.setattr("matching.bed.verify.time", clock)
    monkeypatch.setattr("matching.export.tuned_case", lambda _: SimpleNamespace(tuned=case))
    assert main(["verify", str(folder), str(growing), "--follow", "5", "--out", str(tmp_path / "out")]) == 2
    printed, said = capsys.readouterr()
    assert printed == ""
    first, second, last = said.splitlines()
    assert first.startswith("so far as_predicted")
    assert second.startswith(f"not yet: {growing}: lasts ")
    assert last.startswith(f"rigmatch: {growing}: lasts ")
    assert last.endswith(f"{tmp_path / 'out'} holds what was judged before")


def test_what_was_never_judged_is_not_said_to_have_an_answer(case, record, tmp_path, capsys, monkeypatch):
    growing = tmp_path / "running.csv"
    growing.write_bytes(record("good", noise=0.02).read_bytes()[:3000])
    monkeypatch.setattr("matching.bed.verify.time", Clock(lambda: None))
    monkeypatch.setattr("matching.export.tuned_case", lambda _: SimpleNamespace(tuned=case))
    assert main(["verify", str(tmp_path), str(growing), "--follow", "5", "--out", str(tmp_path / "out")]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith(f"rigmatch: {growing}: lasts ")
    assert "judged before" not in last


@pytest.mark.parametrize(
    ("columns", "seconds", "wrong"),
    [
        (["time [s]", "motor_torque [N*m]"], 20, "none of the compared sensors"),
        (["time [s]", "motor_speed [rad/s]"], 20, "holds no change of"),
        (["time [s]", "motor_torque [N*m]", "motor_speed [rad/s]"], 2, "lasts"),
    ],
)
def test_recordings_that_cannot_be_judged(columns, seconds, wrong, tmp_path, capsys):
    path = tmp_path / "r.csv"
    rows = [",".join(columns)]
    rows += [
        ",".join([f"{i * 0.004:.3f}", *(f"{np.sin(i * 0.3):.6f}" for _ in columns[1:])])
        for i in range(int(seconds / 0.004))
    ]
    path.write_text("\n".join(rows), encoding="utf-8")
    assert main(["verify", str(EXAMPLE), str(path), "--out", str(tmp_path / "out")]) == 2
    assert wrong in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
