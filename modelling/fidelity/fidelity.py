"""What an XiL fidelity consists of: signals, their partial fidelities, sensors, and the total."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from modelling.common.errors import InputError
from modelling.fidelity.delay import Delay
from modelling.fidelity.measures import ARITHMETICS, NRMSE_FORMS

DYNAMIC_DOMAINS = ("system_dynamics", "residual_vehicle_model")
MEASUREMENT_DOMAIN = "measurement_uncertainty"


@dataclass(frozen=True)
class FidelityMethod:
    """How a fidelity is calculated.

    Attributes
    ----------
    f_max : float
        Largest relevant frequency of the manoeuvre, Hz (Eq. 20).
    arithmetic, nrmse_form : str
        See :mod:`modelling.fidelity.measures`.
    longest_delay : float, optional
        Largest delay that is looked for, s; by default a quarter of the recording.

    Raises
    ------
    InputError
        If ``f_max`` is not positive, or a form is not known.
    """

    f_max: float
    arithmetic: str = "definition"
    nrmse_form: str = "definition"
    longest_delay: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.f_max) and self.f_max > 0):
            raise InputError("f_max", f"{self.f_max!r} is not possible", "give a frequency above 0 in Hz")
        for name, value, known in (
            ("arithmetic", self.arithmetic, ARITHMETICS),
            ("nrmse", self.nrmse_form, NRMSE_FORMS),
        ):
            if value not in known:
                raise InputError(name, f"'{value}' is not known", f"choose {' | '.join(known)}")


@dataclass(frozen=True)
class SignalPair:
    """Reference and test signal in the same SI unit, with what is known of the test bed's sensor.

    Attributes
    ----------
    reference, test : ndarray (t,)
    expanded_uncertainty : float, optional
        U of the test bed's sensor, in the unit of the signals.
    coverage_factor : float
        k of U.
    degrees_of_freedom : float
        Of U.
    noise : tuple of float, optional
        Standard deviation of the white noise of one sample of reference and test; by default estimated from the part
        of the spectrum above f_max.
    """

    reference: np.ndarray
    test: np.ndarray
    expanded_uncertainty: float | None = None
    coverage_factor: float = 2.0
    degrees_of_freedom: float = math.inf
    noise: tuple[float, float] | None = None


@dataclass(frozen=True)
class SignalFidelity:
    """R_NRMSE and R_τ of one signal of a dynamic domain.

    Attributes
    ----------
    name : str
    nrmse, delay_fidelity : float
        R_NRMSE (Eq. 18) and R_τ (Eq. 19).
    delay : Delay
        The delay (s) that R_τ follows from.
    nrmse_uncertainty : float
        Standard uncertainty of a stated R_NRMSE; 0 where signals are there.
    pair : SignalPair, optional
        The signals, unless the values were stated.
    mean_square, width : float
        Mean square deviation and range of the reference, SI; NaN where the values were stated.
    """

    name: str
    nrmse: float
    delay: Delay
    delay_fidelity: float
    nrmse_uncertainty: float = 0.0
    pair: SignalPair | None = None
    mean_square: float = math.nan
    width: float = math.nan


@dataclass(frozen=True)
class SensorUncertainty:
    """One signal of the measurement domain: U/range (Eq. 23) and the degrees of freedom of U."""

    name: str
    ratio: float
    degrees_of_freedom: float = math.inf


@dataclass(frozen=True)
class Fidelity:
    """R_XiL with its parts.

    Attributes
    ----------
    total : float
        R_XiL.
    domains, weights : dict of str to float
        Fidelity and weight of each domain.
    signals : dict of str to tuple of SignalFidelity
        By dynamic domain.
    sensors : tuple of SensorUncertainty
    method : FidelityMethod
    step : float, optional
        Sampling step, s; None where all values were stated.
    notes : tuple of str
        What was corrected in the recordings.
    """

    total: float
    domains: dict[str, float]
    weights: dict[str, float]
    signals: dict[str, tuple[SignalFidelity, ...]]
    sensors: tuple[SensorUncertainty, ...]
    method: FidelityMethod
    step: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def f_max(self) -> float:
        """Largest relevant frequency, Hz."""
        return self.method.f_max
