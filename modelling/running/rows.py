"""The structures of ``rows.c``, and a run of it: in the process that has its arrays, or in that of a vehicle's FMU."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from ctypes import c_double, c_longlong, c_void_p
from typing import Any

import numpy as np

_SIZES = (
    "rows", "physical", "read", "drives", "dynamometers", "pieces", "longest", "parameters", "sensors", "kept",
    "law_sensors", "known", "every", "controller_bytes", "emulated_size",
)  # fmt: skip
FUNCTIONS = ("sample", "reading", "step", "shown")
NUMBERS = ("span", "largest")
SAMPLES = ("drift_from", "drift_samples", "noise_from", "work_size")
SHARES = ("drive", "known_torque", "hold", "added")
MADE = ("readings", "commands", "states", "emulated", "fault", "fault_at", "lost_at")  # what C writes and is asked for
NOT_FINITE = 2  # of an FMU that failed: its speeds, else its answer


class _Shared(ctypes.Structure):
    _fields_ = [("at", c_void_p), *((name, c_longlong) for name in ("sample", "place", "row"))]


class _Vehicles(ctypes.Structure):
    """``vehicles`` of ``rows.c``, field by field."""

    _fields_ = [
        *((name, c_void_p) for name in ("set", "go_on", "get", "instance", "input", "output")),
        *((name, c_longlong) for name in ("rows", "cuts", "own", "steps", "late", "waits", "behind")),
        ("inertia", c_double),
        *((name, c_void_p) for name in (
            "time", "given", "speed", "before", "momentum", "waiting", "due", "stepped", "own_from", "driven",
            "speed_state", "angle_state", "pushed", "driven_trim", "asked", "progress", "wrong",
        )),
    ]  # fmt: skip


class _Rows(ctypes.Structure):
    """``rows`` of ``rows.c``, field by field."""

    _fields_ = [
        *((name, c_void_p) for name in FUNCTIONS),
        *((name, c_longlong) for name in _SIZES),
        *((name, c_double) for name in NUMBERS),
        *((name, c_void_p) for name in ("state", "parameter", "arriving")),
        *((name, _Shared) for name in SHARES),
        *((name, c_void_p) for name in (
            "mode", "trigger", "middle", "sensor", "lagged", "keep", "law", "trim", "gain", "zero", "drift", "count",
            "out_from", "out_until", "angle", "last", "rest", "noise",
        )),
        ("drift_from", c_longlong), ("drift_samples", c_longlong), ("noise_from", c_longlong),
        *((name, c_void_p) for name in (
            "controllers", "state_of", "fault", "fault_at", "lost_at", "readings", "commands", "states", "emulated",
            "work", "integers",
        )),
        ("work_size", c_longlong), ("vehicle", c_void_p),
    ]  # fmt: skip


class _Kept:
    """A structure whose arrays are kept as long as it is."""

    def __init__(self, structure: ctypes.Structure):
        self.structure, self.arrays = structure, dict[str, np.ndarray]()

    def point(self, name: str, array: np.ndarray) -> None:
        """Point to an array, which is contiguous."""
        self.arrays[name] = array
        setattr(self.structure, name, array.ctypes.data)


class FmuFailed(Exception):
    """An FMU failed: the cut where its speed is not finite, −1 where its answer is an error, and its time, s."""

    def __init__(self, cut: int, time: float):
        super().__init__(cut, time)
        self.cut, self.time = cut, time


class SteppedFmus:
    """Instances of an FMU of FMI 2.0 that C steps.

    Parameters
    ----------
    loop : CDLL
        Of ``rows.c``.
    functions : (int, int, int)
        Addresses of fmi2SetReal, fmi2DoStep and fmi2GetReal.
    instances : sequence of int (b)
    inputs, outputs : ndarray of uint32
        References of the cuts' torques and own inputs, and of the cuts' speeds.
    """

    def __init__(
        self, loop: ctypes.CDLL, functions: tuple[int, int, int], instances: list[int], inputs: np.ndarray,
        outputs: np.ndarray,
    ):  # fmt: skip
        self.loop, self._kept, rows, k = loop, _Kept(_Vehicles()), len(instances), len(outputs)
        v = self.structure = self._kept.structure
        for name, address in zip(("set", "go_on", "get"), functions, strict=True):
            setattr(v, name, address)
        v.rows, v.cuts, v.own, v.steps, v.waits = rows, k, len(inputs) - k, 1, 1
        self.time, self.progress, self._wrong = np.zeros(rows), np.zeros(1, np.int64), np.array([-1, 0, 0], np.int64)
        arrays = {
            "instance": np.array(instances, np.uint64), "input": inputs, "output": outputs, "time": self.time,
            "given": np.zeros(len(inputs)), "progress": self.progress, "wrong": self._wrong,
        }  # fmt: skip
        for name, array in arrays.items():
            self._kept.point(name, array)

    def step(self, span: float, numbers: np.ndarray) -> np.ndarray:
        """Speeds (b, k) after ``span``, s, with inputs (b, k + own) held; not finite where one is so.

        Raises
        ------
        FmuFailed
        """
        given = np.ascontiguousarray(numbers, dtype=float)
        speeds = np.empty((len(given), self.structure.cuts))
        failed = self.loop.step_vehicles(
            ctypes.byref(self.structure), c_double(span), c_void_p(given.ctypes.data), c_void_p(speeds.ctypes.data)
        )
        if failed:
            self.fail()
        return speeds

    def run_in(
        self, step: float, wanted: np.ndarray, now: np.ndarray, gains: tuple[np.ndarray, np.ndarray, np.ndarray],
        within: float, settled: float, longest: float,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Speeds (b, k), rad/s, after torques at the cuts brought all from ``now`` to ``wanted``, and these torques.

        Parameters
        ----------
        step : float
            s.
        gains : (ndarray (k,), ndarray (k,), ndarray (k,))
            Proportional, N·m·s/rad, integral, N·m/rad, and the largest torque, N·m.
        within : float
            rad/s.
        settled, longest : float
            s for which all stay near, and after which it ends.

        Raises
        ------
        FmuFailed
        """
        speeds, kept = np.array(now, dtype=float, order="C"), np.zeros(now.shape)
        arrays = [np.ascontiguousarray(each, dtype=float) for each in (wanted, *gains)]
        failed = self.loop.run_in_vehicles(
            ctypes.byref(self.structure), c_double(step), *(c_void_p(each.ctypes.data) for each in arrays),
            c_double(within), c_double(settled), c_double(longest), c_void_p(speeds.ctypes.data),
            c_void_p(kept.ctypes.data),
        )  # fmt: skip
        if failed:
            self.fail()
        return speeds, kept

    def fail(self) -> None:
        """Say what went wrong."""
        row, why, cut = self._wrong.tolist()
        raise FmuFailed(cut if why == NOT_FINITE else -1, float(self.time[row]))

    def join(self, given: Mapping[str, Any]) -> None:
        """Stand beside controllers or behind specimens; ``given`` as :func:`vehicles_given` makes it."""
        v = self.structure
        for name in ("steps", "late", "waits", "behind", "inertia"):
            setattr(v, name, given[name])
        for name, array in given["arrays"].items():
            self._kept.point(name, np.array(array))


