"""What a match found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from matching.match.case import Case
from matching.match.driving import Driving
from matching.match.findings import Finding
from matching.match.free_play import OpenLash
from matching.match.in_time import InTime, simulate_deviations
from matching.match.loop import linear_bed
from matching.match.loop_modes import LoopMode
from matching.match.minutes import Minutes
from matching.match.responses import ResponseError, Responses, SimpleVehicle
from matching.match.verify import MatchFidelity, Verification, match_fidelity
from modelling.display import Displayed
from modelling.linear.steady_motion import acting_torques_of, speeds_of
from modelling.modal.result import Mode


@dataclass(frozen=True)
class TargetResult:
    """A target mode in vehicle, rig and matched loop; frequencies in Hz, None where the mode was not found.

    ``identified`` (Hz) and ``identified_damping`` are identified from the simulated manoeuvre, by a separate method.
    """

    vehicle_mode: int
    symmetry: str
    vehicle: float
    vehicle_damping: float
    rig: float | None
    matched: float | None
    matched_damping: float | None
    identified: float | None
    identified_damping: float | None
    met: bool

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "vehicle_mode": self.vehicle_mode, "symmetry": self.symmetry, "vehicle": self.vehicle,
            "vehicle_damping": self.vehicle_damping, "rig": self.rig, "matched": self.matched,
            "matched_damping": self.matched_damping, "seen_in_simulation": self.identified,
            "identified_damping": self.identified_damping, "met": self.met,
        }  # fmt: skip


@dataclass(frozen=True)
class ParameterResult:
    """A quantity that was allowed to move, SI.

    ``share`` of a target mode's energy, ``weight`` on its change, ``fixed`` where the share is too small to move it.
    """

    name: str
    start: float
    tuned: float
    unit: str
    lower: float
    upper: float
    weight: float
    share: float
    fixed: bool
    logarithmic: bool = False
    change_cost: float = 0.0

    @property
    def at_bound(self) -> bool:
        """Whether it ended within a thousandth of its range, or of the range's logarithm, from a bound."""
        if self.logarithmic:
            return min(self.upper / self.tuned, self.tuned / self.lower) <= (self.upper / self.lower) ** 1e-3
        return min(self.tuned - self.lower, self.upper - self.tuned) <= 1e-3 * (self.upper - self.lower)

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        keys = (
            "name", "start", "tuned", "unit", "lower", "upper", "weight", "share", "fixed", "at_bound", "change_cost",
        )  # fmt: skip
        return {key: getattr(self, key) for key in keys}


@dataclass(frozen=True)
class AdapterTrade:
    """One adapter quantity, SI; errors are means over fresh beds of delivered controllers, by which orders are judged.

    The error is the root of the mean square of the errors to measured and to unmeasured torques, each over its
    tolerance.

    Attributes
    ----------
    ordered : float
        As planned where it gains nothing.
    acceptable : tuple of float
        Between these no value is worse by more than 2 % and the scatter, everything else tuned for it.
    error_as_planned : float or None
        With this quantity as planned, the others as ordered, everything else tuned for it.
    error_as_ordered : float
    curve : tuple of (float, float)
        Values tried and the error there, everything else tuned for each; without those that miss a requirement which
        the order keeps.
    error_all_as_planned : float or None
        Of the bed with every adapter as planned, tuned for it; None where that keeps not every requirement.
    rated_torque, twist : float or None
        N·m that a shaft of this stiffness has to carry, and what it twists by then as ordered, rad; None of others.
    reason : str
        Why it is ordered, or why it stays as planned.
    """

    name: str
    unit: str
    planned: float
    ordered: float
    acceptable: tuple[float, float]
    error_as_planned: float | None
    error_as_ordered: float
    curve: tuple[tuple[float, float], ...]
    error_all_as_planned: float | None
    rated_torque: float | None = None
    twist: float | None = None
    reason: str = ""

    @property
    def changes(self) -> bool:
        """Whether what is ordered is not what was planned."""
        return abs(self.ordered - self.planned) > 1e-9 * max(abs(self.ordered), abs(self.planned))

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {**vars(self), "acceptable": list(self.acceptable), "curve": [list(point) for point in self.curve]}


