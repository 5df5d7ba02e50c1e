"""Exported controllers run side by side, one a bed: their C sources, or Python where there is no compiler."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from typing import Any

import numpy as np

from modelling.bed.foreign_vehicle import ForeignVehicleLaw
from modelling.controller.c_source import c_sources
from modelling.controller.law import ExportedController
from modelling.simulation.compiled import compiler, library_of

OPTIMISATION = "-O2"  # speed only
SHIM = """
#include <stddef.h>
size_t batch_size(void) { return sizeof(controller); }
void batch_begin(unsigned char *all, int count, const double *value, const int *samples)
{
    for (int b = 0; b < count; b++) {
        controller *c = (controller *)(all + (size_t)b * sizeof(controller));
        const double *next = value;
        controller_init(c);
@SETTINGS@
        c->settings.frozen_samples = samples[0];
        c->settings.life_samples = samples[1];
        c->settings.ride_samples = samples[2];
    }
}
static void row_told(void *row, const double *own, int mode, unsigned life, int trigger, int shifting, double *out,
                     int *state)
{
    controller_input input;
    controller_output output;
    memset(&input, 0, sizeof input);
    for (int i = 0; i < READINGS; i++) { input.reading[i] = own[i]; }
    for (int i = 0; i < KNOWN; i++) { input.known[i] = own[READINGS + i]; }
    for (int i = 0; i < DYNAMOMETERS; i++) { input.hold_speed[i] = own[READINGS + KNOWN + i]; }
    for (int i = 0; i < DYNAMOMETERS; i++) { input.added_torque[i] = own[READINGS + KNOWN + DYNAMOMETERS + i]; }
#if CONTROLLER_FOREIGN > 0
    for (int i = 0; i < DYNAMOMETERS; i++) { input.cut_speed[i] = own[READINGS + KNOWN + 2 * DYNAMOMETERS + i]; }
#endif
    input.trigger = trigger;
    input.mode = mode;
    input.life = life;
    input.shifting = shifting;
    controller_step((controller *)row, &input, &output);
    for (int i = 0; i < DYNAMOMETERS; i++) { out[i] = output.command[i]; }
#if CONTROLLER_FOREIGN > 0
    for (int i = 0; i < DYNAMOMETERS; i++) { out[DYNAMOMETERS + i] = output.cut_torque[i]; }
#endif
    state[0] = output.mode;
    state[1] = output.fault;
}
void row_step(void *row, const double *own, int mode, unsigned life, int trigger, double *out, int *state)
{
    row_told(row, own, mode, life, trigger, 0, out, state);
}
void row_shown(const void *row, double *out)
{
#if CONTROLLER_VEHICLE_STATES > 0
    controller_output now;
    show_vehicle((const controller *)row, &now);
    *out++ = now.vehicle_speed;
    *out++ = now.vehicle_distance;
    for (int j = 0; j < DYNAMOMETERS; j++) { *out++ = now.wheel_speed[j]; }
    for (int i = 0; i < CONTROLLER_TYRES; i++) { *out++ = now.slip[i]; }
    for (int i = 0; i < CONTROLLER_TYRES; i++) { *out++ = now.tyre_torque[i]; }
#else
    (void)row;
    (void)out;
#endif
}
enum { CUTS = CONTROLLER_FOREIGN * DYNAMOMETERS };
void batch_step(unsigned char *all, int count, const double *in, int mode, unsigned life, int trigger, int shifting,
                double *out, int *state)
{
    for (int b = 0; b < count; b++) {
        row_told(all + (size_t)b * sizeof(controller), in + b * (READINGS + KNOWN + 2 * DYNAMOMETERS + CUTS), mode,
                 life, trigger, shifting, out + b * (DYNAMOMETERS + CUTS), state + 2 * b);
    }
}
"""
# of a controller's settings, in the order of their values
ARRAYS = (
    "torque_limit", "speed_limit", "hold_proportional", "hold_integral", "lost_torque", "torque_gain", "power_limit",
    "check_torque", "check_speed", "curve_speeds", "curve_torques", "unexpected", "opened_torque",
)  # fmt: skip
SHARES = ("opened_share", "undelivered_share")
C_NAMES = {"curve_speeds": "curve_speed", "curve_torques": "curve_torque"}


def _source(controller: ExportedController) -> str:
    """C of a controller without its settings, so that all controllers of one law share a library."""
    settings = controller.settings
    neutral: dict[str, Any] = {name: np.zeros(getattr(settings, name).shape) for name in ARRAYS}
    neutral |= dict.fromkeys(SHARES, 0.0) | {"frozen_samples": 0, "life_samples": 0, "ride_samples": 0}
    files = c_sources(replace(controller, title="", settings=replace(settings, **neutral)))
    taken = [
        f"        for (int i = 0; i < {len(getattr(settings, name))}; i++) {{ c->settings.{C_NAMES.get(name, name)}[i] "
        "= *next++; }"
        for name in ARRAYS
    ]  # fmt: skip
    shares = [f"        c->settings.{name} = *next++;" for name in SHARES]
    shim = SHIM.replace("@SETTINGS@", "\n".join([*taken, *shares]))
    source = "\n".join([files["controller.h"], files["controller.c"], shim]).replace('#include "controller.h"', "")
    return source.replace('#include "controller_data.h"', files["controller_data.h"])


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
        self._foreign = isinstance(controller.law, ForeignVehicleLaw)
        self.cut_torque = np.zeros((self._k, count))  # N·m, into vehicles that are stepped outside
        library = None
        if compiler():
            library = library_of(
                _source(controller), OPTIMISATION, ["batch_size", "batch_begin", "row_step", "row_shown"]
            )
        self.library = library
        self._python = [controller.running() for _ in range(count)] if library is None else []
        self.row_step: Any = None if library is None else library.row_step
        self.row_shown: Any = None if library is None else library.row_shown
        if library is None:
            return
        self._batch_step = library.batch_step
        settings = controller.settings
        shares = [getattr(settings, name) for name in SHARES]
        values = np.concatenate([*(getattr(settings, name) for name in ARRAYS), shares])
        samples = np.array([settings.frozen_samples, settings.life_samples, settings.ride_samples], np.int32)
        library.batch_size.restype = ctypes.c_size_t
        self.bytes_each = library.batch_size()
        self.memory = np.zeros((count, self.bytes_each), np.uint8)
        library.batch_begin(*(ctypes.c_void_p(part.ctypes.data) for part in (self.memory,)), count,
                            *(ctypes.c_void_p(part.ctypes.data) for part in (values, samples)))  # fmt: skip

    def step(
        self, readings: np.ndarray, known: np.ndarray, mode: int, hold: np.ndarray, life: int,
        added: np.ndarray | None = None, trigger: bool = False, wheel: np.ndarray | None = None, shifting: bool = False,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
        """Commands (k, b) in N·m, active modes (b,) and faults (b,).

        For readings (y, b), known torques (w, b), speeds to hold (k, b), torques that are added (k, b), and speeds
        (k, b) of vehicles that are stepped outside; see :meth:`modelling.controller.law.SupervisedController.step`.
        """
        wheel = np.zeros(hold.shape) if wheel is None else wheel
        more = np.zeros(hold.shape) if added is None else added
        if self._python:
            answers = [
                one.step(
                    readings[:, b], known[:, b], mode, hold[:, b], life, more[:, b], trigger, wheel[:, b], shifting
                )
                for b, one in enumerate(self._python)
            ]
            commands = np.stack([answer.commands for answer in answers], axis=1)
            modes, faults = (np.array([getattr(one, key) for one in answers]) for key in ("mode", "fault"))
            self.cut_torque = np.stack([one.cut_torque for one in self._python], axis=1)
            return commands, modes, faults
        of_vehicle = [wheel] if self._foreign else []
        given = np.ascontiguousarray(np.vstack([readings, known, hold, more, *of_vehicle]).T, dtype=float)
        sent, state = np.empty((self._count, self._k * (1 + self._foreign))), np.empty((self._count, 2), np.int32)
        memory, numbers, to, found = (ctypes.c_void_p(part.ctypes.data) for part in (self.memory, given, sent, state))
        life_sign = ctypes.c_uint(life & 0xFFFFFFFF)
        self._batch_step(memory, self._count, numbers, mode, life_sign, int(trigger), int(shifting), to, found)
        self.cut_torque = sent[:, self._k :].T.copy()
        return sent[:, : self._k].T.copy(), state[:, 0].copy(), state[:, 1].copy()
