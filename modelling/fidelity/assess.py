"""The XiL fidelity of one test bed on one manoeuvre: of each signal, of each domain, in total."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from modelling.common.errors import InputError
from modelling.fidelity.checks import check_pair, check_time
from modelling.fidelity.delay import delay
from modelling.fidelity.fidelity import (
    DYNAMIC_DOMAINS,
    MEASUREMENT_DOMAIN,
    Fidelity,
    FidelityMethod,
    SensorUncertainty,
    SignalFidelity,
    SignalPair,
)
from modelling.fidelity.measures import (
    WEIGHTS,
    check_weights,
    delay_fidelity,
    dynamics_fidelity,
    measurement_fidelity,
    nrmse_fidelity_of,
    signal_range,
    total_fidelity,
)


# Seven parameters: the signals, and the paper's own settings by keyword, most with a default.
def fidelity_of_signals(
    time: np.ndarray,
    system_dynamics: Mapping[str, SignalPair],
    residual_vehicle_model: Mapping[str, SignalPair] | None = None,
    *,
    f_max: float,
    weights: Mapping[str, float] | None = None,
    nrmse: str = "definition",
    longest_delay: float | None = None,
) -> Fidelity:
    """R_SD, R_RVM, R_MU and R_XiL (Eqs. 14–23) of simultaneous reference and test signals.

    Parameters
    ----------
    time : ndarray (t,)
        s, at equal steps; only differences count.
    system_dynamics, residual_vehicle_model : mapping of str to SignalPair
        Each signal (t,). Pairs with an ``expanded_uncertainty`` make up R_MU.
    f_max, nrmse, longest_delay
        See :class:`FidelityMethod`.
    weights : mapping of str to float, optional
        By domain, for exactly the domains there are; by default the paper's 0.4, 0.4, 0.2.

    Raises
    ------
    InputError
        Unequal lengths, NaN, a constant reference, weights that do not sum to one or do not fit the domains.
    """
    step = check_time(time)
    method = FidelityMethod(f_max, nrmse_form=nrmse, longest_delay=longest_delay)
    pairs = dict(zip(DYNAMIC_DOMAINS, (system_dynamics, residual_vehicle_model or {}), strict=True))
    for domain, members in pairs.items():
        for name, pair in members.items():
            check_pair(np.asarray(pair.reference), np.asarray(pair.test), len(time), f"{domain}.{name}")
    signals = {
        domain: tuple(assess_signal(name, pair, step, method, domain) for name, pair in members.items())
        for domain, members in pairs.items()
        if members
    }
    sensors = tuple(
        SensorUncertainty(signal.name, signal.pair.expanded_uncertainty / signal.width, signal.pair.degrees_of_freedom)
        for members in signals.values()
        for signal in members
        if signal.pair is not None and signal.pair.expanded_uncertainty is not None
    )
    return assemble(signals, sensors, weights, method, step)


def assemble(
    signals: dict[str, tuple[SignalFidelity, ...]],
    sensors: tuple[SensorUncertainty, ...],
    weights: Mapping[str, float] | None,
    method: FidelityMethod,
    step: float | None = None,
    where: str = "fidelity",
) -> Fidelity:
    """R_XiL (Eqs. 14, 16) from the fidelities of signals by domain and from the sensors; ``step`` is in s.

    Raises
    ------
    InputError
        If the weights do not sum to one, or do not name exactly the domains there are.
    """
    domains = {
        name: dynamics_fidelity(
            [signal.nrmse for signal in members],
            [signal.delay_fidelity for signal in members],
            method.arithmetic,
            where,
        )
        for name, members in signals.items()
    }
    if sensors:
        domains[MEASUREMENT_DOMAIN] = measurement_fidelity(
            [sensor.ratio for sensor in sensors], method.arithmetic, where
        )
    weights = dict(WEIGHTS if weights is None else weights)
    if set(weights) != set(domains):
        raise InputError(
            f"{where}: weights",
            f"they name {', '.join(weights)}, but there are values for {', '.join(domains) or 'nothing'}",
            "give a weight to each domain that has signals, no other",
        )
    check_weights(weights, f"{where}: weights")
    return Fidelity(total_fidelity(domains, weights), domains, weights, signals, sensors, method, step)


def assess_signal(
    name: str, pair: SignalPair, step: float, method: FidelityMethod, where: str = "signal"
) -> SignalFidelity:
    """R_NRMSE (Eq. 18) and R_τ (Eq. 19) of one pair of signals (t,) with a step in s.

    Where the delay is undetermined, R_τ is that of the smallest delay that explains the signals as well as any, and 0
    where no delay does.

    Raises
    ------
    InputError
        Unequal lengths, a sample that is not finite, a constant reference.
    """
    where = f"{where}.{name}"
    reference, test = (np.asarray(signal, dtype=float) for signal in (pair.reference, pair.test))
    check_pair(reference, test, None, where)
    width = signal_range(reference, where)
    mean_square = float(np.mean((reference - test) ** 2))
    estimate = delay(reference, test, step, method.longest_delay)
    r_tau = 0.0 if estimate.nearest is None else float(delay_fidelity(estimate.nearest, method.f_max))
    r_nrmse = nrmse_fidelity_of(mean_square, width, method.nrmse_form)
    return SignalFidelity(name, r_nrmse, estimate, r_tau, 0.0, pair, mean_square, width)
