"""Frequency and damping of ringing, read off sampled signals by the matrix pencil, no frequency assumed.

Several signals that ring together share their poles, so their Hankel matrices stand side by side (Hua and Sarkar, IEEE
Trans. Acoust. Speech Signal Process. 38 (1990) 814; the many-signal form as in the eigensystem realisation algorithm,
Juang and Pappa, J. Guidance 8 (1985) 620). The number of poles follows from the singular values by the threshold for
unknown noise of Gavish and Donoho, IEEE Trans. Inf. Theory 60 (2014) 5040.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

MOST_POLES = 40  # poles
WINDOW = 200  # samples that a row of the Hankel matrix lags behind the first, at most
HALVINGS = 4  # of the record, until what dies away soon is seen
EXPLAINED = 0.9  # of the motion of such a part, or it may be noise
SHORTEST = 40  # samples of a record
ROUNDING = 1e-11  # of a signal's largest value: what remains below of a straight line is rounding, not motion
LEAST_MAC = 0.5  # modal assurance criterion over the sensors, from which a pole may be a mode's
LEAST_SHARE = 0.01  # of the oscillation, that it has to hold
INSTANTS = 1500  # columns of the Hankel matrix, about


@dataclass(frozen=True)
class Ringing:
    """What was read of one mode.

    Attributes
    ----------
    frequency, damping_ratio : float
        |λ|/2π in Hz and −Re λ/|λ|.
    spread : float
        Relative scatter of the frequency over parts of the record.
    fit : float
        Share of the signals' motion that all poles found explain, 0 … 1.
    share : float
        Share of the oscillation (drift left out) that this mode holds at the beginning, 0 … 1.
    """

    frequency: float
    damping_ratio: float
    spread: float
    fit: float
    share: float


@dataclass(frozen=True)
class Poles:
    """Poles (m,) in rad/s, complex amplitudes (m, c) at the first sample over each signal's scale (c,), and the fit."""

    poles: np.ndarray
    amplitudes: np.ndarray
    scale: np.ndarray
    fit: float


