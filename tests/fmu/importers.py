"""Tools that import FMUs, each run in a process of its own: python importers.py TOOL FMU RUN.npz OUT.npy.

RUN.npz holds the step (s), names of inputs (i,), their values (t, i), names of outputs (o,), parameters and settings;
OUT.npy gets the outputs (t, o) after each step, which were calculated from the inputs that stood at its beginning.
"""

import sys
import xml.etree.ElementTree as ET
import zipfile

import numpy as np


def libcosim(fmu, run):
    """Open Simulation Platform, FMI 2.0; inputs are overridden before each step, as its scenarios do."""
    from libcosimpy.CosimEnums import CosimErrorCode, CosimExecutionState
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.WARNING)
    references = {name: number for number, name in _variables(fmu).items()}
    execution = CosimExecution.from_step_size(round(float(run["step"]) * 1e9))
    slave = CosimLocalSlave(fmu, "controller")
    number = execution.add_local_slave(slave)
    for name, value in zip(run["parameters"], run["settings"], strict=True):
        assert execution.real_initial_value(number, references[name], value)
    hand, watch = CosimManipulator.create_override(), CosimObserver.create_last_value()
    assert execution.add_manipulator(hand)
    assert execution.add_observer(watch)
    inputs, outputs = ([references[name] for name in run[which]] for which in ("inputs", "outputs"))
    answers = []
    for values in run["values"]:
        assert hand.slave_real_values(number, inputs, list(values))
        assert execution.step(), execution.status()
        answers.append(watch.last_real_values(number, outputs))
    status = execution.status()
    assert status.error_code == CosimErrorCode.SUCCESS.value, status
    assert status.state != CosimExecutionState.ERROR.value, status
    return np.array(answers)


def ecos(fmu, run):
    """Ecos, FMI 2.0 and 3.0."""
    from ecospy import EcosSimulation, EcosSimulationStructure

    structure = EcosSimulationStructure()
    structure.add_model("controller", fmu)
    answers = []
    with EcosSimulation(structure=structure, step_size=float(run["step"])) as simulation:
        assert simulation.init()
        for name, value in zip(run["parameters"], run["settings"], strict=True):
            simulation.set_real(f"controller::{name}", value)
        for values in run["values"]:
            for name, value in zip(run["inputs"], values, strict=True):
                simulation.set_real(f"controller::{name}", value)
            simulation.step()
            answers.append([simulation.get_real(f"controller::{name}") for name in run["outputs"]])
        simulation.terminate()
    return np.array(answers)


def _variables(fmu):
    """Names of an FMI 2.0 FMU's variables by value reference."""
    with zipfile.ZipFile(fmu) as archive:
        description = ET.fromstring(archive.read("modelDescription.xml"))
    return {int(each.get("valueReference")): each.get("name") for each in description.iter("ScalarVariable")}


if __name__ == "__main__":
    tool, fmu, run, out = sys.argv[1:]
    np.save(out, {"libcosim": libcosim, "ecos": ecos}[tool](fmu, np.load(run)))
