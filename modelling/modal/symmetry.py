"""Left/right symmetry: what mirrors what, how symmetric a shape is, and how repeated modes are split by it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from modelling.model.mirror import mirror_images
from modelling.model.system import System

SYMMETRY_THRESHOLD = 0.9  # correlation of a shape with its mirror image from which it is called (anti)symmetric


def images(system: System, components: Sequence[str]) -> np.ndarray | None:
    """Index (k,) of the mirror image of every component; itself where it has none. None without mirror pairs."""
    if not system.mirror:
        return None
    index = {name: i for i, name in enumerate(components)}
    images = mirror_images(components, system)
    return np.array([index.get(image, i) for i, image in enumerate(images)])


def correlation(turns: np.ndarray, J: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Correlation of shapes with their mirror images, weighted by inertia: 1 symmetric, −1 antisymmetric.

    Parameters
    ----------
    turns : ndarray (..., k, m)
        Amplitude of every mass.
    J : ndarray (..., k)
    image : ndarray (k,)
    """
    weight = (J + J[..., image])[..., None] / 2
    norm = np.sum(weight * np.abs(turns) ** 2, axis=-2)
    return np.sum(weight * (np.conj(turns) * turns[..., image, :]).real, axis=-2) / np.maximum(norm, 1e-300)


def labels(turns: np.ndarray, J: np.ndarray, image: np.ndarray | None) -> np.ndarray:
    """``symmetric``, ``antisymmetric`` or ``none`` for every shape, (..., m); arguments as in :func:`correlation`."""
    if image is None:
        return np.full(turns.shape[:-2] + turns.shape[-1:], "none", dtype="<U13")
    symmetry = correlation(turns, J, image)
    return np.where(
        symmetry > SYMMETRY_THRESHOLD, "symmetric", np.where(symmetry < -SYMMETRY_THRESHOLD, "antisymmetric", "none")
    )


def split(shapes: np.ndarray, turns: np.ndarray, J: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Shapes (n, c) of one repeated mode, rotated so that symmetric ones come first and antisymmetric ones last.

    Any combination of the shapes of a repeated mode is a shape; this picks the one that symmetry knows.
    ``turns`` (k, n), ``J`` and ``image`` (k,).
    """
    moved = turns @ shapes
    swapped = moved.T @ (((J + J[image]) / 2)[:, None] * moved[image])
    _, rotation = np.linalg.eigh((swapped + swapped.T) / 2)
    return shapes @ rotation[:, ::-1]
