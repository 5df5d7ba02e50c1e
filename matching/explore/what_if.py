"""Values tried out on a model before they are kept: modes and responses beside those of the file."""

from __future__ import annotations

from dataclasses import dataclass, field

from matching.explore.files.model_document import ModelDocument
from matching.explore.live import LiveModel, LiveState, slider_range
from modelling.modal.result import Mode

LARGEST_SHARES = 3  # components of a mode that its row of the table names


@dataclass
class WhatIf:
    """A model with quantities that a slider moves.

    Attributes
    ----------
    document : ModelDocument
    values : dict of str to float
        Tried, SI, by name.
    now, before : LiveState
        With the tried values, and with those of the document.
    """

    document: ModelDocument
    values: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget what was tried, and follow the document."""
        self.live = LiveModel(self.document.system)
        self.values.clear()
        self.before: LiveState = self.live.at()
        self.now: LiveState = self.before

    @property
    def movable(self) -> dict[str, tuple[float, float]]:
        """Range of the slider (SI) of every quantity that has one."""
        ranges = {name: slider_range(quantity) for name, quantity in self.document.system.parameters.items()}
        return {name: ends for name, ends in ranges.items() if ends is not None}

    def try_value(self, name: str, value: float) -> None:
        """Set a quantity (SI) and follow it.

        Raises
        ------
        InputError
            If there is nothing to oscillate about; then nothing has changed.
        """
        values = self.values | {name: value}
        self.now = self.live.at(values)
        self.values = values

    def keep(self) -> None:
        """Write what was tried into the document, as changes that can be undone.

        Raises
        ------
        InputError
            If the model is none with them.
        """
        for name, value in self.values.items():
            self.document.set_value(name, value)
        self.reset()


def largest_shares(mode: Mode) -> str:
    """The components that hold most of a mode's energy, in words: ``body left 49 %, …``."""
    shares = sorted((mode.kinetic | mode.potential).items(), key=lambda item: -item[1])[:LARGEST_SHARES]
    return ", ".join(f"{name.partition('.')[2].replace('_', ' ')} {100 * share:.0f} %" for name, share in shares)
