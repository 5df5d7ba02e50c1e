"""The process in which the FMU of a foreign vehicle runs: ``python -m modelling.fmu.vehicle_process``.

The first line on standard input is a request in JSON. One line of JSON answers: what is wrong, or that all stand ready.
From then on each message is a byte (``s`` step, ``b`` begin anew) and numbers as doubles, and each answer is the wheel
speeds. A begin brings the vehicles to the speeds of its message; where they do not come there, the answer holds NaN.
The torques that hold them there follow.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from ctypes import c_double, c_int, c_size_t, c_uint32, c_void_p
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

import numpy as np

LOOKED_EVERY = 1.0  # s: whether the parent still lives


class Wrong(Exception):
    """What of the FMU is wrong, and what would be right."""


def main() -> None:
    """Serve the parent until it closes the pipe."""
    # what the FMU prints must not mix with the answers
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    asked = sys.stdin.buffer
    request = json.loads(asked.readline())
    with TemporaryDirectory(prefix="rigmatch-vehicle-") as folder:
        try:
            vehicles = Vehicles(request, folder)
        except Wrong as wrong:
            answers.write(json.dumps({"wrong": list(wrong.args)}).encode() + b"\n")
            return
        except ModuleNotFoundError as missing:
            answers.write(json.dumps({"needs": missing.name}).encode() + b"\n")
            return
        answers.write(json.dumps({"ready": True}).encode() + b"\n")
        _serve(vehicles, asked, answers)


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(LOOKED_EVERY)
    os._exit(1)


def _serve(vehicles: Vehicles, asked: BinaryIO, answers: BinaryIO) -> None:
    size = 8 * (1 + vehicles.count * vehicles.width)
    while kind := asked.read(1):
        if kind == b"b":
            wanted = np.frombuffer(asked.read(8 * vehicles.count * vehicles.cuts)).reshape(vehicles.count, -1)
            vehicles.begin()
            speeds = np.stack(vehicles.run_in(wanted))
        else:
            numbers = np.frombuffer(asked.read(size))
            vehicles.step(float(numbers[0]), numbers[1:].reshape(vehicles.count, vehicles.width))
            speeds = vehicles.speeds()
        answers.write(speeds.tobytes())


class Vehicles:
    """Instances of one FMU side by side."""

    def __init__(self, request: dict[str, Any], folder: str):
        import fmpy

        path = request["path"]
        try:
            self.about = fmpy.read_model_description(path, validate=False)
        except Exception as fault:  # whatever a file that is no FMU makes of the reader
            raise Wrong(f"is no FMU: {str(fault).splitlines()[0] if str(fault) else type(fault).__name__}",
                        "give an FMU of FMI 2.0 or 3.0") from None  # fmt: skip
        if self.about.fmiVersion not in ("2.0", "3.0") or self.about.coSimulation is None:
            without = "" if self.about.coSimulation else " without co-simulation"
            raise Wrong(
                f"is an FMU of FMI {self.about.fmiVersion}{without}",
                "export it for co-simulation, FMI 2.0 or 3.0",
            )
        self.count = 1 if self.about.coSimulation.canBeInstantiatedOnlyOncePerProcess else int(request["count"])
        if self.count < request["count"]:
            raise Wrong("only once")
        known = {each.name: each for each in self.about.modelVariables}
        inputs, outputs = request["inputs"], request["outputs"]
        for names, causality in ((inputs, "input"), (outputs, "output")):
            there = [name for name, each in known.items() if each.causality == causality]
            for name in names:
                if name not in there:
                    raise Wrong(f"has no {causality} {name!r}", f"it has {', '.join(sorted(there)[:12]) or 'none'}")
        self.width, self.cuts, self._run_in = len(inputs), len(outputs), request["run_in"]
        self._inputs = [known[name].valueReference for name in inputs]
        self._outputs = [known[name].valueReference for name in outputs]
        self._real = "Float64" if self.about.fmiVersion == "3.0" else "Real"
        self._unzipped = fmpy.extract(path, unzipdir=folder)
        self._all: list[Any] = []
        # functions of FMI 2.0 called straight, with arrays that are made once: a fifth of the time
        self._calls: tuple[Any, Any, Any] | None = None
        self._set, self._get = ((c_uint32 * len(each))(*each) for each in (self._inputs, self._outputs))
        self._given, self._read = (c_double * self.width)(), (c_double * self.cuts)()
        self._time = 0.0
        self.begin()

    def begin(self) -> None:
        """Make them anew, at their own start."""
        for each in self._all:
            each.terminate()
            each.freeInstance()
        self._time = 0.0
        self._all = [self._made(number) for number in range(self.count)]
        if self._real == "Real" and self._calls is None:
            set_real, do_step, get_real = (
                self._all[0].dll[name] for name in ("fmi2SetReal", "fmi2DoStep", "fmi2GetReal")
            )
            for function in (set_real, get_real):
                function.argtypes = [c_void_p, c_void_p, c_size_t, c_void_p]
            do_step.argtypes = [c_void_p, c_double, c_double, c_int]
            self._calls = set_real, do_step, get_real

    def _made(self, number: int) -> Any:
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        simulation = self.about.coSimulation
        given = {
            "guid": self.about.guid, "unzipDirectory": self._unzipped, "modelIdentifier": simulation.modelIdentifier,
            "instanceName": f"vehicle{number}",
        }  # fmt: skip
        try:
            made = FMU3Slave(**given) if self._real == "Float64" else FMU2Slave(**given)
            made.instantiate()
            if self._real == "Float64":
                made.enterInitializationMode(startTime=0.0)
            else:
                made.setupExperiment(startTime=0.0)
                made.enterInitializationMode()
            made.exitInitializationMode()
        except Exception as fault:
            right = "it needs a binary for this system (Linux, 64 bit), or sources that were built"
            raise Wrong(f"does not start: {str(fault).splitlines()[0]}", right) from None
        return made

    def step(self, span: float, numbers: np.ndarray) -> None:
        """Go on by ``span``, s, with inputs (b, inputs) held."""
        for number, each in enumerate(self._all):
            if self._calls is None:
                each.setFloat64(self._inputs, numbers[number].tolist())
                each.doStep(currentCommunicationPoint=self._time, communicationStepSize=span)
            else:
                self._given[:] = numbers[number].tolist()
                set_real, do_step, _ = self._calls
                wrong = set_real(each.component, self._set, self.width, self._given) or do_step(
                    each.component, self._time, span, 1
                )
                if wrong > 1:
                    raise RuntimeError(f"fmi2DoStep answers {wrong}")
        self._time += span

    def run_in(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bring all to speeds (b, cuts), rad/s, by torques at their cuts: speeds, NaN where that fails, and torques."""
        asked, now = self._run_in, self.speeds()
        proportional, integral, largest = (np.array(asked[name]) for name in ("proportional", "integral", "largest"))
        numbers, kept, near, step = np.zeros((self.count, self.width)), np.zeros_like(wanted), 0.0, asked["step"]
        while near < asked["settled"]:
            if self._time > asked["longest"] or not np.isfinite(now).all():
                return np.where(np.abs(wanted - now) < asked["within"], now, np.nan), kept
            torque = proportional * (wanted - now) + kept
            numbers[:, : self.cuts] = np.clip(torque, -largest, largest)
            kept = kept + (np.abs(torque) <= largest) * integral * step * (wanted - now)
            self.step(step, numbers)
            now = self.speeds()
            near = near + step if np.abs(wanted - now).max() < asked["within"] else 0.0
        return now, kept

    def speeds(self) -> np.ndarray:
        """Outputs (b, outputs)."""
        if self._calls is None:
            return np.array([each.getFloat64(self._outputs) for each in self._all])
        found = np.empty((self.count, self.cuts))
        for number, each in enumerate(self._all):
            if self._calls[2](each.component, self._get, self.cuts, self._read) > 1:
                raise RuntimeError("fmi2GetReal fails")
            found[number] = self._read
        return found


if __name__ == "__main__":
    main()
