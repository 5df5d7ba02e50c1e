"""What manufacturing tolerances of the bed do to a match whose controller stays as it is.

Every quantity of the rig that has a range in its file, and what the user adds, is drawn evenly from it, each on its
own (a mirror image too). Margin, stability, the feedback loop's modes and the response errors come of every draw. Where
quantities of the controller are drawn as well, response errors have to be worked out singly, and come of the first few
hundred. A component that vehicle and rig share is the same piece of hardware: there the vehicle it is compared with has
the drawn value too.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from matching.frequency.beds.requirements import requirements
from matching.frequency.case.case import Case
from matching.frequency.case.case_file import case_files
from matching.frequency.case.load_moves import movable
from matching.frequency.case.tuned import apply
from matching.frequency.loop.encirclements import encirclements
from matching.frequency.loop.parts import parts_of
from matching.frequency.studies.distribution import Regressors, Spread, spread
from matching.frequency.studies.draws import CHECKED, Prepared, Varied, draw, work
from matching.studies import run
from modelling.common.display import Displayed
from modelling.common.errors import InputError, unknown
from modelling.common.version import VERSION

CHUNK = 1000  # draws
RESPONSES = 400  # draws whose response errors are worked out where that is done singly
TARGET_FREQUENCY_TOLERANCE = 0.01  # relative, about the nominal value; as a target's own default
TARGET_DAMPING_TOLERANCE = 0.02  # of the damping ratio, absolute


@dataclass(frozen=True)
class Tolerance(Displayed):
    """A tolerance study.

    Attributes
    ----------
    draws, seed : int
    varied : tuple of Varied
    spreads : tuple of Spread
        Modulus margin, modes of the feedback loop near the targets, response errors.
    differences : dict of str to float
        By result: largest relative difference from the draws that were worked out exactly as well; of ``stable`` the
        share that differs.
    shares : dict of str to float
        Yield: the share of draws that is stable, keeps the margin asked for, keeps every target mode near its nominal
        value (1 % in frequency, 0.02 in damping ratio), and all of these.
    asked, asked_from : float
        Modulus margin that is required, and from which frequency (Hz) on it counts.
    """

    title: str
    draws: int
    seed: int
    varied: tuple[Varied, ...]
    spreads: tuple[Spread, ...]
    differences: dict[str, float]
    shares: dict[str, float]
    asked: float
    asked_from: float

    def to_dict(self) -> dict[str, Any]:
        """The content of ``tolerance.json``."""
        return {
            "title": self.title, "draws": self.draws, "seed": self.seed,
            "varied": [vars(quantity) for quantity in self.varied],
            "quantities": [spread.to_dict() for spread in self.spreads], "yield": self.shares,
            "modulus_margin_asked": self.asked, "modulus_margin_from": self.asked_from,
            "checked_exactly": {"draws": min(CHECKED, self.draws), "largest_difference": self.differences},
        }  # fmt: skip


def varied_of(case: Case, added: Mapping[str, float] | None = None) -> tuple[Varied, ...]:
    """What varies: quantities of the rig with a range, and ``added`` ones by their relative tolerance.

    Raises
    ------
    InputError
        If nothing varies, a name is unknown or belongs to the residual vehicle, or a tolerance is not in (0, 1).
    """
    known = {f"rig.{name}": (parameter.value, case.rig.units[name]) for name, parameter in case.rig.parameters.items()}
    every = movable(case.rig, case.residual_vehicle, case.loop)
    known |= {name: (place.start, place.unit) for name, place in every.items() if not name.startswith("rig.")}
    varied = {}
    for name, quantity in case.rig.uncertain.items():
        if quantity.lower is not None and quantity.upper is not None and quantity.lower < quantity.upper:
            unit = known[f"rig.{name}"][1]
            varied[f"rig.{name}"] = Varied(f"rig.{name}", quantity.value, quantity.lower, quantity.upper, unit)
    for name, share in _named(added or {}, known):
        if name.startswith("residual_vehicle."):
            raise InputError(
                "--tolerance", f"{name} is a number in the controller", "name a quantity of the rig or loop"
            )
        value, unit = known[name]
        if not 0 < share < 1 or value == 0:
            raise InputError("--tolerance", f"{name} = {value:g} cannot vary by {share:g}", "give 0 < SHARE < 1")
        varied[name] = Varied(name, value, value - share * abs(value), value + share * abs(value), unit)
    if not varied:
        right = 'write { value = …, tolerance = 0.05 } in the rig file, or add --tolerance "rig.*.stiffness=0.05"'
        raise InputError(case.path, "no quantity of the rig has a tolerance", right)
    return tuple(varied.values())


def _named(added: Mapping[str, float], known: Mapping[str, tuple[float, str]]) -> list[tuple[str, float]]:
    """Names with their tolerances; a pattern stands for all of the rig and loop that it fits and that are not zero."""
    named = []
    for name, share in added.items():
        fitting = [name] if name in known else []
        if "*" in name:
            not_zero = [candidate for candidate in known if known[candidate][0] != 0]
            possible = [candidate for candidate in not_zero if not candidate.startswith("residual_vehicle.")]
            fitting = fnmatch.filter(possible, name)
        if not fitting:
            raise unknown(name, list(known), "--tolerance")
        named += [(match, share) for match in fitting]
    return named


def tuned(case: Case) -> Case:
    """The case at the start values of its ``[move]``, which a match writes as tuned."""
    return apply(case, {name: move.start for move in case.moves for name in move.together})


def what_varies(case: Case, added: Mapping[str, float] | None) -> tuple[Varied, ...]:
    """What varies of a case as tuned, see :func:`varied_of`.

    Raises
    ------
    InputError
        If nothing varies, a name does not exist, or the study does not cover the control structure.
    """
    if case.loop.structure.is_observer:
        right = "the match's own drawn beds say it: state the tolerances under [uncertainty]"
        raise InputError(f"{case.path}: loop.structure", "the study does not cover 'observer'", right)
    return varied_of(tuned(case), added)


# more than six parameters: what is drawn, and how the study runs
def tolerance(
    case: Case, draws: int, executor: Executor, *, seed: int = 0, added: Mapping[str, float] | None = None,
    record: Path | None = None, progress: Callable[[int, int], None] | None = None,
) -> Tolerance:  # fmt: skip
    """Spread of margin, modes and response errors over tolerances, with the yield and what drives it.

    Parameters
    ----------
    case : Case
        Its moves stand at their start values: give the case file that a match wrote.
    draws : int
    executor : concurrent.futures.Executor
    added : mapping of str to float, or None
        Relative tolerances beside those of the rig file, by name or by a pattern such as ``rig.*.stiffness``; what
        stands later counts.
    record, progress : see :func:`matching.studies.run`

    Raises
    ------
    InputError
        If nothing varies, or the nominal loop is unstable.
    """
    varied = what_varies(case, added)
    case = tuned(case)
    winding = encirclements(parts_of(case))
    if winding.unstable or not winding.clear:
        raise InputError(case.path, "the loop is unstable as it stands", "match first and give DIR/case.toml")
    few = -(-RESPONSES // max(1, -(-draws // CHUNK)))
    chunks = [[number, min(CHUNK, draws - CHUNK * number), few] for number in range(-(-draws // CHUNK))]
    content = [VERSION, str(seed), *(str(vars(quantity)) for quantity in varied)]
    content += [f"{name}: {text}" for name, text in case_files(case).items()]
    rows = run(
        work, Prepared, (case, varied, seed), chunks, executor,
        content="\n".join(content), record=record, progress=progress,
    )  # fmt: skip
    values: dict[str, np.ndarray] = {
        name: np.concatenate([np.array(row["values"][name], float) for row in rows]) for name in rows[0]["values"]
    }
    x = np.concatenate([draw(varied, seed, number, count) for number, count, _ in chunks])
    first = np.concatenate([np.arange(count) < few for _, count, _ in chunks])
    nominal = rows[0]["nominal"]
    names = [quantity.name for quantity in varied]
    every, some = Regressors(names, x), Regressors(names, x[first])
    spreads = [
        spread(name, unit, nominal[name], values[name], every if len(values[name]) == len(x) else some)
        for name, unit in rows[0]["units"].items()
    ]
    asked, counted_from = case.limits["modulus_margin"], requirements(case).margin_from
    shares = yields(values, nominal, asked)
    return Tolerance(case.title, draws, seed, varied, tuple(spreads), rows[0]["check"], shares, asked, counted_from)


def yields(values: Mapping[str, np.ndarray], nominal: Mapping[str, float], asked: float) -> dict[str, float]:
    """Shares of draws that keep each demand, and all of them; see :class:`Tolerance`.

    Parameters
    ----------
    values : mapping of str to ndarray (b,)
        ``stable`` (1 or 0), ``modulus_margin``, and by target ``target … frequency`` in Hz and its damping ratio.
    nominal : mapping of str to float
        The same without tolerances.
    asked : float
        Modulus margin.
    """
    kept = {"stable": values["stable"] > 0.5}
    kept["modulus_margin"] = kept["stable"] & (values["modulus_margin"] >= asked)
    for name in nominal:
        if name.startswith("target"):
            low, high = required_range(name, nominal[name], asked)
            kept[name] = (values[name] >= low) & (values[name] <= high)
    kept["all"] = np.logical_and.reduce(list(kept.values()))
    return {name: float(value.mean()) for name, value in kept.items()}


def required_range(name: str, nominal: float, asked: float) -> tuple[float, float]:
    """Least and largest value of a result with which a bed counts in the yield; infinite where nothing is required.

    Parameters
    ----------
    name : str
        As in :func:`yields`.
    nominal : float
        Value of the bed as planned: Hz for a frequency.
    asked : float
        Modulus margin.
    """
    if name == "modulus_margin":
        return asked, np.inf
    if not name.startswith("target"):
        return -np.inf, np.inf
    reach = TARGET_FREQUENCY_TOLERANCE * nominal if name.endswith("frequency") else TARGET_DAMPING_TOLERANCE
    return nominal - reach, nominal + reach
