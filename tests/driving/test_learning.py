"""Learning over repetitions on beds that rigmatch knows nothing of, half of them with free play and dry friction."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from driving.own_car import Bed, Car, Sensors, drive_car, run_bed, still
from needs import compiles

from matching.bed.learn import Learned, learn, read_played
from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from matching.match.learning import Learner
from matching.match.loop import control_law, linear_bed
from matching.match.match import match
from matching.match.variables import SearchSettings
from modelling.controller.batch import ControllerBatch
from modelling.errors import InputError
from modelling.recordings.read import csv_text

pytestmark = compiles
REFERENCE = Path(__file__).parents[2] / "examples" / "road_to_rig"
STEP, SAMPLES, BEDS, RECORDINGS, REPETITIONS = 1e-3, 2000, 20, 2, 3
NOISE = {"flange_left_torque": 0.3445, "flange_right_torque": 0.3385}
SPEED_NOISE = 0.0836  # rad/s
COMPARED = ("motor_speed", "side_left_torque", "side_right_torque")


class Exact(Sensors):
    """The same speeds, means over a sample, without counts, noise and chance: what repeats."""

    def read(self, state, ratio):
        rows = []
        for name in self.names:
            side = "left" if "left" in name else "right"
            if name.endswith("torque"):
                rows.append(state[f"read_{side}"] * self.gains[name])
                continue
            angle = state["motor_angle"] if name == "motor_speed" else state[f"angle_{side}"]
            rows.append((angle - self.counts.get(name, angle)) / self.step)
            self.counts[name] = angle
        return np.stack(rows)


class Bench:
    """Twenty drawn beds and the one as planned, each beside a car with its specimen, in the same tip-in."""

    def __init__(self, case, dead_time, beds=BEDS, seed=97):
        random = np.random.default_rng(seed)

        def some(width):
            return 1 + width * np.r_[0.0, random.uniform(-1, 1, beds)]

        self.count = beds + 1
        inertias = ("motor", "gearbox", "differential", "adapter_left", "adapter_right", "rotor_left", "rotor_right")
        shafts = ("gear_mesh", "gear_output", "side_left", "side_right", "flange_left", "flange_right")
        factors = {f"inertias.{name}.J": some(0.05) for name in inertias}
        factors |= {f"shafts.{name}.stiffness": some(0.05) for name in shafts}
        factors |= {f"shafts.{name}.damping": some(0.3) for name in shafts}
        odd = np.arange(self.count) % 2
        play, friction = 0.01 * odd, 8.0 * odd
        self.controller = exported_controller(case)
        self.car = Car(REFERENCE / "vehicle.toml", factors, self.count, play, friction)
        gains = np.stack([some(0.03), some(0.03)])
        lags = 0.002 * some(0.2), 0.0005 * some(0.2)
        self.bed = Bed(REFERENCE / "rig.toml", factors, self.count, *lags, gains, play, friction)
        self.delay = dead_time - STEP / 2 + 0.0005 * (some(1.0) - 1)
        names = self.controller.law.sensors
        self.noise, self.gains = [NOISE.get(name, SPEED_NOISE) for name in names], {name: some(0.005) for name in names}
        time = np.arange(SAMPLES) * STEP
        self.torque = (100 * np.clip((time - 0.2) / 0.05, 0, 1))[:, None] + np.zeros(self.count)
        self.car_motion, _ = drive_car(self.car, still(self.car, np.zeros(self.count)), self.torque, STEP)

    def repeated(self, added, seed, exact=False):
        """Motion less the car's (t, 3, b) with torques added (b, t, k), and the readings (t, y, b)."""
        law, rest, before = self.controller.law, np.zeros(self.count), 0.3
        first = round(before / STEP)
        sensors = (Exact if exact else Sensors)(law.sensors, self.noise, self.gains, STEP, seed)
        batch, read = ControllerBatch(self.controller, self.count), []

        def commands(readings, _, mode, hold, sample):
            more = added[:, sample - first].T if sample >= first else np.zeros((2, self.count))
            sent, _, faults = batch.step(readings, np.zeros((len(law.known), self.count)), mode, hold, sample, more)
            if sample >= first:
                read.append(readings)
            return sent, faults

        found, _, lasted = run_bed(
            self.bed, still(self.bed, rest), self.torque, commands, sensors, self.delay, STEP, np.stack([rest, rest]),
            before=before,
        )  # fmt: skip
        assert lasted.all()
        return found - self.car_motion, np.array(read)


