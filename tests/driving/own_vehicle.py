"""The FMU of ``own_vehicle.c``: built by the C compiler and zipped here, nothing of it is rigmatch's."""

import subprocess
import zipfile
from pathlib import Path

from needs import compiler

HERE = Path(__file__).parent
INPUTS, OUTPUTS = ("drive_l", "drive_r", "brake_l", "brake_r", "wrong"), ("spin_l", "spin_r")


def own_fmu(folder: Path, name: str = "car", only_once: bool = False, without_binary: bool = False, **defines) -> Path:
    """Write ``NAME.fmu``; ``defines`` change the car: ``BODY`` and ``SLIP`` of each side, ``MASSLESS`` wheels,
    ``CRASHES`` after so many seconds."""
    folder.mkdir(parents=True, exist_ok=True)
    library = folder / f"{name}.so"
    command = [compiler(), "-O2", "-shared", "-fPIC", *(f"-D{key}={value}" for key, value in defines.items())]
    subprocess.run([*command, str(HERE / "own_vehicle.c"), "-o", str(library), "-lm"], check=True)
    kinds = [*((each, "input") for each in INPUTS), *((each, "output") for each in OUTPUTS)]
    start = {"input": ' start="0"', "output": ""}
    variables = "".join(
        f'<ScalarVariable name="{each}" valueReference="{number}" causality="{kind}" variability="continuous">'
        f"<Real{start[kind]}/></ScalarVariable>"
        for number, (each, kind) in enumerate(kinds)
    )
    outputs = "".join(f'<Unknown index="{len(INPUTS) + 1 + i}"/>' for i in range(len(OUTPUTS)))
    once = ' canBeInstantiatedOnlyOncePerProcess="true"' if only_once else ""
    described = (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="own">'
        f'<CoSimulation modelIdentifier="{name}"{once}/><ModelVariables>{variables}</ModelVariables>'
        f"<ModelStructure><Outputs>{outputs}</Outputs></ModelStructure></fmiModelDescription>"
    )
    path = folder / f"{name}.fmu"
    with zipfile.ZipFile(path, "w") as made:
        made.writestr("modelDescription.xml", described)
        if not without_binary:
            made.write(library, f"binaries/linux64/{name}.so")
    return path
