"""Independent verification of a tuned case: poles, encirclements, simulation and responses by NumPy and SciPy.

It starts from the linear models and shares no code with the CasADi loop that the optimiser differentiates.
"""

from __future__ import annotations

from matching.frequency.loop.response_error import error_figures, response_error
from matching.frequency.loop.responses import responses
from matching.frequency.verification.verify import Verification, verify

__all__ = ["Verification", "error_figures", "response_error", "responses", "verify"]
