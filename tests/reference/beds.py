"""Cases to be matched: the reference in other structures and with other dead times, a small bed, twin drives."""

import re
import tomllib
from pathlib import Path

import small_bed
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


def small(folder: Path, structure: str = "observer", more: dict[str, str] | None = None) -> Path:
    """The small bed under load: one dynamometer, and in the vehicle a wheel and a body behind the cut."""
    case = tomllib.loads(small_bed.CASE) | {"operating_point": {"motor_torque": 40}}
    if structure != "observer":
        gains = {
            "proportional_gain": (1, 300), "integral_gain": (1, 3000), "torque_feed_forward": (0, 1.5),
            "acceleration_feed_forward": (0, 1.2), "lead_time": (0, 0.01),
        }  # fmt: skip
        case["move"] = {f"loop.{name}": {"lower": low, "upper": top} for name, (low, top) in gains.items()}
        case["loop"] = {"structure": structure, "knows": ["motor_torque"], "dead_time": 0.0023}
    path = small_bed.write(folder, tomli_w.dumps(case))
    for name, text in (more or {}).items():
        with (folder / f"{name}.toml").open("a", encoding="utf-8") as file:
            file.write(text)
    return path


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
    for name, table in (("vehicle", vehicle), ("rig", rig), ("case", case)):
        (folder / f"{name}.toml").write_text(tomli_w.dumps(table), encoding="utf-8")
    return folder / "case.toml"
