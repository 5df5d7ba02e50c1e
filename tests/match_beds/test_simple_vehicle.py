"""A residual vehicle of the user's own: put behind the cut, fitted to the vehicle, and what it lacks named."""

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import tomli_w
from small_bed import CASE, RIG, VEHICLE

from matching.match.case_file import case_files, load_case
from matching.match.findings import Finding, sentences, stated
from matching.match.loop import control_law, linear_bed
from matching.match.match import match, with_simple_vehicle
from matching.match.problem import problem_of
from matching.match.responses import SimpleVehicle, fitted_simple_vehicle
from matching.match.variables import SearchSettings
from modelling.bed.vehicle import cut
from modelling.errors import InputError
from modelling.linear.state_space import state_space
from modelling.linear.steady_motion import speeds_of, torques_of
from modelling.modal.modes import modes

RIGID_BODY = """
[inertias.wheel]
J = { value = 30, lower = 5, upper = 100 }
drag = 0.5
[inputs.road]
on = "wheel"
"""
AS_THE_VEHICLE = """
[inertias.wheel]
J = { value = 0.6, lower = 0.1, upper = 10 }
[inertias.body]
J = { value = 70, lower = 10, upper = 100 }
drag = 0.5
[shafts.tyre]
between = ["wheel", "body"]
stiffness = { value = 5000, lower = 1000, upper = 20000 }
damping = 30
[inputs.road]
on = "body"
"""


def written(folder, own, moved=""):
    texts = {"vehicle.toml": VEHICLE, "rig.toml": RIG, "own.toml": own}
    texts["case.toml"] = CASE.replace("[loop]", '[residual_vehicle]\nmodel = "own.toml"\n[loop]') + moved
    for name, text in texts.items():
        (folder / name).write_text(text)
    return load_case(folder / "case.toml")


def test_the_vehicles_own_parts_are_found_again(tmp_path, small_case):
    """A residual vehicle of the same build with wrong values: the fit ends at the vehicle."""
    fitted, found = fitted_simple_vehicle(written(tmp_path, AS_THE_VEHICLE))
    assert found.as_written > 0.3
    assert found.fitted < 1e-4
    assert found.left_out == ()
    assert fitted.simple_vehicle.parameters["inertias.body.J"].value == pytest.approx(40, rel=1e-3)
    assert fitted.simple_vehicle.parameters["shafts.tyre.stiffness"].value == pytest.approx(8000, rel=1e-3)
    own, wanted = control_law(linear_bed(fitted)), control_law(linear_bed(small_case))
    frequencies = np.exp(2j * np.pi * np.array([2.0, 5.0]) * 1e-3)
    for z in frequencies:
        answers = [law.K @ np.linalg.solve(z * np.eye(len(law.A)) - law.A, law.Bw) for law in (own, wanted)]
        assert answers[0] == pytest.approx(answers[1], rel=1e-2)


def test_a_rigid_body_comes_as_near_as_it_can_and_the_tyre_is_what_it_lacks(tmp_path):
    case = written(tmp_path, RIGID_BODY)
    fitted, found = fitted_simple_vehicle(case)
    assert 0.01 < found.fitted < found.as_written
    assert found.left_out[0][0] == "shafts.tyre"
    assert found.left_out[0][1] < 0.01 * found.fitted  # a vehicle whose tyre is rigid it would reproduce
    assert found.left_out[1][1] > found.fitted  # a car without its body it would not
    start, end = found.values["inertias.wheel.J"]
    assert start == 30
    for factor in (0.99, 1.01):  # no other inertia comes nearer
        other = fitted.simple_vehicle.with_values({"inertias.wheel.J": end * factor})
        assert fitted_simple_vehicle(replace(case, simple_vehicle=_fixed(other)))[1].fitted > found.fitted
    assert "shafts.tyre costs most" in found.sentence()
    again = tmp_path / "again"
    again.mkdir()
    for name, text in case_files(fitted).items():
        (again / name).write_text(text)
    assert load_case(again / "case.toml").simple_vehicle.parameters["inertias.wheel.J"].value == pytest.approx(end)


def test_what_moves_begins_at_the_fitted_values_and_is_weighted_by_the_emulated_modes(tmp_path, small_case):
    """The user's tyre has another name than the vehicle's, and holds as much of the target mode's energy."""
    moved = '[move]\n"residual_vehicle.shafts.rubber.stiffness" = { lower = 1000, upper = 20000 }\n'
    case = written(tmp_path, AS_THE_VEHICLE.replace("tyre", "rubber"), moved)
    fitted, _ = fitted_simple_vehicle(case)
    (move,) = (move for move in fitted.moves if move.name.startswith("residual_vehicle."))
    assert (move.start, move.planned) == pytest.approx((8000, 8000), rel=1e-3)
    mode = modes(small_case.vehicle)[small_case.targets[0].mode - 1]
    assert problem_of(fitted).shares[move.name] == pytest.approx(mode.potential["shafts.tyre"], rel=1e-2)


def _fixed(system):
    """The system without ranges: nothing is left to fit."""
    inertias = tuple(replace(part, J=replace(part.J, lower=None, upper=None)) for part in system.inertias)
    return replace(system, inertias=inertias)


@pytest.mark.long
def test_a_match_with_a_rigid_body_says_how_near_it_comes(tmp_path):
    case, found = fitted_simple_vehicle(written(tmp_path, RIGID_BODY))
    result = match(
        case, beds=2, settings=SearchSettings(drawn=2, pool=8, rounds=1, steps=1, blind=0, scenarios=0, emulated=0)
    )
    assert result.response_error.after == pytest.approx(found.fitted, rel=0.2)  # what is missing, and nothing else


