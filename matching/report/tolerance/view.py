"""Views of a tolerance study: distributions with nominal value and limit, and the drivers of each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from matching.frequency.studies.distribution import Spread
from matching.frequency.studies.tolerance import Tolerance, required_range
from matching.report.common.style import LIMIT, MATCHED, VEHICLE, figure, styled
from matching.report.common.table import preformatted
from matching.report.common.wording import ABSENT, counted, enough_digits, number, spaced
from modelling.common import display

DRIVERS_DRAWN, DRIVERS_PRINTED = 5, 3  # quantities with the largest shares of the variance
LEAST_SHARE_PRINTED = 0.02


@display.plot.register
def plot(study: Tolerance) -> Figure:
    """One row a result: its distribution, and the quantities that it comes from."""
    with styled():
        fig = figure(8.0, 0.8 + 1.75 * len(study.spreads))
        rows = fig.subplots(len(study.spreads), 2, squeeze=False, width_ratios=[3, 2])
        for (left, right), spread in zip(rows, study.spreads, strict=True):
            left.stairs(100 * spread.counts / spread.draws, spread.edges, fill=True, color=MATCHED, alpha=0.6)
            left.axvline(spread.nominal, color="black", linewidth=1.2, label="nominal")
            for place, label in zip(_required(study, spread), ("required", "_"), strict=False):
                left.axvline(place, color=LIMIT, linestyle="--", linewidth=1.2, label=label)
            left.set_xlabel(result_words(spread.name) + (f" in {spread.unit}" if spread.unit else ""))
            left.set_ylabel("share of draws\nin %")
            left.locator_params(axis="x", nbins=6)
            left.legend(fontsize=7, loc="lower right", bbox_to_anchor=(1, 1), ncols=2, borderaxespad=0)
            drivers = spread.drivers[:DRIVERS_DRAWN][::-1]
            right.barh(range(len(drivers)), [100 * share for _, share in drivers], color=VEHICLE)
            right.set_yticks(range(len(drivers)), [short_name(name) for name, _ in drivers], fontsize=7)
            right.set_xlim(0, 100)
            right.set_xlabel("share of the variance in %", fontsize=8)
        fig.align_ylabels(rows[:, 0])
    return fig


def _required(study: Tolerance, spread: Spread) -> list[float]:
    """Ends of what is required of a result: the margin, and those of a target mode that a draw comes near."""
    if spread.name == "modulus_margin":
        return [study.asked]
    low, high = spread.edges[0], spread.edges[-1]
    return [end for end in required_range(spread.name, spread.nominal, study.asked) if low <= end <= high]


@display.text.register
def as_text(study: Tolerance) -> str:
    """Yield, spread and drivers."""
    return summary(study.to_dict())


@display.html.register
def as_html(study: Tolerance) -> str:
    """The text of the result as HTML for a notebook."""
    return preformatted(as_text(study))


def summary(result: Mapping[str, Any]) -> str:
    """Yield, spread and drivers in a few lines, from the content of ``tolerance.json``."""
    shares = result["yield"]
    lines = [
        f"{result['title'] or 'Tolerances of the bed'}: {result['draws']} draws of "
        f"{counted(len(result['varied']), 'quantity', 'quantities')}",
        f"yield {shares['all']:.1%}: stable {shares['stable']:.1%}, modulus margin of at least "
        f"{result['modulus_margin_asked']:g} from {result['modulus_margin_from']:.3g} Hz on "
        f"{shares['modulus_margin']:.1%}"
        + "".join(f", {result_words(name)} {share:.1%}" for name, share in shares.items() if name.startswith("target")),
        f"{'':46} {'nominal':>9} {'5 %':>9} {'(interval)':23} {'95 %':>9} {'(interval)':23} {'draws':>8}   driven by",
    ]
    for spread in result["quantities"]:
        drivers = [
            f"{short_name(driver['name'])} {driver['share']:.0%}"
            for driver in spread["drivers"][:DRIVERS_PRINTED]
            if driver["share"] > LEAST_SHARE_PRINTED
        ]
        low, high = (_quantile(spread, level) for level in ("0.05", "0.95"))
        name = result_words(spread["name"]) + (f" [{spread['unit']}]" if spread["unit"] else "")
        lines.append(
            f"{name:46} {spread['nominal']:9.4g} {low} {high} {spread['draws']:8}   {', '.join(drivers) or ABSENT}"
        )
    lines.append("interval: where the quantile of all such beds lies with 95 % confidence, by the number of draws")
    checked = result["checked_exactly"]
    worst = ", ".join(f"{result_words(name)} {value:.1g}" for name, value in checked["largest_difference"].items())
    lines.append(
        f"{checked['draws']} of the draws were worked out exactly as well; largest relative difference: {worst}"
    )
    return "\n".join(lines)


def _quantile(spread: Mapping[str, Any], level: str) -> str:
    """A quantile and its confidence interval; an open end where the draws do not bound it."""
    ends = spread["quantile_intervals"][level]
    digits = max(enough_digits(ends, 4), enough_digits(list(spread["quantiles"].values())))
    low, high = (number(end, digits) if end is not None else "…" for end in ends)
    return f"{number(spread['quantiles'][level], digits):>9} {f'({low} to {high})':23}"


def result_words(name: str) -> str:
    """A result of the study in words."""
    words = name.replace("target_mode", "loop mode near vehicle mode", 1)
    return spaced(words.replace("error_unmeasured", "error to unmeasured torques"))


def short_name(name: str) -> str:
    """A quantity as figures name it."""
    return name.removeprefix("rig.")
