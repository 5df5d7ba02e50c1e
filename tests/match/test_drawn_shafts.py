"""Shafts that move by their drawing: what follows from a dimension, against closed forms (GJ/L, 16T/πd³) of the tests'
own, and against the same case in stiffness and inertias."""

import tomllib
from dataclasses import replace
from math import pi

import numpy as np
import pytest

import rigmatch as rm
from matching.match.case_file import case_files, load_case
from matching.match.demands import demands, rig_values
from matching.match.match import match
from matching.match.objective import search_for
from matching.match.order_sheet import ordered_parts
from matching.match.problem import problem_of
from matching.match.variables import SearchSettings
from matching.report import order_sheet
from matching.report.match import report
from modelling.errors import InputError
from modelling.model_file import dumps, from_dict

STEEL, DENSITY = 79.3e9, 7850.0
FEW = SearchSettings(drawn=2, pool=4, rounds=1, steps=2, joint_rounds=1, restarts=0, emulated=0.0, scenarios=0, blind=0)
LITTLE = replace(FEW, drawn=4, pool=8, steps=6, starts=1, fresh=20)
STEP = 2e-4


def tube(length, outside, inside=0.0, modulus=STEEL, density=DENSITY):
    """Stiffness, inertia and shear stress per torque of a round bar or tube."""
    fourth = outside**4 - inside**4
    return modulus * pi * fourth / 32 / length, density * length * pi * fourth / 32, 16 * outside / (pi * fourth)


def drawn(rng):
    """Sizes of a shaft far from each other: length, outside, inside."""
    outside = rng.uniform(0.02, 0.09)
    return rng.uniform(0.05, 1.2), outside, float(rng.choice([0.0, rng.uniform(0.2, 0.85)])) * outside


def chain(length, outside, inside):
    shaft = {"between": ["a", "b"], "length": length, "diameter": outside, "inner_diameter": inside, "damping": 3.0}
    inertias = {"a": {"J": 0.02}, "b": {"J": 0.3, "drag": 0.1}, "c": {"J": 0.1}}
    other = {"between": ["b", "c"], "length": 0.4, "diameter": 0.03}
    return from_dict({"inertias": inertias, "shafts": {"s": shaft, "t": other}})


@pytest.mark.parametrize("seed", range(8))
def test_stiffness_inertia_and_stress_follow_the_dimensions_and_the_file_keeps_them(seed):
    rng = np.random.default_rng(650 + seed)
    before, after = drawn(rng), drawn(rng)
    names = [f"shafts.s.{key}" for key in ("length", "diameter", "inner_diameter")]
    try:
        moved = chain(*before).with_values(dict(zip(names, after, strict=True)))
    except InputError:
        pytest.fail("sizes are checked together, not one after another")
    stiffness, inertia, stress = tube(*after)
    beside = tube(0.4, 0.03)[1]
    assert moved.parameters["shafts.s.stiffness"].value == pytest.approx(stiffness, rel=1e-12)
    assert moved.parameters["inertias.a.J"].value == pytest.approx(0.02 + inertia / 2, rel=1e-12)
    assert moved.parameters["inertias.b.J"].value == pytest.approx(0.3 + inertia / 2 + beside / 2, rel=1e-12)
    assert moved.shafts[0].drawing.stress_per_torque == pytest.approx(stress, rel=1e-12)
    written = tomllib.loads(dumps(moved))
    assert [written["shafts"]["s"].get(name[9:], 0.0) for name in names] == list(after)
    assert "stiffness" not in written["shafts"]["s"]
    assert written["inertias"]["a"]["J"] == pytest.approx(0.02, rel=1e-9)
    again = from_dict(written)
    assert again.dimensions == moved.dimensions
    for name, quantity in moved.parameters.items():
        assert again.parameters[name].value == pytest.approx(quantity.value, rel=1e-14)