@pytest.mark.parametrize(
    ("own", "said"),
    [
        (RIGID_BODY.replace("wheel", "lump"), "lack wheel"),
        (RIGID_BODY + '[inertias.motor]\nJ = 1\n[inputs.extra]\non = "motor"\n', "which the bed has"),
    ],
)
def test_what_does_not_fit_the_cut_is_refused_in_one_line(tmp_path, own, said):
    with pytest.raises(InputError, match=said):
        written(tmp_path, own)


COMPACT = Path(__file__).parents[2] / "examples" / "compact_bev"
RIGID_CAR = """
[inertias.wheel_left]
J = 0.95
[inertias.wheel_right]
J = 0.95
[inertias.car]
J = 144.2
drag = 0.6
[shafts.left]
between = ["wheel_left", "car"]
stiffness = 12000
damping = 20
[shafts.right]
between = ["wheel_right", "car"]
stiffness = 12000
damping = 20
[inputs.road_torque]
on = "car"
"""


def at_speed(folder, own):
    """compact_bev at 30 km/h with a road load that grows with the speed, and with a residual vehicle of one's own."""
    data = tomllib.loads((COMPACT / "case.toml").read_text())
    data["operating_point"]["road_load"] = {"constant": 100, "quadratic": 0.4}
    data |= {"residual_vehicle": {"model": "own.toml"}, "move": {}}
    texts = {name: (COMPACT / name).read_text() for name in ("vehicle.toml", "rig.toml")}
    for name, text in (texts | {"own.toml": own, "case.toml": tomli_w.dumps(data)}).items():
        (folder / name).write_text(text)
    return load_case(folder / "case.toml")


def test_at_an_operating_point_it_turns_as_the_vehicle_under_the_same_road_load(tmp_path):
    """The wheels as the vehicle's, which slip; each cut carries half of drag and road load of a car without slip."""
    case = at_speed(tmp_path, RIGID_CAR)
    (part,) = case.residual_vehicle.parts
    wheel, radius = speeds_of(case.vehicle)["wheel_left"], 0.31
    assert wheel > 30 / 3.6 / radius
    assert speeds_of(part) == pytest.approx(dict.fromkeys(("wheel_left", "wheel_right", "car"), wheel))
    half = (0.6 * wheel + 100 * radius + 0.4 * radius**3 * wheel**2) / 2
    assert torques_of(part)["side_left_torque"] == pytest.approx(half)
    slope = 0.6 + 2 * 0.4 * radius**3 * wheel
    assert max(np.linalg.eigvals(state_space(part).A).real) == pytest.approx(-slope / (144.2 + 1.9), rel=2e-3)
    again = tmp_path / "again"
    again.mkdir()
    for name, text in case_files(case).items():
        (again / name).write_text(text)
    (read,) = load_case(again / "case.toml").residual_vehicle.parts
    assert torques_of(read) == pytest.approx(torques_of(part))
    assert pytest.approx(state_space(part).A) == state_space(read).A


def test_at_an_operating_point_the_vehicles_own_parts_change_nothing(tmp_path):
    data = tomllib.loads((COMPACT / "vehicle.toml").read_text())
    del data["reference"], data["title"]
    for table, names in (
        ("inertias", ("wheel_left", "wheel_right", "body")), ("shafts", ("tyre_left", "tyre_right")),
        ("inputs", ("road_torque",)), ("sensors", ()), ("gears", ()), ("differentials", ()),
    ):  # fmt: skip
        data[table] = {name: data[table][name] for name in names}
    case = at_speed(tmp_path, tomli_w.dumps(data))
    plain = cut(case.vehicle, case.rig)
    for own, wanted in zip(case.residual_vehicle.parts, plain.parts, strict=True):
        assert torques_of(own) == pytest.approx(torques_of(wanted))
        assert pytest.approx(state_space(wanted).A) == state_space(own).A


def test_one_that_cannot_turn_as_the_vehicle_is_refused_in_one_line(tmp_path):
    unlike = RIGID_CAR.replace("[shafts.right]", "[gears.right]").replace(
        "stiffness = 12000\ndamping = 20\n[in", "ratio = 2\n[in"
    )
    with pytest.raises(InputError, match=r"operating_point: the vehicle has it, with the residual vehicle"):
        at_speed(tmp_path, unlike)


@dataclass(frozen=True)
class FewOfAResult:
    """The fields of a match's result that what its residual vehicle lacks may change."""

    case: SimpleNamespace
    findings: tuple[Finding, ...]
    remarks: tuple[str, ...] = ("a note",)
    simple_vehicle: SimpleVehicle | None = None

    @property
    def limits(self) -> tuple[str, ...]:
        return tuple(sentences(self.findings))


@pytest.mark.parametrize(("fitted", "limits", "is_limit"), [
    (0.2, ("missed",), True), (0.2, (), False), (0.05, ("missed",), False), (0.05, (), False),
])  # fmt: skip
def test_what_it_lacks_stands_first_among_the_limits_where_it_is_too_much_and_else_among_the_notes(
    fitted, limits, is_limit
):
    simple = SimpleVehicle(0.3, fitted, {}, ())
    before = tuple(stated("components_differ", limits))
    found = with_simple_vehicle(FewOfAResult(SimpleNamespace(tolerance=0.1), before), simple)
    assert found.simple_vehicle is simple
    assert found.limits == ((simple.sentence(), *limits) if is_limit else limits)
    assert found.remarks == (("a note",) if is_limit else (simple.sentence(), "a note"))
    assert with_simple_vehicle(found, None) is found
