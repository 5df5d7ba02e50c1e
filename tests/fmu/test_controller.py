"""The exported controller: its C equals Python's, its law equals rigmatch's own, it watches, it closes a loop."""

import subprocess
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from fmu.linear_bed import LinearBed
from fmu.slave import slave
from needs import compiles
from scipy.signal import cont2discrete, dlsim

from matching.cli import main
from matching.match.case_file import case_from_tables, load_case
from matching.match.exported import exported_controller
from matching.match.loop import linear_bed
from matching.match.verify import matched_motion
from modelling.bed.controllers import STRUCTURES
from modelling.controller.c_source import c_sources, memory_bytes
from modelling.controller.law import FAULTS
from modelling.fmu.export import contents, controller_fmu
from modelling.linear.state_space import state_space
from modelling.modal.modes import modes
from modelling.simulation.compiled import compiler
from modelling.toml import read_toml

pytestmark = compiles

ZERO, HOLD, EMULATION, CHECK = 0, 1, 2, 3


def with_structure(case, name):
    structure = STRUCTURES[name]
    values = {key: quantity.start for key, quantity in structure.quantities.items()}
    return replace(case, loop=replace(case.loop, structure=structure, values={**values, **case.loop.values}))


@pytest.fixture(scope="module")
def case(reference_case):
    return load_case(reference_case)


@pytest.fixture(scope="module", params=sorted(STRUCTURES))
def controller(request, case):
    return exported_controller(with_structure(case, request.param))


@pytest.fixture(scope="module")
def path(controller, tmp_path_factory):
    target = tmp_path_factory.mktemp("controller") / "controller.fmu"
    target.write_bytes(controller_fmu(controller).content)
    return target


def names(controller):
    law = controller.law
    per = [f"{name}.{what}" for what in ("hold_speed", "added_torque") for name in law.dynamometers]
    inputs = [*law.sensors, *law.known, *per]
    return inputs, [*(f"{name}.command" for name in law.dynamometers), "active_mode", "fault"]


def test_c_equals_python_through_all_modes_and_faults(controller, path):
    """Random readings through hold, emulation, limits, a loss of torque, the check of the channels, an overspeed in it,
    and readings that are no numbers."""
    rng = np.random.default_rng(3)
    law = controller.law
    watched_not = replace(controller.settings, ride_samples=0, unexpected=np.full(len(law.sensors), 1e12))
    own = replace(controller, settings=watched_not).running()
    y, w, k = len(law.sensors), len(law.known), len(law.dynamometers)
    inputs, outputs = names(controller)
    sizes = np.ones(y)
    sizes[list(controller.torque_readings)] = 30.0
    seen = set()
    with slave(path) as one:
        one.begin(given={"ride_samples": 0.0} | {f"{name}.unexpected": 1e12 for name in law.sensors})
        for n in range(500):
            mode = ZERO if n < 5 or 300 <= n < 305 or n >= 450 else HOLD if n < 60 or 305 <= n < 350 else EMULATION
            mode = CHECK if n >= 455 else mode
            readings, known = sizes * rng.normal(size=y), 50 * rng.normal(size=w)
            readings[list(controller.speed_readings)] += 30
            if n == 250:
                readings[1] = np.nan
            if n >= 450:
                readings[list(controller.speed_readings)] += 50.0 * (n == 490) - 30  # the limit is 12.6
            hold, added = np.full(k, 30.0), 40 * rng.normal(size=k)
            answer = own.step(readings, known, mode, hold, n, added)
            given = np.concatenate([readings, known, hold, added])
            one.set(dict(zip(inputs, given, strict=True)) | {"mode": float(mode), "life": float(n)})
            one.step(law.sample_time)
            got = np.array(one.get(outputs))
            np.testing.assert_allclose(got[:k], answer.commands, rtol=1e-9, atol=1e-9 * 1500)
            assert (got[k], got[k + 1]) == (answer.mode, answer.fault)
            seen.add((answer.mode, answer.fault))
    overspeed = FAULTS.index("overspeed")
    assert {(ZERO, 0), (HOLD, 0), (EMULATION, 0), (ZERO, 1), (CHECK, 0), (ZERO, overspeed)} <= seen


