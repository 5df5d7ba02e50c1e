"""The mode table: frequency, damping, symmetry and where most of the energy sits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matching.report.common.wording import ABSENT, spaced


def mode_table(modes: Sequence[dict[str, Any]], components: int = 3) -> list[dict[str, str]]:
    """Rows of the mode table from the entries of ``modes.json``, with the components that hold most of the energy.

    Undamped modes have no column of damping ratios.
    """
    damped = any(mode["damping_ratio"] for mode in modes)
    return [
        {
            "mode": str(mode["number"]),
            "frequency [Hz]": f"{mode['frequency']:.4g}",
            **({"damping ratio": f"{mode['damping_ratio']:.4f}"} if damped else {}),
            "symmetry": mode["symmetry"],
            "kinetic energy": _largest(mode["kinetic"], components),
            "potential energy": _largest(mode["potential"], components),
        }
        for mode in modes
    ]


def _largest(shares: dict[str, float], count: int) -> str:
    ranked = sorted(shares.items(), key=lambda item: -round(item[1], 6))[:count]  # equal ones in the model's order
    return ", ".join(f"{short_name(name)} {100 * share:.0f} %" for name, share in ranked if share >= 0.05) or ABSENT


def short_name(name: str) -> str:
    """A component's name without its table, for a figure or a table."""
    return spaced(name.rsplit(".", 1)[1])
