"""Models and controllers as FMUs of FMI 2.0 and 3.0: the same bytes for the same content, always."""

from __future__ import annotations

import hashlib
import io
import math
import platform
import zipfile
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol
from xml.etree import ElementTree as ET

import casadi as ca
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from modelling.bed.foreign_vehicle import ForeignVehicleLaw
from modelling.bed.stepped import Law, own_vehicle, shown_of
from modelling.controller.c_source import c_sources, memory_bytes
from modelling.controller.law import ExportedController
from modelling.effects.effect import SECOND_STATE
from modelling.effects.torques import ENGAGED
from modelling.equations.casadi_code import Model, compiled
from modelling.equations.lagrange import CREEP, FOLLOW_TIME, RECORDING, SIMULATION_DEFAULTS, STICK_SPEED
from modelling.equations.shaft_law import CONTACT_TIME
from modelling.errors import InputError
from modelling.escape import c_comment, c_identifier, c_string, xml
from modelling.simulation.clutch_steps import steps_of_clutches
from modelling.simulation.compiled import CompilerFault, check, compile_library, compiler
from modelling.simulation.stepping import steps_per_second
from modelling.simulation.task import functions
from modelling.system import System
from modelling.units import registry

# --- The variables of an FMU: a model's names, units, start values and physical bounds.


@dataclass(frozen=True)
class Variable:
    """A variable of an FMU, SI: ``causality`` as FMI says it; ``nonzero`` where 0 itself is impossible."""

    name: str
    causality: str
    unit: str
    start: float = 0.0
    description: str = ""
    lower: float = -math.inf
    upper: float = math.inf
    nonzero: bool = False


def input_variables(model: Model) -> list[Variable]:
    """Torques, motions that are imposed, and pedals."""
    quantities, units = model.system.input_quantities, model.system.input_units
    meaning = {part.name: f"{quantities[part.name]} on {part.on}" for part in model.system.inputs}
    meaning |= {
        part.name: f"pedal, 0 to 1, of the torque map on {part.on}"
        for part in model.system.inputs
        if part.name in model.system.pedals
    }
    for box in model.system.gearboxes:
        for gear, name in enumerate(box.capacities, 1):
            meaning[name] = f"torque that the clutch of gear {gear} of {box.name} can carry; below 0 counts as 0"
    return [Variable(part.name, "input", units[part.name], 0.0, meaning[part.name]) for part in model.system.inputs]


def output_variables(model: Model) -> list[Variable]:
    """Readings of the sensors."""
    return [
        Variable(sensor.name, "output", sensor.unit, 0.0, f"{sensor.measures} of {sensor.of}")
        for sensor in model.system.sensors
    ]


OF_SHARPNESS = {
    STICK_SPEED: ("rad/s", "speed over which the sign of dry friction turns"),
    CREEP: ("rad/s", "speed at which a held brake gives way under its full torque"),
    FOLLOW_TIME: ("s", "time in which a limited rate follows where it may"),
}


def parameter_variables(model: Model) -> list[Variable]:
    """Every quantity of the model; the contact time of a closing lash is the step's own affair."""
    system, variables = model.system, []
    for name, value in zip(model.parameters, model.p0, strict=True):
        place, _, key = name.rpartition(".")
        if name == CONTACT_TIME:
            continue
        if name in OF_SHARPNESS:
            unit, meaning = OF_SHARPNESS[name]
            variables.append(Variable(name, "parameter", unit, float(value), meaning, 0.0, nonzero=name != CREEP))
            continue
        low, high, nonzero = _bounds(system, name)
        if name == RECORDING:
            meaning = "number of the recording whose values hold, from 1; their mean holds at 0"
            variables.append(Variable(name, "parameter", "1", float(value), meaning, 0.0))
            continue
        meaning = f"{key} of {place}"
        variables.append(Variable(name, "parameter", system.units[name], float(value), meaning, low, high, nonzero))
    return variables


def _bounds(system: System, name: str) -> tuple[float, float, bool]:
    """Physical bounds of a parameter, and whether 0 is impossible."""
    place, _, key = name.rpartition(".")
    effect = next((effect for effect in system.effects if effect.name == place), None)
    if effect is None:
        return (-math.inf if key == "ratio" else 0.0), math.inf, key in ("J", "ratio")
    if effect.law.replaces_quantity:
        return _bounds(system, effect.at)
    parameter = effect.law.parameters[key]
    return parameter.lower, parameter.upper, False