def test_a_stiffness_that_is_changed_by_itself_ends_the_drawing():
    system = chain(0.5, 0.04, 0.0)
    changed = system.with_values({"shafts.s.stiffness": 1234.0})
    written = tomllib.loads(dumps(changed))
    assert written["shafts"]["s"]["stiffness"] == 1234.0
    assert "diameter" not in written["shafts"]["s"]
    assert written["inertias"]["a"]["J"] == system.parameters["inertias.a.J"].value
    assert from_dict(written).parameters == changed.parameters


# --- A case whose flange is stated by its drawing.

PLAN = 0.09, 0.045, 0.02


def case_of(folder, move, shaft=None, J=(0.09, 1.1), limits=""):
    """The starter, its flange by the drawing or by the table ``shaft``, with these lines below [move] alone."""
    rm.new(folder)
    rig = (folder / "rig.toml").read_text(encoding="utf-8")
    length, outside, inside = PLAN
    by_drawing = f"length = {length}\ndiameter = {outside}\ninner_diameter = {inside}"
    rig = rig.replace("stiffness = { value = 360000, tolerance = 0.1 }", shaft or by_drawing)
    rig = rig.replace("J = 0.09", f"J = {J[0]!r}").replace("J = 1.1", f"J = {J[1]!r}")
    (folder / "rig.toml").write_text(rig, encoding="utf-8")
    text = (folder / "case.toml").read_text(encoding="utf-8")
    text = text.replace('"shafts.flange.torque" = 2000           # N·m', f'"shafts.flange.torque" = 2000\n{limits}')
    lines = [line for line in text.splitlines() if not line.startswith('"rig.')]
    (folder / "case.toml").write_text("\n".join([*lines, *move]), encoding="utf-8")
    return folder / "case.toml"


def stiff(folder, sizes, move=()):
    """The same case with the flange as a stiffness and with inertias, by the closed forms."""
    stiffness, inertia, _ = tube(*sizes)
    return case_of(folder, move, f"stiffness = {stiffness!r}", (0.09 + inertia / 2, 1.1 + inertia / 2))


DIAMETER = '"rig.shafts.flange.diameter" = { lower = "30 mm", upper = "90 mm" }'
LENGTH = '"rig.shafts.flange.length" = { lower = 0.05, upper = 0.3 }'


@pytest.mark.parametrize("seed", range(2))
def test_cost_and_its_derivatives_are_those_of_the_stiffness_and_inertias_that_follow(seed, tmp_path):
    """The second case knows no drawing; its derivative by a dimension is a difference of two such cases."""
    rng = np.random.default_rng(6500 + seed)
    problem = problem_of(load_case(case_of(tmp_path / "drawn", [DIAMETER, LENGTH])))
    search = search_for(problem.case, problem.moves, problem.shares, problem.demands, FEW).members[0]
    names = list(search.names)
    at = {"diameter": names.index("rig.shafts.flange.diameter"), "length": names.index("rig.shafts.flange.length")}
    low, high = search.bounds()
    x = np.clip(search.begin({"loop.proportional_gain": 40.0, "loop.integral_gain": 40.0}), low + 0.01, high - 0.01)
    x[list(at.values())] = rng.uniform(0.15, 0.85, 2)

    def judged(point, number):
        values = search.values(point)
        sizes = values["rig.shafts.flange.length"], values["rig.shafts.flange.diameter"], PLAN[2]
        other = problem_of(load_case(stiff(tmp_path / f"{number}", sizes)))
        alone = search_for(other.case, other.moves, other.shares, other.demands, FEW).members[0]
        assert set(alone.names) == set(names) - {f"rig.shafts.flange.{key}" for key in at}
        return alone.judged(np.array([point[names.index(name)] for name in alone.names])), search._change(point)

    own, (here, change) = search.judged(x), judged(x, "here")
    unmoved = [i for i in range(len(x)) if i not in at.values()]
    still = x.copy()
    still[list(at.values())] = [search.variables[i].at(search.variables[i].move.planned) for i in at.values()]
    assert own.cost - change == pytest.approx(here.cost - search._change(still), rel=1e-9)
    cost, _ = search.slopes(x)
    assert np.all(np.isfinite(cost[unmoved]))
    for key, i in at.items():
        step = STEP * np.eye(len(x))[i]
        (there, _), (back, _) = judged(x + step, f"{key}+"), judged(x - step, f"{key}-")
        wanted = (there.cost - back.cost) / (2 * STEP)
        wanted += (search._change(x + step) - search._change(x - step)) / (2 * STEP)
        assert cost[i] == pytest.approx(wanted, rel=5e-3, abs=1e-4 * np.abs(cost).max()), key


