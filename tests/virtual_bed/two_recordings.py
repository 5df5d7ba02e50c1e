"""Makes the recordings of examples/from_recordings: the car on the road and the bed without emulation.

``python -m tests.virtual_bed.two_recordings``: both with the engine of the truth plant, which shares no code with
rigmatch; what is recorded of the bed is what ``rigmatch excite`` plans for the case as it is known before.
"""

import sys
import tomllib
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # the truth plant is imported as `plant`

import numpy as np
import tomli_w

from matching.bed.excite import ExcitationOrder, plan_excitation
from matching.bed.simulated_bed import FmuBed, columns, excited_recording, held_as_linear
from matching.match.case_file import load_case
from modelling.recordings.read import csv_text
from virtual_bed.bed import Actuator, Reader, VirtualBed, drive_of

FOLDER = Path(__file__).parents[2] / "examples" / "from_recordings"
HELD = 5e-4  # s: the half sample of hold that the loop's dead time counts
ROAD_STEP, STEP = 2e-3, 1e-3  # s
# of a drive: from when (s) the driver asks for which torque, N·m; each is reached within 0.1 s
DEMANDS = ((0.0, 20.0), (1.0, 90.0), (2.5, -40.0), (3.5, 120.0), (5.0, 0.0), (7.0, -30.0), (8.0, 60.0))
RISE, LENGTH, ROAD_SPEED = 0.1, 10.0, 40.0  # s, s, rad/s at the start


def true_drive(name: str, build: Path, **tables: dict[str, float]):
    """Drive of a model file of the example with its true values."""
    data = tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))
    for full, value in {key: value for table in tables.values() for key, value in table.items()}.items():
        table, part, key = full.split(".")
        if part in data.get(table, {}):
            data[table][part][key] = value
    path = build / f"{name}.toml"
    path.write_text(tomli_w.dumps(data), encoding="utf-8")
    return drive_of(path)


def readers(drive, system) -> dict[str, Reader]:
    """Sensors with the noise that the model states."""
    return {sensor.name: Reader(noise=sensor.uncertainty) for sensor in system.sensors if sensor.name in drive.sensors}


def main(build: Path) -> None:
    case, truth = load_case(FOLDER / "case.toml"), tomllib.loads((FOLDER / "truth.toml").read_text(encoding="utf-8"))
    car = true_drive("vehicle", build, vehicle=truth["car"])
    (FOLDER / "road.csv").write_text(road(VirtualBed(car, [], {}, readers(car, case.vehicle)), case, build))
    bed = true_drive("rig", build, vehicle=truth["car"], rig=truth["bed"])
    loop = case.loop
    actuator = Actuator(truth["loop"]["dead_time"] - HELD, loop["inverter_lag"], truth["loop"]["torque_gain"])
    sensing = readers(bed, case.rig)
    sensing["flange_torque"].lag = loop["torque_sensor_lag"]
    path = VirtualBed(bed, [], {"dyno": actuator}, sensing, seed=2).write(build / "bed.fmu", STEP)
    plan = plan_excitation(case, ExcitationOrder(duration=6.0, beds=4))
    with FmuBed(path, ["dyno", "motor_torque"], [sensor.name for sensor in case.rig.sensors]) as stand:
        (FOLDER / "bed.csv").write_text(shortened(excited_recording(stand, case, plan)), encoding="utf-8")


def road(car: VirtualBed, case, build: Path) -> str:
    """Text of the recording of tip-ins, back-outs and coasting."""
    time = np.arange(round(LENGTH / STEP)) * STEP
    demand = np.zeros(len(time))
    last = DEMANDS[0][1]
    for begin, torque in DEMANDS:
        demand += (torque - last) * np.clip((time - begin) / RISE, 0, 1)
        last = torque
    demand += DEMANDS[0][1]
    names = [sensor.name for sensor in case.vehicle.sensors]
    read = np.zeros((len(time), len(names)))
    with FmuBed(car.write(build / "car.fmu", STEP), ["motor_torque", "road"], names) as fmu:
        fmu.begin(ROAD_SPEED)
        for i, torque in enumerate(demand):
            read[i] = fmu.readings()
            fmu.step(np.array([torque, 0.0]), STEP)
    units = {sensor.name: sensor.unit for sensor in case.vehicle.sensors} | {"motor_torque": "N*m"}
    every = round(ROAD_STEP / STEP)
    acting = held_as_linear(demand[:, None])[:, 0]
    signals = {"motor_torque": acting, **columns(names, read)}
    return shortened(csv_text(time[::every], {name: values[::every] for name, values in signals.items()}, units))


def shortened(text: str, digits: int = 6) -> str:
    """A CSV with so many significant digits: less than the noise is lost."""
    head, *rows = text.splitlines()
    short = [",".join(f"{float(value):.{digits}g}" for value in row.split(",")) for row in rows]
    return "\n".join([head, *short]) + "\n"


if __name__ == "__main__":
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        main(Path(folder))
