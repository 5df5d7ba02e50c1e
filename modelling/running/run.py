"""The one loop that steps plants and controllers from sample to sample: in C for rows of the product, else in NumPy."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from ctypes import c_void_p
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from modelling.controller.batch import ControllerBatch
from modelling.errors import InputError, unknown
from modelling.running.beds import BedRows
from modelling.running.compiled_loop import CompiledVehicle, compiled_loop
from modelling.running.controllers import ControllerRows
from modelling.running.plant import Controller, Plant
from modelling.running.rows import RowsRun, numbers_of, shared, vehicles_given
from modelling.running.vehicles import SpecimenAndVehicle
from modelling.simulation.compiled import GENERATED, compiler, generated, library_of
from modelling.simulation.stepping import SimulationError

TOO_LARGE = 1e9  # a state beyond this has left every bed
SAMPLES_AT_ONCE = 4000  # of noise that is drawn before they are run (memory only)


@dataclass(frozen=True)
class Motion:
    """What the rows did; t samples, y kept sensors, k commands, b rows.

    Attributes
    ----------
    time : ndarray (t,)
        s.
    sensors, names : tuple of str (y), tuple of str (k)
        Of what was kept, and of the commands.
    readings : ndarray (t, y, b)
        Absolute, SI; NaN after a row left all bounds. Of rows of the product the true values, of other plants what they
        read.
    commands : ndarray (t, k, b)
        N·m, absolute.
    lost : ndarray of bool (b,)
        Which rows left all bounds.
    fault, fault_at : ndarray of int (b,)
        What ended emulation first, by number (:data:`modelling.controller.law.FAULTS`), 0 where nothing did, and its
        sample, −1.
    states : ndarray (t, x, b) or None
        Absolute, where they were asked for.
    emulated : mapping of str to ndarray (t, b)
        What the emulated vehicle does under a controller over a range of speeds, by the names that its FMU has
        (``vehicle.speed`` in m/s, ``vehicle.distance`` in m, ``NAME.wheel_speed`` in rad/s, ``TYRE.slip``,
        ``TYRE.torque`` in N·m); NaN while nothing is emulated.
    interpreted : bool
        Whether there was no C compiler, with which it takes a tenth of the time.
    """

    time: np.ndarray
    sensors: tuple[str, ...]
    names: tuple[str, ...]
    readings: np.ndarray = field(repr=False)
    commands: np.ndarray = field(repr=False)
    lost: np.ndarray
    fault: np.ndarray
    fault_at: np.ndarray
    states: np.ndarray | None = field(repr=False, default=None)
    interpreted: bool = False
    emulated: Mapping[str, np.ndarray] = field(repr=False, default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        """Time series (t, b) of a sensor, command or quantity of the emulated vehicle by name."""
        if name in self.sensors:
            found: np.ndarray = self.readings[:, self.sensors.index(name)]
        elif name in self.names:
            found = self.commands[:, self.names.index(name)]
        elif name in self.emulated:
            found = self.emulated[name]
        else:
            raise unknown(name, [*self.sensors, *self.names, *self.emulated], "time series")
        return found


def run(
    plant: Plant, controller: Controller | None = None, torques: Mapping[str, np.ndarray] | None = None,
    known: Mapping[str, np.ndarray] | None = None, *, samples: int | None = None, sample_time: float | None = None,
    keep: Sequence[str] | None = None, every: int = 1, states: bool = False,
) -> Motion:  # fmt: skip
    """Step a plant under a controller, sample by sample.

    Parameters
    ----------
    plant : Plant
        Rows of the product, or any object with the attributes and methods of
        :class:`modelling.running.plant.Plant`.
    controller : Controller, optional
        Without one the commands are those of the operating point, or 0.
    torques : mapping of str to ndarray (t,) or (t, b)
        N·m by input of the plant, one value a sample, straight in between; 0 of inputs that are left out.
    known : mapping of str to ndarray (t,) or (t, b)
        N·m, absolute, as the controller is told; 0 of those left out.
    samples : int, optional
        How many, where no torques say so.
    sample_time : float, optional
        s; that of the plant where it has one.
    keep : sequence of str, optional
        Sensors whose time series are returned; all of the plant's unless given.
    every : int
        Every so many samples are returned.
    states : bool
        Return the states of rows of the product, too.

    Returns
    -------
    Motion

    Raises
    ------
    InputError
        If a name is no input or sensor, or nothing says how many samples, or how long one is.
    """
    given = [*(torques or {}).values(), *(known or {}).values()]
    count = samples if samples is not None else max((len(each) for each in given), default=0)
    if count <= 0:
        raise InputError("run", "nothing says how many samples", "give torques, or samples")
    span = getattr(plant, "sample_time", None) if sample_time is None else sample_time
    if span is None or not span > 0:
        raise InputError("run", "nothing says how long a sample is", "give sample_time in s")
    own = getattr(plant, "sample_time", None)
    if own is not None and abs(span - own) > 1e-9 * own:
        raise InputError("run", f"sample_time = {span:g} s, the plant has {own:g} s", "leave sample_time out")
    for name in () if controller is None else controller.sensors:
        if name not in plant.sensors:
            raise unknown(name, list(plant.sensors), "controller")
    drive = _stacked(torques or {}, plant.inputs, count, plant.count, "torques")
    told_names = () if controller is None else controller.known
    told = _stacked({name: each for name, each in (known or {}).items() if name in told_names}, told_names, count,
                    plant.count, "known")  # fmt: skip
    behind = plant if isinstance(plant, SpecimenAndVehicle) and controller is None else None
    if behind is not None and isinstance(behind.vehicle, CompiledVehicle) and behind.vehicle.in_c and not states:
        loop = compiled_loop()
        assert loop is not None
        names = behind.sensors if keep is None else tuple(keep)
        done = _Compiled(behind.specimen, None, drive, told, count, names, every, states, loop, behind).motion()
        if done is not None:
            return done
    if isinstance(plant, BedRows) and not plant.held and (controller is None or _in_c(controller)):
        names = tuple(plant.beds.model.sensors) if keep is None else tuple(keep)
        if compiler() and (loop := compiled_loop()) is not None:
            assert controller is None or isinstance(controller, ControllerRows)
            done = _Compiled(plant, controller, drive, told, count, names, every, states, loop).motion()
            if done is not None:
                return done
        return _interpreted(plant, controller, drive, told, count, span, names, every, states)
    return _interpreted(plant, controller, drive, told, count, span, plant.sensors if keep is None else tuple(keep),
                        every, states)  # fmt: skip


def _in_c(controller: Controller) -> bool:
    """Whether a controller runs in C: one of the product, alone or beside vehicles that C steps, too."""
    if type(controller) is not ControllerRows:
        return False
    beside = controller.vehicle
    return beside is None or (isinstance(beside.vehicle, CompiledVehicle) and beside.vehicle.in_c)


def grown(seconds: float) -> SimulationError:
    """The error of a motion that left all bounds within so many seconds."""
    return SimulationError("simulation", f"the motion grows out of bounds within {seconds:g} s", "the loop is unstable")


def _stacked(
    by_name: Mapping[str, np.ndarray], names: Sequence[str], count: int, rows: int, place: str
) -> np.ndarray:  # fmt: skip
    """Torques (t, n, b) or (t, n, 1) in the order of ``names``."""
    for name in by_name:
        if name not in names:
            raise unknown(name, list(names), place)
    arrays = {name: np.asarray(each, float) for name, each in by_name.items()}
    width = rows if any(each.ndim == 2 and each.shape[1] > 1 for each in arrays.values()) else 1
    made = np.zeros((count, len(names), width))
    for i, name in enumerate(names):
        if name in arrays:
            each = arrays[name]
            if len(each) < count:
                raise InputError(f"{place}.{name}", f"has {len(each)} values", f"{count} samples need as many")
            made[:, i] = each[:count, None] if each.ndim == 1 else each[:count]
    return made


# --- Without a compiler, and of plants and controllers that are none of the product's.


def _interpreted(
    plant: Plant, controller: Controller | None, drive: np.ndarray, told: np.ndarray, count: int, span: float,
    keep: Sequence[str], every: int, states: bool,
) -> Motion:  # fmt: skip
    own = plant if isinstance(plant, BedRows) else None
    rows, k = plant.count, len(plant.commands)
    kept = -(-count // every)
    read, sent = np.full((kept, len(keep), rows), np.nan), np.full((kept, k, rows), np.nan)
    sensors = plant.sensors if own is None else own.beds.model.sensors
    for name in keep:
        if name not in sensors:
            raise unknown(name, list(sensors), "keep")
    chosen = [sensors.index(name) for name in keep]
    needed = [] if controller is None else [plant.sensors.index(name) for name in controller.sensors]
    motion = np.full((kept, own.beds.physical, rows), np.nan) if own is not None and states else None
    idle = np.zeros((k, rows)) if own is None else own.idle()
    shown = controller.shown if isinstance(controller, ControllerRows) else ()
    emulated = np.full((kept, len(shown), rows), np.nan)
    lost, lost_at = np.zeros(rows, bool), np.full(rows, count)
    drive, told = (np.broadcast_to(each, (count, each.shape[1], rows)) for each in (drive, told))
    plant.begin(drive[0])
    if isinstance(controller, ControllerRows):
        controller.begin()
    ended, gone = count, False
    for n in range(count):
        if own is None:
            values = here = plant.readings()
        else:
            here = own.exact()
            values = own.sensed(here) if controller is not None else here
        commands = idle
        if isinstance(controller, ControllerRows) and shown and n % every == 0:
            emulated[n // every] = controller.show()
        if controller is not None:
            asked = controller.step(n, values[needed], told[n])
            if asked is None:
                ended = n
                break
            commands = asked
        if n % every == 0:
            read[n // every], sent[n // every] = here[chosen], commands
            if motion is not None and own is not None:
                motion[n // every] = own.x[: own.beds.physical]
            if gone:
                for each in (read, sent, *([] if motion is None else [motion])):
                    each[n // every][:, lost] = np.nan
        plant.step(commands, drive[n], drive[min(n + 1, count - 1)], span)
        if own is not None and (gone or not np.abs(own.x[: own.beds.physical]).max(initial=0.0) <= TOO_LARGE):
            lost |= ~(np.abs(own.x[: own.beds.physical]) <= TOO_LARGE).all(axis=0)
            lost_at, gone = np.where(lost, np.minimum(lost_at, n + 1), count), True
            own.stop(lost)
            if lost.all():
                break
    kept = min(kept, -(-ended // every))
    fault = getattr(controller, "fault", np.zeros(rows, np.int32))
    fault_at = getattr(controller, "fault_at", np.full(rows, -1, np.int64))
    late = fault_at >= lost_at  # what a controller said of a row that had left all bounds
    fault, fault_at = np.where(late, 0, fault), np.where(late, -1, fault_at)
    if own is None:
        lost = ~np.isfinite(read[:kept]).all(axis=(0, 1)) if kept else lost
    return Motion(
        np.arange(kept) * (every * span), tuple(keep), tuple(plant.commands), read[:kept], sent[:kept], lost,
        fault, fault_at, None if motion is None else motion[:kept], compiler() is None,
        {name: emulated[:kept, i] for i, name in enumerate(shown)},
    )  # fmt: skip


# --- In C: the bed's functions, the controller's step and the loop, each compiled once.


def _functions_of(plant: BedRows) -> dict[str, tuple[ctypes.CDLL, str]] | None:
    """Libraries of the bed's two functions, and their names there; None where they cannot be compiled."""
    found = {}
    for name, function in zip(("sample", "reading"), plant.beds.functions, strict=True):
        library = library_of(generated(function), GENERATED, [function.name()])
        if library is None:
            return None
        found[name] = library, function.name()
    return found


