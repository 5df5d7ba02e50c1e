"""A controller as an FMU: the C sources that run on a bed, with the interface of FMI round them."""

from __future__ import annotations

from dataclasses import dataclass

from modelling.common.escape import c_string, xml
from modelling.controller.c_source import c_sources, memory_bytes
from modelling.controller.exported import ExportedController
from modelling.fmu.export import Fmu, package, page_of
from modelling.fmu.source import interface, variable_table
from modelling.fmu.variables import Variable

SMALLEST_GAIN = 0.1  # of a dynamometer's torque: a smaller one is no calibration but a mistake
MOST_SAMPLES = 1e6  # of a watchdog
ABOUT = (
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
    known = [Variable(torque, "input", "N*m", 0.0, "torque, measured or demanded") for torque in law.known]
    hold = [
        Variable(f"{dynamometer}.hold_speed", "input", "rad/s", 0.0, "speed that speed hold holds")
        for dynamometer in law.dynamometers
    ]
    switches = [
        Variable(
            "mode", "input", "1", 0.0, "asked for: 0 zero torque, which also ends a fault; 1 speed hold; 2 emulation"
        ),
        Variable("life", "input", "1", 0.0, "changes from sample to sample as long as the sender lives"),
    ]
    outputs = [
        Variable(f"{dynamometer}.command", "output", "N*m", 0.0, "torque command for this sample")
        for dynamometer in law.dynamometers
    ]
    outputs += [
        Variable("active_mode", "output", "1", 0.0, "0 zero torque, 1 speed hold, 2 emulation"),
        Variable(
            "fault", "output", "1", 0.0,
            "0 none, 1 not finite, 2 missing, 3 frozen, 4 overspeed, 5 torque gone, 6 unexpected",
        ),
    ]  # fmt: skip
    return ControllerContents(
        xml(controller.title), name, ABOUT, (*readings, *known, *hold, *switches), tuple(outputs),
        tuple(_settings(controller)),
    )  # fmt: skip


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
    for key, meaning in (
        ("frozen_samples", "samples with the same readings on a turning bed that are a fault; 0: no check"),
        ("life_samples", "samples without a change of life that are a fault; 0: no check"),
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
        states=len(controller.law.A),
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
    }
    table = variable_table(inside.title, defines, inside.variables, inside.parameters)
    return {
        **c_sources(controller),
        **interface(fmi, "controller_motion.c"),
        "model.h": "\n".join(table) + "\n",
    }