def test_a_shift_is_told_to_a_controller_that_does_not_know_the_specimen(case, reference_case, tmp_path):
    """Meanwhile a torque that is gone is no fault, in the FMU as in Python; before and after it is."""
    told = "shifting"
    assert told not in {one.name for one in contents(exported_controller(case)).inputs}
    file = reference_case.with_name("observer.toml")
    data = read_toml(file)
    data["loop"] |= {"specimen": "unknown"}
    controller = exported_controller(case_from_tables(data, str(file)))
    law, k, path, gone = controller.law, 2, tmp_path / "controller.fmu", FAULTS.index("torque gone")
    path.write_bytes(controller_fmu(controller).content)
    large, faults = 2 * float(controller.settings.lost_torque.max()), []
    for first, last in ((0, 0), (90, 140), (140, 200)):
        own, seen = controller.running(), []
        inputs, outputs = names(controller)
        with slave(path) as one:
            one.begin()
            for n in range(160):
                readings, known = np.zeros(len(law.sensors)), np.zeros(len(law.known))
                readings[list(controller.torque_readings)] = large * (n < 120) + 0.01 * (n % 7)
                readings[list(controller.speed_readings)] = 5.0
                mode, shifting = HOLD if n < 100 else EMULATION, first <= n < last
                answer = own.step(readings, known, mode, np.full(k, 5.0), n, shifting=shifting)
                given = np.concatenate([readings, known, np.full(k, 5.0), np.zeros(k)])
                one.set(dict(zip(inputs, given, strict=True)) | {
                    "mode": float(mode), "life": float(n), told: float(shifting),
                })  # fmt: skip
                one.step(law.sample_time)
                got = np.array(one.get(outputs))
                np.testing.assert_allclose(got[:k], answer.commands, rtol=1e-9, atol=1e-9 * large)
                assert (got[k], got[k + 1]) == (answer.mode, answer.fault)
                seen.append(answer.fault)
        faults.append([n for n, fault in enumerate(seen) if fault == gone][:1])
    assert faults[0] == faults[2] == [120]
    assert faults[1] == []


def closed(case, law, torques):
    """Commands of a law on the linear bed of a case, by half samples, a queue for the dead time; torques linear."""
    parts = linear_bed(case)
    bed, state, commands = LinearBed(parts, case.loop), np.zeros(len(law.A)), []
    drives = np.stack([torques.get(name, np.zeros(len(torques["motor_torque"]))) for name in parts.drives], axis=1)
    known = np.stack([torques.get(name, np.zeros(len(drives))) for name in law.known], axis=1)
    following = np.concatenate([drives[1:], drives[-1:]])
    for now, drive, after in zip(known, drives, following, strict=True):
        sent, state = law.step(state, bed.readings(), now, np.full(len(parts.dynamometers), np.inf))
        commands.append(sent)
        bed.step(sent, drive, after)
    return np.array(commands)


def test_law_of_the_feed_forward_commands_what_the_verification_commands(case):
    """On the linear bed as in the simulation of the equations of motion: to the steps of RK4, which feedback passes."""
    case = with_structure(case, "model_based")
    time = np.arange(600) * case.loop["sample_time"]
    torques = {"motor_torque": 100.0 * (time > 0.05), "road_left": -200.0 * np.sin(20 * time)}
    wanted = matched_motion(linear_bed(case), torques)
    commands = closed(case, exported_controller(case).law, torques)
    for j, name in enumerate(("left", "right")):
        trace = wanted[f"dynamometers.{name}.command"]
        np.testing.assert_allclose(commands[:, j], trace, atol=1e-5 * np.abs(trace).max())


