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
        "matching.frequency.search.result": [
            "MatchResult", "TargetResult", "ParameterResult", "ResponseError", "AdapterTrade",
        ],
        "matching.frequency.verification.verify": ["Verification"],
        "matching.frequency.independent.beds_check": ["BedsCheck"],
    },
    "Map and tolerance study": {
        "matching.frequency.studies.map": ["Map"],
        "matching.frequency.studies.map_point": ["Point"],
        "matching.frequency.studies.tolerance": ["Tolerance"],
    },
    "Diagnosis": {
        "matching.diagnosis.verdict.result": [
            "Diagnosis", "SensorErrors", "PooledErrors", "RemainingError",
        ],
        "matching.diagnosis.verdict.causes": ["NamedCause", "CauseParameter"],
    },
    "Modes, responses, simulation": {
        "modelling.modal.result": ["Modes", "Mode"],
        "modelling.linear.response": ["Response"],
        "modelling.simulation.result": ["Simulation"],
    },
    "Uncertainty and fidelity": {
        "matching.validity.uncertainty.result": ["Uncertainty", "MeasurandResult", "Row"],
        "matching.validity.fidelity.result": ["XilFidelity"],
    },
    "Verification of a bed": {
        "matching.bed_test.result": ["BedVerification", "ErrorJudgement", "ModeJudgement", "RecordedFidelity"],
    },
    "Commissioning": {
        "matching.commissioning.rounds": ["Commissioning", "Round"],
        "matching.commissioning.from_recordings": ["FromRecordings", "Identification"],
        "matching.commissioning.identified": ["IdentifiedValue"],
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
