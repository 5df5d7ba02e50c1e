"""In what beds differ from the model, quantity by quantity."""

from dataclasses import replace

import pytest

from matching.match.imperfections import (
    EVERYTHING_DRAWN,
    EVERYTHING_STATED,
    Imperfection,
    imperfections,
    perturbed_system,
)
from modelling.system import Effect, Quantity

NOTHING = Imperfection("")


def named(case, words):
    (row,) = (row for row in imperfections(case, 250.0, 3) if words in row.words)
    return row


@pytest.mark.parametrize(
    ("words", "changed"),
    [
        ("nothing", {}),
        ("shafts at the cut", {"values": {"rig.shafts.side.stiffness": 0.95 * 4000}}),
        ("inertia of motor 5 % higher", {"values": {"rig.inertias.motor.J": 1.05 * 0.5}}),
        ("dead time 0.5 ms longer", {"values": {"loop.dead_time": 0.0028}}),
        ("driving torque 5 % high and 5 ms late", {"demand_factor": 1.05, "demand_late": 5e-3}),
        ("lash of 0.02 rad", {"gap": 0.02}),
        ("dry friction of 5 N·m", {"friction": 5.0}),  # 2 % of the largest torque
        ("noise, offset, encoders", {"poor_sensors": True}),
    ],
)
def test_one_thing_is_wrong_at_a_time(small_case, words, changed):
    row = named(small_case, words)
    assert row.values == pytest.approx(changed.pop("values", {}))
    rest = replace(NOTHING, words=row.words, values=row.values, **changed)
    assert row == rest


def test_all_that_is_wrong_alone_is_wrong_at_once(small_case):
    row = named(small_case, EVERYTHING_STATED)
    values = {"rig.shafts.side.stiffness": 0.95 * 4000, "rig.inertias.motor.J": 1.05 * 0.5, "loop.dead_time": 0.0028}
    assert row.values == pytest.approx(values)
    wrong = replace(NOTHING, gap=0.02, friction=5.0, demand_factor=1.05, demand_late=5e-3, poor_sensors=True)
    assert row == replace(wrong, words=EVERYTHING_STATED, values=row.values)


def test_everything_is_wrong_at_once_on_four_drawn_beds(small_case):
    rows = [row for row in imperfections(small_case, 250.0, 3) if row.words == EVERYTHING_DRAWN]
    drawn = small_case.uncertainty.draw(4, 3)
    wrong = replace(NOTHING, gap=0.02, friction=5.0, demand_factor=1.05, demand_late=5e-3, poor_sensors=True)
    for row, position in zip(rows, drawn, strict=True):
        values = small_case.uncertainty.at(position)
        assert row == replace(wrong, words=row.words, values=values)


def test_a_flaw_of_a_shared_part_is_in_vehicle_and_rig_and_one_of_the_bed_in_the_rig_alone(small_case):
    flaw = Imperfection(
        "", {"rig.shafts.side.stiffness": 3000.0, "rig.shafts.flange.stiffness": 2e4, "loop.dead_time": 9e-3}
    )
    rig, vehicle = (
        perturbed_system(system, flaw, small_case).parameters for system in (small_case.rig, small_case.vehicle)
    )
    assert rig["shafts.side.stiffness"].value == vehicle["shafts.side.stiffness"].value == 3000.0
    assert rig["shafts.flange.stiffness"].value == 2e4
    assert vehicle["shafts.tyre.stiffness"].value == 8000.0


@pytest.mark.parametrize("gap", [0.0, 0.02])
def test_lash_is_in_the_cut_shaft_and_friction_on_the_beds_side_of_it(small_case, gap):
    for system in (small_case.rig, small_case.vehicle):
        effects = perturbed_system(system, Imperfection("", gap=gap, friction=3.0), small_case).effects
        friction = [(effect.at, dict(effect.parameters)) for effect in effects if effect.kind == "coulomb_friction"]
        assert friction == [("inertias.motor", {"torque": Quantity(3.0)})]
        lash = [(effect.at, dict(effect.parameters)) for effect in effects if effect.kind == "backlash"]
        assert lash == ([("shafts.side", {"gap": Quantity(gap)})] if gap else [])


def test_parts_with_an_effect_of_their_own_keep_it(small_case):
    laden = small_case.rig.with_effects(
        Effect("backlash", "shafts.side", (("gap", Quantity(0.5)),)),
        Effect("coulomb_friction", "inertias.motor", (("torque", Quantity(9.0)),)),
    )
    made = perturbed_system(laden, Imperfection("", gap=0.02, friction=3.0), small_case)
    assert made.effects == laden.effects
