"""The result of ``rigmatch fidelity``: the fidelity, its uncertainty, its spectrum and the attribution of its loss."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from matching.validity.fidelity.attribution import Attribution, attribute
from matching.validity.fidelity.spectrum import Band, bands
from modelling.common.display import Displayed
from modelling.fidelity.distribution import DrawnValue, fidelity_distribution
from modelling.fidelity.fidelity import MEASUREMENT_DOMAIN, Fidelity, SignalFidelity
from modelling.fidelity.measures import PUBLISHED_DIVISOR


@dataclass(frozen=True)
class XilFidelity(Displayed):
    """The XiL fidelity of a case.

    Attributes
    ----------
    title : str
    fidelity : Fidelity
    uncertainty : dict of str to DrawnValue
        Of ``"total"`` and of each domain, by Monte Carlo with ``draws`` and ``seed``.
    draws, seed : int
    attribution : Attribution, optional
        None for the published arithmetic.
    bands : dict of str to dict of str to tuple of Band
        By domain and signal; empty where values were stated.
    """

    title: str
    fidelity: Fidelity
    uncertainty: dict[str, DrawnValue]
    draws: int
    seed: int
    attribution: Attribution | None
    bands: dict[str, dict[str, tuple[Band, ...]]]

    @property
    def R_XiL(self) -> float:
        """The total, 0 … 1."""
        return self.fidelity.total

    @property
    def domains(self) -> dict[str, float]:
        """Fidelity of every domain, 0 … 1."""
        return dict(self.fidelity.domains)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the figures has to know."""
        fidelity = self.fidelity
        notes = list(fidelity.notes)
        if fidelity.method.arithmetic == "published":
            notes.append(_published_note(fidelity))
        if fidelity.method.nrmse_form == "literal":
            notes.append(
                "literal Eq. 18: the range stands inside the root, so the result depends on the unit of the signals "
                "(SI here)"
            )
        signals = {
            f"{domain}.{signal.name}": signal for domain, members in fidelity.signals.items() for signal in members
        }
        if fidelity.step is None and not any(
            signal.nrmse_uncertainty or signal.delay.standard_uncertainty for signal in signals.values()
        ):
            notes.append(
                "the values are stated without uncertainty, so R_XiL has none: it cannot be compared between test beds"
            )
        for name, signal in signals.items():
            if signal.delay.value is None:
                nearest = signal.delay.nearest
                counts = "as 0" if nearest is None else f"the smallest that fits, {nearest:.4g} s"
                notes.append(f"{name}: delay undetermined, {signal.delay.reason}; R_tau counts {counts}")
        return tuple(notes)

    def to_dict(self) -> dict[str, Any]:
        """The content of ``fidelity.json``."""
        fidelity = self.fidelity
        content: dict[str, Any] = {
            "title": self.title,
            "R_XiL": fidelity.total,
            "domains": fidelity.domains,
            "weights": fidelity.weights,
            "f_max": fidelity.f_max,
            "arithmetic": fidelity.method.arithmetic,
            "nrmse": fidelity.method.nrmse_form,
            "signals": {
                domain: [_signal_to_dict(signal) for signal in members] for domain, members in fidelity.signals.items()
            },
            "sensors": [
                {"name": sensor.name, "uncertainty_over_range": sensor.ratio, "fidelity": 1 - sensor.ratio}
                for sensor in fidelity.sensors
            ],
            "uncertainty": {name: value.to_dict() for name, value in self.uncertainty.items()}
            | {"draws": self.draws, "seed": self.seed},
            "notes": list(self.notes),
        }
        if self.attribution is not None:
            content["attribution"] = self.attribution.to_dict()
        if self.bands:
            content["bands"] = {
                domain: {name: [band.to_dict() for band in spectrum] for name, spectrum in signals.items()}
                for domain, signals in self.bands.items()
            }
        return content


def xil_fidelity(title: str, fidelity: Fidelity, draws: int = 20_000, seed: int = 1) -> XilFidelity:
    """A fidelity with its uncertainty, spectrum and attribution."""
    spectra = {}
    if fidelity.step is not None:
        spectra = {
            domain: {
                signal.name: bands(signal.pair, fidelity.step, fidelity.f_max)
                for signal in members
                if signal.pair is not None
            }
            for domain, members in fidelity.signals.items()
        }
    attribution = attribute(fidelity) if fidelity.method.arithmetic == "definition" else None
    uncertainty = fidelity_distribution(fidelity, draws, seed).summary()
    return XilFidelity(title, fidelity, uncertainty, draws, seed, attribution, spectra)


def _signal_to_dict(signal: SignalFidelity) -> dict[str, Any]:
    return {
        "name": signal.name,
        "R_NRMSE": signal.nrmse,
        "R_tau": signal.delay_fidelity,
        "delay": signal.delay.value,
        "delay_standard_uncertainty": signal.delay.standard_uncertainty,
        "delay_undetermined": signal.delay.reason or None,
        "nearest_delay": signal.delay.nearest,
    }


def _published_note(fidelity: Fidelity) -> str:
    dynamic = 4 / PUBLISHED_DIVISOR  # square of what an ideal test bed scores in a dynamic domain of two signals
    weights = fidelity.weights
    total = sum(weights.get(name, 0) for name in fidelity.signals) * dynamic + weights.get(MEASUREMENT_DOMAIN, 0)
    return (
        "published arithmetic: every sum is divided by 6 instead of 2m or m, which alone gives the paper's Tab. 3; an "
        f"ideal test bed would score {dynamic**0.5:.3f} in a dynamic domain and {total**0.5:.3f} in all, not 1"
    )
