"""The reference of functions and of the results that they return, by autodoc from the docstrings."""

import rigmatch
from site_pages.result_keys import result_keys_tables

FUNCTIONS = """# Functions

`import rigmatch as rm`. Paths or loaded objects go in, results come out. Every result has `to_dict()` (what the command
writes as JSON) and shows itself in a notebook, most with `plot()`. The examples are run as tests.
"""
TASKS = {  # every public name, by what one wants to do
    "Match": ["match", "map", "sweep", "tolerance", "load_case", "Case", "SearchSettings", "JudgeSettings"],
    "Manoeuvres of a case": ["BackOut", "DriveAway", "Step", "Sweep", "TipIn"],
    "Understand a model": ["load", "modes", "response", "campbell", "order_response", "simulate", "to_ss", "System",
                           "CriticalSettings"],
    "Find what a model lacks": ["diagnose", "read_recording", "Recording", "DiagnosisSettings"],
    "Go onto the bed": ["identify", "export", "excite", "verify", "commission", "learn"],
    "Step beds and controllers by yourself": [
        "bed", "controller", "run", "Plant", "Controller", "Vehicle", "RecordedPlant",
    ],
    "Say how far it can be trusted": ["uncertainty", "fidelity"],
    "Begin, look, and load what was saved": ["new", "show", "explore", "load_result"],
    "Results": ["MatchResult", "Map", "Tolerance", "Modes", "Response", "Campbell", "OrderResponse", "StateSpace",
                "Simulation", "Diagnosis", "Uncertainty", "XilFidelity"],
    "Errors": ["InputError", "SimulationError"],
}  # fmt: skip
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
    """Every public name, by task."""
    listed = [name for names in TASKS.values() for name in names]
    assert sorted(listed) == sorted(rigmatch.__all__), set(listed) ^ set(rigmatch.__all__)
    parts = [FUNCTIONS]
    for task, names in TASKS.items():
        parts.append(_page(f"## {task}\n", [f".. autofunction:: rigmatch.{name}\n" for name in names]))
    return "\n".join(parts)


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
