"""One search over several speeds: the same values everywhere, the requirements of every speed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from matching.match.objective import OF_ERRORS, Evaluation, Search
from matching.match.variables import Variable


class RangeSearch(Search):
    """Searches of one case at several speeds, as one: mean of their costs, all of their requirements.

    Parameters
    ----------
    members : sequence of Search
        With the same variables; the first one, at the operating point of the case, gives targets and drawn beds.
    """

    def __init__(self, members: Sequence[Search]):
        self._members = tuple(members)
        first = self._members[0]
        self.case, self.required, self.demands, self.settings = (
            first.case,
            first.required,
            first.demands,
            first.settings,
        )
        self.variables: tuple[Variable, ...] = first.variables
        self.known: dict[tuple[float, ...], Evaluation] = {}

    @property
    def members(self) -> tuple[Search, ...]:
        """See :attr:`Search.members`."""
        return self._members

    @property
    def of_errors(self) -> int:
        """See :attr:`Search.of_errors`."""
        return OF_ERRORS * len(self._members)

    @property
    def free(self) -> np.ndarray:  # type: ignore[override]
        """Which variables (m,) move now."""
        return self._members[0].free

    @free.setter
    def free(self, which: np.ndarray) -> None:
        for one in self._members:
            one.free = which

    @property
    def active(self) -> tuple[int, ...]:  # type: ignore[override]
        """Beds that are seen, over all speeds."""
        return tuple(range(sum(len(one.active) for one in self._members)))

    @active.setter
    def active(self, which: tuple[int, ...]) -> None:
        for one in self._members:
            one.active = which

    @property
    def opened(self) -> dict:  # type: ignore[override]
        """Beds with opened cut shafts, by speed and number."""
        return {(at, number): way for at, one in enumerate(self._members) for number, way in one.opened.items()}

    @property
    def failures(self) -> Counter[str]:  # type: ignore[override]
        """Settings without a controller at one of the speeds, by the reason."""
        return sum((one.failures for one in self._members), Counter[str]())

    def leave_out_opened(self) -> None:
        """See :meth:`Search.leave_out_opened`."""
        for one in self._members:
            one.leave_out_opened()
        self.known.clear()

    def activate(self, x: np.ndarray) -> None:
        """See :meth:`Search.activate`."""
        for one in self._members:
            one.activate(x)
        self.known.clear()

    def forget(self) -> None:
        """See :meth:`Search.forget`."""
        for one in self._members:
            one.forget()
        self.known.clear()

    def judged(self, x: np.ndarray) -> Evaluation:
        """Cost and requirements at a point (m,): damping at every speed, what else is asked there, errors."""
        key = tuple(x.tolist())
        if key not in self.known:
            each = [one.judged(x) for one in self._members]
            least = self._ordered([one.least_margins for one in each])
            errors = np.min([one.least_margins[-OF_ERRORS:] for one in each], axis=0)
            self.known[key] = Evaluation(
                float(np.mean([one.cost for one in each])), self._ordered([one.margins for one in each]),
                np.concatenate([least[: -self.of_errors], errors]), self.settings.penalty,
                self.settings.error_penalty, max(one.unstable for one in each),
            )  # fmt: skip
        return self.known[key]

    def slopes(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`Search.slopes`."""
        each = [one.slopes(x) for one in self._members]
        return np.mean([cost for cost, _ in each], axis=0), self._ordered([rows for _, rows in each])

    def _ordered(self, each: Sequence[np.ndarray]) -> np.ndarray:
        """Requirements (r, …) of every speed in the order of one search: damping, the rest, errors."""
        counts = [len(one.active) for one in self._members]
        return np.concatenate([
            *(rows[:count] for rows, count in zip(each, counts, strict=True)),
            *(rows[count:-OF_ERRORS] for rows, count in zip(each, counts, strict=True)),
            *(rows[-OF_ERRORS:] for rows in each),
        ])  # fmt: skip

    def begin(self, values: Mapping[str, float] | None = None) -> np.ndarray:
        """See :meth:`Search.begin`."""
        return self._members[0].begin(values)

    def values(self, x: np.ndarray) -> dict[str, float]:
        """See :meth:`Search.values`."""
        return self._members[0].values(x)
