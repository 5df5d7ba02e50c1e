"""Beds of kinds that no example has: an engine, axles of two makers, stiff half shafts, a gear at the rotor and more.

Every quantity of a bed is drawn within ±15 %, what vehicle and rig share alike; a kind that is drawn twice gets other
numbers each time.
"""

from pathlib import Path

import numpy as np
import tomli_w

SPREAD = 0.15
RPM = 2 * np.pi / 60
NOISE = {"torque": 0.35, "speed": 0.8 * RPM}


def inertia(J, drag=0.0):
    return {"J": J, "drag": drag}


def shaft(first, second, stiffness, damping, **more):
    return {"between": [first, second], "stiffness": stiffness, "damping": damping, **more}


def sensors(**of):
    """Sensors NAME_speed and NAME_torque of inertias and shafts, by kind."""
    return {
        f"{name}_{kind}": {"measures": kind, "of": name, "uncertainty": NOISE[kind]}
        for kind, names in of.items() for name in names
    }  # fmt: skip


def slip(shafts, coefficient):
    return [{"kind": "slip", "at": f"shafts.{name}", "coefficient": coefficient} for name in shafts]


def dynamometer(name, follows, **own):
    return {
        "torque_input": f"dyno_{name}", "torque_sensor": f"flange_{name}_torque", "speed_sensor": f"rotor_{name}_speed",
        "follows": follows, **own,
    }  # fmt: skip


def case_of(drive, dynos, compared, roads, further, torque, amplitude, mode=2, **loop):
    """A case with an observer: input ``drive``, dynamometers by name, sensors compared for drive and roads."""
    drives = [drive] if isinstance(drive, str) else drive
    return {
        "vehicle": "vehicle.toml", "rig": "rig.toml", "dynamometers": dynos,
        "loop": {"structure": "observer", "dead_time": 0.003, "inverter_lag": 0.002, "knows": drives,
                 "measures": further, **loop},
        "targets": [{"mode": mode}],
        "response": {"band": [0.5, 30],
                     "compare": [{"input": i, "sensor": s} for i in (*drives, *roads) for s in compared]},
        "manoeuvre": {name: {"kind": "tip_in", "amplitude": amplitude, "at": 0.2, "rise_time": 0.05, "duration": 3}
                      for name in drives},
        "limits": {"dynamometer_torque": torque},
    }  # fmt: skip


def engine():
    """Engine and clutch on a rubber coupling, one load machine."""
    shared = {"engine": inertia(0.16, 0.02), "flywheel": inertia(0.12)}
    crank, clutch = shaft("engine", "flywheel", 6e4, 8.0), (900.0, 3.0)
    vehicle = {
        "inertias": shared | {"gearbox": inertia(0.012, 0.005), "wheels": inertia(0.075), "body": inertia(4.6, 0.04)},
        "shafts": {"crank": crank, "clutch": shaft("flywheel", "gearbox", *clutch),
                   "halves": shaft("gearbox", "wheels", 340.0, 0.35), "tyres": shaft("wheels", "body", 900.0, 1.2)},
        "inputs": {"engine_torque": {"on": "engine"}, "road": {"on": "body"}}, "effects": slip(["tyres"], 90.0),
        "sensors": sensors(speed=["engine", "body"], torque=["clutch"]),
    }  # fmt: skip
    rig = {
        "inertias": shared | {"hub": inertia(0.02), "coupling": inertia(0.03), "rotor_m": inertia(0.45, 0.02)},
        "shafts": {"crank": crank, "clutch": shaft("flywheel", "hub", *clutch),
                   "rubber": shaft("hub", "coupling", 2500.0, 6.0), "flange_m": shaft("coupling", "rotor_m", 2e5, 8.0)},
        "inputs": {"engine_torque": {"on": "engine"}, "dyno_m": {"on": "rotor_m"}},
        "sensors": sensors(speed=["engine", "rotor_m"], torque=["clutch", "flange_m"]),
    }  # fmt: skip
    case = case_of("engine_torque", {"m": dynamometer("m", "clutch")}, ["engine_speed", "clutch_torque"], ["road"],
                   ["engine_speed"], 600.0, 150.0)  # fmt: skip
    return vehicle, rig, case


