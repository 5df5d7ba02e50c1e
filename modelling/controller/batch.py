"""Exported controllers run side by side, one a bed: their C sources, or Python where there is no compiler."""

from __future__ import annotations

import ctypes

import numpy as np

from modelling.controller.c_source import c_sources
from modelling.controller.law import ExportedController
from modelling.simulation.compiled import library_of

OPTIMISATION = "-O2"  # speed only
SHIM = """
#include <stddef.h>
size_t batch_size(void) { return sizeof(controller); }
void batch_begin(unsigned char *all, int count)
{
    for (int b = 0; b < count; b++) {
        controller_init((controller *)(all + (size_t)b * sizeof(controller)));
    }
}
void batch_step(unsigned char *all, int count, const double *in, int mode, unsigned life, int trigger, double *out,
                int *state)
{
    for (int b = 0; b < count; b++) {
        controller *c = (controller *)(all + (size_t)b * sizeof(controller));
        controller_input input;
        controller_output output;
        const double *own = in + b * (READINGS + KNOWN + 2 * DYNAMOMETERS);
        for (int i = 0; i < READINGS; i++) { input.reading[i] = own[i]; }
        for (int i = 0; i < KNOWN; i++) { input.known[i] = own[READINGS + i]; }
        for (int i = 0; i < DYNAMOMETERS; i++) { input.hold_speed[i] = own[READINGS + KNOWN + i]; }
        for (int i = 0; i < DYNAMOMETERS; i++) {
            input.added_torque[i] = own[READINGS + KNOWN + DYNAMOMETERS + i];
        }
        input.trigger = trigger;
        input.mode = mode;
        input.life = life;
        controller_step(c, &input, &output);
        for (int i = 0; i < DYNAMOMETERS; i++) { out[b * DYNAMOMETERS + i] = output.command[i]; }
        state[2 * b] = output.mode;
        state[2 * b + 1] = output.fault;
    }
}
"""


class ControllerBatch:
    """The same exported controller on b beds, each with a state of its own.

    Parameters
    ----------
    controller : ExportedController
    count : int
        How many beds.
    """

    def __init__(self, controller: ExportedController, count: int):
        self._count, self._k = count, len(controller.law.dynamometers)
        files = c_sources(controller)
        parts = [files["controller.h"], files["controller.c"], SHIM]
        source = "\n".join(parts).replace('#include "controller.h"', "")
        source = source.replace('#include "controller_data.h"', files["controller_data.h"])
        library = library_of(source, OPTIMISATION, ["batch_size", "batch_begin", "batch_step"])
        self._python = [controller.running() for _ in range(count)] if library is None else []
        if library is None:
            return
        library.batch_size.restype = ctypes.c_size_t
        self._all = np.zeros(library.batch_size() * count, np.uint8)
        width = len(controller.law.sensors) + len(controller.law.known) + 2 * self._k
        self._in, self._out = np.zeros((count, width)), np.zeros((count, self._k))
        self._state = np.zeros((count, 2), np.int32)
        library.batch_begin(ctypes.c_void_p(self._all.ctypes.data), count)
        self._step = library.batch_step
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in (self._all, self._in, self._out, self._state)]
        self._pointers = pointers

    def step(
        self, readings: np.ndarray, known: np.ndarray, mode: int, hold: np.ndarray, life: int,
        added: np.ndarray | None = None, trigger: bool = False,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
        """Commands (k, b) in N·m, active modes (b,) and faults (b,).

        For readings (y, b), known torques (w, b), speeds to hold (k, b) and torques that are added (k, b); see
        :meth:`modelling.controller.law.SupervisedController.step`.
        """
        more = np.zeros(hold.shape) if added is None else added
        if self._python:
            answers = [
                one.step(readings[:, b], known[:, b], mode, hold[:, b], life, more[:, b], trigger)
                for b, one in enumerate(self._python)
            ]
            commands = np.stack([answer.commands for answer in answers], axis=1)
            modes, faults = (np.array([getattr(one, key) for one in answers]) for key in ("mode", "fault"))
            return commands, modes, faults
        y, w = len(readings), len(readings) + len(known)
        self._in[:, :y], self._in[:, y:w], self._in[:, w:] = readings.T, known.T, np.vstack([hold, more]).T
        everything, given, sent, state = self._pointers
        self._step(everything, self._count, given, mode, ctypes.c_uint(life & 0xFFFFFFFF), int(trigger), sent, state)
        return self._out.T.copy(), self._state[:, 0].copy(), self._state[:, 1].copy()
