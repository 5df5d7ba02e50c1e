"""The picture of the how-to on a specimen that shifts: car and bed in three shifts, each in the tests' own equations.

    python -m tests.driving.picture_of_shifts

writes ``docs/howto/shifts.png``.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from driving.own_bed import Beside  # noqa: E402
from driving.test_shifts import HOLD, RADIUS, STEP, Shift, case_of, shifting  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402

from matching.match.exported import exported_controller  # noqa: E402
from matching.match.match import attempt  # noqa: E402
from matching.report.common import MATCHED, RIG, VEHICLE  # noqa: E402

KINDS = {"power-on up": "Upshift under power, 0.4 s", "automated manual": "Automated manual, 0.4 s",
         "power-on down": "Downshift under power, 0.4 s"}  # fmt: skip


def main() -> None:
    """Tune both controllers, play the shifts and write the picture."""
    beside = {
        specimen: Beside(exported_controller(attempt(case_of(0.003, specimen), starts=1).solution.tuned),
                         Path(tempfile.mkdtemp()))
        for specimen in ("known", "unknown")
    }  # fmt: skip
    figure = Figure(figsize=(11, 5.6), layout="constrained")
    for (kind, title), (above, below) in zip(KINDS.items(), figure.subplots(2, 3, sharex=True).T, strict=True):
        shift = Shift(kind)
        car = shifting(0.003, shift)
        u, _ = shift.played(car)
        runs = {name: one.run(car, shift.kmh / 3.6 / RADIUS, u, HOLD) for name, one in beside.items()}
        time = np.arange(len(u)) * STEP - 0.7
        ends = np.flatnonzero(runs["known"].faults)
        last = ends[0] if len(ends) else len(u)
        for axes, column, name in ((above, 0, "motor"), (below, 1, "side_left")):
            axes.plot(time, runs["unknown"].car[:, column], color=VEHICLE, linewidth=2.5, label="car")
            axes.plot(
                time, runs["unknown"].bed[:, column], color=MATCHED, linewidth=1.2, label='bed, specimen "unknown"'
            )
            axes.plot(time[:last], runs["known"].bed[:last, column], "--", color=RIG, linewidth=1.2,
                      label='bed, specimen "known" in one gear, until emulation ends')  # fmt: skip
            if last < len(u):
                axes.plot(time[last - 1], runs["known"].bed[last - 1, column], "x", color=RIG, markersize=8)
            axes.set_ylabel({"motor": "motor [rad/s]", "side_left": "side shaft [N·m]"}[name])
            axes.grid(alpha=0.3)
        above.set_title(title, fontsize=10)
        below.set_xlabel("time [s]")
        below.set_xlim(-0.3, 1.0)
    handles, labels = above.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    figure.savefig(ROOT / "docs" / "howto" / "shifts.png", dpi=90)


if __name__ == "__main__":
    main()