def two_axles():
    """A motor and a machine at each axle; the machines are of two makers, with dead times of 2 and 5 ms."""
    vehicle, rig = ({"inertias": {}, "shafts": {}, "inputs": {}} for _ in range(2))
    for side, J, k, ratio in (("f", 0.03, 13e3, 9.0), ("r", 0.05, 19e3, 8.0)):
        for model, outer in ((vehicle, f"wheels_{side}"), (rig, f"adapter_{side}")):
            model["inertias"] |= {f"motor_{side}": inertia(J, 0.003), f"cage_{side}": inertia(0.09)}
            model["shafts"] |= {f"out_{side}": shaft(f"motor_{side}", f"cage_{side}", 2.7e5, 11.0, ratio=ratio),
                                f"axle_{side}": shaft(f"cage_{side}", outer, k, 13.0)}  # fmt: skip
            model["inputs"][f"torque_{side}"] = {"on": f"motor_{side}"}
        vehicle["inertias"][f"wheels_{side}"] = inertia(2.3)
        vehicle["shafts"][f"tyre_{side}"] = shaft(f"wheels_{side}", "body", 3.1e4, 60.0)
        rig["inertias"] |= {f"adapter_{side}": inertia(0.08), f"rotor_{side}": inertia(1.6, 0.1)}
        rig["shafts"][f"flange_{side}"] = shaft(f"adapter_{side}", f"rotor_{side}", 4e5, 30.0)
        rig["inputs"][f"dyno_{side}"] = {"on": f"rotor_{side}"}
    vehicle["inertias"]["body"] = inertia(180.0, 1.2)
    vehicle["inputs"]["road"] = {"on": "body"}
    vehicle["effects"] = slip(["tyre_f", "tyre_r"], 2500.0)
    seen = {"speed": ["motor_f", "motor_r"], "torque": ["axle_f", "axle_r"]}
    vehicle["sensors"] = sensors(**seen)
    rig["sensors"] = sensors(**seen) | sensors(speed=["rotor_f", "rotor_r"], torque=["flange_f", "flange_r"])
    dynos = {"f": dynamometer("f", "axle_f", dead_time=0.002), "r": dynamometer("r", "axle_r", dead_time=0.005)}
    compared = ["motor_f_speed", "motor_r_speed", "axle_f_torque", "axle_r_torque"]
    case = case_of(["torque_f", "torque_r"], dynos, compared, ["road"], ["motor_f_speed", "motor_r_speed"], 4000.0,
                   130.0)  # fmt: skip
    return vehicle, rig, case


