"""Figures are drawn faster, not otherwise: ticks kept give the same file, and powers are plain text."""

import contextlib

import numpy as np
import pytest

from matching.report import common as style
from matching.report.common import figure, image, plain, styled


def drawn():
    with styled():
        fig = figure(6, 4)
        cells = fig.subplots(2, 2, sharex=True)
        x = np.geomspace(1e-3, 1e3, 50)
        for axes, scale in zip(cells.ravel(), (1, 1e-6, 1e4, -2.5), strict=True):
            axes.plot(x, scale * x)
            axes.set_xscale("log")
            axes.set_ylabel("Torque in N·m")
            axes.set_title("costs $5 or $6")
        cells[0, 1].set_yscale("log")
    return fig


def test_kept_ticks_give_the_same_file(monkeypatch):
    kept = image(drawn())
    monkeypatch.setattr(style, "ticks_kept", lambda fig: contextlib.nullcontext())
    assert image(drawn()) == kept


def test_axes_are_as_before_afterwards():
    fig = drawn()
    image(fig)
    assert not any("_update_ticks" in vars(axes.xaxis) for axes in fig.axes)


@pytest.mark.parametrize(
    ("formula", "text"),
    [
        (r"$\mathdefault{10^{-3}}$", "10⁻³"),
        (r"$\mathdefault{10^{12}}$", "10¹²"),
        (r"$\mathdefault{2\times10^{-1}}$", "2×10⁻¹"),
        (r"$\mathdefault{-10^{4}}$", "−10⁴"),
        (r"$\mathdefault{0}$", "0"),
        ("", ""),
        ("costs $5", "costs $5"),
    ],
)
def test_powers_are_plain_text(formula, text):
    assert plain(formula) == text
