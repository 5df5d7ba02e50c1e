"""The effects beyond a linear chain: one law a file, registered by being there.

A new kind is one new module here with a class derived from :class:`modelling.effects.kind.Kind`;
model files, equations, simulation, fit, diagnosis and report read all they need from ``EFFECTS``.
"""

from __future__ import annotations

import importlib
import pkgutil

from modelling.effects.kind import Kind, Parameter

__all__ = ["EFFECTS", "Kind", "Parameter"]

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")

EFFECTS: dict[str, Kind] = {cls.kind: cls() for cls in sorted(Kind.__subclasses__(), key=lambda cls: cls.kind)}
