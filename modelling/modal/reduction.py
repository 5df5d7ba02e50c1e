"""Values reduced to the shaft of a reference inertia, as the paper reports them (2.3): J/i², c/i²."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from modelling.common.errors import InputError
from modelling.equations.compiled import compiled
from modelling.linear.elements import Elements, elements, null_space, unit_rows
from modelling.modal.result import Modes
from modelling.model.system import System


def speed_ratios(system: System, values: Mapping[str, float] | None = None) -> dict[str, float]:
    """speed(reference)/speed(component) of every inertia and of the second end of every shaft, no shaft twisting.

    Where shafts leave several ways to turn (an open differential), that with the least kinetic energy counts: both
    sides alike.

    Raises
    ------
    InputError
        If the system names no reference, or the reference cannot turn without twisting a shaft.
    """
    model = compiled(system)
    parts = elements(model, model.vector(values)[None])
    if not system.reference:
        raise InputError("reference", "the model names none", 'write reference = "NAME" of an inertia at the top')
    reference = parts.masses.index(f"inertias.{system.reference}")
    motion = _rigid_motion(parts, parts.mass_transformation[reference])
    speeds = dict(zip(parts.masses, parts.mass_transformation @ motion, strict=True))
    ratios = {name: 1 / speed for name, speed in speeds.items() if abs(speed) > 1e-12}
    for shaft in system.shafts:
        end = ratios.get(f"inertias.{shaft.between[1]}")
        if end is not None:
            ratios[f"shafts.{shaft.name}"] = end
    return ratios


def _rigid_motion(parts: Elements, reference: np.ndarray) -> np.ndarray:
    """Coordinates' speeds (n,) at reference speed 1, no twist, least kinetic energy."""
    mass = parts.mass_matrix()[0]
    basis = (
        null_space(unit_rows(parts.spring_transformation)) if len(parts.spring_transformation) else np.eye(len(mass))
    )
    direction = basis.T @ reference
    energy = basis.T @ mass @ basis
    if not np.linalg.norm(direction) > 1e-9 * np.linalg.norm(reference):
        raise InputError("reference", "it cannot turn without twisting a shaft", "name another inertia")
    motion = np.linalg.solve(energy, direction)
    return basis @ (motion / (direction @ motion))


def reduced_values(system: System, values: Mapping[str, float] | None = None) -> dict[str, float]:
    """J, drag, stiffness and damping of every component at the reference shaft, by parameter name, SI.

    Raises
    ------
    InputError
        As :func:`speed_ratios`.
    """
    ratios = speed_ratios(system, values)
    model = compiled(system)
    p = dict(zip(model.parameters, model.vector(values), strict=True))
    at_reference = {}
    for name, value in p.items():
        place, _, key = name.rpartition(".")
        if key in ("J", "drag", "stiffness", "damping") and place in ratios and place.count(".") == 1:
            at_reference[name] = float(value / ratios[place] ** 2)
    return at_reference


def reduced(modes: Modes, ratios: Mapping[str, float]) -> Modes:
    """The same modes with amplitudes, modal mass and modal stiffness at the reference shaft; largest amplitude 1.

    ``ratios`` are those of :func:`speed_ratios`; frequencies and energy shares stay as they are.
    """
    at_reference = modes.mass_amplitudes * np.array([ratios.get(name, 1.0) for name in modes.masses])[:, None]
    peak = at_reference[np.argmax(np.abs(at_reference), axis=0), range(len(modes))]
    size = np.abs(peak) ** 2
    return dataclasses.replace(
        modes,
        shapes=modes.shapes / peak,
        mass_amplitudes=at_reference / peak,
        modal_mass=modes.modal_mass / size,
        modal_stiffness=modes.modal_stiffness / size,
    )