def front_axle(half=(9500.0, 9.0), body=158.0, wheel=1.05, tyre=(15500.0, 25.0), rotor=0.7, **loop):
    """A motor with rotor shaft, gear and differential, a machine in the place of each wheel."""
    shared = {
        "motor": inertia(0.028, 0.002), "pinion": inertia(0.001), "cage": inertia(0.06), "side_l": inertia(0.002),
        "side_r": inertia(0.002),
    }  # fmt: skip
    inside = {"rotor": shaft("motor", "pinion", 7000.0, 0.06)}
    joints = {
        "gears": {"red": {"between": ["pinion", "cage"], "ratio": 9.2}},
        "differentials": {"axle": {"cage": "cage", "left": "side_l", "right": "side_r"}},
    }
    vehicle, rig = {"inertias": dict(shared), **joints}, {"inertias": dict(shared), **joints}
    vehicle["shafts"], rig["shafts"] = dict(inside), dict(inside)
    for side in "lr":
        vehicle["inertias"][f"wheel_{side}"] = inertia(wheel)
        vehicle["shafts"] |= {f"half_{side}": shaft(f"side_{side}", f"wheel_{side}", *half),
                              f"tyre_{side}": shaft(f"wheel_{side}", "body", *tyre)}  # fmt: skip
        rig["inertias"] |= {f"adapter_{side}": inertia(0.05), f"rotor_{side}": inertia(rotor, 0.03)}
        rig["shafts"] |= {f"half_{side}": shaft(f"side_{side}", f"adapter_{side}", *half),
                          f"flange_{side}": shaft(f"adapter_{side}", f"rotor_{side}", 2e5, 15.0)}  # fmt: skip
    vehicle["inertias"]["body"] = inertia(body, 0.6)
    vehicle["inputs"] = {"motor_torque": {"on": "motor"}, "road": {"on": "body"}}
    vehicle["effects"] = slip(["tyre_l", "tyre_r"], 900.0)
    rig["inputs"] = {"motor_torque": {"on": "motor"}, "dyno_l": {"on": "rotor_l"}, "dyno_r": {"on": "rotor_r"}}
    seen = {"speed": ["motor"], "torque": ["half_l", "half_r"]}
    vehicle["sensors"] = sensors(**seen)
    rig["sensors"] = sensors(**seen) | sensors(speed=["rotor_l", "rotor_r"], torque=["flange_l", "flange_r"])
    case = case_of("motor_torque", {"l": dynamometer("l", "half_l"), "r": dynamometer("r", "half_r")},
                   ["motor_speed", "half_l_torque", "half_r_torque"], ["road"], ["motor_speed"], 1500.0, 120.0,
                   **loop)  # fmt: skip
    return vehicle, rig, case


def stiff_half_shafts():
    """Half shafts six times as stiff: the vehicle's own modes ring less than its shuffle."""
    return front_axle(half=(6e4, 12.0))


def light_vehicle():
    """28 kg·m² of a vehicle in place of 158, and an inverter with 12 ms of lag."""
    return front_axle(body=28.0, wheel=0.3, tyre=(6000.0, 12.0), inverter_lag=0.012)


def geared_rotor():
    """Each machine drives its flange through a belt with a ratio of 2.5."""
    vehicle, rig, case = front_axle()
    for side in "lr":
        rig["inertias"] |= {f"pulley_{side}": inertia(0.08), f"rotor_{side}": inertia(0.12, 0.005)}
        rig["shafts"][f"flange_{side}"] = shaft(f"adapter_{side}", f"pulley_{side}", 2e5, 15.0)
        rig["gears"] = rig["gears"] | {f"belt_{side}": {"between": [f"rotor_{side}", f"pulley_{side}"], "ratio": 2.5}}
        case["limits"]["dynamometer_torque"] = 600.0
    return vehicle, rig, case


def differential_beyond():
    """Rear drive: one machine at the propeller shaft; differential, half shafts and tyres are beyond the cut."""
    shared = {"motor": inertia(0.05, 0.003), "gearbox": inertia(0.02)}
    gear, prop = shaft("motor", "gearbox", 9e3, 0.8), (6500.0, 2.5)
    vehicle = {
        "inertias": shared | {"pinion": inertia(0.02), "cage": inertia(0.12), "side_l": inertia(0.01),
                              "side_r": inertia(0.01), "wheel_l": inertia(1.1), "wheel_r": inertia(1.1),
                              "body": inertia(150.0, 0.7)},
        "shafts": {"gear": gear, "prop": shaft("gearbox", "pinion", *prop),
                   "half_l": shaft("side_l", "wheel_l", 8e3, 8.0), "half_r": shaft("side_r", "wheel_r", 8e3, 8.0),
                   "tyre_l": shaft("wheel_l", "body", 1.5e4, 25.0), "tyre_r": shaft("wheel_r", "body", 1.5e4, 25.0)},
        "gears": {"final": {"between": ["pinion", "cage"], "ratio": 3.4}},
        "differentials": {"axle": {"cage": "cage", "left": "side_l", "right": "side_r"}},
        "inputs": {"motor_torque": {"on": "motor"}, "road": {"on": "body"}},
        "effects": slip(["tyre_l", "tyre_r"], 900.0),
        "sensors": sensors(speed=["motor"], torque=["prop"]),
    }  # fmt: skip
    rig = {
        "inertias": shared | {"adapter": inertia(0.03), "rotor_p": inertia(0.4, 0.02)},
        "shafts": {"gear": gear, "prop": shaft("gearbox", "adapter", *prop),
                   "flange_p": shaft("adapter", "rotor_p", 1.5e5, 8.0)},
        "inputs": {"motor_torque": {"on": "motor"}, "dyno_p": {"on": "rotor_p"}},
        "sensors": sensors(speed=["motor", "rotor_p"], torque=["prop", "flange_p"]),
    }  # fmt: skip
    case = case_of("motor_torque", {"p": dynamometer("p", "prop")}, ["motor_speed", "prop_torque"], ["road"],
                   ["motor_speed"], 800.0, 150.0)  # fmt: skip
    return vehicle, rig, case


