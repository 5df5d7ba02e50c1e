"""What measurements say: causes that a model lacks, measurement uncertainty, XiL fidelity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from typing import TYPE_CHECKING

from matching.api.files import File, recording_of, system_of

if TYPE_CHECKING:
    from matching.diagnosis.verdict.result import Diagnosis
    from matching.validity.fidelity.result import XilFidelity
    from matching.validity.uncertainty.result import Uncertainty
    from modelling.measurement.recording import Recording
    from modelling.model.system import System


def diagnose(
    model: System | File, recordings: Sequence[Recording | File] | Recording | File,
    holdout: Sequence[Recording | File] | Recording | File | None = None, *, channels: File | None = None,
    keep_rest: bool = False, tell: Callable[[str], None] | None = None,
) -> Diagnosis:  # fmt: skip
    """Find what a model lacks, from recordings: name the cause, extend the model, measure the gain.

    Parameters
    ----------
    model : System or path
        What is believed of the drivetrain; quantities with a range are fitted within it.
    recordings : Recording, path or a sequence of them
        What was measured.
    holdout : Recording, path or a sequence of them, optional
        Is never fitted and judges the result; by default the last 30 % of the recordings.
    channels : path, optional
        A file that says what the channels are called in the recordings.
    keep_rest : bool
        Whether the extended model keeps the torque that no cause explains as a table, where unseen data gain by it.
    tell : callable, optional
        Is called with a line of text at every step.

    Returns
    -------
    Diagnosis
        ``verdict`` is ``"adequate"``, ``"explained"`` or ``"unexplained"``; ``causes`` with parameters, standard
        uncertainties, confidence and evidence; ``extended`` is the extended model.

    Raises
    ------
    InputError
        One line that names file, key or column.

    Examples
    --------
    >>> found = rm.diagnose("examples/diagnosis/model.toml", "bench.csv")  # doctest: +SKIP
    >>> for cause in found.causes:  # doctest: +SKIP
    ...     print(cause.kind, cause.at, cause.evidence)
    """
    from matching.diagnosis.diagnosis import diagnose as run
    from modelling.measurement.recording import Recording

    system = system_of(model)
    fitted, judging = (
        [what] if isinstance(what, str | PathLike | Recording) else list(what or ()) for what in (recordings, holdout)
    )
    read, judge = ([recording_of(each, system, channels) for each in some] for some in (fitted, judging))
    return run(system, read, judge, tell or (lambda _: None), keep_rest)


def uncertainty(budget: File, *, draws: int | None = None, seed: int = 0, digits: int = 2) -> Uncertainty:
    """Evaluate a measurement uncertainty budget after the GUM, first order and by Monte Carlo.

    Parameters
    ----------
    budget : path
        A budget file (TOML).
    draws : int, optional
        Of Monte Carlo; by default as many as make the result stable (JCGM 101, 7.9).
    seed : int
        Of the draws.
    digits : int
        Significant digits of the stated uncertainty.

    Returns
    -------
    Uncertainty
        For every measurand the complete result, the budget's table and the check of first order against Monte Carlo.

    Raises
    ------
    InputError
        One line that names file and key.

    Examples
    --------
    >>> budget = rm.uncertainty("examples/gum/end_gauge.toml", draws=10_000)
    >>> print(f"{budget.measurands[0].propagation.first_order * 1e9:.1f} nm")  # standard uncertainty, first order
    31.7 nm
    """
    from matching.validity.budget.budget_file import read_budget
    from matching.validity.uncertainty.evaluate import evaluate

    return evaluate(read_budget(str(budget)), seed=seed, draws=draws, digits=digits)


def fidelity(
    case: File, *, channels: File | None = None, arithmetic: str | None = None, nrmse: str | None = None,
    draws: int = 20_000, seed: int = 1,
) -> XilFidelity:  # fmt: skip
    """Partial and total XiL fidelity of a fidelity case (Eqs. 13–23 of the paper).

    Parameters
    ----------
    case : path
        A fidelity case (TOML).
    channels : path, optional
        A file that says what the channels are called in the recordings.
    arithmetic : {"definition", "published"}, optional
        Replaces that of the file: the equations as defined, or as the paper's table was calculated.
    nrmse : {"definition", "literal"}, optional
        Form of Eq. 18; replaces that of the file.
    draws, seed : int
        Of Monte Carlo.

    Returns
    -------
    XilFidelity
        ``R_XiL`` (0 … 1), its parts, and their uncertainties.

    Raises
    ------
    InputError
        One line that names file and key.

    Examples
    --------
    >>> print(f"{rm.fidelity('examples/fidelity/tab2.toml').R_XiL:.3f}")
    0.885
    """
    from matching.validity.fidelity.case_file import read_case
    from matching.validity.fidelity.result import xil_fidelity
    from modelling.measurement.channels import read_channels

    names = None if channels is None else read_channels(channels)
    return xil_fidelity(*read_case(str(case), arithmetic, nrmse, names), draws, seed)
