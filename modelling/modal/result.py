"""What a modal analysis gives: one mode, and all modes of a model or of a batch of parameter sets."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from modelling import display
from modelling.display import Displayed, labelled


@dataclass(frozen=True)
class Mode:
    """One mode.

    Attributes
    ----------
    number : int
        From 1 on, by frequency.
    frequency, damping_ratio : float
        Hz, 0.0 for a rigid-body mode; 0 for undamped modes.
    symmetry : str
        ``symmetric``, ``antisymmetric`` or ``none``.
    kinetic, potential : dict of str to float
        Energy shares by component name (Eqs. 7 and 6).
    modal_mass, modal_stiffness : float
        μ in kg·m² and γ in N·m/rad of ``shape``: f = √(γ/μ)/2π (Eq. 3).
    shape : dict of str to float or complex
        Amplitude of every inertia, the largest 1; complex for damped modes.
    """

    number: int
    frequency: float
    damping_ratio: float
    symmetry: str
    kinetic: dict[str, float]
    potential: dict[str, float]
    modal_mass: float = field(default=0.0)
    modal_stiffness: float = field(default=0.0)
    shape: dict[str, complex] = field(default_factory=dict, repr=False)
    damped: bool = field(default=True, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """As ``modes.json`` holds it; the damping ratio of an undamped mode, which was not calculated, is None."""
        keys = ("number", "frequency", "damping_ratio", "symmetry", "kinetic", "potential")
        known = {key: getattr(self, key) for key in keys}
        return known if self.damped else known | {"damping_ratio": None}

    def animate(self) -> Any:
        """The chain swinging in this mode, slowed: a drawing for a notebook, with ``save(path)`` for a file (SVG)."""
        return display.animation(self)


OF_HELD = 0.5  # share of the kinetic energy from which a motion is that of an imposed inertia; others have none of it


@dataclass(frozen=True)
class Modes(Displayed):
    """Modes of a model, in order of frequency; every array may have leading batch axes (b, …).

    Attributes
    ----------
    frequencies, damping_ratios : ndarray (m,)
        Hz (a rigid-body mode is exactly 0.0), and −Re λ/abs(λ), 0 for undamped modes.
    symmetries : ndarray (m,) of str
        ``symmetric``, ``antisymmetric`` or ``none``.
    shapes : ndarray (n, m)
        Amplitudes of the coordinates, normalised so that the largest is 1.
    modal_mass, modal_stiffness : ndarray (m,)
        μ and γ (Eqs. 4 and 5) of these shapes, kg·m² and N·m/rad.
    kinetic, potential : ndarray (m, k), (m, s)
        Energy shares (Eqs. 7 and 6) of masses and springs; each row adds up to 1, potential ones of rigid modes to 0.
    mass_amplitudes : ndarray (k, m)
        Amplitudes of the masses.
    masses, springs, coordinates : tuple of str
        Names.
    eigenvalues : ndarray (m,), complex
        1/s.
    damped : bool
        Whether damping ratios were calculated.
    """

    frequencies: np.ndarray
    damping_ratios: np.ndarray
    symmetries: np.ndarray
    shapes: np.ndarray
    modal_mass: np.ndarray
    modal_stiffness: np.ndarray
    kinetic: np.ndarray
    potential: np.ndarray
    mass_amplitudes: np.ndarray
    masses: tuple[str, ...]
    springs: tuple[str, ...]
    coordinates: tuple[str, ...]
    eigenvalues: np.ndarray
    damped: bool = True

    _ARRAYS = (
        "frequencies", "damping_ratios", "symmetries", "shapes", "modal_mass", "modal_stiffness", "kinetic",
        "potential", "mass_amplitudes", "eigenvalues",
    )  # fmt: skip

    def case(self, index: int) -> Modes:
        """Modes of one parameter set of a batch."""
        arrays = {name: getattr(self, name)[index] for name in self._ARRAYS}
        return Modes(
            masses=self.masses, springs=self.springs, coordinates=self.coordinates, damped=self.damped, **arrays
        )  # fmt: skip

    def without_held(self, held: Collection[str]) -> Modes:
        """The same without the motions of inertias whose motion is imposed: what is held or driven is no mode.

        ``held`` are their places, ``inertias.NAME``; they stand still in every other mode.
        """
        rows = [number for number, place in enumerate(self.masses) if place in held]
        keep = self.kinetic[:, rows].sum(axis=1) < OF_HELD
        if keep.all():
            return self
        last = ("shapes", "mass_amplitudes")
        arrays = {name: getattr(self, name)[..., keep] if name in last else getattr(self, name)[keep]
                  for name in self._ARRAYS}  # fmt: skip
        return replace(self, **arrays)

    def __len__(self) -> int:
        return self.frequencies.shape[-1]

    def __getitem__(self, index: int) -> Mode:
        """Mode by index from 0; its number is one more."""
        index = range(len(self))[index]
        return Mode(
            number=index + 1,
            frequency=float(self.frequencies[index]),
            damping_ratio=float(self.damping_ratios[index]),
            symmetry=str(self.symmetries[index]),
            kinetic=dict(zip(self.masses, self.kinetic[index].tolist(), strict=True)),
            potential=dict(zip(self.springs, self.potential[index].tolist(), strict=True)),
            modal_mass=float(self.modal_mass[index]),
            modal_stiffness=float(self.modal_stiffness[index]),
            shape=dict(zip(self.masses, self.mass_amplitudes[:, index].tolist(), strict=True)),
            damped=self.damped,
        )

    def __iter__(self) -> Iterator[Mode]:
        return (self[i] for i in range(len(self)))

    def to_dict(self) -> dict[str, Any]:
        """The content of ``modes.json``."""
        return {"modes": [mode.to_dict() for mode in self]}

    def to_xarray(self) -> Any:
        """Frequencies, damping ratios, energy shares and shapes over mode and component (xarray Dataset).

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        return labelled(
            {
                "frequency": (["mode"], self.frequencies, "Hz"),
                "damping_ratio": (["mode"], self.damping_ratios, "1"),
                "kinetic": (["mode", "mass"], self.kinetic, "1"),
                "potential": (["mode", "spring"], self.potential, "1"),
                "shape": (["mass", "mode"], self.mass_amplitudes, "1"),
            },
            {
                "mode": (np.arange(1, len(self) + 1), ""),
                "mass": (list(self.masses), ""),
                "spring": (list(self.springs), ""),
            },
        )
