# PYTHON_ARGCOMPLETE_OK
"""rigmatch: tunes a powertrain test bed until it reproduces the vehicle, and says how far that can be trusted.

The functions behind the commands, under the same names; each is imported when it is first asked for::

    import rigmatch as rm
    rm.modes("rig.toml")                     # energy shares, symmetry; .plot(), .to_dict(), .to_xarray()
    result = rm.match("case.toml")           # result.status, result.limits, result.plot()
"""

import sys
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

MANOEUVRES = ("BackOut", "DriveAway", "Step", "Sweep", "TipIn")
# Where a class is at home; every other name is a function of matching.api.
HOMES = dict.fromkeys(MANOEUVRES, "modelling.bed.manoeuvres") | {
    "DiagnosisSettings": "matching.diagnosis.settings",
    "InputError": "modelling.errors",
    "JudgeSettings": "matching.match.match",
    "SearchSettings": "matching.match.variables",
    "Controller": "modelling.running.plant",
    "Plant": "modelling.running.plant",
    "Vehicle": "modelling.running.plant",
    "RecordedPlant": "modelling.running.log",
    "bed": "matching.match.imperfections",
    "controller": "matching.match.exported",
    "run": "modelling.running.run",
    "SimulationError": "modelling.simulation.stepping",
    # what functions take and give
    "System": "modelling.system",
    "Case": "matching.match.case",
    "Recording": "modelling.recordings.recording",
    "Modes": "modelling.modal.result",
    "Campbell": "modelling.modal.orders",
    "OrderResponse": "modelling.modal.forced",
    "CriticalSettings": "modelling.modal.forced",
    "Response": "modelling.linear.state_space",
    "StateSpace": "modelling.linear.state_space",
    "Simulation": "modelling.simulation.stepping",
    "MatchResult": "matching.match.result",
    "Map": "matching.match.map",
    "Tolerance": "matching.match.tolerance",
    "Diagnosis": "matching.diagnosis.result",
    "Uncertainty": "matching.uncertainty.result",
    "XilFidelity": "matching.fidelity",
}
__all__ = [
    "BackOut", "Campbell", "Case", "Controller", "CriticalSettings", "Diagnosis", "DiagnosisSettings", "DriveAway",
    "InputError", "JudgeSettings", "Map", "MatchResult", "Modes", "OrderResponse", "Plant", "RecordedPlant",
    "Recording", "Response", "SearchSettings", "Simulation", "SimulationError", "StateSpace", "Step", "Sweep",
    "System", "TipIn", "Tolerance", "Uncertainty", "Vehicle", "XilFidelity", "bed", "campbell", "commission",
    "controller", "diagnose", "excite", "explore", "export", "fidelity", "identify", "learn", "load", "load_case",
    "load_result", "map", "match", "modes", "new", "order_response", "read_recording", "response", "run", "show",
    "simulate", "sweep", "to_ss", "tolerance", "uncertainty", "verify",
]  # fmt: skip

if TYPE_CHECKING:
    from matching.api import (
        campbell,
        commission,
        diagnose,
        excite,
        explore,
        export,
        fidelity,
        identify,
        learn,
        load,
        load_case,
        load_result,
        map,  # noqa: A004
        match,
        modes,
        new,
        order_response,
        read_recording,
        response,
        show,
        simulate,
        sweep,
        to_ss,
        tolerance,
        uncertainty,
        verify,
    )
    from matching.diagnosis.result import Diagnosis
    from matching.diagnosis.settings import DiagnosisSettings
    from matching.fidelity import XilFidelity
    from matching.match.case import Case
    from matching.match.exported import controller
    from matching.match.imperfections import bed
    from matching.match.map import Map
    from matching.match.match import JudgeSettings
    from matching.match.result import MatchResult
    from matching.match.tolerance import Tolerance
    from matching.match.variables import SearchSettings
    from matching.uncertainty.result import Uncertainty
    from modelling.bed.manoeuvres import BackOut, DriveAway, Step, Sweep, TipIn
    from modelling.errors import InputError
    from modelling.linear.state_space import Response, StateSpace
    from modelling.modal.forced import CriticalSettings, OrderResponse
    from modelling.modal.orders import Campbell
    from modelling.modal.result import Modes
    from modelling.recordings.recording import Recording
    from modelling.running.log import RecordedPlant
    from modelling.running.plant import Controller, Plant, Vehicle
    from modelling.running.run import run
    from modelling.simulation.stepping import Simulation, SimulationError
    from modelling.system import System

PACKAGES = ("modelling", "matching")
REPLACED = (
    "the package {package!r} in {place} is not rigmatch's but another distribution's of the same name; "
    "remove that one, then install rigmatch again"
)


@cache
def replaced_package() -> str:
    """One line on a package of rigmatch that another distribution hides or has overwritten; empty if all is well."""
    here = Path(__file__).resolve().parent
    for package in PACKAGES:
        specification = find_spec(package)
        place = Path(specification.origin).resolve().parent if specification and specification.origin else None
        if place is None or place.parent != here or not _is_ours(package):
            return REPLACED.format(package=package, place=place or here)
    return ""


def _is_ours(package: str) -> bool:
    """Whether the package names rigmatch as its distribution; one that fails at its import does not."""
    try:
        return getattr(import_module(package), "DISTRIBUTION", None) == "rigmatch"
    except Exception:  # a foreign package may fail in any way
        return False


def main() -> int:
    """The command ``rigmatch``; exit code as :func:`matching.cli.main` has it."""
    try:
        if line := replaced_package():
            print(f"rigmatch: {line}", file=sys.stderr)
            return 2
        from matching.cli import main as run
        from matching.cli import supervised

        return supervised(run)
    except KeyboardInterrupt:  # before the command itself has begun
        print("rigmatch: interrupted", file=sys.stderr)
        return 130


def __getattr__(name: str) -> Any:
    if name not in __all__ and name != "__version__":
        raise AttributeError(f"module 'rigmatch' has no attribute {name!r}; it has {', '.join(__all__)}")
    if line := replaced_package():
        raise ImportError(f"rigmatch: {line}")
    if name == "__version__":
        from modelling.errors import VERSION

        return VERSION
    return getattr(import_module(HOMES.get(name, "matching.api")), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
