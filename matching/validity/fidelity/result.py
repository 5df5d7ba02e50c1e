"""The result object of ``fidelity.json``."""

from __future__ import annotations

from typing import Any

from matching.validity.fidelity import attribution, spectrum
from modelling.fidelity.assess import Fidelity, SignalFidelity
from modelling.fidelity.measures import PUBLISHED_DIVISOR
from modelling.fidelity.spread import spread


def as_json(title: str, fidelity: Fidelity, draws: int = 20_000, seed: int = 1) -> dict[str, Any]:
    """Everything there is to say of one case: parts, total, uncertainty, bands and attribution."""
    answer: dict[str, Any] = {
        "title": title,
        "R_XiL": fidelity.total,
        "domains": fidelity.domains,
        "weights": fidelity.weights,
        "f_max": fidelity.f_max,
        "arithmetic": fidelity.arithmetic,
        "nrmse": fidelity.nrmse_form,
        "signals": {domain: [_signal(one) for one in members] for domain, members in fidelity.signals.items()},
        "sensors": [
            {"name": one.name, "uncertainty_over_range": one.ratio, "fidelity": 1 - one.ratio}
            for one in fidelity.sensors
        ],
        "uncertainty": spread(fidelity, draws, seed).summary() | {"draws": draws, "seed": seed},
        "notes": _notes(fidelity),
    }
    if fidelity.arithmetic == "definition":
        answer["attribution"] = attribution.as_json(attribution.attribute(fidelity))
    if fidelity.step is not None:
        answer["bands"] = {
            domain: {
                one.name: spectrum.as_json(spectrum.bands(one.pair, fidelity.step, fidelity.f_max))
                for one in members
                if one.pair is not None
            }
            for domain, members in fidelity.signals.items()
        }
    return answer


def _signal(one: SignalFidelity) -> dict[str, Any]:
    return {
        "name": one.name,
        "R_NRMSE": one.nrmse,
        "R_tau": one.delay_fidelity,
        "delay": one.delay.value,
        "delay_standard_uncertainty": one.delay.standard_uncertainty,
        "delay_undetermined": one.delay.reason or None,
        "nearest_delay": one.delay.nearest,
    }


def _notes(fidelity: Fidelity) -> list[str]:
    notes = list(fidelity.notes)
    if fidelity.arithmetic == "published":
        ideal = (
            sum(fidelity.weights.get(name, 0) for name in fidelity.signals) * 4 / PUBLISHED_DIVISOR
            + fidelity.weights.get("measurement_uncertainty", 0)
        ) ** 0.5
        notes.append(
            "published arithmetic: every sum is divided by 6 instead of 2m or m, which alone gives the paper's "
            f"Tab. 3; an ideal test bed would score {(4 / PUBLISHED_DIVISOR) ** 0.5:.3f} in a dynamic domain and "
            f"{ideal:.3f} in all, not 1"
        )
    if fidelity.nrmse_form == "literal":
        notes.append(
            "literal Eq. 18: the range stands inside the root, so the result depends on the unit of the signals "
            "(taken in SI)"
        )
    if fidelity.step is None and not any(
        one.nrmse_uncertainty or one.delay.standard_uncertainty
        for members in fidelity.signals.values()
        for one in members
    ):
        notes.append("the values are given without uncertainty, so R_XiL shows none: it is not comparable between rigs")
    notes += [
        f"{domain}.{one.name}: delay undetermined, {one.delay.reason}; R_tau counts "
        + ("as 0" if one.delay.nearest is None else f"the smallest that fits, {one.delay.nearest:.4g} s")
        for domain, members in fidelity.signals.items()
        for one in members
        if one.delay.value is None
    ]
    return notes
