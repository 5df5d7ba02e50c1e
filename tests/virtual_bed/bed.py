"""Builds a bed's FMU from a drive, what is hidden in it, and how its actuators and sensors really are."""

from __future__ import annotations

import subprocess
import tempfile
import tomllib
import uuid
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from plant.build import chain_of
from plant.engine import INERTIA, INPUT, INPUT_FLAGS, SHAFT, SHAFT_ENDS, Chain, compiler
from plant.hidden import Hidden
from plant.systems import Drive

HERE = Path(__file__).parent
RATE = 0.25  # of one over the fastest rate: inner steps are no longer
LARGEST_STEP = 1e-4  # s


@dataclass
class Actuator:
    """From a torque command to the torque that acts: dead time (s), lag (s), factor, and limit (N·m)."""

    delay: float = 0.0
    lag: float = 0.0
    factor: float = 1.0
    limit: float = np.inf


@dataclass
class Reader:
    """From the truth to a reading: lag and delay (s), gain, offset, standard deviation of noise, converter's step."""

    lag: float = 0.0
    delay: float = 0.0
    gain: float = 1.0
    offset: float = 0.0
    noise: float = 0.0
    converter: float = 0.0


@dataclass
class VirtualBed:
    """A bed as it is: true values of the drive, hidden effects, actuators and sensors by name, jitters (s).

    ``wired`` names the sensor that a channel is connected to, where that is not the one that it is called by.
    """

    drive: Drive
    effects: list[Hidden] = field(default_factory=list)
    actuators: dict[str, Actuator] = field(default_factory=dict)
    readers: dict[str, Reader] = field(default_factory=dict)
    command_jitter: float = 0.0
    sampling_jitter: float = 0.0
    seed: int = 1
    wired: dict[str, str] = field(default_factory=dict)

    def chain(self) -> Chain:
        """The engine's chain."""
        chain = chain_of(self.drive, self.effects)
        for j, name in enumerate(self.drive.inputs):
            own = self.actuators.get(name, Actuator())
            for key in ("delay", "lag", "factor", "limit"):
                chain[key][j] = getattr(own, key)
        return chain

    def write(self, path: Path, dt: float = 1e-3) -> Path:
        """Write the FMU, whose communication step is a whole number of samples ``dt`` (s)."""
        with tempfile.TemporaryDirectory() as folder:
            build = Path(folder)
            (build / "bed_data.h").write_text(self._data(dt), encoding="utf-8")
            command = [compiler(), "-O2", "-w", "-fPIC", "-shared", f"-I{build}", f"-I{HERE.parent / 'plant'}"]
            subprocess.run([*command, str(HERE / "bed.c"), "-lm", "-o", str(build / "bed.so")], check=True)
            with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
                archive.writestr("modelDescription.xml", self._description(dt))
                archive.write(build / "bed.so", "binaries/linux64/bed.so")
        return path

    def _data(self, dt: float) -> str:
        chain, drive = self.chain(), self.drive
        substeps = int(np.ceil(dt / min(LARGEST_STEP, RATE / chain.fastest())))
        lines = []
        for name in (*INERTIA, *SHAFT_ENDS, *SHAFT, *INPUT_FLAGS, *INPUT):
            kind = "int" if chain[name].dtype == np.int32 else "double"
            lines.append(f"static const {kind} p_{name}[] = {{{_numbers(chain[name])}}};")
        fields = ", ".join(f".{name} = p_{name}" for name in (*INERTIA, *SHAFT_ENDS, *SHAFT, *INPUT_FLAGS, *INPUT))
        lines.append(
            f"static const Plant PLANT = {{.n = {chain.n}, .s = {chain.s}, .u = {chain.u}, .jump_sample = 1 << 30,"
            f" .disturbed = -1, .dt = {dt!r}, {fields}}};"
        )
        readers = [self.readers.get(name, Reader()) for name in drive.sensors]
        turns = np.ones(chain.n)
        turns[: len(drive.inertias)] = [drive.speed_ratio(name) for name in drive.inertias]
        for j in range(len(drive.shafts), chain.s):
            turns[chain["first"][j]] = turns[chain["second"][j]]
        lines += [
            f"#define INPUTS {len(drive.inputs)}", f"#define SENSORS {len(drive.sensors)}", f"#define DT {dt!r}",
            f"#define SUBSTEPS {substeps}", f"#define SEED {self.seed}u",
            f"#define SAMPLING_JITTER {self.sampling_jitter!r}", f"#define COMMAND_JITTER {self.command_jitter!r}",
            f"static const int SOURCE[] = {{{_numbers([self._source(name, chain) for name in drive.sensors])}}};",
            f"static const double TURNS[] = {{{_numbers(turns)}}};",
        ]  # fmt: skip
        columns = {"FILTER": "lag", "LATE": "delay", "GAIN": "gain", "OFFSET": "offset", "NOISE": "noise",
                   "CONVERTER": "converter"}  # fmt: skip
        for name, key in columns.items():
            lines.append(f"static const double {name}[] = {{{_numbers([getattr(own, key) for own in readers])}}};")
        return "\n".join(lines) + "\n"

    def _source(self, sensor: str, chain: Chain) -> int:
        what, of = self.drive.sensors[sensor]
        if what == "torque":
            return 3 * chain.n + list(self.drive.shafts).index(of)
        return ("angle", "speed", "acceleration").index(what) * chain.n + self.drive.inertias.index(of)

    def _description(self, dt: float) -> str:
        drive = self.drive
        token = uuid.uuid5(uuid.NAMESPACE_URL, self._data(dt))
        rows, number = [], 0
        for name in drive.inputs:
            rows.append(f'<ScalarVariable name="{name}" valueReference="{number}" causality="input" '
                        'variability="continuous"><Real start="0"/></ScalarVariable>')  # fmt: skip
            number += 1
        first = number + 1
        channel = {sensor: name for name, sensor in self.wired.items()}
        for sensor in drive.sensors:
            name = channel.get(sensor, sensor)
            rows.append(f'<ScalarVariable name="{name}" valueReference="{number}" causality="output" '
                        'variability="continuous" initial="calculated"><Real/></ScalarVariable>')  # fmt: skip
            number += 1
        rows.append(f'<ScalarVariable name="start_speed" valueReference="{number}" causality="parameter" '
                    'variability="fixed"><Real start="0"/></ScalarVariable>')  # fmt: skip
        outputs = "".join(f'<Unknown index="{i}"/>' for i in range(first, number + 1))
        return (
            '<?xml version="1.0" encoding="UTF-8"?>'
            f'<fmiModelDescription fmiVersion="2.0" modelName="bed" guid="{token}">'
            f'<CoSimulation modelIdentifier="bed" canHandleVariableCommunicationStepSize="true"/>'
            f"<ModelVariables>{''.join(rows)}</ModelVariables>"
            f"<ModelStructure><Outputs>{outputs}</Outputs><InitialUnknowns>{outputs}</InitialUnknowns></ModelStructure>"
            "</fmiModelDescription>"
        )