class _Compiled:
    """A run in C: what ``rows.c`` needs of a plant and its controller."""

    def __init__(
        self, plant: BedRows, controller: ControllerRows | None, drive: np.ndarray, told: np.ndarray, count: int,
        keep: Sequence[str], every: int, states: bool, loop: ctypes.CDLL, behind: SpecimenAndVehicle | None = None,
    ):  # fmt: skip
        self.plant, self.controller, self.count, self.loop = plant, controller, count, loop
        self.keep, self.every, self.behind = tuple(keep), every, behind
        self.drive, self.told, self.with_states = drive, told, states

    def motion(self) -> Motion | None:
        """Run it; None where something could not be compiled."""
        plant, beds, controller, behind = self.plant, self.plant.beds, self.controller, self.behind
        functions = _functions_of(plant)
        if controller is not None:
            controller.begin()
        beside = None if controller is None else controller.vehicle
        batch = None
        if controller is not None:
            batch = controller.batch or ControllerBatch(controller.controller, plant.count)
        if functions is None or (batch is not None and batch.row_step is None):
            return None
        b, k, count, sensors = plant.count, beds.dynamometers, self.count, list(beds.model.sensors)
        for name in self.keep:
            if name not in sensors:
                raise unknown(name, sensors, "keep")
        kept = -(-count // self.every)
        plant.begin(np.zeros((len(plant.inputs), b)))
        errors, sensing = plant.errors, plant.sensing
        shown = () if controller is None else controller.shown
        law = np.array([] if controller is None else [plant.sensors.index(name) for name in controller.sensors])
        if batch is not None:
            assert batch.library is not None
            functions |= {"step": (batch.library, "row_step")}
            functions |= {"shown": (batch.library, "row_shown")} if shown else {}
        sizes = (
            b, beds.physical, len(sensors), len(beds.drives), k, beds.pieces, beds.longest, beds.parameters.shape[1],
            len(plant.sensors), len(self.keep), len(law), self.told.shape[1], self.every,
            0 if batch is None else batch.bytes_each, len(shown),
        )  # fmt: skip
        state = np.array(beds.start.T, order="C", copy=True)  # C writes to it
        sizes_of_work = [(f.sz_w(), f.sz_iw(), max(f.sz_arg(), f.sz_res())) for f in beds.functions]
        work_size = max(each[0] for each in sizes_of_work) + 1
        if max(each[2] for each in sizes_of_work) > 64:  # ARGUMENTS of rows.c
            return None
        buffers = len(beds.drives) + len(sensors) + 2 * len(plant.sensors) + len(law) + self.told.shape[1] + 3 * k
        buffers += (k + len(beds.drives)) * beds.pieces + beds.physical + 8
        foreign = None if beside is None else beside.vehicle
        given: dict[str, Any] | None = None
        if behind is not None:
            behind.begin(np.broadcast_to(self.drive[0], (self.drive.shape[1], b)))
            foreign, given = behind.vehicle, behind.given()
            state[:] = behind.specimen.x.T
        elif beside is not None and controller is not None:
            timing = beside.timing
            own = [controller.known.index(name) for name in beside.vehicle.own]
            given = vehicles_given(beside.speeds.T, timing.steps, timing.late, own)
        if foreign is not None:
            buffers += 4 * len(foreign.cuts) + self.drive.shape[1]
        numbers = numbers_of(sizes) | {
            "span": plant.sample_time, "largest": TOO_LARGE, "drift_from": errors.drift_from,
            "drift_samples": errors.drift_samples, "noise_from": errors.noise_from, "work_size": work_size,
        }  # fmt: skip
        made = {
            "readings": np.full((kept, b, len(self.keep)), np.nan), "commands": np.full((kept, b, k), np.nan),
            "emulated": np.full((kept, b, len(shown)), np.nan), "fault": np.zeros(b, np.int32),
            "fault_at": np.full(b, -1, np.int64), "lost_at": np.full(b, -1, np.int64),
        }  # fmt: skip
        if self.with_states:
            made["states"] = np.full((kept, b, beds.physical), np.nan)
        reals = {
            "state": state, "parameter": beds.parameters, "arriving": beds.arriving, "middle": beds.middles,
            "trim": beds.trim.T, "gain": errors.gain, "zero": errors.zero, "drift": errors.drift,
            "count": errors.count, "angle": sensing.angle, "last": sensing.last, "rest": sensing.rest,
            "work": np.zeros(work_size + buffers),
        }  # fmt: skip
        whole = {
            "sensor": np.array(plant.at), "lagged": plant.lagged, "law": law,
            "keep": np.array([sensors.index(name) for name in self.keep]), "out_from": errors.out[0],
            "out_until": errors.out[1], "integers": np.zeros(max(each[1] for each in sizes_of_work) + 1),
        }  # fmt: skip
        arrays = made | {name: np.ascontiguousarray(array, dtype=float) for name, array in reals.items()}
        arrays |= {name: np.ascontiguousarray(array, dtype=np.int64) for name, array in whole.items()}
        shares = {"drive": self._drive()}
        if batch is not None and controller is not None:
            asked = controller.schedule.lasting(count)
            arrays |= {name: np.ascontiguousarray(getattr(asked, name), np.int32) for name in ("mode", "trigger")}
            arrays |= {"controllers": batch.memory, "state_of": np.zeros((b, 2), np.int32)}
            shares |= {"known_torque": self.told, "hold": asked.hold, "added": asked.added}
        shares = {name: shared(array) for name, array in shares.items()}
        noisy = controller is not None and errors.noisy
        ends = range(0, count, SAMPLES_AT_ONCE if noisy else count)
        chunks = (
            (first, min(first + SAMPLES_AT_ONCE, count) if noisy else count,
             sensing.drawn(min(first + SAMPLES_AT_ONCE, count) - first) if noisy else None)
            for first in ends
        )  # fmt: skip
        if isinstance(foreign, CompiledVehicle):
            assert given is not None
            made = foreign.run_rows(functions, numbers, arrays, shares, given, chunks, count)
        else:
            addresses = {
                name: ctypes.cast(getattr(library, function), c_void_p).value or 0
                for name, (library, function) in functions.items()
            }
            here = RowsRun(self.loop, addresses, numbers, arrays, shares)
            for first, end, noise in chunks:
                here.go_on(first, end, count, noise)
        if controller is not None:
            controller.fault[:], controller.fault_at[:] = made["fault"], made["fault_at"]
        motion = made.get("states")
        return Motion(
            np.arange(kept) * (self.every * plant.sample_time), self.keep, plant.commands,
            made["readings"].transpose(0, 2, 1), made["commands"].transpose(0, 2, 1), made["lost_at"] >= 0,
            made["fault"], made["fault_at"], None if motion is None else motion.transpose(0, 2, 1),
            emulated={name: made["emulated"][:, :, i] for i, name in enumerate(shown)},
        )  # fmt: skip

    def _drive(self) -> np.ndarray:
        """Torques (t, d, b) of the specimen's drives, then those of the vehicle behind it; as they are of a bed."""
        if self.behind is None:
            return self.drive
        return self.behind.drives(self.drive)