def test_law_of_pi_is_its_sampled_state_space(case):
    case = with_structure(case, "pi")
    parts, law = linear_bed(case), exported_controller(case).law
    rng = np.random.default_rng(1)
    readings, known = rng.normal(size=(200, 4)), rng.normal(size=(200, len(law.known)))
    state, got = np.zeros(len(law.A)), []
    for y, w in zip(readings, known, strict=True):
        sent, state = law.step(state, y, w, np.full(2, np.inf))
        got.append(sent)
    own = parts.sampled_feedback
    drive = np.hstack([readings * np.concatenate([parts.torque_signs, np.ones(2)]), known])
    wanted = dlsim((own.A, own.B, own.C, own.D, law.sample_time), drive)[1]
    np.testing.assert_allclose(np.array(got), wanted, atol=1e-9 * np.abs(wanted).max())


def test_nothing_winds_up_behind_a_limit(controller):
    """After a long time at the limit the commands leave it at once when the demand does."""
    law = controller.law
    y, k = len(law.sensors), len(law.dynamometers)
    pushed, rest = np.zeros(y), np.zeros(y)
    pushed[list(controller.speed_readings)] = -5.0  # rotors too slow by far
    state, limit = np.zeros(len(law.A)), np.full(k, 50.0)
    for _ in range(2000):
        _, state = law.step(state, pushed, np.zeros(len(law.known)), limit)
    assert np.isfinite(state).all()
    for _ in range(40):
        _, state = law.step(state, rest, np.zeros(len(law.known)), limit)
    free = np.zeros(len(law.A))
    for n in range(2040):
        _, free = law.step(free, pushed if n < 2000 else rest, np.zeros(len(law.known)), np.full(k, np.inf))
    assert np.abs(state).max() <= np.abs(free).max()


class Bed:
    """The rig as an FMU; dead time, inverter and sensor lag by this test, in fine steps."""

    def __init__(self, one, case, fine=10):
        self.one, self.case, self.fine = one, case, fine
        loop = case.loop
        self.queue = [np.zeros(2)] * round(loop["dead_time"] / loop["sample_time"])
        self.air_gap, self.flange = np.zeros(2), np.zeros(2)

    def sample(self):
        speeds = self.one.get([own.speed_sensor for own in self.case.loop.dynamometers])
        return np.concatenate([self.flange, speeds])

    def step(self, command, motor_torque, following):
        loop = self.case.loop
        self.queue.append(np.array(command))
        h = loop["sample_time"] / self.fine
        issued = self.queue.pop(0), self.queue[0]
        torques = [own.torque_sensor for own in loop.dynamometers]
        for i in range(self.fine):
            arrived = issued[0 if i < self.fine / 2 else 1]  # half a sample earlier: the hold is part of the dead time
            before = self.air_gap
            self.air_gap = arrived + (before - arrived) * np.exp(-h / loop["inverter_lag"])
            mean = arrived + (before - arrived) * np.exp(-h / 2 / loop["inverter_lag"])
            values = {own.torque_input: float(t) for own, t in zip(loop.dynamometers, mean, strict=True)}
            now = motor_torque + (following - motor_torque) * (i + 0.5) / self.fine
            self.one.set(values | {"motor_torque": float(now)})
            self.one.step(h)
            now = np.array(self.one.get(torques))
            self.flange = now + (self.flange - now) * np.exp(-h / loop["torque_sensor_lag"])


