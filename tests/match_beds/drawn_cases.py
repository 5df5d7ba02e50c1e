"""Cases drawn at random: a drive and its bed of one of six builds, every number of them drawn, a loop and a question.

One dynamometer on a chain or in the place of an axle, two with independent motors, two behind a differential with one
body or with a body each, four; dead times 0.5 to 20 ms; every control structure; with and without the motor's speed.
"""

import tomllib
from pathlib import Path

import numpy as np
import tomli_w
from small_bed import AXLE, CASE, RIG, VEHICLE

EXAMPLES = Path(__file__).parents[2] / "examples"
DEAD_TIMES_S = (0.0005, 0.001, 0.003, 0.005, 0.008, 0.012, 0.02)
STRUCTURES = ("observer", "pi", "model_based", "observer")
BUILDS = ("chain", "axle", "motors", "compact_bev", "road_to_rig", "four_wheel")
SPREAD = 0.3  # of every inertia, stiffness and damping, either way


def draw(seed, folder):
    """Write a drawn case to a folder; the case file."""
    random = np.random.default_rng([31, seed])
    build = BUILDS[seed % len(BUILDS)]
    vehicle, rig, case = models(build)
    factors = {}
    for model in (vehicle, rig):
        scale(model, random, factors)
    structure = STRUCTURES[(seed // len(BUILDS) + seed) % len(STRUCTURES)]
    loop = {
        "structure": structure, "dead_time": DEAD_TIMES_S[int(random.integers(len(DEAD_TIMES_S)))],
        "sample_time": float(random.choice([0.0005, 0.001])), "inverter_lag": float(random.uniform(0.0005, 0.003)),
    }  # fmt: skip
    drives = [name for name in rig["inputs"] if not name.startswith("dyno")]
    if structure == "model_based" or random.random() < 0.7:
        loop["knows"] = drives
    if structure == "observer" and random.random() < 0.6:
        loop["measures"] = [name for name in rig["sensors"] if name.startswith(("motor", "speed"))]
    case["loop"] = loop
    case["limits"]["dynamometer_torque"] *= 0.3 if random.random() < 0.1 else 1.0
    if structure == "observer":
        case.pop("move", None)
    else:
        case["move"] = {
            "loop.proportional_gain": {"lower": 1, "upper": 300}, "loop.integral_gain": {"lower": 1, "upper": 3000},
            "loop.torque_feed_forward": {"lower": 0, "upper": 1.5},
            "loop.acceleration_feed_forward": {"lower": 0, "upper": 1.2}, "loop.lead_time": {"lower": 0, "upper": 0.01},
        }  # fmt: skip
    if build in ("motors", "compact_bev") and random.random() < 0.5:
        case["operating_point"] = {"vehicle_speed": f"{random.uniform(20, 120):.0f} km/h", "rolling_radius": 0.31}
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in (("vehicle", vehicle), ("rig", rig), ("case", case)):
        (folder / f"{name}.toml").write_text(tomli_w.dumps(content))
    return folder / "case.toml"


def models(build):
    """Vehicle, rig and case of a build, as tables."""
    if build in ("chain", "axle"):
        case = tomllib.loads(CASE)
        if build == "axle":
            case["targets"] = [{"mode": 3}]  # two motions are rigid
        return tomllib.loads(VEHICLE if build == "chain" else AXLE), tomllib.loads(RIG), case
    if build == "motors":
        return motors()
    vehicle, rig, case = (
        tomllib.loads((EXAMPLES / build / f"{name}.toml").read_text()) for name in ("vehicle", "rig", "case")
    )
    case["limits"] = {"modulus_margin": 0.5, "dynamometer_torque": 1500}
    for manoeuvre in case["manoeuvre"].values():
        manoeuvre["duration"] = min(manoeuvre["duration"], 3)
    for key in ("operating_point", "move", "title", "uncertainty"):
        case.pop(key, None)
    return vehicle, rig, case


def scale(model, random, factors):
    """Draw every number of a model; mirror images and what vehicle and rig share are drawn alike."""
    for table, keys in (("inertias", ("J", "drag")), ("shafts", ("stiffness", "damping"))):
        for name, part in model[table].items():
            for key in keys:
                if key in part:
                    place = table, name.replace("_left", "").replace("_right", ""), key
                    if place not in factors:
                        factors[place] = random.uniform(1 - SPREAD, 1 + SPREAD)
                    part[key] = float(f"{part[key] * factors[place]:.6g}")


def motors():
    """A motor at each wheel of a car with one body; on the bed both sides stand apart."""
    sides = ("left", "right")
    vehicle = {"inertias": {"body": {"J": 150.0, "drag": 0.8}}, "shafts": {}, "inputs": {}, "sensors": {}}
    rig = {"inertias": {}, "shafts": {}, "inputs": {}, "sensors": {}}
    for side in sides:
        for model, outer in ((vehicle, f"wheel_{side}"), (rig, f"adapter_{side}")):
            model["inertias"] |= {
                f"motor_{side}": {"J": 0.03, "drag": 0.002}, outer: {"J": 1.1 if model is vehicle else 0.05},
            }  # fmt: skip
            model["shafts"][f"side_{side}"] = {
                "between": [f"motor_{side}", outer], "ratio": 9.0, "stiffness": 6000.0, "damping": 9.0,
            }  # fmt: skip
            model["inputs"][f"torque_{side}"] = {"on": f"motor_{side}"}
            model["sensors"] |= {
                f"speed_{side}": {"measures": "speed", "of": f"motor_{side}"},
                f"side_torque_{side}": {"measures": "torque", "of": f"side_{side}"},
            }
        vehicle["shafts"][f"tyre_{side}"] = {"between": [f"wheel_{side}", "body"], "stiffness": 2e4, "damping": 30.0}
        rig["inertias"][f"rotor_{side}"] = {"J": 0.6, "drag": 0.02}
        rig["shafts"][f"flange_{side}"] = {
            "between": [f"adapter_{side}", f"rotor_{side}"], "stiffness": 2e5, "damping": 15.0,
        }  # fmt: skip
        rig["inputs"][f"dyno_{side}"] = {"on": f"rotor_{side}"}
        rig["sensors"] |= {
            f"flange_torque_{side}": {"measures": "torque", "of": f"flange_{side}"},
            f"rotor_speed_{side}": {"measures": "speed", "of": f"rotor_{side}"},
        }
    vehicle["effects"] = [{"kind": "slip", "at": f"shafts.tyre_{side}", "coefficient": 1500.0} for side in sides]
    case = {
        "vehicle": "vehicle.toml", "rig": "rig.toml",
        "dynamometers": {side: {
            "torque_input": f"dyno_{side}", "torque_sensor": f"flange_torque_{side}",
            "speed_sensor": f"rotor_speed_{side}", "follows": f"side_{side}",
        } for side in sides},
        "targets": [{"mode": 2}],
        "response": {"compare": [
            {"input": f"torque_{one}", "sensor": f"speed_{other}"} for one in sides for other in sides
        ]},
        "manoeuvre": {"torque_left": {"kind": "tip_in", "amplitude": 60, "duration": 3}},
        "limits": {"dynamometer_torque": 1500.0},
    }  # fmt: skip
    return vehicle, rig, case
