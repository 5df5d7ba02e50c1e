"""The reference of functions and of the results that they return, by autodoc from the docstrings."""

import rigmatch
from site_pages.result_keys import result_keys_tables

FUNCTIONS = """# Functions

`import rigmatch as rm`. Paths or loaded objects go in, results come out. Every result has `to_dict()` (what the command
writes as JSON) and shows itself in a notebook, most with `plot()`. The examples are run as tests.
"""
RESULTS = """# Results

What the functions return, and what stands in the JSON files under the same names: `result.json` of a match,
`diagnosis.json`, `tolerance.json`, `map.json`, `modes.json`, `uncertainty.json`, `fidelity.json`, `verification.json`.
SI unless stated.
"""
CLASSES = {
    "Match": {
        "matching.match.result": [
            "MatchResult", "TargetResult", "ParameterResult", "AdapterTrade",
        ],
        "matching.match.responses": ["ResponseError"],
        "matching.match.verify": ["Verification"],
        "matching.match.beds": ["BedsCheck"],
    },
    "Map and tolerance study": {
        "matching.match.map": ["Map", "Point"],
        "matching.match.tolerance": ["Tolerance"],
    },
    "Diagnosis": {
        "matching.diagnosis.result": [
            "Diagnosis", "SensorErrors", "PooledErrors", "RemainingError", "NamedCause", "CauseParameter",
        ],
    },
    "Modes, responses, simulation": {
        "modelling.modal.result": ["Modes", "Mode"],
        "modelling.linear.state_space": ["Response"],
        "modelling.simulation.stepping": ["Simulation"],
    },
    "Uncertainty and fidelity": {
        "matching.uncertainty.result": ["Uncertainty", "MeasurandResult", "Row"],
        "matching.fidelity": ["XilFidelity"],
    },
    "Verification of a bed": {
        "matching.bed.verify": ["BedVerification", "ErrorJudgement", "ModeJudgement", "RecordedFidelity"],
    },
    "Commissioning": {
        "matching.bed.commission": ["Commissioning", "Round"],
        "matching.bed.identify": ["FromRecordings", "Identification", "IdentifiedValue"],
    },
}  # fmt: skip


def functions_page() -> str:
    """Every public function."""
    return _page(FUNCTIONS, [f".. autofunction:: rigmatch.{name}\n" for name in rigmatch.__all__])


def results_page() -> str:
    """The classes of the results with their fields."""
    parts = [RESULTS]
    for title, modules in CLASSES.items():
        classes = [f".. autoclass:: {module}.{name}()\n" for module, names in modules.items() for name in names]
        parts.append(_page(f"## {title}\n", classes))
    parts.append(result_keys_tables())
    return "\n".join(parts)


def _page(head: str, directives: list[str]) -> str:
    return "\n".join([head, "```{eval-rst}", *directives, "```", ""])
