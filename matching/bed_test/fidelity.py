"""XiL fidelity of a recording of the controlled bed: the vehicle is simulated on the torques that were recorded."""

from __future__ import annotations

import numpy as np
import scipy

from matching.bed_test.prediction import box_values
from matching.bed_test.recorded import BedRecordings
from matching.bed_test.result import COVERAGE_FACTOR, RecordedFidelity
from matching.frequency.case.case import Case
from matching.frequency.case.uncertainty import of_system
from modelling.fidelity.assess import fidelity_of_signals
from modelling.fidelity.distribution import fidelity_distribution
from modelling.fidelity.fidelity import Fidelity, SignalPair
from modelling.fidelity.measures import WEIGHTS
from modelling.linear.state_space import state_space
from modelling.measurement.recording import Recording
from modelling.model.system import System

DRAWS = 2_000
VEHICLES = 8  # drawn evenly
LONGEST_DELAY = 0.25  # s: a delay beyond it counts as none of the fidelity
SAMPLES_A_PERIOD = 8.0  # of the highest frequency that are enough


def recorded_fidelity(case: Case, recorded: BedRecordings, recording: Recording) -> RecordedFidelity:
    """R_SD of the compared sensors, R_MU and R_XiL with its standard uncertainty (Eqs. 14 to 23) of one recording.

    The vehicle starts at rest with the recording's first sample; both lose their mean, for only deviations are
    compared. The weights are those of the domains there are. What is not known of the vehicle enters the uncertainty.
    """
    fidelity = _against(case, case.vehicle, recorded, recording)
    drawn = fidelity_distribution(fidelity, DRAWS).summary()["total"]
    others = [
        _against(case, case.vehicle.with_values(of_system(values, case.vehicle)), recorded, recording).total
        for values in box_values(case.uncertainty.of_kind("vehicle."), VEHICLES)
    ]
    of_vehicle = float(np.sqrt(np.mean((np.array(others) - fidelity.total) ** 2))) if others else 0.0
    below, above = (np.hypot(fidelity.total - end, COVERAGE_FACTOR * of_vehicle) for end in drawn.interval)
    lower, upper = (fidelity.total - below, fidelity.total + above) if others else drawn.interval
    return RecordedFidelity(
        recording.source,
        system_dynamics=fidelity.domains.get("system_dynamics"),
        measurement_uncertainty=fidelity.domains.get("measurement_uncertainty"),
        total=fidelity.total,
        standard_uncertainty=float(np.hypot(drawn.standard_uncertainty, of_vehicle)),
        of_vehicle=of_vehicle,
        interval=(float(lower), float(upper)),
    )


def _against(case: Case, system: System, recorded: BedRecordings, recording: Recording) -> Fidelity:
    """Fidelity of a recording against a vehicle."""
    torques, readings = recorded.signals(recording)
    step = float(np.mean(np.diff(recording.time)))
    vehicle = state_space(system)
    drive = np.zeros((len(torques), len(vehicle.inputs)))
    for j, name in enumerate(recorded.inputs):
        drive[:, vehicle.inputs.index(name)] = torques[:, j] - torques[0, j]
    A, B, C, D, _ = scipy.signal.cont2discrete((vehicle.A, vehicle.B, vehicle.C, vehicle.D), step, "foh")
    answer = scipy.signal.dlsim((A, B, C, D, step), drive)[1]
    every = max(int(1 / (SAMPLES_A_PERIOD * case.band[1] * step)), 1)
    units = {sensor.name: sensor.uncertainty for sensor in case.rig.sensors}
    pairs = {}
    for i, name in enumerate(recorded.sensors):
        reference, test = (trace - trace.mean() for trace in (answer[:, vehicle.outputs.index(name)], readings[:, i]))
        if np.ptp(reference) <= 0:
            continue
        u = units.get(name)
        pairs[name] = SignalPair(reference[::every], test[::every], None if u is None else COVERAGE_FACTOR * u)
    domains = ["system_dynamics"]
    if any(pair.expanded_uncertainty is not None for pair in pairs.values()):
        domains.append("measurement_uncertainty")
    total = sum(WEIGHTS[name] for name in domains)
    time = recording.time[::every] - recording.time[0]
    return fidelity_of_signals(
        np.arange(len(time)) * step * every, pairs, f_max=case.band[1],
        weights={name: WEIGHTS[name] / total for name in domains}, longest_delay=min(LONGEST_DELAY, time[-1] / 4),
    )  # fmt: skip