def pencil(signals: np.ndarray, step: float) -> Poles:
    """Poles that signals (t, c) at even steps (s) share."""
    y = np.asarray(signals, float)
    if len(y) < 20 or not np.isfinite(y).all():
        raise ValueError("at least 20 finite samples are needed")
    # a straight line taken off leaves a line at most: it would drown small ringing
    line = np.stack([np.ones(len(y)), np.linspace(-1, 1, len(y))], axis=1)
    largest = np.abs(y).max(axis=0)
    y = y - line @ np.linalg.lstsq(line, y, rcond=None)[0]
    scale = np.std(y, axis=0)
    moves = scale > ROUNDING * largest  # else a straight line and nothing else
    scale = np.where(moves, scale, 1.0)
    y = np.where(moves, y / scale, 0.0)
    rows = min(len(y) // 3, WINDOW)
    windows = np.lib.stride_tricks.sliding_window_view(y, rows + 1, axis=0)
    windows = windows[:: max(1, windows.shape[0] * y.shape[1] // INSTANTS)]
    hankel = windows.transpose(2, 0, 1).reshape(rows + 1, -1)
    # the triangle has the left singular vectors in half the time: no right ones
    triangle = np.asarray(np.linalg.qr(hankel.T, mode="r"))
    left, sizes, _ = np.linalg.svd(triangle.T, full_matrices=False)
    order = _order(sizes, hankel.shape)
    base = left[:, :order]
    z = np.linalg.eigvals(np.linalg.lstsq(base[:-1], base[1:], rcond=None)[0])
    z = z[(np.abs(z) > 1e-3) & (np.abs(z) < 1.5)]
    times = np.arange(len(y))
    modes = z[None] ** times[:, None]
    amplitudes = np.linalg.lstsq(modes, y.astype(complex), rcond=None)[0]
    rest = y - (modes @ amplitudes).real
    spread = np.std(y, axis=0)
    fit = 1 - float(np.linalg.norm(rest) / max(np.linalg.norm(spread) * np.sqrt(len(y)), 1e-300))
    return Poles(np.log(z.astype(complex)) / step, amplitudes, scale, max(fit, 0.0))


def _order(sizes: np.ndarray, shape: tuple[int, ...]) -> int:
    """How many singular values stand above the noise."""
    beta = min(shape) / max(shape)
    threshold = (0.56 * beta**3 - 0.95 * beta**2 + 1.82 * beta + 1.43) * np.median(sizes)
    return int(np.clip(np.sum(sizes > max(threshold, 1e-9 * sizes[0])), 1, min(MOST_POLES, len(sizes) - 1)))


def thinned(signals: np.ndarray, step: float, top: float) -> tuple[np.ndarray, float]:
    """Signals (t, c) at fewer samples, what lies above ``top`` (Hz) filtered off.

    The filter is finite and only its settled part is kept: it changes amplitudes, not poles.
    """
    by = int(min(max(1 / (step * 5 * top), 1), max(len(signals) // 60, 1)))
    if by == 1:
        return signals, step
    taps = scipy.signal.firwin(8 * by + 1, 0.8 / by)
    smooth = np.stack([np.convolve(column, taps, "valid") for column in signals.T], axis=1)
    return smooth[::by], step * by


def read_modes(
    signals: np.ndarray, step: float, shapes: np.ndarray, top: float = 30.0, neighbours: np.ndarray | None = None,
    eigenvalues: np.ndarray | None = None,
) -> list[Ringing | None]:  # fmt: skip
    """Read off modes, told from others by how they move the sensors.

    Parameters
    ----------
    signals : ndarray (t, c)
        Free motion: what drives it has ended or is constant.
    step : float
        s.
    shapes : ndarray (m, c)
        Complex amplitudes of each mode in every signal, whatever their scale.
    top : float
        Hz; modes above are filtered off.
    neighbours : ndarray (n, c), optional
        The same of modes for which those to be read might be taken: what moves the sensors as they do is theirs.
    eigenvalues : ndarray (m + n,), optional
        1/s, of the modes and then of the neighbours in the vehicle: of poles that move the sensors alike, a mode gets
        the nearer one.

    Returns
    -------
    list of Ringing or None
        None where no oscillation moves the sensors like that, holds 1 % of the oscillation or more, and is read alike
        (frequency within 5 %) from three parts of the record, or of the half, quarter … of it that comes first: what
        is well damped has died away before most of a long record. Of such a part nine tenths have to be explained.
    """
    signals, shapes = np.asarray(signals, float), np.asarray(shapes, complex)
    others = np.zeros((0, shapes.shape[1]), complex) if neighbours is None else np.asarray(neighbours, complex)
    out: list[Ringing | None] = [None] * len(shapes)
    for length in (len(signals) >> halvings for halvings in range(HALVINGS + 1)):
        open_yet = [i for i, modes in enumerate(out) if modes is None]
        if not open_yet or length < SHORTEST:
            break
        of_all = _alike(signals[:length], step, KnownModes(np.concatenate([shapes, others]), eigenvalues), top)
        for i, modes in ((i, of_all[i]) for i in open_yet):
            if modes is not None and (length == len(signals) or modes.fit > EXPLAINED):
                out[i] = modes
    return out


@dataclass(frozen=True)
class KnownModes:
    """Complex amplitudes (m, c) of the modes to read, and their eigenvalues (m,), 1/s, where they are known."""

    shapes: np.ndarray
    eigenvalues: np.ndarray | None

    def nearness(self, poles: np.ndarray) -> np.ndarray:
        """exp(−|ln s/s₀|) of each mode and pole, (m, poles)."""
        if self.eigenvalues is None:
            return np.ones((len(self.shapes), len(poles)))
        return np.asarray(np.exp(-np.abs(np.log(poles[None] / self.eigenvalues[:, None]))))


def _alike(signals: np.ndarray, step: float, wanted: KnownModes, top: float) -> list[Ringing | None]:
    """What three parts of a record show alike."""
    length = len(signals)
    spans = ((0, length), (length // 10, length), (0, 4 * length // 5))
    runs = [_read_ringing(signals[first:last], step, wanted, top) for first, last in spans]
    out: list[Ringing | None] = []
    for together in zip(*runs, strict=True):
        good = [mode for mode in together if mode is not None]
        if len(good) < len(spans):
            out.append(None)
            continue
        frequencies = [mode.frequency for mode in good]
        spread = (max(frequencies) - min(frequencies)) / frequencies[0]
        out.append(replace(good[0], spread=spread) if spread <= 0.05 else None)
    return out


def _read_ringing(signals: np.ndarray, step: float, modes: KnownModes, top: float) -> list[Ringing | None]:
    (few, longer), shapes = thinned(signals, step, top), modes.shapes
    nothing: list[Ringing | None] = [None] * len(shapes)
    moving = np.ptp(few, axis=0) > 1e-9 * np.abs(few).max(axis=0, initial=1e-300) if len(few) else np.zeros(0, bool)
    if len(few) < 20 or not moving.any():
        return nothing
    few, shapes = few[:, moving], shapes[:, moving]
    got = pencil(few, longer)
    lasting = len(few) * longer
    swinging = (got.poles.imag > np.pi / lasting) & (-got.poles.real < 0.9 * np.abs(got.poles))
    swinging &= np.abs(got.poles) < 2 * np.pi * 1.2 * top
    if not swinging.any():
        return nothing
    poles, amplitudes = got.poles[swinging], got.amplitudes[swinging]
    growth = np.exp(2 * poles.real[:, None] * longer * np.arange(len(few)))
    energy = np.sum(np.abs(amplitudes) ** 2, axis=1) * growth.sum(axis=1)
    share = energy / energy.sum()
    wanted = shapes / got.scale
    mac = np.abs(wanted.conj() @ amplitudes.T) ** 2  # modal assurance criterion (m, poles)
    mac /= np.maximum(np.outer(np.sum(np.abs(wanted) ** 2, axis=1), np.sum(np.abs(amplitudes) ** 2, axis=1)), 1e-300)
    score = np.where((mac > LEAST_MAC) & (share > LEAST_SHARE), mac * np.sqrt(share), 0.0) * modes.nearness(poles)
    out = nothing
    # a pole belongs to one mode
    for shape, i in zip(*scipy.optimize.linear_sum_assignment(score, maximize=True), strict=True):
        if score[shape, i] > 0:
            ratio = float(-poles[i].real / abs(poles[i]))
            out[shape] = Ringing(float(abs(poles[i]) / (2 * np.pi)), ratio, 0.0, got.fit, float(share[i]))
    return out
