"""Verification of a tuned case: poles, encirclements, simulation, responses, and all of it by an independent method.

It shares nothing with the CasADi programme. With the search, which accepts ends by poles and encirclements, it shares
:mod:`matching.frequency.loop`; :mod:`matching.frequency.independent` shares nothing with either.
"""

from __future__ import annotations

from matching.frequency.loop.response_error import error_figures, response_error
from matching.frequency.loop.responses import responses
from matching.frequency.verification.verify import Verification, verify

__all__ = ["Verification", "error_figures", "response_error", "responses", "verify"]