@pytest.mark.parametrize("controller", ["model_based"], indirect=True)
def test_controller_and_bed_as_fmus_answer_like_the_vehicle(controller, path, case, reference_case, export):
    """Speed hold, emulation without a bump, a tip-in; side-shaft torque against the vehicle's closed-form response."""
    case, step, count = with_structure(case, "model_based"), controller.law.sample_time, 1500
    on = 1000  # samples of speed hold before, twice its integral time: emulation begins at a steady speed
    turning = modes(case.rig)[0].shape  # the rigid motion: all turn at 20 rad/s of the left rotor
    rotor = turning["inertias.rotor_left"]
    motor = 100.0 * np.clip((np.arange(count + 1) - on - 50) / 50, 0, 1)  # N·m: a ramp of 50 ms
    speeds = {f"speed({name.removeprefix('inertias.')})": 20.0 * value / rotor for name, value in turning.items()}
    rig = export(reference_case.with_name("rig.toml"))
    with slave(rig) as bed_fmu, slave(path) as one:
        bed_fmu.begin(given=speeds)
        one.begin()
        bed, side, commands = Bed(bed_fmu, case), [], []
        for n in range(count):
            readings = dict(zip(controller.law.sensors, bed.sample(), strict=True))
            one.set(readings | {"motor_torque": motor[n], "mode": 1.0 if n < on else 2.0, "life": float(n)})
            one.set({"left.hold_speed": 20.0, "right.hold_speed": 20.0})
            one.step(step)
            side.append(bed_fmu.get(["side_left_torque"])[0])
            commands.append(one.get(["left.command"])[0])
            bed.step([commands[-1], one.get(["right.command"])[0]], motor[n], motor[n + 1])
    vehicle = state_space(case.vehicle)
    A, B, C, D, _ = cont2discrete((vehicle.A, vehicle.B, vehicle.C, vehicle.D), step, "foh")
    torque = np.zeros((count - on, len(vehicle.inputs)))
    torque[:, vehicle.inputs.index("motor_torque")] = motor[on:count]
    wanted = dlsim((A, B, C, D, step), torque)[1][:, vehicle.outputs.index("side_left_torque")]
    got = np.array(side[on:])
    assert abs(commands[on] - commands[on - 1]) < 1.0  # N·m: no bump
    assert np.abs(got - got[0] - wanted).max() < 0.01 * np.ptp(wanted)


MAIN = """
#include <stdio.h>
#include "controller.h"
int main(void) {
    static controller c;
    controller_input in = {0};
    controller_output out;
    controller_init(&c);
    for (int n = 0; n < 3000; n++) {
        for (int i = 0; i < CONTROLLER_READINGS; i++) in.reading[i] = (controller_real)((n * 7 + i) % 13);
        in.mode = n < 10 ? 1 : 2;
        in.life = (uint32_t)n;
        in.hold_speed[0] = (n == 2500) ? in.reading[0] / (controller_real)0 : (controller_real)0;
        controller_step(&c, &in, &out);
    }
    controller_reset(&c);
    printf("%u %d\\n", (unsigned)sizeof c, (int)out.fault);
    return 0;
}
"""


@pytest.mark.parametrize("real", ["double", "float"])
def test_sources_compile_without_a_warning_and_run_under_sanitizers(real, controller, tmp_path):
    for name, text in c_sources(controller).items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    (tmp_path / "main.c").write_text(MAIN, encoding="utf-8")
    strict = [compiler(), "-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", f"-DCONTROLLER_REAL={real}"]
    files = ["main.c", "controller.c", "-lm", "-o", "run"]
    sane = subprocess.run([*strict, "-g", "-fsanitize=address,undefined", *files], cwd=tmp_path, capture_output=True)
    if sane.returncode:  # a compiler without sanitizers
        subprocess.run([*strict, *files], cwd=tmp_path, check=True)
    done = subprocess.run(["./run"], cwd=tmp_path, capture_output=True, text=True, check=True)
    size, fault = map(int, done.stdout.split())
    assert fault in (1, 6, 7)
    if real == "double":
        assert abs(size - memory_bytes(controller)) <= 8
    text = (tmp_path / "controller.c").read_text()
    assert not [word for word in ("malloc", "calloc", "free(", "goto", "printf") if word in text]


def test_a_title_cannot_leave_its_comment(controller):
    hostile = replace(controller, title='*/ int x; /* "??/\n#error')
    first = c_sources(hostile)["controller.h"].split("\n")[0]
    assert first.count("*/") == 0
    assert "#" not in first


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_the_command_writes_it(fmi, reference_case, tmp_path, capsys):
    target = tmp_path / "bed.fmu"
    assert main(["export", str(reference_case), "--controller", str(target), "--fmi", fmi]) == 0
    assert "sample time 1 ms" in capsys.readouterr().out
    with zipfile.ZipFile(target) as archive:
        assert {"sources/controller.c", "sources/controller.h", "sources/controller_data.h"} <= set(archive.namelist())
    assert main(["export", str(reference_case), "--controller", str(tmp_path / "bed.txt")]) == 2
    assert "--controller" in capsys.readouterr().err
