"""Dynamometers of two makers: each with a dead time and lags of its own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from matching.match.case_file import case_files, load_case
from matching.match.loop import linear_bed
from matching.match.verify import disagreement, manoeuvre_torques, simulate_case
from modelling.bed.bed import delayed_bed, held
from modelling.errors import InputError

ROAD = Path(__file__).parents[2] / "examples" / "road_to_rig"
STEP = 1e-3


def written(folder, left="", rig=""):
    """The reference whose left dynamometer has further keys, and whose rig has more."""
    for name in ("vehicle.toml", "rig.toml", "observer.toml"):
        (folder / name).write_text((ROAD / name).read_text())
    case, model = folder / "observer.toml", folder / "rig.toml"
    case.write_text(case.read_text().replace("[dynamometers.left]\n", f"[dynamometers.left]\n{left}\n"))
    model.write_text(model.read_text() + rig)
    return case


@pytest.mark.parametrize("late", [(0.0015, 0.0055), (0.0032, 0.0007), (0.002, 0.002), (0.0, 0.0043)])
def test_commands_that_arrive_at_different_times(late):
    """Against the same plant held in steps of a twentieth of a sample, with a queue for every command."""
    random = np.random.default_rng(1)
    A = np.array([[-3.0, 40.0, 0.0], [-40.0, -5.0, 8.0], [0.0, -8.0, -30.0]])
    B, W = random.normal(size=(3, 2)), random.normal(size=(3, 1))
    bed, fine = delayed_bed(A, B, W, np.array(late), STEP), 20
    commands, torques = random.normal(size=(40, 2)), random.normal(size=(40, 1))
    small, push = held(A, np.hstack([B, W]), STEP / fine)
    x, wanted = np.zeros(3), []
    for n in range(40 * fine):
        issued = [int(np.floor(n / fine - delay / STEP + 1e-9)) for delay in late]
        u = [commands[k, j] if k >= 0 else 0.0 for j, k in enumerate(issued)]
        x = small @ x + push @ np.append(u, torques[n // fine])
        if n % fine == fine - 1:
            wanted.append(x)
    x, got = np.zeros(len(bed.whole)), []
    for n in range(40):
        x = bed.whole @ x + bed.torques @ torques[n]
        for ago, part in ((bed.delay, bed.new), (bed.delay + 1, bed.old)):
            if n >= ago:
                x = x + part @ commands[n - ago]
        got.append(x[:3])
    np.testing.assert_allclose(got, wanted, atol=1e-12)


def test_the_loop_with_own_dead_times_and_lags_is_what_the_equations_of_motion_do(tmp_path):
    """The matrices of loop and observer against the nonlinear bed, which has a delay line for every dynamometer."""
    case = load_case(written(tmp_path, 'dead_time = "1.7 ms"\ninverter_lag = "1 ms"\ntorque_sensor_lag = "0.8 ms"'))
    assert case.loop.command_delays() == pytest.approx([0.0012, 0.0025])
    assert case.loop.command_delays(case.loop["dead_time"] + 5e-4) == pytest.approx([0.0017, 0.003])
    assert case.loop.lags("inverter_lag", 2 * case.loop["inverter_lag"]) == pytest.approx([0.002, 0.004])
    bed = linear_bed(case)
    torques = {name: torque[:800] for name, torque in manoeuvre_torques(bed)[0].items()}
    assert disagreement(bed, simulate_case(bed, torques)) < 1e-4
    equal = replace(case, loop=load_case(ROAD / "observer.toml").loop)
    assert disagreement(linear_bed(equal), simulate_case(bed, torques)) > 0.01


def test_own_times_are_written_and_read_again(tmp_path):
    case = load_case(written(tmp_path, "dead_time = 0.0017"))
    again = tmp_path / "again"
    again.mkdir()
    for name, text in case_files(case).items():
        (again / name).write_text(text)
    assert load_case(again / "case.toml").loop.dynamometers == case.loop.dynamometers
    with pytest.raises(InputError, match=r"dynamometers\.left\.dead_time: 0\.5 is not possible"):
        load_case(written(tmp_path, "dead_time = 0.5"))


def test_a_dead_time_in_the_rigs_model_is_the_dynamometers_own(tmp_path):
    effect = '\n[[effects]]\nkind = "dead_time"\nat = "inputs.dyno_left"\ndelay = 0.004\n'
    case = load_case(written(tmp_path, rig=effect))
    assert [one.dead_time for one in case.loop.dynamometers] == pytest.approx([0.007, None])
    assert not any(one.law.only_delays for one in case.rig.effects)
    assert any("its dead time is 7 ms" in note for note in case.notes)
    stated = load_case(written(tmp_path, "dead_time = 0.006", effect))
    assert stated.loop.dynamometers[0].dead_time == 0.006
    assert any("are not added" in note for note in stated.notes)
