"""What no cause explains, kept in the extended model as a table of torque, where that helps on unseen data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from matching.diagnosis.candidates.refit import fit_extended
from matching.diagnosis.search.hypothesis import Hypothesis
from matching.diagnosis.search.refinement import FIT_ERRORS
from matching.diagnosis.search.unseen_data import UnseenData
from matching.diagnosis.verdict.discrepancy import DiscrepancyCurve
from modelling.effects.table import AXES, TorqueTable, table_parameters
from modelling.model.components import Effect
from modelling.model.quantity import Quantity

REPEATS = 0.5  # correlation of the curves of both halves of the data, from which a curve is more than chance


@dataclass(frozen=True)
class KeptTable:
    """A curve as an effect of the extended model.

    Attributes
    ----------
    effect : Effect
    over : str
        ``speed``, ``angle`` or ``twist``.
    values : dict of str to float
        Parameters fitted with it, SI by name.
    nrmse_before, nrmse_after : float
        Error of all sensors on unseen data over their ranges, of the extended model without it and with it.
    """

    effect: Effect
    over: str
    values: dict[str, float]
    nrmse_before: float
    nrmse_after: float

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "at": self.effect.at, "over": self.over, "nrmse_before": self.nrmse_before,
            "nrmse_after": self.nrmse_after,
        }  # fmt: skip


def table_effect(curve: DiscrepancyCurve) -> Effect:
    """A curve over speed, angle or twist as an effect."""
    parameters = table_parameters(curve.over, curve.grid.tolist(), curve.torque.tolist())
    return Effect(TorqueTable.kind, curve.at, tuple((key, Quantity(value)) for key, value in parameters.items()))


def kept_table(final: Hypothesis, curves: Sequence[DiscrepancyCurve], unseen: UnseenData) -> KeptTable | None:
    """The best curve that repeats and with which unseen data are met better; None where there is none.

    The parameters of the model are fitted again with it.
    """
    start = final.at_fit()
    for curve in curves:
        if curve.over not in AXES or not curve.repeats > REPEATS:
            continue
        effect = table_effect(curve)
        model = replace(start, base=start.base.with_effects(effect), starts=tuple(final.fit.starts))
        try:
            extended = Hypothesis(model, fit_extended(model, final.fit))
        except FIT_ERRORS:
            continue
        before, after = unseen.error(final), unseen.error(extended)
        if before is not None and after is not None and unseen.earns_place(extended, final):
            return KeptTable(effect, curve.over, extended.fit.values, before.pooled, after.pooled)
    return None
