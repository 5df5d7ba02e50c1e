"""C sources of an FMU: the functions by CasADi, sizes and names, and the files of ``sources/`` round them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import casadi as ca

from modelling.common.escape import c_comment, c_string
from modelling.fmu.block import Block
from modelling.fmu.variables import Variable

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
    for function in (block.constants, block.field, block.reading):
        generator.add(function)
    return generator.dump()


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
    functions = (block.constants, block.field, block.reading)
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
        "N_TAKEN": math.ceil(LOOK_BACK * block.delay * block.steps_per_second) + 8 if block.delay else 0,
        "HAS_CONTACT": int(not math.isnan(block.contact)),
    }
    defines = {"IDENTIFIER": c_string(identifier), "TOKEN": c_string(token)}
    defines |= {name: str(value) for name, value in sizes.items()}
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