@pytest.mark.long
@pytest.mark.parametrize("dead_time", [0.003, 0.008])
def test_what_repeats_is_learned_at_the_cut(dead_time, tmp_path):
    """On 20 beds whose specimens are up to 5 % off: the error at the cut falls, the true side shafts get no worse."""
    case = load_case(REFERENCE / "observer.toml")
    limits = {**case.limits, "opened_shafts": False}
    case = replace(case, loop=case.loop.with_values({"dead_time": dead_time}), limits=limits)
    tuned = match(case, settings=SearchSettings(emulated=0.0), beds=20, ordering=False).tuned
    bench = Bench(tuned, dead_time)
    ranges = np.ptp(bench.car_motion[:, :, 0], axis=0)
    names, time = bench.controller.law.sensors, np.arange(SAMPLES) * STEP
    units = {sensor.name: sensor.unit for sensor in tuned.rig.sensors} | {"motor_torque": "N*m"}

    def true_errors(error):
        return np.sqrt(np.mean((error[:, 1:] / ranges[1:, None]) ** 2, axis=0)).max(axis=0)

    added = np.zeros((bench.count, SAMPLES, 2))
    at_cut, noise, sides = np.zeros((REPETITIONS + 1, bench.count)), np.zeros(bench.count), []
    for repetition in range(REPETITIONS + 1):
        sides.append(true_errors(bench.repeated(added, 0, exact=True)[0]))
        runs = [bench.repeated(added, 1 + 10 * repetition + number) for number in range(RECORDINGS)]
        off = true_errors(runs[0][0] - runs[1][0]) / np.sqrt(2)
        for number in range(bench.count):
            paths = [tmp_path / f"{number}_{n}.csv" for n in range(RECORDINGS)]
            for path, (_, read) in zip(paths, runs, strict=True):
                columns = {name: read[:, i, number] for i, name in enumerate(names)}
                columns["motor_torque"] = bench.torque[:, number]
                path.write_text(csv_text(time, columns, {name: units[name] for name in columns}))
            folder = tmp_path / f"learned_{number}"
            learned = learn(tuned, paths, played=folder if repetition else None)
            at_cut[repetition, number], noise[number] = learned.error, learned.noise
            learned.save(folder)
            added[number] = learned.torques
        assert (sides[-1] <= sides[0] + off).all(), (sides, off)
    shares = at_cut / at_cut[0]
    print(dead_time, "cut", np.round(at_cut[0], 4), np.round(shares[1:], 2), "noise", np.round(noise, 4))
    print("sides", np.round(np.array(sides), 4), "largest rise", np.diff(np.array(sides), axis=0).max(), "noise", off)
    smooth = np.arange(bench.count) % 2 == 0  # the others have free play and dry friction, which do not repeat exactly
    assert ((shares[-1] <= 0.4) | (at_cut[-1] <= 1.5 * noise))[smooth].all(), (shares, at_cut, noise)
    assert np.median(sides[-1] / sides[0]) <= 0.5