def test_limits_on_shear_stress_at_the_torque_of_the_manoeuvre(tmp_path):
    limits = '"shafts.flange.shear_stress" = "100 MPa"\n"shafts.flange.shear_stress_amplitude" = "50 MPa"'
    case = load_case(case_of(tmp_path, [DIAMETER], limits=limits))
    asked = demands(case)
    (torque,) = [part.loads(rig_values(case)).shafts["flange"] for part in asked.behind]
    for outside in (0.031, 0.045, 0.088):
        values = {**rig_values(case), "rig.shafts.flange.diameter": outside}
        taken = {one.limit: one.demand for one in asked.taken(values)}
        per_torque = tube(PLAN[0], outside, PLAN[2])[2]
        assert taken["shafts.flange.shear_stress"] == pytest.approx(per_torque * np.abs(torque).max(), rel=1e-9)
        half_range = (torque.max() - torque.min()) / 2
        assert taken["shafts.flange.shear_stress_amplitude"] == pytest.approx(per_torque * half_range, rel=1e-9)
    assert "rig.shafts.flange.diameter" in asked.quantities("shafts.flange.shear_stress", rig_values(case))
    # a limit that only a thicker shaft keeps releases the diameter, and a bound below it is told
    needed = (16 * np.abs(torque).max() / pi / 100e6) ** (1 / 3)
    assert PLAN[1] < needed * 1.5  # the bar of the test is loaded in earnest
    tight = f'"shafts.flange.shear_stress" = {float(tube(*PLAN)[2] * np.abs(torque).max() / 2)}'
    thin = '"rig.shafts.flange.diameter" = { lower = "40 mm", upper = "46 mm" }'
    problem = problem_of(load_case(case_of(tmp_path / "tight", [thin], limits=tight)))
    assert [one.limit for one in problem.beyond] == ["shafts.flange.shear_stress"]
    assert not problem_of(load_case(case_of(tmp_path / "wide", [DIAMETER], limits=tight))).beyond


@pytest.mark.parametrize(
    ("move", "limits", "said"),
    [
        ([DIAMETER, '"rig.shafts.flange.stiffness" = { lower = 1e5, upper = 1e6 }'], "", "which moves as well"),
        ([DIAMETER, '"rig.inertias.adapter.J" = { lower = 0.05, upper = 0.2 }'], "", "inertias.adapter.J, which moves"),
        (['"rig.shafts.flange.diameter" = { lower = 0.015, upper = 0.05 }'], "", "inside reach the one outside"),
        (['"rig.shafts.flange.diameter" = { lower = 0, upper = 0.05 }'], "", "0 is not possible"),
        (['"rig.shafts.flange.diametre" = { lower = 0.03, upper = 0.05 }'], "", "'rig.shafts.flange.diameter'"),
        (['"rig.shafts.flange.diameter" = { lower = "3 kg", upper = 0.05 }'], "", "kg"),
        ([], '"shafts.rotor_shaft.shear_stress" = "100 MPa"', "needs the diameter of the shaft"),
        ([], '"shafts.flange.shear_stress" = "100 N*m"', "N*m"),
    ],
)  # fmt: skip
def test_what_cannot_be(move, limits, said, tmp_path):
    with pytest.raises(InputError) as fault:
        load_case(case_of(tmp_path, move, limits=limits))
    assert said in str(fault.value)
    assert "case.toml" in str(fault.value)


