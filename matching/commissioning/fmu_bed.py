"""A bed as an FMU, stepped in real order: readings, controller, commands, one sample of the bed."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np

from modelling.common.errors import InputError
from modelling.controller.law import ControlLaw
from modelling.controller.supervised import Answer

START_SPEED = "start_speed"  # parameter of a bed's FMU, rad/s of its rotors, where it has one


def check_bed(bed: Path) -> None:
    """A folder for recordings need not be there yet; an FMU has to be.

    Raises
    ------
    InputError
        If there is no FMU, or something that is neither file nor folder.
    """
    if not (bed.is_file() or bed.is_dir()) and (bed.exists() or bed.suffix.lower() == ".fmu"):
        wrong = "is no regular file and no folder" if bed.exists() else "does not exist"
        raise InputError(str(bed), wrong, "give the FMU of a bed, or a folder for its recordings")


class Slave:
    """An FMI 2.0 co-simulation FMU, spoken to by the names of its variables.

    Raises
    ------
    InputError
        If FMPy is not installed, the file is no such FMU, lacks a variable that is needed, or does not run.
    """

    def __init__(self, path: Path, needed: Sequence[str]):
        try:
            import fmpy
            from fmpy.fmi2 import FMU2Slave
        except ImportError:
            raise InputError(str(path), "needs FMPy to run", 'in rigmatch\'s folder: pip install -e ".[fmu]"') from None
        try:
            about = fmpy.read_model_description(str(path))
        except Exception as fault:  # FMPy raises what its parsers raise
            raise InputError(
                str(path), f"cannot be read as an FMU: {fault or type(fault).__name__}", "give an FMU or a folder"
            ) from None
        if about.fmiVersion != "2.0" or about.coSimulation is None:
            raise InputError(str(path), "is no FMI 2.0 FMU for co-simulation", "export the bed as one")
        self._references = {variable.name: variable.valueReference for variable in about.modelVariables}
        for name in needed:
            if name not in self._references:
                raise InputError(str(path), f"has no variable {name!r}", "its names are those of the rig file")
        self._path, self._time = path, 0.0
        with self._said():
            self._folder = fmpy.extract(str(path))
            self._slave: Any = FMU2Slave(
                guid=about.guid, unzipDirectory=self._folder, modelIdentifier=about.coSimulation.modelIdentifier,
                instanceName="rigmatch",
            )  # fmt: skip
            self._slave.instantiate()

    @contextlib.contextmanager
    def _said(self) -> Iterator[None]:
        """What the FMU, or FMPy for it, complains of in one line."""
        try:
            yield
        except Exception as fault:  # FMPy raises plain exceptions
            raise InputError(f"{self._path}: t = {self._time:g} s", f"does not run: {fault}", "mend the FMU") from None

    def initialise(self, values: Mapping[str, float]) -> None:
        """Set parameters, SI, of which those that the FMU lacks are left out, and begin."""
        with self._said():
            self._slave.setupExperiment(startTime=0.0)
        self.set({name: value for name, value in values.items() if name in self._references})
        with self._said():
            self._slave.enterInitializationMode()
            self._slave.exitInitializationMode()

    def set(self, values: Mapping[str, float]) -> None:
        """Values by name, SI."""
        if values:
            with self._said():
                self._slave.setReal(
                    [self._references[name] for name in values], [float(value) for value in values.values()]
                )

    def get(self, names: Sequence[str]) -> np.ndarray:
        """Values (v,) by name, SI."""
        with self._said():
            return np.array(self._slave.getReal([self._references[name] for name in names]))

    def advance(self, span: float) -> None:
        """One communication step, s."""
        with self._said():
            self._slave.doStep(currentCommunicationPoint=self._time, communicationStepSize=span)
        self._time += span

    def close(self) -> None:
        """Leave nothing behind."""
        with contextlib.suppress(Exception):  # it may have ended with an error already
            self._slave.terminate()
            self._slave.freeInstance()
        shutil.rmtree(self._folder, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class FmuBed(Slave):
    """A bed whose FMU's inputs are the rig's inputs (u) and whose outputs are the rig's sensors (y).

    Raises
    ------
    InputError
        As :class:`Slave`.
    """

    def __init__(self, path: Path, inputs: Sequence[str], sensors: Sequence[str]):
        super().__init__(path, [*inputs, *sensors])
        self.inputs, self.sensors = tuple(inputs), tuple(sensors)

    def begin(self, speed: float) -> None:
        """Start with rotors at a speed, rad/s, where the FMU lets that be chosen; else at rest."""
        self.initialise({START_SPEED: speed})

    def readings(self) -> np.ndarray:
        """What the sensors (y,) read now, SI."""
        return self.get(self.sensors)

    def step(self, commands: np.ndarray, span: float) -> None:
        """Torques (u,), N·m, held over a span, s."""
        self.set(dict(zip(self.inputs, commands, strict=True)))
        self.advance(span)


class FmuController(Slave):
    """The exported controller's FMU, with the step of :class:`modelling.controller.supervised.SupervisedController`.

    Raises
    ------
    InputError
        As :class:`Slave`.
    """

    def __init__(self, path: Path, law: ControlLaw):
        self._commands = [f"{name}.command" for name in law.dynamometers]
        self._hold = [f"{name}.hold_speed" for name in law.dynamometers]
        super().__init__(path, [*law.sensors, *law.known, *self._commands, *self._hold])
        self._law = law
        self.initialise({})

    def step(self, readings: np.ndarray, known: np.ndarray, mode: int, hold: np.ndarray, life: int) -> Answer:
        """One sample: readings (y,), known torques (w,), N·m, mode asked for, speeds to hold (k,), rad/s."""
        values = dict(zip((*self._law.sensors, *self._law.known, *self._hold), (*readings, *known, *hold), strict=True))
        self.set(values | {"mode": float(mode), "life": float(life)})
        self.advance(self._law.sample_time)
        *commands, active, fault = self.get([*self._commands, "active_mode", "fault"])
        return Answer(np.array(commands), int(active), int(fault))


def held_as_linear(torques: np.ndarray) -> np.ndarray:
    """Samples (t, u) whose straight connection acts like ``torques`` (t, u) held over each sample.

    A recording is read as straight between its samples. The four coefficients make both alike to the fourth order of
    frequency over sampling frequency.
    """
    padded = np.vstack([torques[:1], torques[:1], torques, torques[-1:]])
    return (7 * (padded[2:-1] + padded[1:-2]) - (padded[3:] + padded[:-3])) / 12


def columns(names: Sequence[str], values: np.ndarray) -> Mapping[str, np.ndarray]:
    """Columns (t,) of values (t, y) by name."""
    return {name: values[:, i] for i, name in enumerate(names)}
