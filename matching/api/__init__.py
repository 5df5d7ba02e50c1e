"""What the commands do, as functions: the same names, paths or loaded objects in, results out.

Every result has ``to_dict()`` (what the command writes as JSON), ``plot()`` and shows itself in a notebook.
"""

from matching.api.dynamics import modes, response, simulate
from matching.api.evidence import diagnose, fidelity, uncertainty
from matching.api.files import load, load_case, read_recording, show
from matching.api.in_the_browser import explore
from matching.api.on_the_bed import commission, excite, export, identify, verify
from matching.api.tuning import map, match, tolerance  # noqa: A004

__all__ = [
    "commission",
    "diagnose",
    "excite",
    "explore",
    "export",
    "fidelity",
    "identify",
    "load",
    "load_case",
    "map",
    "match",
    "modes",
    "read_recording",
    "response",
    "show",
    "simulate",
    "tolerance",
    "uncertainty",
    "verify",
]
