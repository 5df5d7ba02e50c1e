"""The implicit method for stiff models: RODASP, a Rosenbrock method of order four, L-stable and stiffly accurate.

W·Uᵢ = f(t + αᵢ·h, x + Σⱼ aᵢⱼ·Uⱼ) + Σⱼ cᵢⱼ/h·Uⱼ + h·γᵢ·∂f/∂t with W = 1/(γ·h) − ∂f/∂x, and x + Σ aₛⱼ·Uⱼ + Uₛ is the next
state: one linear system a stage, no iteration (Hairer and Wanner, Solving Ordinary Differential Equations II, 1996,
section IV.7). Coefficients: G. Steinebach, Order-reduction of ROW-methods for DAEs and method of lines applications,
TH Darmstadt, preprint 1741, 1995; also in Hairer's program RODAS. Its order does not fall off where fast decaying
parts follow an input.
"""

from __future__ import annotations

import numpy as np

STAGES = 6
GAMMA = 0.25
ALPHA = np.array([0.0, 0.75, 0.21, 0.63, 1.0, 1.0])  # where in the step a stage stands
GAMMA_SUM = np.array([0.25, -0.5, -0.023504, -0.0362, 0.0, 0.0])  # γᵢ, of the time derivative

_LAST = [-7.170454962423024, -4.741636671481785, -16.31002631330971, -1.062004044111401]
_A = [
    [],
    [3.0],
    [1.831036793486759, 0.4955183967433795],
    [2.304376582692669, -0.05249275245743001, -1.176798761832782],
    _LAST,
    [*_LAST, 1.0],
]
_C = [
    [],
    [-12.0],
    [-8.791795173947035, -2.207865586973518],
    [10.81793056857153, 6.780270611428266, 19.53485944642410],
    [34.19095006749676, 15.49671153725963, 54.74760875964130, 14.16005392148534],
    [34.62605830930532, 15.30084976114473, 56.99955578662667, 18.40807009793095, -5.714285714285717],
]


def _square(rows: list[list[float]]) -> np.ndarray:
    return np.array([row + [0.0] * (STAGES - len(row)) for row in rows])


A, C = _square(_A), _square(_C)
