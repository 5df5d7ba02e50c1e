"""Independent verification of a tuned case: poles, encirclements, simulation and responses in NumPy and SciPy alone.

Nothing here is used by the optimiser, and nothing of the optimiser is used here.
"""

from __future__ import annotations

from matching.frequency.verification.responses import error_figures, response_error, responses
from matching.frequency.verification.verify import Verification, verify

__all__ = ["Verification", "error_figures", "response_error", "responses", "verify"]