def vehicles_given(
    speed: np.ndarray, steps: int, late: int, own_from: list[int], behind: Mapping[str, np.ndarray] | None = None,
    inertia: float = 0.0,
) -> dict[str, Any]:  # fmt: skip
    """What FMUs beside controllers, or behind specimens, need in a run.

    Parameters
    ----------
    speed : ndarray (b, k)
        rad/s, at which they begin.
    own_from : list of int (r)
        By own input of the FMU which of the known torques it gets, or which of the drives.
    behind : mapping of str to ndarray, optional
        ``driven``, ``speed_state``, ``angle_state``, ``pushed`` (k) of int and ``driven_trim`` (b, k).
    inertia : float
        kg·m² of a specimen's ends.
    """
    (rows, k), waits = speed.shape, late // steps + 2
    reals = {name: np.ascontiguousarray(speed, dtype=float) for name in ("speed", "before")}
    reals |= {"momentum": np.zeros((rows, k)), "waiting": np.zeros((rows, waits, k)), "asked": np.zeros((rows, k))}
    whole = {
        "due": np.full((rows, waits), -1, np.int64), "stepped": np.zeros(rows, np.int64),
        "own_from": np.array(own_from, np.int64),
    }  # fmt: skip
    more = {} if behind is None else {
        name: np.ascontiguousarray(array, dtype=float if name == "driven_trim" else np.int64)
        for name, array in behind.items()
    }  # fmt: skip
    return {
        "steps": steps, "late": late, "waits": waits, "behind": int(behind is not None), "inertia": inertia,
        "arrays": {**reals, **whole, **more},
    }  # fmt: skip


