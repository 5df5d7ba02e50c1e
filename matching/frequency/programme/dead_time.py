"""Where the dead time enters the optimiser: exactly, as exp(−s·T) between each command and its inverter."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from modelling.equations.complex_sx import Complex, exp


def actuator(loop: Mapping[str, ca.SX], s: Complex) -> Complex:
    """Air-gap torque over command: dead time, then inverter lag (s)."""
    return exp(-(s * loop["dead_time"])) / (1 + s * loop["inverter_lag"])
