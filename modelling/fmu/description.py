"""``modelDescription.xml`` of FMI 2.0 and 3.0."""

from __future__ import annotations

import math
from xml.etree import ElementTree as ET

from modelling.common.escape import xml
from modelling.fmu.block import Contents
from modelling.fmu.units import exponents
from modelling.fmu.variables import Variable

VARIABILITY = {
    "independent": "continuous", "input": "continuous", "output": "continuous", "parameter": "tunable",
    "local": "continuous",
}  # fmt: skip


def description(block: Contents, identifier: str, fmi: str, token: str, step: float, source: str) -> str:
    """XML text; ``step`` (s) is the communication step suggested, ``source`` the C file to be compiled."""
    two = fmi == "2.0"
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": fmi,
            "modelName": xml(block.title),
            "guid" if two else "instantiationToken": token,
            "description": block.about,
            "generationTool": "rigmatch",
            "variableNamingConvention": "flat",
        },
    )
    able = {"canHandleVariableCommunicationStepSize": "true"}
    state = "FMUstate" if two else "FMUState"
    able |= {f"canGetAndSet{state}": "true", f"canSerialize{state}": "true"}
    if two:
        _units(root, block)
    slave = ET.Element("CoSimulation", {"modelIdentifier": identifier} | able)
    if two:
        slave.set("canInterpolateInputs", "true")
        root.insert(0, slave)
        ET.SubElement(ET.SubElement(slave, "SourceFiles"), "File", name=source)
    else:
        root.append(slave)
        _units(root, block)
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="what was wrong with a call")
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime="1", stepSize=repr(step))
    variables = ET.SubElement(root, "ModelVariables")
    time = Variable("time", "independent", "s", description="time")
    for reference, variable in enumerate((time, *block.variables)):
        (_variable2 if two else _variable3)(variables, variable, reference)
    structure = ET.SubElement(root, "ModelStructure")
    first = 1 + len(block.inputs)
    _structure(structure, range(first, first + len(block.outputs)), two)
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _units(root: ET.Element, block: Contents) -> None:
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in sorted({"s", *(variable.unit for variable in block.variables)}):
        powers = {name: str(power) for name, power in exponents(unit).items()}
        ET.SubElement(ET.SubElement(definitions, "Unit", name=unit), "BaseUnit", powers)


def _about(variable: Variable) -> dict[str, str]:
    about = {"causality": variable.causality, "variability": VARIABILITY[variable.causality]}
    if variable.causality in ("parameter", "local", "output"):
        about["initial"] = "calculated" if variable.causality == "output" else "exact"
    return about


def _values(variable: Variable) -> dict[str, str]:
    attributes = {"unit": variable.unit}
    bounds = {"min": variable.lower, "max": variable.upper}
    attributes |= {key: repr(end) for key, end in bounds.items() if math.isfinite(end)}
    if variable.causality in ("input", "parameter", "local"):
        attributes["start"] = repr(variable.start)
    return attributes


def _variable2(parent: ET.Element, variable: Variable, reference: int) -> None:
    about = {"name": variable.name, "valueReference": str(reference), "description": variable.description}
    ET.SubElement(ET.SubElement(parent, "ScalarVariable", about | _about(variable)), "Real", _values(variable))


def _variable3(parent: ET.Element, variable: Variable, reference: int) -> None:
    about = {"name": variable.name, "valueReference": str(reference), "description": variable.description}
    ET.SubElement(parent, "Float64", about | _about(variable) | _values(variable))


def _structure(parent: ET.Element, outputs: range, two: bool) -> None:
    if not two:
        for tag in ("Output", "InitialUnknown"):
            for reference in outputs:
                ET.SubElement(parent, tag, valueReference=str(reference))
        return
    for tag in ("Outputs", "InitialUnknowns"):
        if outputs:
            group = ET.SubElement(parent, tag)
            for reference in outputs:  # variables are counted from 1 here
                ET.SubElement(group, "Unknown", index=str(reference + 1))
