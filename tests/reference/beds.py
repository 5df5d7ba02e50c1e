"""Cases to be matched: the reference in other structures and with other dead times, a small bed, twin drives."""

import re
from pathlib import Path

import tomli_w

EXAMPLES = Path(__file__).parents[2] / "examples"
SIDES = "left", "right"


def backlash(*shafts: str) -> str:
    """Free play of 0.02 rad in each shaft."""
    return "".join(f'\n[[effects]]\nkind = "backlash"\nat = "shafts.{name}"\ngap = 0.02\n' for name in shafts)


def reference(
    folder: Path, case: str = "observer", structure: str = "", dead_time: float = 0.0, more: str = ""
) -> Path:
    """The case of examples/road_to_rig with another structure, another dead time (s), and more in both models."""
    text = (EXAMPLES / "road_to_rig" / f"{case}.toml").read_text(encoding="utf-8")
    for key, value in (("structure", f'"{structure}"' if structure else ""), ("dead_time", dead_time)):
        if value:
            text, count = re.subn(rf"(?m)^{key} = \S+", f"{key} = {value}", text)
            assert count == 1, f"{case}.toml has {count} lines with {key}"
    for name in ("vehicle.toml", "rig.toml"):
        model = (EXAMPLES / "road_to_rig" / name).read_text(encoding="utf-8")
        (folder / name).write_text(model + more, encoding="utf-8")
    (folder / "case.toml").write_text(text, encoding="utf-8")
    return folder / "case.toml"


def shaft(first: str, second: str, stiffness: float, damping: float, **more: float) -> dict:
    return {"between": [first, second], "stiffness": stiffness, "damping": damping, **more}


def sensor(measures: str, of: str) -> dict:
    return {"measures": measures, "of": of}


def written(folder: Path, more: dict[str, str] | None = None, **tables: dict) -> Path:
    for name, table in tables.items():
        text = tomli_w.dumps(table) + (more or {}).get(name, "")
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    return folder / "case.toml"


def small(folder: Path, structure: str = "observer", more: dict[str, str] | None = None) -> Path:
    """One dynamometer: motor, side shaft, rotor; in the vehicle a wheel and a body behind the cut."""
    motor = {"motor": {"J": 0.5, "drag": 0.01}}
    sensors = {"motor_speed": sensor("speed", "motor"), "side_torque": sensor("torque", "side")}
    vehicle = {
        "inertias": motor | {"wheel": {"J": 1.0}, "body": {"J": 40.0, "drag": 0.5}},
        "shafts": {"side": shaft("motor", "wheel", 4000, 2), "tyre": shaft("wheel", "body", 8000, 30)},
        "inputs": {"motor_torque": {"on": "motor"}, "road": {"on": "body"}},
        "sensors": sensors,
    }
    rig = {
        "inertias": motor | {"adapter": {"J": 0.05}, "rotor": {"J": 0.9, "drag": 0.1}},
        "shafts": {"side": shaft("motor", "adapter", 4000, 2), "flange": shaft("adapter", "rotor", 1e5, 10)},
        "inputs": {"motor_torque": {"on": "motor"}, "dyno": {"on": "rotor"}},
        "sensors": sensors | {"flange_torque": sensor("torque", "flange"), "rotor_speed": sensor("speed", "rotor")},
    }
    gains = {
        "proportional_gain": (1, 300), "integral_gain": (1, 3000), "torque_feed_forward": (0, 1.5),
        "acceleration_feed_forward": (0, 1.2), "lead_time": (0, 0.01),
    }  # fmt: skip
    knows = {"knows": ["motor_torque"]} | ({"measures": ["motor_speed"]} if structure == "observer" else {})
    case = {
        "vehicle": "vehicle.toml", "rig": "rig.toml",
        "dynamometers": {"dyno": {
            "torque_input": "dyno", "torque_sensor": "flange_torque", "speed_sensor": "rotor_speed", "follows": "side",
        }},
        "operating_point": {"motor_torque": 40},
        "loop": {"structure": structure, "dead_time": 0.0023} | knows,
        "targets": [{"mode": 2}],
        "response": {"compare": [
            {"input": "motor_torque", "sensor": "motor_speed"}, {"input": "motor_torque", "sensor": "side_torque"},
            {"input": "road", "sensor": "side_torque"},
        ]},
        "manoeuvre": {"motor_torque": {"kind": "tip_in", "amplitude": 50, "duration": 2}},
        "limits": {"dynamometer_torque": 1500},
    }  # fmt: skip
    if structure != "observer":
        case["move"] = {f"loop.{name}": {"lower": low, "upper": top} for name, (low, top) in gains.items()}
    return written(folder, more, vehicle=vehicle, rig=rig, case=case)


def twins(folder: Path) -> Path:
    """A motor at each wheel: on the bed both sides stand apart with the same modes, in the car a body joins them."""
    vehicle: dict = {"inertias": {"body": {"J": 150.0, "drag": 0.8}}, "shafts": {}, "inputs": {}, "sensors": {}}
    vehicle["effects"] = []
    rig: dict = {"inertias": {}, "shafts": {}, "inputs": {}, "sensors": {}}
    for side in SIDES:
        for model, outer, J in ((vehicle, "wheel", 1.1), (rig, "adapter", 0.05)):
            model["inertias"] |= {f"motor_{side}": {"J": 0.03, "drag": 0.002}, f"{outer}_{side}": {"J": J}}
            model["shafts"][f"side_{side}"] = shaft(f"motor_{side}", f"{outer}_{side}", 6000, 9, ratio=9.0)
            model["inputs"][f"torque_{side}"] = {"on": f"motor_{side}"}
            model["sensors"][f"speed_{side}"] = sensor("speed", f"motor_{side}")
        vehicle["shafts"][f"tyre_{side}"] = shaft(f"wheel_{side}", "body", 2e4, 30)
        vehicle["effects"].append({"kind": "slip", "at": f"shafts.tyre_{side}", "coefficient": 1500})
        rig["inertias"][f"rotor_{side}"] = {"J": 0.6, "drag": 0.02}
        rig["shafts"][f"flange_{side}"] = shaft(f"adapter_{side}", f"rotor_{side}", 2e5, 15)
        rig["inputs"][f"dyno_{side}"] = {"on": f"rotor_{side}"}
        rig["sensors"][f"flange_torque_{side}"] = sensor("torque", f"flange_{side}")
        rig["sensors"][f"rotor_speed_{side}"] = sensor("speed", f"rotor_{side}")
    case = {
        "vehicle": "vehicle.toml", "rig": "rig.toml",
        "dynamometers": {side: {
            "torque_input": f"dyno_{side}", "torque_sensor": f"flange_torque_{side}",
            "speed_sensor": f"rotor_speed_{side}", "follows": f"side_{side}",
        } for side in SIDES},
        "loop": {
            "structure": "observer", "knows": [f"torque_{side}" for side in SIDES],
            "measures": [f"speed_{side}" for side in SIDES], "dead_time": 0.002,
        },
        "operating_point": {"vehicle_speed": "50 km/h", "rolling_radius": 0.3},
        "targets": [{"mode": 2}],
        "response": {"compare": [
            {"input": f"torque_{one}", "sensor": f"speed_{other}"} for one in SIDES for other in SIDES
        ]},
        "manoeuvre": {"torque_left": {"kind": "tip_in", "amplitude": 60, "duration": 2}},
    }  # fmt: skip
    return written(folder, vehicle=vehicle, rig=rig, case=case)
