"""Inputs of a simulation, checked and brought into arrays."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from modelling.common.errors import InputError, unknown
from modelling.equations.compiled import Model

Inputs = Mapping[str, np.ndarray] | np.ndarray


def checked(model: Model, time: np.ndarray, inputs: Inputs) -> tuple[np.ndarray, np.ndarray]:
    """Time (t,) in s and inputs (t, u) in N·m, contiguous and checked.

    Raises
    ------
    InputError
        If time does not rise, an input is missing or of another length, or a value is not finite.
    """
    time = np.ascontiguousarray(time, dtype=float)
    if time.ndim != 1 or len(time) < 2:
        raise InputError("time", f"shape {time.shape}", "at least two samples are needed")
    if not np.isfinite(time).all() or (np.diff(time) <= 0).any():
        raise InputError("time", "is not finite or does not rise", "give rising times in s")
    u = _columns(model, time, inputs) if isinstance(inputs, Mapping) else np.asarray(inputs, dtype=float)
    if u.shape != (len(time), len(model.inputs)):
        raise InputError("inputs", f"shape {u.shape}", f"(t, u) = ({len(time)}, {len(model.inputs)}) is needed")
    if not np.isfinite(u).all():
        sample, column = np.argwhere(~np.isfinite(u))[0]
        raise InputError(
            f"inputs.{model.inputs[column]}", f"is not finite at {time[sample]:g} s", "fill or cut the gap"
        )
    return time, np.ascontiguousarray(u)


def _columns(model: Model, time: np.ndarray, inputs: Mapping[str, np.ndarray]) -> np.ndarray:
    for name in model.inputs:
        if name not in inputs:
            raise unknown(name, list(inputs), f"inputs.{name}")
    columns = [np.asarray(inputs[name], dtype=float) for name in model.inputs]
    for name, column in zip(model.inputs, columns, strict=True):
        if column.shape != time.shape:
            raise InputError(f"inputs.{name}", f"shape {column.shape}", f"one value a sample is needed: {time.shape}")
    return np.stack(columns, axis=1) if columns else np.empty((len(time), 0))