@pytest.mark.long
def test_the_loop_answers_added_torques_as_the_learner_expects():
    """A pulse of torque added on the bed as planned, in equations of the test, without noise."""
    case = load_case(REFERENCE / "observer.toml")
    bench = Bench(case, 0.003, beds=0)
    pulse = np.zeros((1, SAMPLES, 2))
    time = np.arange(SAMPLES) * STEP
    pulse[0, :, 0] = 40 * np.sin(2 * np.pi * 6 * time) * np.sin(np.pi * np.clip((time - 0.1) / 0.5, 0, 1)) ** 2
    found = bench.repeated(pulse, 0, exact=True)[0][:, :, 0] - bench.repeated(0 * pulse, 0, exact=True)[0][:, :, 0]
    learner = Learner.of(case, control_law(linear_bed(case)), SAMPLES)
    lines = slice(1, learner.answers.shape[1] + 1)
    A = np.fft.rfft(pulse[0], learner.padded, axis=0)[lines]
    spectrum = np.zeros((learner.padded // 2 + 1, 3), complex)
    spectrum[lines] = (learner.answers[0] @ A[..., None])[..., 0]
    expected = np.fft.irfft(spectrum, learner.padded, axis=0)[:SAMPLES]
    for column, name in enumerate(COMPARED):
        off = found[:, column] - expected[:, column]
        off -= off.mean()  # what stands for ever has no line
        assert np.std(off) < 0.15 * np.std(found[:, column]), name


def test_noise_alone_teaches_nothing():
    case = load_case(REFERENCE / "observer.toml")
    learner = Learner.of(case, control_law(linear_bed(case)), SAMPLES)
    ranges, random = np.array([200.0, 900.0, 900.0]), np.random.default_rng(5)
    noise = random.standard_normal((4, SAMPLES, 3)) * 0.01 * ranges
    ramp = np.sin(2 * np.pi * 7 * np.arange(SAMPLES) * STEP)[:, None] * np.exp(-np.arange(SAMPLES) * 2e-3)[:, None]
    learned = learner.correction(noise + 0.02 * ramp * ranges, ranges)
    nothing = learner.correction(noise, ranges)
    assert np.std(nothing.torques) < 0.25 * np.std(learned.torques)
    assert learned.size > 2 * learned.noise > 0


BODY = 0.69 + 0.456 + 90.1  # kg·m² behind a cut of the reference vehicle, which is rigid to a slow torque


def recording(error, shift=0, noise=0.0, seed=0, torque=60.0, speed=0.0, samples=1500, **replaced):
    """A CSV recording of a tip-in whose rotors turn as the vehicle's body does, but for an error."""
    time = np.arange(1500) * STEP
    random = np.random.default_rng(seed)
    rising = np.clip((time - 0.2 - shift * STEP) / 0.3, 0, 1)
    flange = 5 * torque * rising**2 * (3 - 2 * rising)
    turns = speed + np.cumsum(flange) * STEP / BODY + np.roll(error, shift)
    columns = {"motor_torque": torque * rising}
    for side in ("left", "right"):
        columns[f"flange_{side}_torque"] = flange + noise * random.standard_normal(1500)
        columns[f"rotor_{side}_speed"] = turns + 0.01 * noise * random.standard_normal(1500)
    columns["motor_speed"] = 10.05 * columns["rotor_left_speed"]
    columns |= replaced
    units = {name: "rad/s" if name.endswith("speed") else "N*m" for name in columns}
    return csv_text(time[:samples], {name: column[:samples] for name, column in columns.items()}, units)


SWING = 0.05 * np.sin(2 * np.pi * 8 * np.arange(1500) * STEP)


@pytest.fixture(scope="module")
def case():
    return load_case(REFERENCE / "observer.toml")


def test_recordings_are_learned_from_and_played_again(case, tmp_path):
    paths = []
    for number in range(2):
        paths.append(tmp_path / f"{number}.csv")
        paths[-1].write_text(recording(SWING, 0, 0.3, number))
    learned = learn(case, paths)
    assert isinstance(learned, Learned)
    assert learned.repetition == 1
    assert learned.sensors == ("rotor_left_speed", "rotor_right_speed")
    assert learned.noise < 0.2 * learned.error
    assert not learned.left_out
    assert len(learned.controller.learned) == len(learned.time)
    assert np.abs(learned.torques[-1]).max() < 1e-9, "it ends"
    folder = tmp_path / "learned"
    learned.save(folder)
    again = learn(case, paths, played=folder)
    assert again.repetition == 2
    assert again.history == pytest.approx((learned.error,))
    np.testing.assert_allclose(read_played(folder, case.loop.dynamometers).torques, learned.torques, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize(
    ("broken", "said"),
    [
        ({"shift": 80}, "80 ms late"),
        ({"shift": -30}, "30 ms early"),
        ({"speed": 6.0}, "rotor speeds that differ by 6"),
        ({"samples": 900}, "ends after 0.9 s"),
        ({"torque": 42.0}, "torques that differ"),
        ({"flange_left_torque": np.zeros(1500)}, "a channel that does not move"),
        ({"seed": 0}, "the same values"),
        ({"rotor_left_speed": np.zeros(1500), "rotor_right_speed": 1e-6 * SWING}, "does not move"),
    ],
)
def test_what_is_no_repetition_is_left_out_and_named(broken, said, case, tmp_path):
    texts = [recording(SWING, noise=0.3, seed=0), recording(SWING, noise=0.3, **{"seed": 1, **broken})]
    for number, text in enumerate(texts):
        (tmp_path / f"{number}.csv").write_text(text)
    learned = learn(case, [tmp_path / "0.csv", tmp_path / "1.csv"])
    assert learned.recordings == 1
    assert len(learned.left_out) == 1
    assert said in learned.left_out[0]
    assert learned.left_out[0].startswith(str(tmp_path / "1.csv")) or "1.csv" in learned.left_out[0]
    assert "left out" in learned.sentence()


@pytest.mark.long
def test_emulation_that_ended_inside_is_no_repetition(case, tmp_path):
    time = np.arange(1500) * STEP
    stopped = {f"rotor_{side}_speed": np.where(time < 1.0, 2.0 * time, 20.0) for side in ("left", "right")}
    (tmp_path / "0.csv").write_text(recording(SWING, noise=0.3, seed=0))
    (tmp_path / "1.csv").write_text(recording(SWING, noise=0.3, seed=1, **stopped))
    learned = learn(case, [tmp_path / "0.csv", tmp_path / "1.csv"])
    assert learned.recordings == 1
    assert "emulation has ended" in learned.left_out[0]


def test_learned_torques_stay_within_the_limit_and_what_is_expected_is_expected_of_these(case, tmp_path):
    limit = float(case.limits_of("torque").min())
    (tmp_path / "0.csv").write_text(recording(60 * SWING, noise=0.3, torque=600.0))
    learned = learn(case, [tmp_path / "0.csv"])
    assert np.abs(learned.torques).max() <= limit + 1e-9
    assert learned.predicted > 0.1 * learned.error


def test_what_cannot_be_learned_is_refused(case, tmp_path):
    path = tmp_path / "one.csv"
    path.write_text(recording(np.zeros(1500)))
    with pytest.raises(InputError, match="does not know of torques"):
        learn(load_case(REFERENCE / "case.toml"), [path])
    with pytest.raises(InputError, match="operating_range"):
        learn(case, [path], vehicle_speed=3.0)
    with pytest.raises(InputError, match="does not exist"):
        learn(case, [path], played=tmp_path / "nothing")