@dataclass(frozen=True)
class Contribution:
    """What is reached if only a part of what may move has moved; all rows of a match on the same fresh beds.

    Attributes
    ----------
    moved : str
        ``nothing``, ``controller alone``, ``adapters as planned`` (controller and residual vehicle moved) or ``all``.
    measured, unmeasured : float
        Response errors of the bed as planned.
    measured_median, measured_95, unmeasured_median, unmeasured_95 : float or None
        The same of the stable fresh beds; None without any.
    stable, drawn : int
        How many of the fresh beds are stable, and how many there are.
    keeps_all : bool
        Whether every requirement is met.
    """

    moved: str
    measured: float
    unmeasured: float
    measured_median: float | None
    measured_95: float | None
    unmeasured_median: float | None
    unmeasured_95: float | None
    stable: int
    drawn: int
    keeps_all: bool


@dataclass(frozen=True)
class Remedy:
    """A single change of a case that was solved, judged and matched.

    Attributes
    ----------
    change : mapping
        Key of the case, or ``rig: key`` of its rig file, with what is to be written there, SI.
    words : str
        The change in words.
    factor : float
        How far it goes: the larger of new over old and old over new, 1 for a requirement that is waived or a sensor
        that is added.
    measured, unmeasured : float
        Response errors with it.
    """

    change: Mapping[str, Any]
    words: str
    factor: float
    measured: float
    unmeasured: float

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {**vars(self), "change": dict(self.change)}


