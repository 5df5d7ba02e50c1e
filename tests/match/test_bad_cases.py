"""Malformed case files each give one line that names file and key; no mutation of an example gives anything worse."""

import re
import tomllib
from pathlib import Path

import pytest
import tomli_w

import rigmatch as rm
from matching.cli import main
from matching.match.case_file import load_case
from matching.match.targets import target_modes
from modelling.errors import InputError

EXAMPLES = Path(__file__).parents[2] / "examples"
REFERENCE = tomllib.loads((EXAMPLES / "road_to_rig" / "case.toml").read_text())
for _key in ("vehicle", "rig"):
    REFERENCE[_key] = (EXAMPLES / "road_to_rig" / REFERENCE[_key]).as_posix()


def changed(path, value):
    """The reference case with one entry changed, or dropped where the value is None."""
    data = tomllib.loads(tomli_w.dumps(REFERENCE))
    *way, last = path
    here = data
    for key in way:
        here = here[key]
    if value is None:
        del here[last]
    else:
        here[last] = value
    return tomli_w.dumps(data)


FLANGE = ("move", "rig.shafts.flange_left.stiffness")
BAD = {
    "no vehicle": (("vehicle",), None, "vehicle: is missing"),
    "vehicle no text": (("vehicle",), 3, "vehicle: is missing or no text"),
    "vehicle file missing": (("vehicle",), "nowhere.toml", "nowhere.toml"),
    "vehicle a device": (("vehicle",), "/dev/zero", "vehicle: /dev/zero is no regular file"),
    "rig a folder": (("rig",), "/", "rig: / is no regular file"),
    "recorded torque a device": (("manoeuvre", "motor_torque"), {"file": "/dev/zero"}, "/dev/zero is no regular file"),
    "rig file missing": (("rig",), "nowhere.toml", "nowhere.toml"),
    "rig is the vehicle": (("rig",), REFERENCE["vehicle"], "nothing is left to emulate"),
    "rig of another car": (("rig",), (EXAMPLES / "compact_bev" / "rig.toml").as_posix(), "case.toml"),
    "unknown table": (("limit",), {"modulus_margin": 0.5}, "limits"),
    "another objective": (("response", "objective"), "amplitude", "response.objective: is not response_error"),
    "no dynamometers": (("dynamometers",), None, "the case has none"),
    "one dynamometer short": (("dynamometers", "left"), None, "0 of them follow the cut at 'side_left'"),
    "two follow one cut": (("dynamometers", "left", "follows"), "side_right", "follow the cut"),
    "missing end": (("dynamometers", "left", "follows"), None, "dynamometers.left"),
    "unknown input": (("dynamometers", "left", "torque_input"), "dyno_leff", "dyno_left"),
    "unknown sensor": (("dynamometers", "left", "speed_sensor"), "rotor_left_sped", "rotor_left_speed"),
    "speed taken for torque": (("dynamometers", "left", "torque_sensor"), "rotor_left_speed", "a torque sensor"),
    "torque taken for speed": (("dynamometers", "left", "speed_sensor"), "flange_left_torque", "a speed sensor"),
    "unknown structure": (("loop", "structure"), "pid", "loop.structure"),
    "unknown knob": (("loop", "dead_tim"), 0.003, "dead_time"),
    "dead time negative": (("loop", "dead_time"), -0.001, "is not possible"),
    "dead time endless": (("loop", "dead_time"), 5, "is not possible"),
    "dead time in N": (("loop", "dead_time"), "3 N", "loop.dead_time"),
    "dead time NaN": (("loop", "dead_time"), float("nan"), "loop.dead_time"),
    "dead time a list": (("loop", "dead_time"), [0.003], "loop.dead_time"),
    "dead time true": (("loop", "dead_time"), True, "loop.dead_time"),
    "knows no list": (("loop", "knows"), "motor_torque", "loop.knows: is no list of names"),
    "knows a stranger": (("loop", "knows"), ["motor_torqe"], "motor_torque"),
    "fixed neither true nor false": (("loop", "fixed"), 1, "loop.fixed: is neither true nor false"),
    "specimen neither known nor unknown": (("loop", "specimen"), "shifts", "loop.specimen"),
    "specimen true": (("loop", "specimen"), True, "loop.specimen"),
    "fixed and moved": (("loop", "fixed"), True, "belongs to a fixed controller"),
    "no targets": (("targets",), [], "the case has none"),
    "target no number": (("targets", 0, "mode"), "shuffle", "is no mode number"),
    "target mode 0": (("targets", 0, "mode"), 0, "is no mode number"),
    "target tolerance 0": (("targets", 0, "frequency_tolerance"), 0, "greater than 0"),
    "target key unknown": (("targets", 0, "tolerance"), 0.1, "damping_tolerance"),
    "empty band": (("response", "band"), [30, 0.5], "is empty"),
    "band from 0": (("response", "band"), [0, 30], "begins at 0 Hz"),
    "band of one": (("response", "band"), [30], "is no pair"),
    "band NaN": (("response", "band"), [0.5, float("nan")], "response.band"),
    "band in metres": (("response", "band"), ["1 m", "2 m"], "response.band"),
    "nothing compared": (
        ("response", "compare"), [], 'is no list of transfer functions; write compare = [{ input = "…", sensor = "…" }]'
    ),
    "compared without sensor": (("response", "compare"), [{"input": "motor_torque"}], "is no pair"),
    "compared sensor off the rig": (("response", "compare", 0, "sensor"), "body_left_speed", "compare[1].sensor"),
    "no manoeuvre": (("manoeuvre",), None, "the case has none"),
    "manoeuvre on a dynamometer": (("manoeuvre", "dyno_left"), {"kind": "step", "amplitude": 1}, "manoeuvre"),
    "manoeuvre of unknown kind": (("manoeuvre", "motor_torque", "kind"), "tipin", "tip_in"),
    "manoeuvre too short": (("manoeuvre", "motor_torque", "duration"), 0.1, "ends before it begins"),
    "manoeuvre infinite": (("manoeuvre", "motor_torque", "amplitude"), float("inf"), "amplitude"),
    "limit unknown": (("limits", "shafts.flange_lef.torque"), 100, "shafts.flange_left.torque"),
    "limit 0": (("limits", "dynamometer_torque"), 0, "greater than 0"),
    "limit in the wrong unit": (("limits", "dynamometer_torque"), "1500 W", "limits.dynamometer_torque"),
    "damping share above 1": (("limits", "damping_share"), 1.2, "cannot be reached"),
    "roll-off of 0": (("limits", "rolled_off"), 0, "greater than 0"),
    "margin of 1": (("limits", "modulus_margin"), 1, "cannot be reached"),
    "move unknown": (("move", "rig.shafts.flange_left.stifness"), {"lower": 1, "upper": 2}, "stiffness"),
    "move of the specimen": (("move", "rig.inertias.motor.J"), {"lower": 0.01, "upper": 1}, "rig.inertias"),
    "bounds crossed": (FLANGE, {"lower": 4e5, "upper": 1e5}, "cross"),
    "bounds one": (FLANGE, {"lower": 1e5}, "has no bounds"),
    "bounds no table": (FLANGE, 2e5, "has no bounds"),
    "start outside": (FLANGE, {"lower": 1e5, "upper": 4e5, "start": 9e5}, "cross"),
    "bound negative": (FLANGE, {"lower": -1, "upper": 4e5}, "a physical bound is needed"),
    "bound NaN": (FLANGE, {"lower": 1e5, "upper": float("nan")}, "upper"),
    "mirror image too": (("move", "rig.shafts.flange_right.stiffness"), {"lower": 1e5, "upper": 4e5}, "mirror image"),
    "operating point empty": (("operating_point",), {}, "states no speed and no torque"),
    "operating point unknown": (("operating_point",), {"vehicle_spee": 3}, "vehicle_speed"),
    "operating point without radius": (("operating_point",), {"vehicle_speed": 9}, "rolling_radius: is missing"),
    "operating point in 1/s": (("operating_point",), {"motor": "30 1/s"}, "operating_point.motor"),
    "operating point that cannot be": (("operating_point",), {"motor": 10, "gearbox": 9}, "no steady motion"),
    "torque over speed falls back": (("limits", "dynamometer_torque_over_speed"), [[9, 1], [3, 1]], "do not rise"),
    "torque over speed of 0": (("limits", "dynamometer_torque_over_speed"), [[0, 1], [3, 0]], "greater than 0"),
    "torque over speed no table": (("limits", "dynamometer_torque_over_speed"), 300, "is no list of pairs"),
    "title a number": (("title",), 3, "title"),
}  # fmt: skip


