"""What an objective of the match has to answer: one file each, registered in the package."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import casadi as ca

from matching.frequency.case.case import Case, Move
from matching.frequency.programme.closed_loop import General
from matching.frequency.programme.constraints import CommonParts
from matching.frequency.programme.evaluators import Derivation
from matching.frequency.programme.terms import Term

Terms = dict[str, tuple[Derivation, Term]]


class ObjectiveBlock(ABC):
    """The objective as expressions of the decision vector (v,)."""

    @abstractmethod
    def value(self) -> ca.MX:
        """Scalar."""

    @abstractmethod
    def gradient(self) -> tuple[ca.MX, ca.MX]:
        """Value and gradient (v, 1)."""

    @abstractmethod
    def hessian(self) -> ca.MX:
        """Hessian (v, v)."""


class Objective(ABC):
    """What the feedback of a case is tuned by, prepared for that case.

    Attributes
    ----------
    name : str
        As case files write it under ``response.objective``.
    tracks_modes : bool
        Whether the target modes are tracked as eigenpairs beside it.
    """

    name: ClassVar[str]
    tracks_modes: ClassVar[bool]

    @classmethod
    @abstractmethod
    def of(cls, case: Case) -> Objective:
        """Prepared for a case.

        Raises
        ------
        InputError
            If vehicle or rig cannot be made linear.
        """

    @staticmethod
    def terms(loop: General, free: ca.SX, p: ca.SX, fixed: ca.SX) -> tuple[Terms, Terms]:
        """Functions of the case's own loop that the block takes: always, and for second derivatives."""
        return {}, {}

    @abstractmethod
    def block(self, common: CommonParts, moves: Sequence[Move], compiled: bool) -> ObjectiveBlock:
        """The objective in a programme."""
