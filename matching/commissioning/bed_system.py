"""The bed without emulation as a model file's system, with a range on all that the case's box leaves open."""

from __future__ import annotations

from dataclasses import replace

from matching.commissioning.ranges import around, with_quantities
from matching.commissioning.sensor_faults import as_recorded
from matching.frequency.case.case import Case
from matching.frequency.case.uncertainty import Uncertain
from modelling.effects.all_pass import AllPass
from modelling.effects.dead_time import DeadTime
from modelling.effects.input_gain import InputGain
from modelling.effects.lag import Lag
from modelling.effects.place import shared_place
from modelling.effects.sensor_delay import SensorDelay
from modelling.model.components import Effect
from modelling.model.quantity import Quantity
from modelling.model.system import System


def names_in_system(case: Case) -> dict[str, str]:
    """Name in :func:`bed_system` of each uncertain quantity that a recording can tell, by its name in the box."""
    loop = case.loop
    commands = _commands(case)
    names = {}
    for quantity in case.uncertainty.uncertain:
        if quantity.name.startswith("rig."):
            names[quantity.name] = _as_recorded(quantity.name.removeprefix("rig."))
    names["loop.dead_time"] = f"{commands}.{DeadTime.kind}.delay"
    names["loop.torque_sensor_lag"] = f"{_torques(case)}.{Lag.kind}.time_constant"
    names["loop.inverter_lag"] = f"{commands}.{Lag.kind}.time_constant"
    for dynamometer in loop.dynamometers:
        names[f"dynamometers.{dynamometer.name}.torque_gain"] = (
            f"inputs.{dynamometer.torque_input}.{InputGain.kind}.factor"
        )
    return names


def bed_system(case: Case) -> System:
    """The rig with the dynamometers' dead time, lag and gain, and the lag of their torque sensors, as effects.

    Its inputs are torque commands as recorded, linear between samples: the half sample of hold that the loop's dead
    time counts is none of the delay here. Gains of sensors are taken as known; the box counts them after the fit.
    """
    box = {quantity.name: quantity for quantity in case.uncertainty.uncertain}
    loop = case.loop
    of_rig = {
        name.removeprefix("rig."): around(quantity.value, quantity.half_width)
        for name, quantity in box.items() if name.startswith("rig.")
    }  # fmt: skip
    commands, torques = _commands(case), _torques(case)
    delay, hold = box.get("loop.dead_time"), loop["dead_time"] - loop.command_delay()
    effects = [
        Effect(DeadTime.kind, commands, (("delay", _shifted(delay, loop["dead_time"], hold)),)),
        Effect(Lag.kind, commands, (("time_constant", _of(box, "loop.inverter_lag", loop["inverter_lag"])),)),
        Effect(Lag.kind, torques, (("time_constant", _of(box, "loop.torque_sensor_lag", loop["torque_sensor_lag"])),)),
    ]
    for dynamometer in loop.dynamometers:
        gain = _of(box, f"dynamometers.{dynamometer.name}.torque_gain", dynamometer.torque_gain)
        effects.append(Effect(InputGain.kind, f"inputs.{dynamometer.torque_input}", (("factor", gain),)))
    return _with_ranges(case.rig, of_rig).with_effects(*effects)


def _commands(case: Case) -> str:
    return shared_place(f"inputs.{dynamometer.torque_input}" for dynamometer in case.loop.dynamometers)


def _torques(case: Case) -> str:
    return shared_place(f"sensors.{dynamometer.torque_sensor}" for dynamometer in case.loop.dynamometers)


def _of(box: dict[str, Uncertain], name: str, value: float) -> Quantity:
    return around(value, box[name].half_width) if name in box else Quantity(value)


def _shifted(delay: Uncertain | None, value: float, hold: float) -> Quantity:
    return Quantity(value - hold) if delay is None else around(value - hold, delay.half_width)


def _as_recorded(name: str) -> str:
    """Name of a rig's quantity in the system that recordings are fitted with."""
    return name.replace(f".{AllPass.kind}.", f".{SensorDelay.kind}.")


def _with_ranges(rig: System, ranges: dict[str, Quantity]) -> System:
    """The rig with ranges on some of its quantities, by name, and on no other; late sensors as recordings have them."""
    of_effects = {f"{effect.name}.{key}" for effect in rig.effects for key, _ in effect.parameters}
    fixed = {name: Quantity(quantity.value) for name, quantity in rig.parameters.items() if name not in of_effects}
    rig = with_quantities(rig, fixed | ranges)
    return replace(rig, effects=tuple(as_recorded(effect) for effect in rig.effects), operating_point=None)