@dataclass(frozen=True)
class MatchResult(Displayed):
    """A match: what was asked, what was tuned, how well it does, and how that was checked.

    Attributes
    ----------
    findings : tuple of Finding
        What stands in the way, most binding first, then what is to be known of drawn beds.
    remarks : tuple of str
        What else the user should know.
    remedies : tuple of Remedy
        Single changes of the case with which it was matched, the smallest first; see
        :mod:`matching.match.remedies`.
    case, tuned : Case
        As asked and with the tuned values.
    vehicle_modes, rig_modes : tuple of Mode
    matched_modes : tuple of LoopMode
        Of the closed loop.
    verification : Verification
        See :mod:`matching.match.verify`.
    objective : float
        Cost of the search, and ``starts`` that of every start.
    failures : mapping of str to int
        How many settings that the search tried have no controller, by the reason.
    adapters : tuple of AdapterTrade
        What each adapter that may change gains, and how exactly it has to be what was ordered.
    contributions : tuple of Contribution
        What controller, residual vehicle and adapters contribute, where more than the controller moves.
    simple_vehicle : SimpleVehicle or None
        How near a residual vehicle of the user's own comes; None where it is cut from the vehicle.
    minutes : Minutes
        The exported controller at rest and at speed.
    lash : OpenLash or None
        Drawn beds with free play in their cut shafts; None where there was nothing to simulate.
    driving : Driving or None
        The controller over its range of speeds; None where the case has none.
    simulated_in_time : InTime or None
        What ``in_time`` is, where it was worked out during the verification; None where only on request.
    """

    findings: tuple[Finding, ...]
    remarks: tuple[str, ...]
    case: Case
    tuned: Case
    vehicle_modes: tuple[Mode, ...]
    rig_modes: tuple[Mode, ...]
    matched_modes: tuple[LoopMode, ...]
    targets: tuple[TargetResult, ...]
    parameters: tuple[ParameterResult, ...]
    response_error: ResponseError
    curves: Responses = field(repr=False)
    verification: Verification = field(repr=False)
    objective: float = float("nan")
    starts: tuple[float, ...] = ()
    failures: Mapping[str, int] = field(default_factory=dict)
    adapters: tuple[AdapterTrade, ...] = ()
    contributions: tuple[Contribution, ...] = ()
    seconds: float = 0.0
    simple_vehicle: SimpleVehicle | None = None
    minutes: Minutes = field(default_factory=Minutes)
    lash: OpenLash | None = None
    driving: Driving | None = None
    simulated_in_time: InTime | None = field(default=None, repr=False)
    remedies: tuple[Remedy, ...] = ()

    @property
    def status(self) -> str:
        """``matched``, or ``limited`` where a finding stands in the way."""
        return "limited" if self.limits else "matched"

    @property
    def limits(self) -> tuple[str, ...]:
        """What stands in the way, in sentences, most binding first."""
        return tuple(one.sentence() for one in self.findings if one.limits)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know in addition, in sentences."""
        return (*self.remarks, *(one.sentence() for one in self.findings if not one.limits))

    def limited_by(self, cause: str) -> bool:
        """Whether a cause (:data:`matching.match.findings.CAUSES`) stands in the way."""
        return any(one.cause == cause and one.limits for one in self.findings)

    @property
    def robust(self) -> Verification | None:
        """The verification where fresh beds judged the match, else None."""
        return self.verification if self.verification.beds is not None else None

    @cached_property
    def fidelity(self) -> MatchFidelity | None:
        """R_SD, R_RVM, R_MU and R_XiL of free and matched rig on the manoeuvre; None where the simulation ran away."""
        traces = self.verification.traces
        return None if traces is None else match_fidelity(linear_bed(self.tuned), traces)

    @cached_property
    def in_time(self) -> InTime:
        """The tuned controller in time, on beds that are not the model, against the nonlinear vehicle."""
        return self.simulated_in_time or simulate_deviations(self.tuned)

    def to_dict(self) -> dict[str, Any]:
        """The content of ``result.json``."""
        checks = self.verification
        return {
            "status": self.status,
            "limits": list(self.limits),
            "notes": list(self.notes),
            "findings": [one.to_dict() for one in self.findings],
            "remedies": [one.to_dict() for one in self.remedies],
            "title": self.case.title,
            "structure": self.case.loop.structure.name,
            "vehicle": {"modes": [mode.to_dict() for mode in self.vehicle_modes]},
            "rig": {"modes": [mode.to_dict() for mode in self.rig_modes]},
            "matched": {"modes": [mode.to_dict() for mode in self.matched_modes]},
            "targets": [target.to_dict() for target in self.targets],
            "parameters": [parameter.to_dict() for parameter in self.parameters],
            "insensitive_parameters": [parameter.name for parameter in self.parameters if parameter.fixed],
            "stable": checks.stable,
            "modulus_margin": checks.modulus_margin,
            "modulus_margin_from": checks.margin_from,
            "spectral_abscissa": checks.spectral_abscissa,
            "response_error": self.response_error.to_dict(),
            "operating_point": speeds_of(self.tuned.rig),
            "operating_torques": acting_torques_of(self.tuned.rig),
            "fidelity": None if self.fidelity is None else self.fidelity.to_dict(),
            "in_time": self.in_time.to_dict() | {"open_lash": None if self.lash is None else self.lash.to_dict()},
            "minutes": self.minutes.to_dict(),
            "verification": checks.to_dict(),
            "adapters": [adapter.to_dict() for adapter in self.adapters],
            "contributions": [vars(one) for one in self.contributions],
            "objective": self.objective,
            "starts": list(self.starts),
            "settings_without_controller": dict(self.failures),
            **_of_beds(checks),
            **({} if self.driving is None else {"driving": self.driving.to_dict()}),
            **({} if self.simple_vehicle is None else {"residual_vehicle": self.simple_vehicle.to_dict()}),
        }


def _of_beds(checked: Verification) -> dict[str, Any]:
    """Entries of ``result.json`` on drawn beds, margin, roll-off and noise."""
    loop, required = checked.loop, checked.required
    return {
        **({} if checked.beds is None else {"beds": checked.beds.to_dict()}),
        "command_noise": dict(loop.command_noise),
        "unexpected_torque_of_offsets": dict(loop.unexpected_torque),
        "margin": {
            "modulus": loop.modulus_margin, "at": loop.margin_at, "from": required.margin_from,
            "largest_rolled_off": loop.largest_rolled_off, "rolled_off_from": required.rolled_off_from,
        },
    }  # fmt: skip