def test_the_objective_of_older_cases_is_read(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(changed(("response", "objective"), "response_error"))
    assert load_case(path).compared


@pytest.mark.parametrize("name", BAD)
def test_one_line(name, tmp_path):
    path, value, hint = BAD[name]
    file = tmp_path / "case.toml"
    file.write_text(changed(path, value))
    with pytest.raises(InputError) as caught:
        load_case(file)
    line = str(caught.value)
    assert "\n" not in line
    assert ".toml" in line
    assert hint in line


@pytest.mark.parametrize(
    ("mode", "hint"), [(99, "the vehicle has"), (1, "rigid motion")], ids=["not there", "rigid"]
)  # fmt: skip
def test_targets_that_no_vehicle_has(mode, hint, tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(changed(("targets", 0, "mode"), mode))
    with pytest.raises(InputError, match=hint) as caught:
        target_modes(load_case(file))
    assert "targets[1].mode" in str(caught.value)


def test_a_plan_outside_its_bounds_is_refused_with_both(tmp_path):
    """A flange of 360 kN·m/rad that may be 20 to 120: to clip it would hide what stands on the bed."""
    for name in ("vehicle.toml", "rig.toml"):
        (tmp_path / name).write_text((EXAMPLES / "road_to_rig" / name).read_text())
    text = (EXAMPLES / "road_to_rig" / "observer.toml").read_text()
    flange = '\n[move]\n"rig.shafts.flange_left.stiffness" = { lower = 2e4, upper = 1.2e5, planned = 3.6e5 }\n'
    (tmp_path / "case.toml").write_text(text.split("[move]")[0] + flange)
    with pytest.raises(InputError, match=r"the plan of 360000 N\*m/rad lies outside its bounds 20000 … 120000"):
        load_case(tmp_path / "case.toml")


PLAY = '[[effects]]\nkind = "backlash"\nat = "shafts.side_shafts"\ngap = 1.2\n'


def starter(folder, **edits):
    """The case that `rigmatch new` writes, with edits by file: (before, after)."""
    rm.new(folder)
    for file, (before, after) in edits.items():
        path = folder / f"{file}.toml"
        text = path.read_text()
        assert before in text
        path.write_text(text.replace(before, after))
    return folder / "case.toml"


@pytest.mark.parametrize(
    ("edits", "said"),
    [
        ({"rig": ("ratio = 9.7", "ratio = -9.7")}, "the same part turns the other way"),
        ({"case": ("amplitude = 100 ", "amplitude = 0 ")}, "nothing moves"),
    ],
)
def test_a_mistake_of_a_newcomer_is_refused(tmp_path, edits, said):
    with pytest.raises(InputError, match=said):
        load_case(starter(tmp_path, **edits))


@pytest.mark.parametrize(
    ("edits", "said"),
    [
        ({"rig": ("stiffness = 15000", "stiffness = 12000")}, "12000 N*m/rad in the rig: the same part?"),
        (
            {"case": ('speed_sensor = "rotor_speed"', 'speed_sensor = "motor_speed"')},
            "measures motor: the right sensor?",
        ),
        ({"case": ('dynamometer_speed = "1200 1/min"', "dynamometer_speed = 1200")}, "is in rad/s: 11459 1/min"),
        (
            {"rig": ("[inputs.motor_torque]", PLAY + "[inputs.motor_torque]")},
            "gap is 1.2 rad, 69 deg: is it meant in degrees?",
        ),
    ],
)
def test_a_mistake_of_a_newcomer_is_told(tmp_path, capsys, edits, said):
    """By `--check` and, since the notes are the case's, by the match."""
    path = starter(tmp_path, **edits)
    assert any(said in note for note in load_case(path).notes)
    assert main(["match", str(path), "--check"]) == 0
    assert said in capsys.readouterr().out


def test_the_starter_and_the_examples_have_no_such_note(tmp_path):
    cases = [starter(tmp_path), *EXAMPLES.glob("*/case.toml")]
    assert len(cases) > 6
    for path in cases:
        assert not [note for note in load_case(path).notes if note.endswith(("?", "is tuned")) or "rad/s:" in note]


def test_one_adapter_of_two_is_told_and_the_mirror_that_is_offered_ties_both(tmp_path):
    """Unequal side shafts: no half mirrors the other, and only the left adapter may move."""
    for name in ("vehicle", "rig", "case"):
        text = (EXAMPLES / "road_to_rig" / f"{name}.toml").read_text()
        text = re.sub(r"\n\[mirror\].*?(?=\n\[|\Z)", "\n", text, flags=re.DOTALL)
        if name != "case":
            text = re.sub(
                r"(\[shafts\.side_right\].*?\nstiffness = )\S+", r"\g<1>1.3e4", text, count=1, flags=re.DOTALL
            )
        (tmp_path / f"{name}.toml").write_text(text)
    case = load_case(tmp_path / "case.toml")
    (said,) = [note for note in case.notes if "flange_left.stiffness may move" in note]
    assert "rig.shafts.flange_right.stiffness stays at" in said
    pairs = re.search(r"pairs = (\[\[.*\]\])", said)[1]
    with (tmp_path / "rig.toml").open("a") as file:
        file.write(f"\n[mirror]\npairs = {pairs}\n")
    tied = load_case(tmp_path / "case.toml")
    (move,) = [move for move in tied.moves if move.name == "rig.shafts.flange_left.stiffness"]
    assert "rig.shafts.flange_right.stiffness" in move.together
    assert not [note for note in tied.notes if "may move" in note]


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: rm.match(rm.load(EXAMPLES / "road_to_rig" / "rig.toml")), "case: System is no Case; give a path"),
        (lambda: rm.modes(3), "model: int is no System; give a path, or what rm.load returns"),
        (lambda: rm.match(EXAMPLES / "road_to_rig" / "case.toml", seed="a"), "seed: 'a' is no whole number"),
        (lambda: rm.map(3, "loop.dead_time"), "case: int is no Case"),
        (lambda: rm.campbell(None, "600:6000 1/min"), "model: NoneType is no System"),
    ],
)
def test_a_wrong_argument_in_python_is_one_line(call, said):
    with pytest.raises(InputError, match=re.escape(said)):
        call()
