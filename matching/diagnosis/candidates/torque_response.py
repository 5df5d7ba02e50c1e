"""Readings that torques on the inertias add, by the linear base model.

Inputs are linear between samples, so the response to any sampled torque is exactly the convolution with the response to
one triangular pulse; it is done by FFT.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import fft

from matching.diagnosis.data.segments import Segment
from matching.diagnosis.fitting.batch_simulation import simulate_readings
from matching.diagnosis.fitting.fit import Fit
from modelling.equations.compiled import compiled
from modelling.model.components import Input
from modelling.model.system import System


class TorqueResponse:
    """The linear response of the readings of a fit to torques on its inertias.

    Attributes
    ----------
    parts : tuple of slice
        The segments, one after another.
    """

    def __init__(self, fit: Fit, parts: tuple[slice, ...]):
        self.parts = parts
        self._pulses = _pulse_responses(fit)
        self._sensors = len(fit.problem.data.noise)
        self._spectra: dict[tuple[str, int], np.ndarray] = {}

    def readings(self, torques: dict[str, np.ndarray]) -> np.ndarray:
        """Readings (t, y), SI, that torques (t,) on inertias, N·m, add."""
        out = np.zeros((self.parts[-1].stop, self._sensors))
        for part in self.parts if torques else ():
            size = part.stop - part.start
            length = fft.next_fast_len(2 * size, real=True)
            total = np.zeros((self._sensors, length // 2 + 1), dtype=complex)
            for name, torque in torques.items():
                total += self._spectrum(name, size) * fft.rfft(torque[part], length)
            out[part] = fft.irfft(total, length)[:, :size].T
        return out

    def correlation(self, weights: np.ndarray) -> dict[str, np.ndarray]:
        """By inertia (t,): Σ weights·readings for a torque of 1 N·m at each sample; the adjoint of ``readings``.

        Parameters
        ----------
        weights : ndarray (t, y)
        """
        out = {}
        for name in self._pulses:
            values = np.zeros(len(weights))
            for part in self.parts:
                size = part.stop - part.start
                length = fft.next_fast_len(2 * size, real=True)
                spectrum = np.conj(self._spectrum(name, size)) * fft.rfft(weights[part].T, length)
                values[part] = fft.irfft(spectrum.sum(axis=0), length)[:size]
            out[name] = values
        return out

    def _spectrum(self, name: str, size: int) -> np.ndarray:
        """Spectrum (y, f) of the readings after a pulse on an inertia, for as many samples."""
        if (name, size) not in self._spectra:
            length = fft.next_fast_len(2 * size, real=True)
            self._spectra[name, size] = fft.rfft(self._pulses[name][:size].T, length)
        return self._spectra[name, size]


def _pulse_responses(fit: Fit) -> dict[str, np.ndarray]:
    """By inertia: readings (t, y) of the linear model after a torque that is 1 N·m at the first sample and falls
    linearly to 0 at its neighbours."""
    plain = without_effects(fit.problem.system)
    imposed = (effect for effect in fit.problem.system.effects if effect.law.imposes_motion)
    plain = plain.with_effects(*imposed)  # what is imposed, no torque moves
    plain = plain.with_values({name: value for name, value in fit.values.items() if name in plain.parameters})
    probes = tuple(Input(f"probe{i}", part.name, "torque") for i, part in enumerate(plain.inertias))
    model = compiled(replace(plain, inputs=probes))
    longest = max(fit.problem.data.segments, key=lambda segment: len(segment.time))
    step = float(np.median(np.diff(longest.time)))
    time = step * np.arange(len(longest.time) + 1)
    start = np.zeros((1, len(model.states)))
    out = {}
    for i, part in enumerate(plain.inertias):
        inputs = np.zeros((len(time), len(plain.inertias)))
        inputs[1, i] = 1.0
        segment = Segment(time, inputs, np.full((len(time), len(plain.sensors)), np.nan))
        steps = fit.problem.steps_per_second
        out[part.name] = simulate_readings(model, [segment], model.p0[None], [start], steps)[0][0, 1:]
    return out


def without_effects(system: System) -> System:
    """The linear drivetrain of a system, all inputs torques; a wrong parameter stays as it is said to be."""
    inputs = tuple(replace(part, measures="torque") for part in system.inputs)
    return replace(system, inputs=inputs, effects=tuple(e for e in system.effects if e.law.replaces_quantity))
