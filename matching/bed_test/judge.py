"""Measured responses of the controlled bed beside the vehicle and the prediction of the match."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from matching.bed_test.errors import Figures, judged
from matching.bed_test.fidelity import recorded_fidelity
from matching.bed_test.local_rational import MeasuredResponse, Spectra, lines_needed, response, spectra
from matching.bed_test.modes import MeasuredMode, measured_mode
from matching.bed_test.prediction import drawn_squares, drawn_vehicles, largest_expected
from matching.bed_test.recorded import BedRecordings
from matching.bed_test.result import (
    COVERAGE_FACTOR,
    BedVerification,
    FunctionCurves,
    ModeJudgement,
)
from matching.frequency.case.case import Case
from matching.frequency.loop.parts import parts_of
from matching.frequency.response.observed import ObservedBed
from matching.frequency.response.responses import ComparedBed
from modelling.bed.residual_vehicle import cut
from modelling.common.errors import InputError
from modelling.modal.modes import modes

FINEST = 0.01  # relative distance of neighbouring frequencies
BEYOND_BAND = 1.3  # spectra reach so far, for the windows at its upper end
FIT_VARIANCE = 1e-8  # relative, of responses that are computed


def judge(case: Case, recorded: BedRecordings) -> BedVerification:
    """Judge recordings of the bed of a tuned case.

    Raises
    ------
    InputError
        If a recording is too short for its inputs, or a model cannot be made linear.
    """
    grid, recordings = _frequencies(recorded, case.band), _spectra(recorded, case.band)
    measured = response(recordings, grid)
    bed = compared_bed(case)
    answers = bed.at(grid)
    pairs = [
        (h, source, sensor)
        for h, (source, sensor) in enumerate(answers.pairs)
        if source in recorded.inputs and sensor in recorded.sensors
    ]
    places = [(h, *_place(recorded, source, sensor)) for h, source, sensor in pairs]
    again = _predicted_again(recordings, bed, places, grid)
    units = {part.name: part.unit for part in case.rig.sensors}
    functions, vehicles = [], drawn_vehicles(case, grid)
    for (h, source, sensor), (_, y, u) in zip(pairs, places, strict=True):
        values, variances = measured.values[:, y, u], measured.variances[:, y, u]
        known = bool(bed.measured[h]) or (isinstance(bed, ObservedBed) and source in bed.controller.known)
        figures = Figures.of(
            values, variances, answers.vehicle[:, h], answers.matched[:, h], measured, vehicles[:, :, h]
        )
        repeated = Figures.of(
            again.values[:, y, u], np.zeros(len(grid)), answers.vehicle[:, h], answers.matched[:, h], again
        )
        figures = replace(figures, resolution=repeated.square - repeated.predicted)
        curves = FunctionCurves(
            source, sensor, units[sensor], grid, values, np.sqrt(variances / 2), answers.vehicle[:, h],
            answers.matched[:, h],
        )  # fmt: skip
        functions.append(_Function("measured" if known else "unmeasured", h, figures, curves))
    allowed = {"measured": case.tolerance, "unmeasured": case.unmeasured_tolerance}
    drawn = drawn_squares(case)
    errors = []
    for kind in dict.fromkeys(function.kind for function in functions):
        alike = [function for function in functions if function.kind == kind]
        shown = [function for function in alike if function.figures.known] or alike
        expected = largest_expected(drawn[:, [function.number for function in shown]])
        errors.append(judged(kind, [function.figures for function in alike], expected, allowed[kind]))
    each = [
        judged(
            function.name, [function.figures], largest_expected(drawn[:, [function.number]]), allowed[function.kind]
        )
        for function in functions
    ]  # fmt: skip
    mode_checks = _modes(case, recordings, bed, places)
    fidelity = tuple(recorded_fidelity(case, recorded, recording) for recording in recorded.recordings)
    states = [*(checked.status for checked in errors), *(checked.status for checked in mode_checks)]
    return BedVerification(
        case.title, _together(states), case.band, tuple(errors), tuple(each), tuple(mode_checks), fidelity,
        tuple(function.curves for function in functions), (*recorded.notes, *_hidden(functions)),
    )  # fmt: skip


@dataclass(frozen=True)
class _Function:
    """A compared function: whether its torque is measured or unmeasured, its number, figures, and curves."""

    kind: str
    number: int
    figures: Figures
    curves: FunctionCurves

    @property
    def name(self) -> str:
        return f"{self.curves.input} → {self.curves.sensor}"


def _hidden(functions: Sequence[_Function]) -> list[str]:
    """Sentences on what the recordings do not show."""
    return [
        f"{function.name} is left out of the answer: it shows in {1 - function.figures.unknown:.0%} of the band only, "
        "the rest lies below the noise"
        for function in functions
        if not function.figures.known
    ]


def compared_bed(case: Case) -> ComparedBed:
    """The prediction: an observer is a law of its own, from sample to sample."""
    observer = case.loop.structure.observer(case.rig, cut(case.emulated_vehicle, case.rig), case.loop)
    return ComparedBed(case) if observer is None else ObservedBed(case, parts_of(case), observer)


def _place(recorded: BedRecordings, source: str, sensor: str) -> tuple[int, int]:
    return recorded.sensors.index(sensor), recorded.inputs.index(source)


def _together(states: Sequence[str]) -> str:
    """Short if anything is short, else undetermined if anything is."""
    return next((status for status in ("short", "undetermined") if status in states), "as_predicted")


def _frequencies(recorded: BedRecordings, band: tuple[float, float]) -> np.ndarray:
    """Frequencies (f,), Hz, over the band: as fine as half the windows that the longest recording allows."""
    longest = max(float(np.ptp(recording.time)) for recording in recorded.recordings)
    width = lines_needed(len(recorded.inputs), len(recorded.recordings)) / longest
    grid = [band[0]]
    while grid[-1] < band[1]:
        grid.append(grid[-1] + max(FINEST * grid[-1], width / 4))
    return np.array([*grid[:-1], band[1]])


def _spectra(recorded: BedRecordings, band: tuple[float, float]) -> list[Spectra]:
    """Spectra of every recording, long enough for one window of :func:`response`."""
    of_recordings = []
    for recording in recorded.recordings:
        step = float(np.mean(np.diff(recording.time)))
        of_recordings.append(spectra(*recorded.signals(recording), step, BEYOND_BAND * band[1]))
    lines = lines_needed(len(recorded.inputs), len(of_recordings))
    for recording, spectrum in zip(recorded.recordings, of_recordings, strict=True):
        if len(spectrum.frequencies) < lines:
            raise InputError(
                recording.source, f"is too short for so many inputs: {lines} lines are needed", "record longer"
            )
    return of_recordings


def _predicted_again(
    recordings: Sequence[Spectra], bed: ComparedBed, places: Sequence[tuple[int, int, int]], grid: np.ndarray
) -> MeasuredResponse:
    """The predicted responses as the recordings would show them without noise: what they cannot resolve is missing."""
    predicted = []
    for recording in recordings:
        matched = bed.at(recording.frequencies).matched
        outputs = np.zeros_like(recording.outputs)
        for h, y, u in places:
            outputs[:, y] += matched[:, h] * recording.inputs[:, u]
        predicted.append(replace(recording, outputs=outputs))
    return response(predicted, grid)


def _modes(
    case: Case, recordings: Sequence[Spectra], bed: ComparedBed, places: Sequence[tuple[int, int, int]]
) -> list[ModeJudgement]:
    """Target modes by one estimator for vehicle, prediction and bed: the same frequencies, the same shape."""
    known, out = modes(case.vehicle), []
    for target in case.targets:
        mode = known[target.mode - 1]
        if not case.band[0] <= mode.frequency <= case.band[1]:
            continue
        fine = np.geomspace(mode.frequency / 1.3, mode.frequency * 1.3, 60)
        answers = bed.at(fine)
        computed = [
            MeasuredResponse(
                fine, values[:, [h for h, *_ in places]][:, :, None],
                FIT_VARIANCE * np.abs(values[:, [h for h, *_ in places]][:, :, None]) ** 2, np.full(len(fine), 1e-9),
            )
            for values in (answers.vehicle, answers.matched)
        ]  # fmt: skip
        vehicle, predicted = (
            measured_mode(computation, mode.frequency, mode.damping_ratio) for computation in computed
        )
        if vehicle is None:
            continue
        start = predicted or vehicle
        local = response(recordings, fine)
        rows = np.array([(y, u) for _, y, u in places])
        picked = MeasuredResponse(
            fine,
            local.values[:, rows[:, 0], rows[:, 1], None],
            local.variances[:, rows[:, 0], rows[:, 1], None],
            local.windows,
        )
        fitted = measured_mode(picked, start.frequency, start.damping_ratio)
        status = _mode_status(fitted, vehicle, predicted, target.frequency_tolerance, target.damping_tolerance)
        out.append(
            ModeJudgement(
                target.mode, (vehicle.frequency, vehicle.damping_ratio),
                None if predicted is None else (predicted.frequency, predicted.damping_ratio), fitted, status,
            )
        )  # fmt: skip
    return out


def _mode_status(
    measured: MeasuredMode | None,
    vehicle: MeasuredMode,
    predicted: MeasuredMode | None,
    relative: float,
    damping: float,
) -> str:
    """Short where a deviation is larger than allowed, and than predicted, beyond its uncertainty."""
    if measured is None:
        return "undetermined"
    promised = vehicle if predicted is None else predicted
    states = []
    for value, u, right, expected, tolerance in (
        (
            measured.frequency, measured.frequency_uncertainty, vehicle.frequency, promised.frequency,
            relative * vehicle.frequency,
        ),
        (measured.damping_ratio, measured.damping_uncertainty, vehicle.damping_ratio, promised.damping_ratio, damping),
    ):  # fmt: skip
        limit = max(tolerance, abs(expected - right))
        off, expanded = abs(value - right), COVERAGE_FACTOR * u
        if off - expanded > limit:
            states.append("short")
        else:
            states.append("as_predicted" if off <= limit and expanded <= limit else "undetermined")
    return _together(states)