def state_variables(model: Model) -> list[Variable]:
    """Angles, speeds and what effects bring along."""
    variables = []
    for name in model.states:
        kind, _, of = name.partition("(")
        if of:
            unit, meaning = ("rad" if kind == "angle" else "rad/s"), f"{kind} of {of[:-1]}"
        else:
            unit, meaning = _further(model.system, name)
        variables.append(Variable(name, "local", unit, 0.0, meaning))
    return variables


def _further(system: System, name: str) -> tuple[str, str]:
    """Unit and meaning of a state that an effect or a clutch brings along."""
    clutch = next((box.name for box in system.gearboxes if name.startswith(f"gearboxes.{box.name}.")), None)
    if clutch is not None and name.endswith(ENGAGED):
        return "1", f"engagement of {name.removesuffix(ENGAGED).rpartition('.')[2]} of {clutch}, 1: its teeth are in"
    if clutch is not None:
        return "rad", f"deflection of the clutch {name.rpartition('.')[2]} of {clutch}"
    place, kind = next(
        (place, effect.law)
        for effect in system.effects
        for place in effect.places
        if name.removesuffix(SECOND_STATE) == f"{place}.{effect.kind}"
    )
    assert kind.state is not None
    meaning = kind.second_state if name.endswith(SECOND_STATE) else kind.state.meaning
    return kind.state_unit(place, system), meaning.format(place=place)


# --- One or several systems side by side as what an FMU holds: variables with units, and three CasADi functions.

STEPS = "simulation.steps_per_second"
ABOUT = (
    "All values in SI. Stepped by classical Runge-Kutta of order four, internal steps no longer than "
    "1/simulation.steps_per_second; a communication step may have any length."
)
PACED = (
    " Clutches that slip or stick may need more steps: these follow by themselves, and the time of a step with them."
)
SECTION = 1e-3  # s, for which the steps of clutches are chosen at once: a shift takes a hundred times as long
PACED_STEPS = 2e4  # a second, that delays look back over where clutches need more than usual. Chosen by trial


class Contents(Protocol):
    """What every FMU says of itself: title, file name, one sentence, and its variables with the time left out."""

    @property
    def title(self) -> str:
        """What it is, for a reader."""
        ...

    @property
    def name(self) -> str:
        """As a file name."""
        ...

    @property
    def about(self) -> str:
        """How it steps, in one sentence."""
        ...

    @property
    def inputs(self) -> tuple[Variable, ...]:
        """Inputs."""
        ...

    @property
    def outputs(self) -> tuple[Variable, ...]:
        """Outputs."""
        ...

    @property
    def variables(self) -> tuple[Variable, ...]:
        """All, in the order of their value references, which begin at 1; 0 is the time."""
        ...


@dataclass(frozen=True)
class Block:
    """What an FMU holds.

    Attributes
    ----------
    title, name : str
        What it is, for a reader and as a file name.
    inputs, outputs, parameters, states : tuple of Variable
        The last parameter is :data:`STEPS`.
    constants, field, reading : Function
        (p, contact time) → c, delays of inputs and outputs (s); (x, u, c) → ẋ; (x, u, c, t) → y: those of
        :mod:`modelling.simulation.task`.
    pace : Function or None
        (x, u, c, seconds) → steps a second that clutches need over the next seconds; None without any.
    contact : float
        s, contact time at the start; NaN where no lash closes.
    delay : float
        s, by which readings look back at most as the model stands; 0 where nothing can be delayed.
    speeds : tuple of int
        For every state that is an angle, which one is its speed; −1 for others.
    """

    title: str
    name: str
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    parameters: tuple[Variable, ...]
    states: tuple[Variable, ...]
    constants: ca.Function
    field: ca.Function
    reading: ca.Function
    pace: ca.Function | None
    contact: float
    delay: float
    speeds: tuple[int, ...]

    @property
    def variables(self) -> tuple[Variable, ...]:
        """All, in the order of their value references, which begin at 1; 0 is the time."""
        return (*self.inputs, *self.outputs, *self.parameters, *self.states)

    @property
    def about(self) -> str:
        """How it steps."""
        return ABOUT if self.pace is None else ABOUT + PACED

    @property
    def steps_per_second(self) -> float:
        """Internal steps a second, at least."""
        return self.parameters[-1].start