def small_machine():
    """Machines that have not the torque that the manoeuvre takes."""
    vehicle, rig, case = front_axle()
    case["limits"]["dynamometer_torque"] = 250.0
    case["limits"]["command_noise"] = 25.0
    return vehicle, rig, case


def simple_vehicle():
    """A residual vehicle of one's own without slip of the tyres."""
    vehicle, rig, case = front_axle(tyre=(40e3, 60.0))
    own = {
        "inertias": {"wheel_l": {"J": {"value": 1.0, "lower": 0.4, "upper": 2.5}},
                     "wheel_r": {"J": {"value": 1.0, "lower": 0.4, "upper": 2.5}},
                     "body": {"J": {"value": 150.0, "lower": 60.0, "upper": 300.0}, "drag": 0.6}},
        "shafts": {f"tyre_{side}": {"between": [f"wheel_{side}", "body"], "damping": 60.0,
                                    "stiffness": {"value": 3e4, "lower": 4e3, "upper": 1e5}} for side in "lr"},
        "inputs": {"road": {"on": "body"}},
    }  # fmt: skip
    case["residual_vehicle"] = {"model": "own.toml"}
    return vehicle, rig, case, own


def without_flanges():
    """Encoders at the rotors and the motor, torques of the inverters, no torque flange."""
    return lacking(*front_axle(), sides="lr")


def one_flange():
    """A flange at the left machine alone."""
    return lacking(*front_axle(), sides="r")


def lacking(vehicle, rig, case, sides):
    for side in sides:
        del rig["sensors"][f"flange_{side}_torque"], case["dynamometers"][side]["torque_sensor"]
    return vehicle, rig, case


def long_sample():
    """A sample of 2 ms, longer than the dead time of 1.5 ms."""
    return front_axle(sample_time=0.002, dead_time=0.0015)


KINDS = (
    engine, two_axles, stiff_half_shafts, light_vehicle, geared_rotor, differential_beyond, small_machine,
    simple_vehicle, long_sample, without_flanges, one_flange, two_axles,
)  # fmt: skip


def write(number, folder: Path, seed=50, **loop) -> Path:
    """Draw a bed and write its files, with other values of the loop; the case file."""
    vehicle, rig, case, *own = KINDS[number]()
    case["loop"] |= loop
    for one in own:
        (folder / "own.toml").write_text(tomli_w.dumps(one))
    return write_models(vehicle, rig, case, folder, np.random.default_rng([seed, number]))


def write_models(vehicle, rig, case, folder: Path, random) -> Path:
    """Draw every quantity of two models and write them with their case; the case file."""
    factors: dict = {}
    for model in (vehicle, rig):
        for table, keys in (("inertias", ("J", "drag")), ("shafts", ("stiffness", "damping"))):
            made = {}
            for name, part in model[table].items():
                made[name] = dict(part)
                for key in keys:
                    place = table, name, key
                    if place not in factors:
                        factors[place] = random.uniform(1 - SPREAD, 1 + SPREAD)
                    made[name][key] = float(f"{part[key] * factors[place]:.5g}")
            model[table] = made
    for name, content in (("vehicle", vehicle), ("rig", rig), ("case", case)):
        (folder / f"{name}.toml").write_text(tomli_w.dumps(content))
    return folder / "case.toml"