def _numbers(values: object) -> str:
    return ", ".join("INFINITY" if value == np.inf else repr(value.item()) for value in np.asarray(values)) or "0"


def drive_of(path: Path, title: str = "") -> Drive:
    """The drive of a rig file whose quantities are plain numbers in SI."""
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    values: dict[str, float] = {}
    for name, part in data["inertias"].items():
        values |= {f"inertias.{name}.J": float(part["J"]), f"inertias.{name}.drag": float(part.get("drag", 0.0))}
    for name, part in data["shafts"].items():
        values |= {f"shafts.{name}.{key}": float(part.get(key, 0.0)) for key in ("stiffness", "damping")}
        if "ratio" in part:
            values[f"shafts.{name}.ratio"] = float(part["ratio"])
    return Drive(
        "bed", title or data["title"], list(data["inertias"]),
        {name: (part["between"][0], part["between"][1]) for name, part in data["shafts"].items()},
        {name: part["on"] for name, part in data["inputs"].items()},
        {name: (part["measures"], part["of"]) for name, part in data["sensors"].items()}, values, {}, {"none": 0.0},
    )  # fmt: skip


def drawn(drive: Drive, spread: float, rng: np.random.Generator) -> Drive:
    """The same drive, every inertia and stiffness off by up to ``spread`` (relative), damping by three times that."""
    values = {}
    for name, value in drive.values.items():
        width = {"J": spread, "stiffness": spread, "damping": 3 * spread}.get(name.rsplit(".", 1)[1], 0.0)
        values[name] = value * (1 + rng.uniform(-width, width))
    return Drive(drive.system, drive.title, drive.inertias, drive.shafts, drive.inputs, drive.sensors, values,
                 drive.torque, {"none": 0.0})  # fmt: skip
