"""The process in which the FMU of a foreign vehicle runs: ``python -m modelling.fmu.vehicle_process``.

The first line on standard input is a request in JSON. One line of JSON answers: what is wrong, or that all stand ready.
From then on each message is a byte (``s`` step, ``b`` begin anew) and numbers as doubles, and each answer is the wheel
speeds. A begin brings the vehicles to the speeds of its message; where they do not come there, the answer holds NaN.
The torques that hold them there follow.

``r`` begins a run of whole beds in C beside or before the vehicles: a size and a pickle of what
:class:`modelling.running.rows.RowsRun` needs. Each ``n`` with first sample, end, total, size of noise and noise goes
on, ``f`` asks for what was made. Answers of these have a byte (``.`` alive, ``d`` done, ``x`` an FMU failed), a size
and a pickle.
"""

from __future__ import annotations

import ctypes
import json
import os
import pickle
import struct
import sys
import threading
import time
from ctypes import c_double, c_int, c_size_t, c_uint32, c_void_p
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

import numpy as np

from modelling.running.rows import FmuFailed, RowsRun, SteppedFmus

LOOKED_EVERY = 1.0  # s: whether the parent still lives, and whether samples are stepped
WRONG = 2  # an answer of an FMU from which on it is an error (fmi2Status)


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
        answers.write(json.dumps({"ready": True, "in_c": vehicles.in_c is not None}).encode() + b"\n")
        _serve(vehicles, asked, answers)


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(LOOKED_EVERY)
    os._exit(1)


def _serve(vehicles: Vehicles, asked: BinaryIO, answers: BinaryIO) -> None:
    size = 8 * (1 + vehicles.count * vehicles.width)
    while kind := asked.read(1):
        if kind == b"r":
            _run(vehicles, asked, answers)
            continue
        if kind == b"b":
            wanted = np.frombuffer(asked.read(8 * vehicles.count * vehicles.cuts)).reshape(vehicles.count, -1)
            vehicles.begin()
            speeds = np.stack(vehicles.run_in(wanted))
        else:
            numbers = np.frombuffer(asked.read(size))
            vehicles.step(float(numbers[0]), numbers[1:].reshape(vehicles.count, vehicles.width))
            speeds = vehicles.speeds()
        answers.write(speeds.tobytes())


def _run(vehicles: Vehicles, asked: BinaryIO, answers: BinaryIO) -> None:
    """A run of whole beds in C."""
    made = pickle.loads(asked.read(struct.unpack("q", asked.read(8))[0]))
    libraries = {path: ctypes.CDLL(path) for path, _ in made["functions"].values()}
    functions = {
        name: ctypes.cast(getattr(libraries[path], function), c_void_p).value or 0
        for name, (path, function) in made["functions"].items()
    }
    fmus = vehicles.in_c
    assert fmus is not None
    fmus.join(made["given"])
    rows = RowsRun(fmus.loop, functions, made["numbers"], made["arrays"], made["shares"], fmus)
    while asked.read(1) == b"n":
        first, end, total, size = struct.unpack("qqqq", asked.read(32))
        noise = np.frombuffer(asked.read(size)).copy() if size else None
        over = threading.Event()
        alive = threading.Thread(target=_tell_alive, args=(fmus.progress, over, answers), daemon=True)
        alive.start()
        failed = None
        try:
            rows.go_on(first, end, total, noise)
        except FmuFailed as fault:
            failed = fault.cut, fault.time
        over.set()
        alive.join()
        _answer(answers, b"d" if failed is None else b"x", failed)
    _answer(answers, b"d", rows.made())


def _tell_alive(progress: np.ndarray, over: threading.Event, answers: BinaryIO) -> None:
    """Say now and then that samples are stepped."""
    before = -1
    while not over.wait(LOOKED_EVERY):
        if (now := int(progress[0])) != before:
            before = now
            _answer(answers, b".", None)


def _answer(answers: BinaryIO, kind: bytes, content: object) -> None:
    packed = pickle.dumps(content, protocol=5)
    whole = memoryview(kind + struct.pack("q", len(packed)) + packed)
    while whole:
        whole = whole[answers.write(whole) :]


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
        self._loop = ctypes.CDLL(request["loop"]) if request.get("loop") and self._real == "Real" else None
        self.in_c: SteppedFmus | None = None  # as C steps them, where there is a compiler
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
        if self._loop is not None and self._calls is not None:
            addresses = [ctypes.cast(function, c_void_p).value or 0 for function in self._calls]
            instances = [ctypes.cast(each.component, c_void_p).value or 0 for each in self._all]
            references = (np.array(each, np.uint32) for each in (self._inputs, self._outputs))
            self.in_c = SteppedFmus(self._loop, (addresses[0], addresses[1], addresses[2]), instances, *references)

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
        if self.in_c is not None:
            self._latest = self.in_c.step(span, numbers)
            self._time += span
            return
        for number, each in enumerate(self._all):
            if self._calls is None:
                each.setFloat64(self._inputs, numbers[number].tolist())
                each.doStep(currentCommunicationPoint=self._time, communicationStepSize=span)
            else:
                self._given[:] = numbers[number].tolist()
                set_real, do_step, _ = self._calls
                wrong = set_real(each.component, self._set, self.width, self._given)
                wrong = max(wrong, do_step(each.component, self._time, span, 1)) if wrong < WRONG else wrong
                if wrong >= WRONG:
                    raise RuntimeError(f"fmi2DoStep answers {wrong}")
        self._time += span

    def run_in(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bring all to speeds (b, cuts), rad/s, by torques at their cuts: speeds, NaN where that fails, and torques."""
        asked, now = self._run_in, self.speeds()
        proportional, integral, largest = (np.array(asked[name]) for name in ("proportional", "integral", "largest"))
        if self.in_c is not None:
            gains = proportional, integral, largest
            now, kept = self.in_c.run_in(
                asked["step"], wanted, now, gains, asked["within"], asked["settled"], asked["longest"]
            )  # fmt: skip
            self._time, self._latest = float(self.in_c.time[0]), now
            near = np.abs(wanted - now) < asked["within"]
            return (now if near.all() else np.where(near, now, np.nan)), kept
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
        if self.in_c is not None and self._time > 0:
            return self._latest
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