def block(
    systems: Sequence[System],
    title: str,
    name: str,
    notes: Mapping[str, str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> Block:
    """Put systems that share no name side by side.

    Parameters
    ----------
    systems : sequence of System
    title, name : str
    notes : mapping, optional
        What to say of a variable, by name, after what it is.
    bounds : mapping, optional
        Between what parameters will be set, SI, where they have no range of their own: the steps suffice for all of it.

    Raises
    ------
    InputError
        If a name is taken twice, or a model needs too many steps.
    """
    notes = notes or {}
    models = [compiled(system) for system in systems]
    parameters = {parameter.name: parameter for model in models for parameter in parameter_variables(model)}
    steps = max(steps_per_second(model, _extremes(model, bounds or {})) for model in models)
    parameters[STEPS] = Variable(
        STEPS, "parameter", "1/s", steps, "least number of internal steps a second", 0.0, nonzero=True
    )
    inputs, outputs, states = (
        [variable for model in models for variable in of(model)]
        for of in (input_variables, output_variables, state_variables)
    )
    groups = inputs, outputs, list(parameters.values()), states
    _distinct([variable.name for group in groups for variable in group])
    noted = [tuple(_noted(variable, notes) for variable in group) for group in groups]
    stacked = _functions(models, list(parameters))
    return Block(
        title, name, noted[0], noted[1], noted[2], noted[3], *stacked, _contact(models), _delay(models), _speeds(models)
    )


def _noted(variable: Variable, notes: Mapping[str, str]) -> Variable:
    if variable.name not in notes:
        return variable
    return replace(variable, description=f"{variable.description}; {notes[variable.name]}")


def _delay(models: list[Model]) -> float:
    """Longest delays of an input and a reading together; a little even where they are 0 now but can be set."""
    longest = 0.0
    for model in models:
        assembly = model.equations.assembly
        delays = [path.delay for path in assembly.inputs.values()] + [path.delay for path in assembly.sensors.values()]
        if any(delay != 0 for delay in delays):
            parts = [np.array(part).max(initial=0.0) for part in model.delays(model.p0)]
            longest = max(longest, 1e-3, float(sum(parts)))
    return longest


def _speeds(models: list[Model]) -> tuple[int, ...]:
    speeds: list[int] = []
    for model in models:
        first = len(speeds) + model.n
        speeds += [*range(first, first + model.n), *([-1] * (len(model.states) - model.n))]
    return tuple(speeds)


def _extremes(model: Model, bounds: Mapping[str, tuple[float, float]]) -> np.ndarray:
    """The values, and with every quantity that has bounds at the end that makes the model fast: (b, p)."""
    p = np.stack([model.p0, model.p0])
    for i, name in enumerate(model.parameters):
        quantity = model.system.parameters.get(name)
        known = (None, None) if quantity is None else (quantity.lower, quantity.upper)
        low, high = bounds.get(name, known)
        if low is not None and high is not None:
            p[1, i] = low if name.endswith(".J") else high
    return p


def _distinct(names: list[str]) -> None:
    taken = [name for name, count in Counter(["time", *names]).items() if count > 1]
    if taken:
        raise InputError(taken[0], "the name would stand twice among the variables of the FMU", "rename one of the two")


def _contact(models: list[Model]) -> float:
    return SIMULATION_DEFAULTS[CONTACT_TIME] if any(CONTACT_TIME in model.parameters for model in models) else math.nan


def _functions(
    models: list[Model], names: list[str]
) -> tuple[ca.Function, ca.Function, ca.Function, ca.Function | None]:
    """The functions of all models, stacked."""
    made = [functions(model) for model in models]
    p, contact, t = ca.SX.sym("p", len(names)), ca.SX.sym("contact"), ca.SX.sym("t")
    constants, delays = [], []
    for model, function in zip(models, made, strict=True):
        mine = ca.vertcat(*(contact if name == CONTACT_TIME else p[names.index(name)] for name in model.parameters))
        constants.append(function.constants(mine))
        delays.append(model.delays(mine))
    delay = ca.vertcat(*(delay[0] for delay in delays), *(delay[1] for delay in delays))
    x, u, c = (_stacked(what, [functions.field.size1_in(i) for functions in made]) for i, what in enumerate("xuc"))
    acting = [_carried(model, part) for model, part in zip(models, u, strict=True)]
    rates = [functions.field(*z) for functions, z in zip(made, zip(x, acting, c, strict=True), strict=True)]
    values = [functions.reading(*z, t) for functions, z in zip(made, zip(x, acting, c, strict=True), strict=True)]
    xs, us, cs = (ca.vertcat(*part) for part in (x, u, c))
    seconds = ca.SX.sym("seconds")
    paces = [
        each for model, of_model, rate in zip(models, x, rates, strict=True)
        for each in steps_of_clutches(model, of_model, rate, seconds)
    ]  # fmt: skip
    pace = ca.Function("pace", [xs, us, cs, seconds], [ca.cse(ca.mmax(ca.vertcat(*paces)))]) if paces else None
    return (
        ca.Function("constants", [p, contact], [ca.densify(ca.vertcat(*constants)), ca.densify(delay)]),
        ca.Function("field", [xs, us, cs], [ca.densify(ca.vertcat(*rates))]),
        ca.Function("reading", [xs, us, cs, t], [ca.densify(ca.vertcat(*values))]), pace,
    )  # fmt: skip


def _carried(model: Model, u: ca.SX) -> ca.SX:
    """Inputs (u,) where noise below 0 of what a clutch can carry is 0: a negative torque would drive."""
    capacities = model.system.capacities
    return ca.vertcat(*(ca.fmax(u[i], 0.0) if name in capacities else u[i] for i, name in enumerate(model.inputs)))


def _stacked(name: str, sizes: list[int]) -> list[ca.SX]:
    return [ca.SX.sym(f"{name}{i}", size) for i, size in enumerate(sizes)]


# --- The binary of an FMU, where there is a C compiler.

# no -march: a binary runs on every machine of the platform; no contraction: the same figures everywhere
FLAGS = (
    "-O2", "-std=c11", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-fno-math-errno", "-w",
)  # fmt: skip
SUFFIX = {"linux": "so", "darwin": "dylib", "windows": "dll"}


def folder(fmi: str) -> str:
    """Name of this platform in the folder ``binaries`` of an FMU."""
    system = platform.system().lower()
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    if fmi == "2.0" and machine == "x86_64":
        return {"linux": "linux64", "darwin": "darwin64", "windows": "win64"}.get(system, f"{machine}-{system}")
    return f"{machine}-{system}"


def binary(files: Mapping[str, str], source: str) -> bytes | None:
    """The shared library of C files by name, of which ``source`` includes the others; None without a compiler.

    Raises
    ------
    InputError
        If there is a compiler that does not work.
    RuntimeError
        If a compiler that works does not compile the sources.
    """
    cc = compiler()
    if cc is None:
        return None
    check(cc)
    try:
        return compile_library(cc, FLAGS, files, source)
    except CompilerFault as fault:
        raise RuntimeError(f"the sources of the FMU do not compile: {fault}") from None


# --- Units of an FMU as powers of SI base units.

BASE = {
    "kilogram": "kg", "meter": "m", "second": "s", "ampere": "A",
    "kelvin": "K", "mole": "mol", "candela": "cd", "radian": "rad",
}  # fmt: skip


def exponents(unit: str) -> dict[str, int]:
    """Powers of the base units in a coherent SI unit, as FMI names them: ``N*m/rad`` → kg 1, m 2, s −2, rad −1.

    Raises
    ------
    InputError
        If it is no coherent SI unit.
    """
    units = registry()
    factor, base = units.get_base_units(units.parse_units("dimensionless" if unit == "1" else unit))
    powers = dict(base._units)
    if abs(factor - 1) > 1e-12 or not set(powers) <= set(BASE) or any(power % 1 for power in powers.values()):
        raise InputError("", f"{unit!r} is no coherent SI unit", "the unit of a variable of an FMU is needed")
    return {BASE[name]: int(powers[name]) for name in BASE if name in powers}


# --- ``modelDescription.xml`` of FMI 2.0 and 3.0.

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


# --- C sources of an FMU: the functions by CasADi, sizes and names, and the files of ``sources/`` round them.

FILES = {"2.0": "fmi2.c", "3.0": "fmi3.c"}  # the file to be compiled; it includes the others


LOOK_BACK = 4  # times the steps that the delays hold: parameters may grow, communication steps be short


def sources(block: Block, identifier: str, fmi: str, token: str) -> dict[str, str]:
    """C files by name; ``token`` is the GUID or instantiation token."""
    return interface(fmi, "motion.c") | {"model.c": _generated(block), "model.h": _header(block, identifier, token)}


def interface(fmi: str, motion: str) -> dict[str, str]:
    """The fixed C files of an FMU by name: FMI, what every slave has, and a motion, which is called ``motion.c``."""
    here = Path(__file__).with_name("sources")
    files = {"motion.c": motion, **{name: name for name in ("slave.h", "slave.c", FILES[fmi])}}
    return {name: (here / file).read_text(encoding="utf-8") for name, file in files.items()}


def _generated(block: Block) -> str:
    generator = ca.CodeGenerator("model", {"with_header": False})
    for function in _of(block):
        generator.add(function)
    return generator.dump()


def _of(block: Block) -> list[ca.Function]:
    """The functions of an FMU."""
    return [block.constants, block.field, block.reading, *([] if block.pace is None else [block.pace])]


def variable_table(
    title: str, defines: Mapping[str, str], variables: Sequence[Variable], parameters: Sequence[Variable]
) -> list[str]:
    """Lines of ``model.h``: definitions, then names and start values in the order of the value references."""
    time = Variable("time", "independent", "s")
    lines = [f"/* {c_comment(title)}: sizes, names and start values, in the order of the value references */"]
    lines += [f"#define {name} {value}" for name, value in defines.items()]
    lines += _array("char *const NAME", (c_string(variable.name) for variable in (time, *variables)))
    lines += _array("double START", (_real(variable.start) for variable in (time, *variables)))
    lines += _array("double LOWER", (_real(parameter.lower) for parameter in parameters))
    return lines + _array("double UPPER", (_real(parameter.upper) for parameter in parameters))


def _header(block: Block, identifier: str, token: str) -> str:
    functions = _of(block)
    steps = block.steps_per_second if block.pace is None else max(block.steps_per_second, PACED_STEPS)
    sizes = {
        "N_INPUTS": len(block.inputs),
        "N_OUTPUTS": len(block.outputs),
        "N_PARAMETERS": len(block.parameters),
        "N_STATES": len(block.states),
        "N_CONSTANTS": block.field.size1_in(2),
        "N_ARG": max(function.sz_arg() for function in functions),
        "N_RES": max(function.sz_res() for function in functions),
        "N_W": max(function.sz_w() for function in functions) + 1,  # C knows no empty array
        "N_IW": max(function.sz_iw() for function in functions) + 1,
        "N_TAKEN": math.ceil(LOOK_BACK * block.delay * steps) + 8 if block.delay else 0,
        "HAS_CONTACT": int(not math.isnan(block.contact)),
        "HAS_PACE": int(block.pace is not None),
    }
    defines = {"IDENTIFIER": c_string(identifier), "TOKEN": c_string(token)}
    defines |= {name: str(value) for name, value in sizes.items()}
    defines["SECTION"] = repr(SECTION)
    defines["CONTACT"] = repr(0.0 if math.isnan(block.contact) else block.contact)
    lines = variable_table(block.title, defines, block.variables, block.parameters)
    lines += _array("int SPEED", (str(speed) for speed in block.speeds))
    lines += _array("int NOT_ZERO", (str(int(parameter.nonzero)) for parameter in block.parameters))
    return "\n".join(lines) + "\n"


def _array(what: str, entries: Iterable[str]) -> list[str]:
    return [f"static const {what}[] = {{", *(f"    {entry}," for entry in entries), "};"]


def _real(value: float) -> str:
    if math.isinf(value):
        return "HUGE_VAL" if value > 0 else "-HUGE_VAL"
    return repr(float(value))


# --- Export

LICENCE = """The files motion.c, slave.c, slave.h and fmi2.c or fmi3.c are part of rigmatch, MIT licence. model.c was
written by CasADi's code generator from the model whose values model.h holds.
"""


@dataclass(frozen=True)
class Fmu:
    """An FMU: its bytes, GUID, identifier, and the platform its binary is for: None where there is no C compiler."""

    content: bytes
    token: str
    identifier: str
    platform: str | None


def fmu(block: Block, fmi: str = "2.0", step: float = 1e-3) -> Fmu:
    """Write a block as an FMU for co-simulation.

    Parameters
    ----------
    block : Block
    fmi : str
        ``"2.0"`` or ``"3.0"``.
    step : float
        s, communication step to suggest.

    Raises
    ------
    InputError
        If there is a C compiler that does not work.
    RuntimeError
        If a compiler that works does not compile the sources.
    """
    clean = replace(block, title=xml(block.title))
    page = page_of("index.html", block=clean, fmi=fmi)
    return package(clean, fmi, step, page, lambda identifier, token: sources(clean, identifier, fmi, token))


def package(contents: Contents, fmi: str, step: float, page: str, code_of: Callable[[str, str], dict[str, str]]) -> Fmu:
    """An FMU of any contents.

    Parameters
    ----------
    contents : Contents
        With a title that XML can hold.
    fmi : str
        As in :func:`fmu`.
    step : float
        s, communication step to suggest.
    page : str
        HTML of the documentation.
    code_of : callable
        (identifier, token) → C files by name.
    """
    identifier = c_identifier(contents.name)
    token = _token(description(contents, identifier, fmi, "", step, ""), code_of(identifier, ""))
    code = code_of(identifier, token)
    files: dict[str, bytes] = {
        "modelDescription.xml": description(contents, identifier, fmi, token, step, FILES[fmi]).encode(),
        "documentation/index.html": page.encode(),
        "documentation/licenses/license.txt": LICENCE.encode(),
    }
    made = binary(code, FILES[fmi])
    if made is not None:
        files[f"binaries/{folder(fmi)}/{identifier}.{SUFFIX.get(platform.system().lower(), 'so')}"] = made
    files |= {f"sources/{name}": text.encode() for name, text in code.items()}
    if fmi == "3.0":
        files["sources/buildDescription.xml"] = _build_description(identifier).encode()
    return Fmu(_archive(files), token, identifier, folder(fmi) if made is not None else None)


def _token(described: str, code: dict[str, str]) -> str:
    """A GUID that follows from all that is in the FMU but its binary."""
    digest = hashlib.sha256("\0".join([described, *code.values()]).encode()).hexdigest()
    return "{" + "-".join((digest[:8], digest[8:12], digest[12:16], digest[16:20], digest[20:32])) + "}"


def page_of(template: str, **values: object) -> str:
    """HTML of the documentation from a template of ``sources/``."""
    made = Environment(
        loader=PackageLoader("modelling.fmu.export", "sources"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    return made.get_template(template).render(**values) + "\n"


def _build_description(identifier: str) -> str:
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{identifier}">
    <SourceFileSet language="C99">
      <SourceFile name="{FILES["3.0"]}"/>
    </SourceFileSet>
  </BuildConfiguration>
</fmiBuildDescription>
"""


def _archive(files: dict[str, bytes]) -> bytes:
    """A ZIP archive without a trace of when and where it was made."""
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.compress_type, entry.create_system, entry.external_attr = zipfile.ZIP_DEFLATED, 3, 0o644 << 16
            archive.writestr(entry, files[name])
    return target.getvalue()


# --- A controller as an FMU: the C sources that run on a bed, with the interface of FMI round them.

SMALLEST_GAIN = 0.1  # of a dynamometer's torque: a smaller one is no calibration but a mistake
MOST_SAMPLES = 1e6  # of a watchdog
CONTROLLER_ABOUT = (
    "The controller of a powertrain test bed. All values in SI. A communication step is a whole number of samples; the "
    "controller runs at its beginning, so step it before the bed."
)


@dataclass(frozen=True)
class ControllerContents:
    """What the FMU of a controller says of itself."""

    title: str
    name: str
    about: str
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    parameters: tuple[Variable, ...]

    @property
    def variables(self) -> tuple[Variable, ...]:
        """In the order of their value references, which begin at 1."""
        return (*self.inputs, *self.outputs, *self.parameters)


def contents(controller: ExportedController, name: str = "controller") -> ControllerContents:
    """Variables in the order of ``sources/controller_motion.c``."""
    law = controller.law
    readings = [
        Variable(sensor, "input", unit, 0.0, "reading of the bed")
        for sensor, unit in zip(law.sensors, controller.units, strict=True)
    ]
    own = own_vehicle(law)
    clutches = () if own is None else own.inputs[len(own.inputs) - len(own.slip) :]
    known = [
        Variable(name, "input", "1", 0.0, "pedal, 0 to 1") if name in controller.pedals
        else Variable(name, "input", "N*m", 0.0, "what this clutch of the emulated vehicle can carry; 0: it is open"
                      if name in clutches else "torque, measured or demanded")
        for name in law.known
    ]  # fmt: skip
    hold = [
        Variable(f"{dynamometer}.hold_speed", "input", "rad/s", 0.0, "speed that speed hold holds")
        for dynamometer in law.dynamometers
    ]
    switches = [
        Variable(
            "mode",
            "input",
            "1",
            0.0,
            "asked for: 0 zero torque, which also ends a fault; 1 speed hold; 2 emulation; 3 check of the channels",
        ),
        Variable("life", "input", "1", 0.0, "changes from sample to sample as long as the sender lives"),
    ]
    added = [
        Variable(
            f"{dynamometer}.added_torque", "input", "N*m", 0.0,
            "torque that speed hold and emulation add, and that the check of the channels commands alone",
        )
        for dynamometer in law.dynamometers
    ]  # fmt: skip
    if len(controller.learned):
        meaning = "from 0 to 1: the manoeuvre begins, and what was learned of it is played"
        added.append(Variable("trigger", "input", "1", 0.0, meaning))
    if controller.may_shift:
        meaning = "1 while the specimen shifts or a clutch of it may open: a torque that is gone is no broken shaft"
        added.append(Variable("shifting", "input", "1", 0.0, meaning))
    road, emulated = _vehicle(law)
    numbered = ", ".join(f"{number} {sensor}" for number, sensor in enumerate(law.sensors, 1))
    outputs = [
        Variable(f"{dynamometer}.command", "output", "N*m", 0.0, "torque command for this sample")
        for dynamometer in law.dynamometers
    ]
    outputs += [
        Variable("active_mode", "output", "1", 0.0, "0 zero torque, 1 speed hold, 2 emulation, 3 channel check"),
        Variable(
            "fault", "output", "1", 0.0,
            "0 none, 1 not finite, 2 missing, 3 frozen, 4 overspeed, 5 torque gone, 6 unexpected, 7 not delivered",
        ),
        Variable("fault_sensor", "output", "1", 0.0, f"that led to it: 0 none; {numbered}"),
        Variable("missed_samples", "output", "1", 0.0, "of this emulation that did not run, by the sign of life"),
    ]  # fmt: skip
    return ControllerContents(
        xml(controller.title), name, CONTROLLER_ABOUT, (*readings, *known, *hold, *switches, *added, *road),
        (*outputs, *emulated, *_tracked(law)), tuple(_settings(controller)),
    )  # fmt: skip


def _tracked(law: Law) -> list[Variable]:
    """What is tracked of each dynamometer: value and standard uncertainty, and what has drifted beyond its limit."""
    tracked = (
        ("tracked_gain", "1", 1.0, "air-gap torque over command, 1 as calibrated; tracked in emulation"),
        ("tracked_zero", "N*m", 0.0, "zero of the flange, friction of the rotor included; tracked in emulation"),
        ("tracked_delay", "s", 0.0, "dead time and lags less the planned ones; tracked in emulation"),
    )
    outputs = []
    for name in law.dynamometers:
        for key, unit, start, meaning in tracked:
            outputs.append(Variable(f"{name}.{key}", "output", unit, start, meaning))
            outputs.append(Variable(f"{name}.{key}_uncertainty", "output", unit, 0.0, "its standard uncertainty"))
        meaning = "warning, no fault: 0 nothing; sum of 1 torque gain, 2 zero of the flange, 4 dead time"
        outputs.append(Variable(f"{name}.drifted", "output", "1", 0.0, meaning))
    return outputs


def _vehicle(law: Law) -> tuple[list[Variable], list[Variable]]:
    """What the emulated vehicle is told while it drives, and what it does; nothing of a law without one."""
    if isinstance(law, ForeignVehicleLaw):
        speed, torque = "of the vehicle at this cut, newest step", "into the vehicle at this cut, for its next step"
        return (
            [Variable(f"cut.{name}.speed", "input", "rad/s", 0.0, speed) for name in law.dynamometers],
            [Variable(f"cut.{name}.torque", "output", "N*m", 0.0, torque) for name in law.dynamometers],
        )
    own = own_vehicle(law)
    if own is None:
        return [], []
    tyres = own.tyres
    road = [
        *(Variable(f"{tyre}.friction", "input", "1", 1.0, "of the tyre's road over the planned one") for tyre in tyres),
        Variable("vehicle.mass", "input", "1", 1.0, "of the emulated vehicle's bodies over the planned one"),
        Variable("vehicle.grade", "input", "1", 0.0, "rise of the road over its length on the map"),
    ]
    return road, [Variable(name, "output", unit, 0.0, meaning) for name, unit, meaning in shown_of(law)]


def _settings(controller: ExportedController) -> list[Variable]:
    """Parameters in the order of ``take_settings`` in ``sources/controller_motion.c``."""
    law, settings = controller.law, controller.settings
    parameters = []
    for j, dynamometer in enumerate(law.dynamometers):
        for key, unit, meaning in (
            ("torque_limit", "N*m", "air-gap torques stay within ± this"),
            ("speed_limit", "rad/s", "beyond it is overspeed"),
            ("hold_proportional", "N*m*s/rad", "of the speed hold"),
            ("hold_integral", "N*m/rad", "of the speed hold"),
            ("lost_torque", "N*m", "a flange torque above it that is gone at once is a fault"),
            ("torque_gain", "1", "air-gap torque over command as calibrated: commands are divided by it"),
            ("power_limit", "W", "torque times speed stays within ± this"),
            ("check_torque", "N*m", "commands of the check of the channels stay within ± this"),
            ("check_speed", "rad/s", "beyond it is overspeed while the channels are checked"),
        ):
            value = float(getattr(settings, key)[j])
            least = SMALLEST_GAIN if key == "torque_gain" else 0.0
            parameters.append(Variable(f"{dynamometer}.{key}", "parameter", unit, value, meaning, least))
    for sensor, unit, value in zip(law.sensors, controller.units, settings.unexpected, strict=True):
        meaning = "how far the reading may be from what the controller's model expects"
        parameters.append(Variable(f"{sensor}.unexpected", "parameter", unit, float(value), meaning, 0.0))
    watched = zip(controller.watched.shafts, settings.opened_torque, strict=True)
    for shaft, value in watched:
        meaning = "torque in the shaft above which its opening is noticed within five samples and is a fault"
        parameters.append(Variable(f"{shaft}.opened_torque", "parameter", "N*m", float(value), meaning, 0.0))
    if controller.watched.shafts:
        meaning = "part of the torque that it carried that an opened shaft seems to lose at least"
        parameters.append(Variable("opened_share", "parameter", "1", settings.opened_share, meaning, 0.0, 1.0))
    meaning = "part of the commanded torque that may be missing, or too much, before it is a fault; 0: no check"
    parameters.append(Variable("undelivered_share", "parameter", "1", settings.undelivered_share, meaning, 0.0, 1.0))
    for key, meaning in (
        ("frozen_samples", "samples with the same readings on a turning bed that are a fault; 0: no check"),
        ("life_samples", "samples without a change of life that are a fault; 0: no check"),
        ("ride_samples", "samples that emulation goes on without a reading that is refused; 0: none is refused"),
    ):
        parameters.append(Variable(key, "parameter", "1", float(getattr(settings, key)), meaning, 0.0, MOST_SAMPLES))
    return parameters


def controller_fmu(controller: ExportedController, fmi: str = "2.0") -> Fmu:
    """Write a controller as an FMU for co-simulation.

    Parameters
    ----------
    controller : ExportedController
    fmi : str
        ``"2.0"`` or ``"3.0"``.
    """
    inside = contents(controller)
    page = page_of(
        "controller.html", contents=inside, sample_time=controller.law.sample_time, bytes=memory_bytes(controller),
        states=controller.law.states,
    )  # fmt: skip
    return package(
        inside,
        fmi,
        controller.law.sample_time,
        page,
        lambda identifier, token: _code(controller, inside, fmi, identifier, token),
    )


def _code(
    controller: ExportedController, inside: ControllerContents, fmi: str, identifier: str, token: str
) -> dict[str, str]:
    defines = {
        "IDENTIFIER": c_string(identifier),
        "TOKEN": c_string(token),
        "N_INPUTS": str(len(inside.inputs)),
        "N_OUTPUTS": str(len(inside.outputs)),
        "N_PARAMETERS": str(len(inside.parameters)),
        "MAY_SHIFT": str(int(controller.may_shift)),
    }
    table = variable_table(inside.title, defines, inside.variables, inside.parameters)
    return {
        **c_sources(controller),
        **interface(fmi, "controller_motion.c"),
        "model.h": "\n".join(table) + "\n",
    }
