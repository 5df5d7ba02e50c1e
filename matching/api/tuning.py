"""What a test bed can be tuned to: a match, over two quantities, over tolerances."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from typing import TYPE_CHECKING

from matching.api.files import File, case_of, path_of

if TYPE_CHECKING:
    from matching.frequency.case.case import Case
    from matching.frequency.search.result import MatchResult
    from matching.frequency.studies.map import Map
    from matching.frequency.studies.map_axis import Axis
    from matching.frequency.studies.tolerance import Tolerance


def match(
    case: Case | File, seed: int = 0, starts: int = 14, workers: int = 1,
    progress: Callable[[str], None] | None = None, *, beds: int | None = None,
) -> MatchResult:  # fmt: skip
    """Tune what the case lets move until the rig reproduces the vehicle's response, and verify the result.

    Parameters
    ----------
    case : Case or path
        A case.
    seed : int
        Of the random starts.
    starts : int
        How many starts the search tries; the first is the case's own.
    workers : int
        Processes that share the starts.
    progress : callable, optional
        Is called with a line of text at every step.
    beds : int, optional
        Fresh beds, drawn from the case's ``[uncertainty]``, that judge the result; 200 with an observer unless given,
        none with a feedback law.

    Returns
    -------
    MatchResult
        ``status`` is ``"matched"`` or ``"limited"``, ``limits`` says what stands in the way; ``targets``,
        ``parameters``, ``response_error`` and ``verification`` hold the figures; ``tuned`` is the tuned case.

    Raises
    ------
    InputError
        One line that names file and key, also where no stable solution exists.

    Examples
    --------
    >>> result = rm.match("examples/adapter_only/case.toml", starts=1)  # doctest: +LONG
    >>> result.status  # doctest: +LONG
    'limited'
    """
    from matching.frequency.search.match import match as run

    return run(case_of(case), seed, starts, progress, workers, beds=beds)


# more than six parameters: the options of the command
def map(  # noqa: A001
    case: Case | File, x: str | Axis, y: str | Axis, executor: Executor | None = None, *,
    seed: int = 0, starts: int = 2,
    workers: int | None = None, record: File | None = None, progress: Callable[[int, int], None] | None = None,
) -> Map:  # fmt: skip
    """The response error that a match reaches over two quantities.

    It runs on any ``concurrent.futures`` executor, that of a Dask cluster (``Client(…).get_executor()``) included, else
    on ``workers`` processes. Finished points are kept in ``record``, from which a map that was stopped continues.

    Parameters
    ----------
    case : Case or path
        A case.
    x, y : str or Axis
        ``NAME``, ``NAME=LOW:HIGH[:N]`` or ``NAME=VALUE,VALUE,…``; units as in the case file, SI where none is written.
    executor : Executor, optional
        Where the points are solved.
    seed, starts : int
        As of :func:`match`, for every point.
    workers : int, optional
        Processes where there is no executor; by default one a core.
    record : path, optional
        A file of finished points.
    progress : callable, optional
        Is called with the numbers of finished and of all points.

    Returns
    -------
    Map
        Response errors, margins and status of every point.

    Raises
    ------
    InputError
        One line that names the quantity, file or key.

    Examples
    --------
    >>> axes = "loop.dead_time=0.001:0.005:3", "rig.shafts.adapter_left.stiffness=2e4:1e5:3"
    >>> rm.map("examples/road_to_rig/case.toml", *axes).plot().savefig("map.svg")  # doctest: +SKIP
    """
    from matching.frequency.studies.map import map_case

    return map_case(
        case_of(case),
        x,
        y,
        executor,
        seed=seed,
        starts=starts,
        workers=workers,
        record=path_of(record),
        progress=progress,
    )  # fmt: skip


# more than six parameters: the options of the command
def tolerance(
    case: Case | File, draws: int = 10_000, executor: Executor | None = None, *, seed: int = 0,
    added: Mapping[str, float] | None = None, workers: int | None = None, record: File | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Tolerance:  # fmt: skip
    """Spread of margin, modes and response errors of a match over tolerances of the bed.

    Parameters
    ----------
    case : Case or path
        A tuned case, e.g. ``case.toml`` of a match's directory.
    draws : int
        How many beds are drawn.
    executor, workers, record, progress
        As of :func:`map`.
    seed : int
        Of the draws.
    added : mapping of str to float, optional
        Relative tolerances by name or pattern beside those of the model files, e.g. ``{"loop.dead_time": 0.2}``.

    Returns
    -------
    Tolerance
        Quantiles of every quantity, shares of the inputs in their spread, and the yield: the share of beds within
        limits.

    Raises
    ------
    InputError
        One line that names the quantity, file or key.

    Examples
    --------
    >>> case = "examples/road_to_rig/case.toml"
    >>> study = rm.tolerance(case, 200, added={"loop.dead_time": 0.2}, workers=1)  # doctest: +LONG
    >>> study.draws  # doctest: +LONG
    200
    """
    from contextlib import nullcontext

    from matching.executors import executor_of
    from matching.frequency.studies.tolerance import tolerance as run

    with nullcontext(executor) if executor else executor_of(workers) as pool:
        return run(case_of(case), draws, pool, seed=seed, added=added, record=path_of(record), progress=progress)
