"""Whether an observer's search rests on the beds that fill its box: `python -m tests.benchmarks.observer_seeds [ROW]`.

The search fills the box with a scrambled low-discrepancy sequence, always the same; here every search gets one with
another scrambling, so other beds whose errors are tuned, that are kept damped and that are looked through. ``ROW`` is
one of :mod:`tests.benchmarks.observer_table`. All weights are judged on the same fresh beds. A search takes about 10 s.
"""

import argparse
import time
from dataclasses import dataclass, replace

import numpy as np
import scipy

from matching.match.beds import BED_POINTS, bed_figures, bed_set
from matching.match.case import Box, Case
from matching.match.tune_observer import tuned_weights, tuner
from tests.benchmarks.observer_table import case_of

FRESH_SEED = 1234


@dataclass(frozen=True)
class ScrambledBox(Box):
    """A box that other beds fill."""

    scrambling: int = 0

    def spread(self, count: int) -> np.ndarray:
        """As :meth:`Box.spread`, scrambled anew."""
        sequence = scipy.stats.qmc.Sobol(len(self.uncertain), seed=self.scrambling)
        return 2 * sequence.random_base2(int(np.ceil(np.log2(count))))[:count] - 1


def searched(case: Case, seed: int, beds: int) -> tuple[float, ...]:
    """Objective; median and 95 % of the six functions' error on fresh beds, how many are damped; processor time, s."""
    begin = time.process_time()
    search = tuner(replace(case, uncertainty=ScrambledBox(case.uncertainty.uncertain, seed)))
    weights, cost = tuned_weights(search)
    spent = time.process_time() - begin
    controller = search.gains.controller(np.log10([weights[name] for name in search.gains.names]))
    fresh = [case.uncertainty.at(position) for position in case.uncertainty.draw(beds, FRESH_SEED)]
    figures = bed_figures(bed_set(case, fresh, np.geomspace(*case.band, BED_POINTS)), controller, ())
    damped = int((figures.stable() & (figures.damping_ratio >= search.required.damping_ratio)).sum())
    return cost, *np.quantile(figures.unmeasured, [0.5, 0.95]).tolist(), damped, spent


def main() -> None:
    """Print a line a search, and the spread of all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("row", nargs="?", default="3g")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--beds", type=int, default=200)
    options = parser.parse_args()
    case, rows = case_of(options.row, {}, {}), []
    for seed in range(options.seeds):
        rows.append(searched(case, seed, options.beds))
        cost, median, most, damped, spent = rows[-1]
        print(
            f"{seed}: objective {cost:.4f}, beds {median:.4f}, {most:.4f}, {damped} damped, {spent:.0f} s", flush=True
        )
    for name, column in zip(("objective", "median", "95 %"), np.array(rows).T[:3], strict=True):
        print(
            f"{name}: {column.min():.4f} to {column.max():.4f}, {np.ptp(column) / np.median(column):.1%} of the median"
        )


if __name__ == "__main__":
    main()
