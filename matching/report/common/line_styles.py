"""Line styles of vehicle, rig without control and matched rig: a colour and a stroke each, told apart in grey too."""

from __future__ import annotations

from typing import Any

from matching.report.common.style import MATCHED, RIG, VEHICLE

# The vehicle is a broad pale line underneath: a matched rig runs inside it.
LINES: dict[str, dict[str, Any]] = {
    "vehicle": {"color": VEHICLE, "linewidth": 4.6, "linestyle": "-", "label": "vehicle", "zorder": 2.0, "alpha": 0.4},
    "rig": {"color": RIG, "linewidth": 1.2, "linestyle": (0, (6, 2)), "label": "rig without control", "zorder": 2.1},
    "matched": {"color": MATCHED, "linewidth": 1.4, "linestyle": "-", "label": "matched rig", "zorder": 2.3},
    "unmeasured": {
        "color": MATCHED,
        "linewidth": 1.0,
        "linestyle": (0, (2, 2)),
        "label": "matched rig, torque not measured",
        "zorder": 2.2,
    },
}


def legend_above(fig: Any, axes: Any, columns: int = 4, **options: Any) -> None:
    """One legend for the whole figure, above the axes."""
    handles, labels = axes.get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper center", ncols=columns, **options)
