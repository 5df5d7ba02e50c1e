"""A vehicle of others as an FMU, in a process of its own: what it does wrong is one line, and nothing is lost."""

from __future__ import annotations

import atexit
import ctypes
import json
import os
import pickle
import select
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from modelling.bed.foreign_vehicle import RunIn
from modelling.errors import InputError
from modelling.running.compiled_loop import compiled_loop
from modelling.simulation.compiled import compiler

CHILD = "modelling.fmu.vehicle_process"


@dataclass(frozen=True)
class FmuSettings:
    """How long an FMU may take, by the clock.

    Attributes
    ----------
    start_within, answer_within : float
        s for loading and for one step of all its instances. Large tools start in tens of seconds; a step that takes
        longer than this is a hang, not a slow model.
    within : float
        rad/s that a wheel may still be off where the vehicle counts as brought to a speed: an encoder's noise.
    settled, longest : float
        s of its own time for which it has to stay so, and after which it has not come there.
    """

    start_within: float = 120.0
    answer_within: float = 20.0
    within: float = 0.05
    settled: float = 0.1
    longest: float = 120.0


FMU = FmuSettings()


class FmuVehicle:
    """Instances of an FMU as a :class:`modelling.running.plant.Vehicle`; k cuts, r own inputs, b rows.

    Parameters
    ----------
    path : Path
        FMI 2.0 or 3.0, co-simulation.
    torques, speeds : mapping of str to str (k)
        By cut the FMU's input (N·m into the vehicle) and output (rad/s).
    own : mapping of str to str (r)
        By input of the vehicle's own (brakes, grade) that of the FMU.
    run_in : RunIn
        What brings it to a speed; its states cannot be set from outside.
    step : float
        s, of its steps.
    count : int

    Raises
    ------
    InputError
        Naming the file and what is wrong of it: no FMU, an unknown variable, no binary, a crash, a hang, a speed that
        is not finite, or that FMPy is missing.
    """

    def __init__(
        self, path: Path, torques: Mapping[str, str], speeds: Mapping[str, str], own: Mapping[str, str], run_in: RunIn,
        step: float, count: int = 1, settings: FmuSettings = FMU,
    ):  # fmt: skip
        self._processes: list[_Process] = []
        self._again = True  # whether its processes may serve another vehicle of this kind
        self.path, self.cuts, self.own = Path(path), tuple(torques), tuple(own)
        self.count, self.settings, self._run_in, self._step = count, settings, run_in, step
        self._torques, self._speeds, self._own = dict(torques), [speeds[cut] for cut in self.cuts], dict(own)
        self._loop = compiled_loop() if compiler() else None
        self.seconds = 0.0  # since it began
        self.held = np.zeros((len(self.cuts), count))  # N·m (k, b), with which it stayed at the speeds of its begin
        if not self.path.is_file():
            raise InputError(str(self.path), "is no file", "name the FMU of the vehicle")
        self._start()

    def _start(self) -> None:
        try:
            self._processes = [self._process(self.count)]
        except _OnlyOnce:
            self._again = False
            self._processes = [self._process(1) for _ in range(self.count)]

    def _process(self, count: int) -> _Process:
        request = {
            "path": str(self.path.resolve()), "count": count,
            "inputs": [*self._torques.values(), *self._own.values()], "outputs": self._speeds,
            "run_in": {name: getattr(self._run_in, name).tolist() for name in ("proportional", "integral", "largest")}
            | {name: getattr(self.settings, name) for name in ("within", "settled", "longest")} | {"step": self._step},
            "loop": None if self._loop is None else self._loop._name,
        }  # fmt: skip
        about = self.path.stat()
        key = os.getpid(), json.dumps(request), os.pathsep.join(sys.path), about.st_mtime_ns, about.st_size
        made = next((each for each in reversed(_WAITING) if each.key == key), None)
        if made is None:
            made = _Process(self.path, request, count, len(self.cuts), self.settings)
        else:
            _WAITING.remove(made)
        made.key, made.settings = key, self.settings
        return made

    def begin(self, speed: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Back to its own start, and from there to speeds (k, b), rad/s, by torques at its cuts: the speeds reached.

        Raises
        ------
        InputError
            If it does not come there.
        """
        self.seconds, begun = 0.0, 0
        for each in self._processes:
            each.send(b"b", speed[:, begun : begun + each.count].T)
            begun += each.count
        answers = [each.answer(self.settings.start_within, 2) for each in self._processes]
        found, self.held = (np.hstack([one[which] for one in answers]) for which in (0, 1))
        if not np.isfinite(found).all():
            self._end()
            cut = int(np.argmin(np.isfinite(found).all(axis=1)))
            raise InputError(
                str(self.path), f"its wheel at {self.cuts[cut]} does not come to {speed[cut].max():.4g} rad/s by "
                f"torques at its cuts within {self.settings.longest:g} s",
                "check the signs of its torques and speeds, and that no brake acts in it",
            )  # fmt: skip
        return found

    def step(self, torque: np.ndarray, own: np.ndarray, span: float) -> np.ndarray:
        """Speeds (k, b), rad/s, after ``span`` (s) under torques (k, b), N·m, and own inputs (r, b), held."""
        every, begun = np.vstack([torque, own]), 0
        for each in self._processes:
            each.send(b"s", np.r_[span, every[:, begun : begun + each.count].T.ravel()])
            begun += each.count
        speeds = np.hstack([each.answer()[0] for each in self._processes])
        self.seconds += span
        if not np.isfinite(speeds).all():
            self._end()
            raise self._not_finite(self.seconds, self._speeds[int(np.argmin(np.isfinite(speeds).all(axis=1)))])
        return speeds

    def _not_finite(self, seconds: float, what: str) -> InputError:
        return InputError(
            str(self.path), f"{what} is not finite after {seconds:.4g} s",
            "check its start values, its step and the torques that it gets",
        )  # fmt: skip

    @property
    def in_c(self) -> bool:
        """See :class:`modelling.running.compiled_loop.CompiledVehicle`."""
        return len(self._processes) == 1 and self._processes[0].in_c

    def run_rows(
        self, functions: Mapping[str, tuple[ctypes.CDLL, str]], numbers: Mapping[str, Any],
        arrays: Mapping[str, np.ndarray], shares: Mapping[str, np.ndarray], given: Mapping[str, Any],
        chunks: Iterable[tuple[int, int, np.ndarray | None]], total: int,
    ) -> dict[str, np.ndarray]:  # fmt: skip
        """See :class:`modelling.running.compiled_loop.CompiledVehicle`."""
        named = {name: (library._name, function) for name, (library, function) in functions.items()}
        needs = {"numbers": dict(numbers), "arrays": dict(arrays), "shares": dict(shares), "given": dict(given)}
        whole = pickle.dumps({"functions": named, **needs}, protocol=5)
        (process,) = self._processes
        process.put(b"r" + struct.pack("q", len(whole)) + whole)
        for first, end, noise in chunks:
            content = b"" if noise is None else np.ascontiguousarray(noise, dtype=float).tobytes()
            process.put(b"n" + struct.pack("qqqq", first, end, total, len(content)) + content)
            failed = process.result()
            if failed is not None:
                cut, seconds = failed
                self._end()
                if cut < 0:
                    raise InputError(
                        str(self.path), "answers a step with an error", "run it alone in its own tool first"
                    )
                raise self._not_finite(seconds, self._speeds[cut])
        process.put(b"f")
        made: dict[str, np.ndarray] = process.result()
        process.owes = False
        return made

    def close(self) -> None:
        """End its processes; one that did all that it was asked for waits for the next vehicle of this kind."""
        for each in self._processes:
            if not self._again or each.owes:
                each.close()
                continue
            _WAITING.append(each)
            if len(_WAITING) > MOST_WAITING:  # the one that nobody wanted for longest
                oldest = _WAITING.pop(0)
                if oldest.key[0] == os.getpid():
                    oldest.close()
        self._processes = []

    def _end(self) -> None:
        """End its processes for good: something went wrong."""
        self._again = False
        self.close()

    def __enter__(self) -> FmuVehicle:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __del__(self) -> None:
        self.close()


MOST_WAITING = 4  # processes, of some 50 MB
_WAITING: list[_Process] = []  # the last one that came, last


@atexit.register
def _end_waiting() -> None:
    for each in _WAITING:
        if each.key[0] == os.getpid():
            each.close()


class _OnlyOnce(Exception):
    """The FMU can be made once in a process."""


class _Process:
    """One child with its pipe."""

    def __init__(self, path: Path, request: Mapping[str, object], count: int, cuts: int, settings: FmuSettings):
        self.path, self.count, self.cuts, self.settings = path, count, cuts, settings
        self.owes, self.key = True, tuple[object, ...]()  # an answer, or it has ended
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join(sys.path), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1",
        }  # fmt: skip
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-m", CHILD], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, env=environment, bufsize=0,
        )  # fmt: skip
        self._write(json.dumps(request).encode() + b"\n")
        line = b""
        until = time.monotonic() + settings.start_within
        while not line.endswith(b"\n"):
            line += self._read(1 << 16, until, f"does not start within {settings.start_within:g} s")
        answer = json.loads(line)
        if "needs" in answer:
            self.close()
            right = 'in rigmatch\'s folder: pip install -e ".[fmu]"'
            raise InputError(str(path), f"needs the package {answer['needs']} to run", right)
        if "wrong" in answer:
            self.close()
            if answer["wrong"] == ["only once"]:
                raise _OnlyOnce
            raise InputError(str(path), *answer["wrong"])
        self.in_c, self.owes = bool(answer["in_c"]), False

    def send(self, kind: bytes, numbers: np.ndarray) -> None:
        """One message."""
        self._write(kind + np.ascontiguousarray(numbers, dtype=float).tobytes())

    def answer(self, within: float | None = None, parts: int = 1) -> list[np.ndarray]:
        """Speeds (k, b), after a begin torques (k, b) too."""
        size, got = 8 * self.cuts * self.count * parts, b""
        seconds = self.settings.answer_within if within is None else within
        while len(got) < size:
            got += self._read(size - len(got), time.monotonic() + seconds, f"does not answer within {seconds:g} s")
        self.owes = False
        return [part.T for part in np.frombuffer(got).reshape(parts, self.count, self.cuts)]

    def put(self, content: bytes) -> None:
        """A large message."""
        whole = memoryview(content)
        while whole:
            whole = whole[self._write(whole) :]

    def result(self) -> Any:
        """What a run answers; while its samples are stepped it may take its time."""
        while True:
            head = self._exactly(9)
            content = pickle.loads(self._exactly(struct.unpack("q", head[1:])[0]))
            if head[:1] != b".":
                return content

    def _exactly(self, size: int) -> bytes:
        got, seconds = bytearray(), self.settings.answer_within
        while len(got) < size:
            got += self._read(size - len(got), time.monotonic() + seconds, f"does not answer within {seconds:g} s")
        return bytes(got)

    def _write(self, content: bytes | memoryview) -> int:
        assert self._child.stdin is not None
        self.owes = True
        try:
            return self._child.stdin.write(content) or 0
        except BrokenPipeError:
            raise self._crashed() from None

    def _read(self, most: int, until: float, what: str) -> bytes:
        stream = self._child.stdout
        assert stream is not None
        ready, _, _ = select.select([stream], [], [], max(until - time.monotonic(), 0.0))
        if not ready:
            self.close()
            raise InputError(str(self.path), what, "run it alone in its own tool first")
        content = stream.read(most)
        if not content:
            raise self._crashed()
        return content

    def _crashed(self) -> InputError:
        code = self._child.wait()
        self.close()
        end = signal.Signals(-code).name if code < 0 and -code in set(signal.Signals) else f"exit {code}"
        return InputError(str(self.path), f"crashed ({end})", "run it alone in its own tool first")

    def close(self) -> None:
        """End the child, whatever it does."""
        self.owes = True
        for stream in (self._child.stdin, self._child.stdout):
            if stream is not None:
                stream.close()
        try:
            self._child.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
