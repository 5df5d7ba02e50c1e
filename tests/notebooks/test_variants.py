"""The table of variants that notebook 03 reads: its rows are those of the script, and the program still finds them."""

import json

import pytest

from tests.benchmarks.observer_variants import BEDS, FOLDER, VARIANTS, case_of, row

KEPT = json.loads((FOLDER / "variants.json").read_text(encoding="utf-8"))


def test_every_variant_has_its_row():
    assert [kept["name"] for kept in KEPT["rows"]] == [variant.name for variant in VARIANTS]
    assert KEPT["fresh_beds"] == BEDS
    assert {kept["beds"]["drawn"] for kept in KEPT["rows"]} == {BEDS}


def test_a_variant_changes_what_it_says():
    cases = {variant.name: case_of(variant) for variant in VARIANTS if variant.name.startswith("observer")}
    plain = cases["observer"]
    assert (plain.loop["dead_time"], plain.loop.further_sensors) == (0.003, ("motor_speed",))
    assert cases["observer, dead time 1 ms"].loop["dead_time"] == 0.001
    assert cases["observer, motor speed not measured"].loop.further_sensors == ()
    box = cases["observer, side shafts known to 1 %"].uncertainty.uncertain
    known = {quantity.name: quantity.half_width / quantity.value for quantity in box}
    assert known["rig.shafts.side_left.stiffness"] == pytest.approx(0.01)
    assert known["rig.shafts.side_right.stiffness"] == pytest.approx(0.01)
    assert known["rig.shafts.flange_left.stiffness"] == pytest.approx(0.05)
    heavy = cases["observer, adapters 0.1 kg·m²"].rig.parameters
    assert [heavy[f"inertias.adapter_{side}.J"].value for side in ("left", "right")] == [0.1, 0.1]


@pytest.mark.long
@pytest.mark.parametrize("name", ["observer", "observer, dead time 1 ms"])
def test_the_program_still_finds_the_row(name):
    (variant,) = (variant for variant in VARIANTS if variant.name == name)
    (kept,) = (kept for kept in KEPT["rows"] if kept["name"] == name)
    now = row(variant)
    assert now["status"] == kept["status"]
    assert now["unmeasured"] == pytest.approx(kept["unmeasured"], rel=0.1)
    assert now["beds"]["stable"] == kept["beds"]["stable"]
    for end in ("error_median", "unmeasured_median", "error_95", "unmeasured_95"):
        assert now["beds"][end] == pytest.approx(kept["beds"][end], rel=0.05)
