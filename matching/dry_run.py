"""``--check``: the input files of a command read and checked, nothing calculated or written."""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matching.frequency.case.case import Case
    from modelling.model.system import System

WITHOUT = ("new", "export", "explore")  # commands that read no input file, or do little else than read it


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """What each input file that the arguments name holds, by file.

    Raises
    ------
    InputError
        As the command itself would, for the first file that is not right.
    """
    from modelling.measurement.channels import read_channels

    named, contents = vars(arguments), dict[str, str]()
    channels = None
    if named.get("channels"):
        channels = read_channels(arguments.channels)
        contents[arguments.channels] = f"a channel file: {', '.join(channels)}"
    if named.get("model"):
        from modelling.model.files import load

        system = load(arguments.model)
        contents[arguments.model] = _model(system)
        contents |= _recordings(named, system, channels)
    if "budget" in named:
        from matching.validity.budget.budget_file import read_budget

        budget = read_budget(arguments.budget)
        contents[arguments.budget] = (
            f"a budget: {_counted(budget.measurands, 'measurand')}, {_counted(budget.inputs, 'input')}"
        )
    if arguments.command == "fidelity":
        from matching.validity.fidelity.case_file import read_case

        title, _ = read_case(arguments.case, arguments.arithmetic, arguments.nrmse, channels)
        contents[arguments.case] = f"a fidelity case: {title}"
    elif "case" in named or "file" in named:
        contents |= _case_or_model(named, channels)
    command = import_module(f"matching.commands.{arguments.command}")
    if hasattr(command, "checked"):
        contents |= command.checked(arguments)
    return {"checked": contents}


def summary(result: dict[str, Any]) -> str:
    """One line a file."""
    return "\n".join(f"{file}: {content}" for file, content in result["checked"].items())


def _case_or_model(named: dict[str, Any], channels: Any) -> dict[str, str]:
    from matching.explore.signals.channel_list import channel_list
    from matching.frequency.case.load import is_case, load_case
    from matching.frequency.case.targets import target_modes
    from modelling.common.tables import read_toml
    from modelling.measurement.readers import READERS
    from modelling.model.files import load

    if named["command"] in ("verify", "excite", "commission", "identify"):
        from matching.bed_test.recorded import read_recordings
        from matching.fmu.export_source import tuned_case

        case = tuned_case(named["case"]).tuned
        target_modes(case)
        if named["command"] != "verify":
            return {named["case"]: _case(case)}
        read_recordings(named["recordings"], case, channels)
        return {named["case"]: _case(case)} | dict.fromkeys(named["recordings"], "a recording of the controlled bed")
    path = named.get("case") or named["file"]
    if "file" in named and Path(path).suffix.lower() in READERS:
        listed = channel_list(path)["channels"]
        most = max(row["samples"] for row in listed)
        return {path: f"a recording: {_counted(listed, 'channel')} of up to {most} samples"}
    if "file" in named and not is_case(read_toml(path)):
        return {path: _model(load(path))}
    case = load_case(path)
    target_modes(case)
    if named["command"] == "map":
        from matching.frequency.studies.map_axis import axis

        for name in ("x", "y"):
            axis(case, named[name], f"--{name}")
    return {path: _case(case)}


def _recordings(named: dict[str, Any], system: System, channels: Any) -> dict[str, str]:
    from matching.diagnosis.loggers import read_loggers
    from modelling.measurement.contents import contents_of

    paths = [*named.get("recordings", ()), *([named["recording"]] if named.get("recording") else [])]
    paths += named.get("holdout") or ()
    contents = {}
    for path in paths:
        contents[path] = contents_of(read_loggers(path, system, channels), system)
    return contents


def _model(system: System) -> str:
    parts = [
        _counted(getattr(system, table), word)
        for table, word in (
            ("inertias", "inertia"), ("shafts", "shaft"), ("gears", "gear"), ("differentials", "differential"),
            ("inputs", "input"), ("sensors", "sensor"), ("effects", "effect"),
        )
        if getattr(system, table)
    ]  # fmt: skip
    return f"a model: {', '.join(parts)}"


def _case(case: Case) -> str:
    return (
        f"a case: {_counted(case.loop.dynamometers, 'dynamometer')}, {_counted(case.targets, 'target mode')}, "
        f"{_counted(case.moves, 'quantity')} that may move; vehicle {_model(case.vehicle)}; rig {_model(case.rig)}"
    )


def _counted(parts: Any, word: str) -> str:
    several = word[:-1] + "ies" if word.endswith("ty") else f"{word}s"
    return f"{len(parts)} {word if len(parts) == 1 else several}"