class RowsRun:
    """A run in C.

    Parameters
    ----------
    loop : CDLL
        Of ``rows.c``.
    functions : mapping of str to int
        Addresses by name of :data:`FUNCTIONS`.
    numbers : mapping of str to float or int
        Sizes and numbers of the structure.
    arrays : mapping of str to ndarray
        Contiguous, of the kinds that C has; those of :data:`MADE` are written.
    shares : mapping of str to ndarray
        By name of :data:`SHARES`, (t, n, b); what all samples or rows share has the size 1 there.
    vehicle : SteppedFmus, optional
    """

    def __init__(
        self, loop: ctypes.CDLL, functions: Mapping[str, int], numbers: Mapping[str, Any],
        arrays: Mapping[str, np.ndarray], shares: Mapping[str, np.ndarray], vehicle: SteppedFmus | None = None,
    ):  # fmt: skip
        self.loop, self._kept, self._shares, self.vehicle = loop, _Kept(_Rows()), dict(shares), vehicle
        r = self._kept.structure
        for name, value in (*functions.items(), *numbers.items()):
            setattr(r, name, value)
        for name, array in arrays.items():
            self._kept.point(name, array)
        for name, array in self._shares.items():
            steps = [
                0 if size == 1 else stride // 8 for size, stride in zip(array.shape, array.strides, strict=True)
            ]  # fmt: skip
            setattr(r, name, _Shared(array.ctypes.data, *steps))
        if vehicle is not None:
            r.vehicle = ctypes.addressof(vehicle.structure)

    def go_on(self, first: int, end: int, total: int, noise: np.ndarray | None) -> None:
        """Samples ``first`` to ``end`` of ``total``; ``noise`` (t, b, s) of these.

        Raises
        ------
        FmuFailed
        """
        r = self._kept.structure
        r.noise = None if noise is None else noise.ctypes.data
        failed = self.loop.run_rows(ctypes.byref(r), c_longlong(first), c_longlong(end), c_longlong(total))
        if failed and self.vehicle is not None:
            self.vehicle.fail()

    def made(self) -> dict[str, np.ndarray]:
        """What C wrote."""
        return {name: self._kept.arrays[name] for name in MADE if name in self._kept.arrays}


def numbers_of(sizes: tuple[int, ...]) -> dict[str, int]:
    """Sizes by name, in the order of the structure."""
    return dict(zip(_SIZES, sizes, strict=True))


def shared(array: np.ndarray) -> np.ndarray:
    """An array (t, n, b) without copies of what all samples or rows share, for :class:`RowsRun`."""
    given = np.asarray(array, dtype=float)
    for axis, stride in enumerate(given.strides):
        if stride == 0 and given.shape[axis] > 1:
            given = np.take(given, [0], axis=axis)
    return given
