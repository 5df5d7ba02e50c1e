"""Where a rig is cut whose specimen is not known, and what stays of it (:mod:`modelling.bed.specimen`)."""

from dataclasses import replace

import numpy as np
import pytest

from modelling.bed.specimen import known_part
from modelling.linear.state_space import response
from modelling.linear.steady_motion import speeds_of
from modelling.model_file import from_dict
from modelling.system import OperatingPoint

J, STIFF = {"J": 0.1}, {"stiffness": 1e4, "damping": 1.0}


def rig(**more):
    """motor – … – cage (open differential) – two side shafts, adapters, rotors; what is before the cage differs."""
    data = {
        "inertias": dict.fromkeys(("motor", "cage", "gear_l", "gear_r", "hub_l", "hub_r", "rotor_l", "rotor_r"), J),
        "differentials": {"axle": {"cage": "cage", "left": "gear_l", "right": "gear_r"}},
        "shafts": {
            **{f"side_{s}": {"between": [f"gear_{s}", f"hub_{s}"], **STIFF} for s in "lr"},
            **{f"flange_{s}": {"between": [f"hub_{s}", f"rotor_{s}"], **STIFF} for s in "lr"},
        },
        "inputs": {
            "motor_torque": {"on": "motor"}, **{f"dyno_{s}": {"on": f"rotor_{s}"} for s in "lr"},
        },
        "sensors": {
            "motor_speed": {"measures": "speed", "of": "motor"},
            **{f"flange_{s}_torque": {"measures": "torque", "of": f"flange_{s}"} for s in "lr"},
        },
    }  # fmt: skip
    for table, parts in more.items():
        data.setdefault(table, {})
        data[table] = [*data[table], *parts] if isinstance(parts, list) else data[table] | parts
    return from_dict(data, "rig")


def cut(system, ends="lr", follows="side"):
    return known_part(
        system, [f"rotor_{s}" for s in ends], [f"{follows}_{s}" for s in ends], [f"hub_{s}" for s in ends]
    )


BEFORE_CAGE = {
    "a gear": {"gears": {"final": {"between": ["motor", "cage"], "ratio": 9.0}}},
    "a shaft with a ratio": {"shafts": {"drive": {"between": ["motor", "cage"], "ratio": 9.0, **STIFF}}},
}


@pytest.mark.parametrize("before", BEFORE_CAGE.values(), ids=BEFORE_CAGE)
def test_the_cut_is_at_the_first_gear_and_the_differential_stays(before):
    part = cut(rig(**before))
    assert part.names == {"cage", "gear_l", "gear_r", "hub_l", "hub_r", "rotor_l", "rotor_r"}
    assert list(part.torques.values()) == ["cage"]
    assert list(part.ratios.values()) == [pytest.approx(9.0)]
    assert {one.name for one in part.system.inputs} == {"dyno_l", "dyno_r", *part.torques}
    assert {one.name for one in part.system.sensors} == {"flange_l_torque", "flange_r_torque"}
    assert [one.name for one in part.system.differentials] == ["axle"]


def test_a_clutch_is_a_shaft_without_stiffness_whose_friction_slips():
    clutch = {"between": ["motor", "cage"], "stiffness": 0.0}
    slips = [{"kind": "hysteresis", "at": "shafts.clutch", "torque": 100, "angle": 0.01}]
    part = cut(rig(shafts={"clutch": clutch}, effects=slips))
    assert part.places == ("shafts.clutch",)
    assert list(part.ratios.values()) == [1.0]
    damped = rig(shafts={"clutch": clutch | {"stiffness": 500.0}}, effects=slips)  # friction in a shaft is no clutch
    assert cut(damped).places == ()


def test_a_planetary_gear_is_cut():
    gears = {"planetary": {"sun": "motor", "carrier": "cage", "ring": "drum", "ratio": 3.0}}
    part = cut(rig(inertias={"drum": J}, planetary_gears=gears))
    assert part.places == ("planetary_gears.planetary",)
    assert "drum" not in part.names


def test_without_a_gear_nothing_is_cut():
    whole = rig(shafts={"drive": {"between": ["motor", "cage"], **STIFF}})
    part = cut(whole)
    assert part.places == ()
    assert part.names == {one.name for one in whole.inertias}


def test_a_gear_of_the_bed_stays():
    """Between a rotor and its shaft: a step-up gear belongs to the dynamometer."""
    step_up = {"step_up": {"between": ["rotor_l", "machine"], "ratio": 0.5}}
    behind = rig(inertias={"machine": J}, gears={**step_up, **BEFORE_CAGE["a gear"]["gears"]})
    part = known_part(behind, ["machine", "rotor_r"], ["side_l", "side_r"], ["hub_l", "hub_r"])
    assert part.places == ("gears.final",)
    assert "machine" in part.names


def test_two_drives_that_a_shaft_joins_have_a_torque_each():
    four = rig(
        inertias={"rear": J, "second": J},
        shafts={"joint": {"between": ["cage", "second"], **STIFF}},
        gears={**BEFORE_CAGE["a gear"]["gears"], "back": {"between": ["rear", "second"], "ratio": 7.0}},
        inputs={"rear_torque": {"on": "rear"}},
    )  # fmt: skip
    part = cut(four)
    assert list(part.torques.values()) == ["cage", "second"]
    assert sorted(part.ratios.values()) == [pytest.approx(7.0), pytest.approx(9.0)]


@pytest.mark.parametrize("seed", range(4))
def test_under_the_torque_that_the_rest_gives_the_part_moves_as_the_whole(seed):
    """Transfer functions: the torque at the cut that the whole has, into the part, makes the whole's flange torque."""
    draw = np.random.default_rng(seed)
    ratio = draw.uniform(3, 12)
    inertias = {name: {"J": float(draw.uniform(0.02, 0.4))} for name in ("motor", "cage", "rotor_l", "rotor_r")}
    drive = {"between": ["motor", "cage"], "ratio": ratio, "stiffness": 3e4, "damping": float(draw.uniform(1, 20))}
    probe = {"drive_torque": {"measures": "torque", "of": "drive"}}
    whole = rig(inertias=inertias, shafts={"drive": drive}, sensors=probe)
    part = cut(whole)
    (name,) = part.torques
    f = np.geomspace(0.5, 300, 30)
    of_whole, of_part = response(whole, f), response(part.system, f)
    wanted = of_whole["flange_l_torque", "motor_torque"]
    found = of_part["flange_l_torque", name] * of_whole["drive_torque", "motor_torque"]
    np.testing.assert_allclose(found, wanted, rtol=1e-6)


def test_the_part_turns_as_the_whole_does():
    """At an operating point with friction, which is linearised there."""
    whole = rig(
        **BEFORE_CAGE["a gear"],
        effects=[{"kind": "quadratic_drag", "at": "inertias.rotor_l", "coefficient": 0.01}],
    )
    point = OperatingPoint((("rotor_l", 30.0), ("rotor_r", 30.0)), (("motor_torque", 12.0),))
    whole = replace(whole, operating_point=point)
    part = cut(whole)
    speeds = speeds_of(whole)
    for name, speed in speeds_of(part.system).items():
        assert speed == pytest.approx(speeds[name], rel=1e-9)
