"""How often intervals of 95 % of a delay cover the truth: `python -m tests.benchmarks.delay_coverage [RATE in Hz…]`.

300 drawn pairs of signals in each cell: smooth and kinked, in white and coloured noise of 1 % and 10 %.
"""

import sys

import numpy as np

from tests.validity.drawn_delays import RATES, deviations, kinked, smooth

DRAWS = 300


def rows(rates):
    """One row of the table a cell, when it is known."""
    for rate in rates:
        for signal in (smooth, kinked):
            for coloured in (False, True):
                for level in (0.01, 0.1):
                    z = deviations(signal, coloured, rate, level, DRAWS)
                    covered = f"{100 * np.mean(np.abs(z) < 1.96):.1f} %" if len(z) else "none"
                    rms = f"{np.sqrt(np.mean(z**2)):.2f}" if len(z) else ""
                    colour = "coloured" if coloured else "white"
                    yield (
                        f"| {rate:g} Hz | {signal.__name__}, {colour}, {100 * level:g} % | {covered} | {rms} | "
                        f"{DRAWS - len(z)} |"
                    )


def main():
    print("| rate | signal, noise | covered | errors over uncertainty, rms | undetermined |\n|---|---|---|---|---|")
    for row in rows([float(rate) for rate in sys.argv[1:]] or RATES):
        print(row, flush=True)


if __name__ == "__main__":
    main()