def test_values_by_dimension_and_a_tuned_case_that_remembers_its_plan(tmp_path):
    case = load_case(case_of(tmp_path, [DIAMETER]))
    changed = case.with_values({"rig.shafts.flange.diameter": "60 mm"})
    stiffness, inertia, _ = tube(PLAN[0], 0.06, PLAN[2])
    assert changed.rig.parameters["shafts.flange.stiffness"].value == pytest.approx(stiffness, rel=1e-12)
    by_name = {one.name: one for one in changed.uncertainty.uncertain}
    assert by_name["rig.shafts.flange.stiffness"].value == pytest.approx(stiffness, rel=1e-12)
    assert by_name["rig.inertias.adapter.J"].value == pytest.approx(0.09 + inertia / 2, rel=1e-12)
    (tmp_path / "tuned").mkdir()
    for name, text in case_files(changed).items():
        (tmp_path / "tuned" / name).write_text(text, encoding="utf-8")
    again = load_case(tmp_path / "tuned" / "case.toml")
    (move,) = [one for one in again.moves if one.name == "rig.shafts.flange.diameter"]
    assert (move.planned, move.start) == (PLAN[1], 0.06)
    planned, own = again.rig.parameters, case.rig.parameters  # a tuned case stands for the plan it came from
    for name in ("shafts.flange.stiffness", "inertias.adapter.J", "inertias.rotor.J"):
        assert planned[name].value == pytest.approx(own[name].value, rel=1e-12)


@pytest.mark.long
def test_a_diameter_is_ordered_as_one_of_the_catalogue(tmp_path):
    """Planned far too thin: a limit on its stress asks for another part."""
    parts = [0.032, 0.040, 0.052, 0.064, 0.085]
    move = f'"rig.shafts.flange.diameter" = {{ lower = 0.03, upper = 0.09, planned = 0.0325, catalogue = {parts} }}'
    path = case_of(tmp_path, [move], limits='"shafts.flange.shear_stress" = "100 MPa"')
    result = match(load_case(path), settings=replace(LITTLE, rounds=3, steps=15, joint_rounds=2))
    (trade,) = result.adapters
    assert trade.ordered in [pytest.approx(part) for part in parts]
    stiffness, _, stress = tube(PLAN[0], trade.ordered, PLAN[2])
    peaks = result.verification.peaks
    assert peaks["shafts.flange.shear_stress"] == pytest.approx(stress * peaks["shafts.flange.torque"], rel=1e-9)
    assert trade.twist == pytest.approx(2000 / stiffness, rel=1e-9)
    assert tomllib.loads(dumps(result.tuned.rig))["shafts"]["flange"]["diameter"] == pytest.approx(trade.ordered)
    assert "flange, diameter" in str(report(result.to_dict(), result=result).lists)
    # the order sheet: loads by the closed forms, at the torque that the simulation has
    (part,) = ordered_parts(result)
    values, loads = ({one.key: one for one in part.values}, {one.what: one for one in part.loads})
    torque = result.verification.traces.absolute("shafts.flange.torque")
    largest, half_range = np.abs(torque).max(), (torque.max() - torque.min()) / 2
    assert loads["shear_stress"].value == pytest.approx(stress * largest, rel=1e-9)
    assert loads["shear_stress"].limit == 100e6
    assert loads["shear_stress_amplitude"].value == pytest.approx(stress * half_range, rel=1e-9)
    assert loads["torque"].value == pytest.approx(largest)
    assert values["stiffness"].ordered == pytest.approx(stiffness, rel=1e-9)
    assert values["inertia"].ordered == pytest.approx(tube(PLAN[0], trade.ordered, PLAN[2])[1], rel=1e-9)
    ends = sorted(tube(PLAN[0], end, PLAN[2])[0] for end in trade.acceptable)
    assert values["stiffness"].serves == pytest.approx(ends, rel=1e-9)
    page = order_sheet.page(result, None)
    for said in (f"{1e3 * trade.ordered:g} mm", "32.5 mm", "90 mm", "one of the catalogue", "shear stress amplitude"):
        assert said in page
    assert ("at its upper bound" in page) == (trade.ordered == 0.085 and values["diameter"].at_bound)
