"""A tolerance study: distributions with nominal value and limit, and what drives each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from matching.frequency.studies.tolerance import Tolerance
from matching.report.common.style import LIMIT, MATCHED, VEHICLE, figure, styled
from matching.report.common.table import lines
from modelling.common import display

DRIVERS = 5


@display.plot.register
def plot(found: Tolerance) -> Figure:
    """One row a result: how it spreads, and which quantities that comes from."""
    with styled():
        drawn = figure(8.0, 0.8 + 1.75 * len(found.spreads))
        rows = drawn.subplots(len(found.spreads), 2, squeeze=False, width_ratios=[3, 2])
        for (left, right), own in zip(rows, found.spreads, strict=True):
            left.stairs(100 * own.counts / own.draws, own.edges, fill=True, color=MATCHED, alpha=0.6)
            left.axvline(own.nominal, color="black", linewidth=1.2, label="nominal")
            if own.name == "modulus_margin":
                left.axvline(found.asked, color=LIMIT, linestyle="--", linewidth=1.2, label="asked for")
            left.set_xlabel(_said(own.name) + (f" in {own.unit}" if own.unit else ""))
            left.set_ylabel("share of draws\nin %")
            left.locator_params(axis="x", nbins=6)
            left.legend(fontsize=7)
            named = own.drivers[:DRIVERS][::-1]
            right.barh(range(len(named)), [100 * share for _, share in named], color=VEHICLE)
            right.set_yticks(range(len(named)), [_short(name) for name, _ in named], fontsize=7)
            right.set_xlim(0, 100)
            right.set_xlabel("share of the variance in %", fontsize=8)
        drawn.align_ylabels(rows[:, 0])
    return drawn


@display.text.register
def said(found: Tolerance) -> str:
    """Spread, yield and drivers."""
    return text(found.to_dict())


@display.html.register
def html(found: Tolerance) -> str:
    """The same for a notebook."""
    return lines(said(found))


def text(result: Mapping[str, Any]) -> str:
    """Spread, yield and drivers in a few lines."""
    shares = result["yield"]
    rows = [
        f"{result['title']}: {result['draws']} draws of {len(result['varied'])} quantities",
        f"yield {shares['all']:.1%}: stable {shares['stable']:.1%}, modulus margin of "
        f"{result['modulus_margin_asked']:g} kept {shares['modulus_margin']:.1%}"
        + "".join(f", {_said(name)} {share:.1%}" for name, share in shares.items() if name.startswith("target")),
        f"{'':46} {'nominal':>9} {'5 %':>9} {'95 %':>9}   driven by",
    ]
    for own in result["quantities"]:
        named = ", ".join(
            f"{_short(one['name'])} {one['share']:.0%}" for one in own["drivers"][:3] if one["share"] > 0.02
        )
        low, high = own["quantiles"]["0.05"], own["quantiles"]["0.95"]
        name = _said(own["name"]) + (f" [{own['unit']}]" if own["unit"] else "")
        rows.append(f"{name:46} {own['nominal']:9.4g} {low:9.4g} {high:9.4g}   {named or '–'}")
    return "\n".join(rows)


def _said(name: str) -> str:
    return name.replace("target_mode", "loop mode near vehicle mode", 1).replace("_", " ")


def _short(name: str) -> str:
    return name.removeprefix("rig.")
