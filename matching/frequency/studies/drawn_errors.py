"""Response errors of many drawn beds at once, with the controller as it is.

At each of the frequencies at which the nominal errors have converged, rig and vehicle of all draws are solved as
dynamic stiffnesses and the sampled controller is closed round them, as in
:mod:`matching.frequency.response.sampled_data`. One thing is not worked out anew for every draw: what the images of the
held command beyond half the sampling frequency add to the sampled plant, some 10⁻⁴ of it, goes through the nominal rig.
The first image on either side is late and lagged as drawn, the others are late as drawn. A study checks some of its
draws exactly and states the largest difference.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import casadi as ca
import numpy as np

from matching.frequency.programme.linear_response import LinearResponse
from matching.frequency.response.band import BandNodes
from matching.frequency.response.responses import ComparedBed
from matching.frequency.response.sampled_data import SampledLoop, feed_forward_action
from modelling.equations.compiled import compiled
from modelling.equations.complex_sx import Complex, exp, joined, solve
from modelling.model.system import System
from modelling.simulation.integrator.vector_function import VectorFunction

AT_ONCE = 128  # draws
HARDWARE = ("loop.dead_time", "loop.inverter_lag", "loop.torque_sensor_lag")  # of the loop; the rest is the controller

Matrix = list[list[Complex]]


def covered(names: Sequence[str]) -> bool:
    """Whether every drawn quantity is hardware; other quantities of the loop change the controller."""
    return all(not name.startswith("loop.") or name in HARDWARE for name in names)


class DrawnErrors:
    """Response errors of a bed with some of its quantities drawn.

    Parameters
    ----------
    bed : ComparedBed
        Nominal.
    names : sequence of str
        The quantities, p of them, :func:`covered`.
    center : ndarray (p,)
        Their nominal values.
    nodes : BandNodes
        f frequencies.
    """

    def __init__(self, bed: ComparedBed, names: Sequence[str], center: np.ndarray, nodes: BandNodes):
        self._weights, f = nodes.weights, nodes.frequencies
        functions = BedExpressions(bed, names)
        k, loop = functions.k, SampledLoop(bed.parts, f)
        s = 2j * np.pi * f
        held = -np.expm1(-s * bed.parts.case.loop["sample_time"]) / (s * bed.parts.case.loop["sample_time"])
        controller = [loop.control]
        if functions.measured:
            assert bed.feed_forward is not None, "what takes measured torques has a feed-forward"
            names_of = [dynamometer.name for dynamometer in bed.parts.dynamometers]
            action = feed_forward_action(bed.feed_forward, bed.parts.toward, names_of, f)
            controller += [action.commands, action.expected]
        table = [s[:, None], held[:, None], *(part.reshape(len(f), -1) for part in controller)]

        def uniform(images: Sequence[np.ndarray]) -> np.ndarray:
            every = np.concatenate([*table, *(image.reshape(len(f), -1) for image in images)], axis=1).T
            return np.concatenate([every.real, every.imag])[:, :, None]

        none = [np.zeros((len(f), 2 * k, k), complex)] * 3
        re, im = np.split(VectorFunction(functions.of_commands)(uniform(none), center[:, None, None])[:, :, 0], 2)
        rest = loop.of_commands - (re + 1j * im).T.reshape(-1, 2 * k, k)
        first = [loop.image(n) for n in (1, -1)]
        self._uniform = uniform([*first, rest - first[0] - first[1]])
        self._squares = VectorFunction(functions.squares)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Response errors (b, 2) of draws x (b, p): to torques as the case measures them, and to unmeasured ones."""
        errors = []
        for begin in range(0, len(x), AT_ONCE):
            squares = self._squares(self._uniform, x[begin : begin + AT_ONCE].T[:, None])
            errors.append(np.sqrt(np.einsum("f,efb->be", self._weights, squares)))
        return np.concatenate(errors)


class BedExpressions:
    """The bed at one frequency as functions of a table of what all draws share there and of the drawn values (p,).

    The table holds, real parts before imaginary parts: s, the hold's response, the controller (k, 2k + r), commands
    (k, w) and expected readings (2k, w) of the feed-forward, and the first image above, the one below and all others,
    each (2k, k); row by row.

    Attributes
    ----------
    squares : casadi.Function
        Means over the compared functions of |log(H_rig/H_vehicle)|², as measured and unmeasured.
    of_commands : casadi.Function
        The sampled readings by commands (2k·k), real parts, then imaginary parts.
    """

    def __init__(self, bed: ComparedBed, names: Sequence[str]):
        parts, case = bed.parts, bed.parts.case
        self._parts, self.k = parts, len(parts.dynamometers)
        feed_forward = bed.feed_forward if bed.measured.any() else None
        self.measured = () if feed_forward is None else tuple(feed_forward.measured)
        width, w, k = 2 * self.k + len(parts.simulated), len(self.measured), self.k
        count = 2 + k * width + 3 * k * w + 6 * k * k
        table, x = ca.SX.sym("table", 2 * count), ca.SX.sym("x", len(names))
        values = iter(Complex(table[i], table[count + i]) for i in range(count))
        s, hold = next(values), next(values)
        control, commands, expected, *images = (
            _matrix(values, *shape) for shape in ((k, width), (k, w), (2 * k, w), *[(2 * k, k)] * 3)
        )
        drawn = dict(zip(names, ca.vertsplit(x), strict=True)) if names else {}
        loop = {name: drawn.get(f"loop.{name}", ca.SX(value)) for name, value in case.loop.values.items()}
        delay = ca.fmax(loop["dead_time"] - case.loop["sample_time"] / 2, 0)
        self._lag = 1 / (1 + s * loop["torque_sensor_lag"])
        self._acting = hold * exp(-(s * delay)) / (1 + s * loop["inverter_lag"])
        self._rig = _linear(parts.rig.system, drawn, s)
        self._control = control
        columns = [self._readings(dynamometer.torque_input) for dynamometer in parts.dynamometers]
        changes = self._image_changes(s, loop, delay)
        self._plant = [
            [
                sum((image[i][j] * change for image, change in zip(images, changes)), columns[j][i] * self._acting)
                for j in range(k)
            ]
            for i in range(2 * k)
        ]
        entries = [entry for row in self._plant for entry in row]
        self.of_commands = ca.Function(
            "of_commands", [table, x], [ca.vertcat(*(e.re for e in entries)), ca.vertcat(*(e.im for e in entries))]
        )
        sources = list(dict.fromkeys(pair.input for pair in case.compared))
        unmeasured = self._answers(sources, *self._feedback_alone(sources))
        matched = unmeasured | self._answers(self.measured, commands, expected) if self.measured else unmeasured
        vehicle = _linear(bed.vehicle.system, drawn, s)
        means = [
            sum(_log_square(answers[pair] / vehicle.response(pair[1], pair[0])) for pair in bed.pairs) / len(bed.pairs)
            for answers in (matched, unmeasured)
        ]
        self.squares = ca.Function("squares", [table, x], ca.cse([ca.SX(mean) for mean in means]))

    def _image_changes(self, s: Complex, loop: Mapping[str, ca.SX], delay: ca.SX) -> list[Complex]:
        """What drawn dead time and lag make of the image above, the one below and all others, over the nominal ones."""
        nominal, spacing = self._parts.case.loop, 2 * np.pi / self._parts.case.loop["sample_time"]
        later = delay - nominal.command_delay()
        changes = []
        for side in (1, -1):
            at = s + Complex(0.0, side * spacing)
            lag = (1 + at * nominal["inverter_lag"]) / (1 + at * loop["inverter_lag"])
            changes.append(exp(-(at * later)) * lag)
        return [*changes, exp(-(s * later))]

    def _readings(self, source: str) -> list[Complex]:
        """Signed, lagged flange torques and rotor speeds (2k) for an input of the rig."""
        torques = [self._rig.response(dynamometer.torque_sensor, source) for dynamometer in self._parts.dynamometers]
        signed = [torque * sign * self._lag for torque, sign in zip(torques, self._parts.toward.tolist(), strict=True)]
        return signed + [
            self._rig.response(dynamometer.speed_sensor, source) for dynamometer in self._parts.dynamometers
        ]

    def _feedback_alone(self, sources: Sequence[str]) -> tuple[Matrix, Matrix]:
        """Commands (k, w) of simulated torques among the sources; expected readings (2k, w), which are zero."""
        simulated, zero = self._parts.simulated, Complex(0.0)
        place = {source: 2 * self.k + simulated.index(source) for source in sources if source in simulated}
        commands = [[row[place[u]] if u in place else zero for u in sources] for row in self._control]
        return commands, [[zero] * len(sources)] * (2 * self.k)

    def _answers(
        self, sources: Sequence[str], commands: Matrix, expected: Matrix
    ) -> dict[tuple[str, str], Complex]:  # fmt: skip
        """Compared responses by input and sensor to these sources."""
        k, on_rig = self.k, self._rig.inputs
        difference: list[dict[int, Complex]] = [{} for _ in range(k)]
        right = [list(row) for row in commands]
        read = [self._readings(u) if u in on_rig else [Complex(0.0)] * (2 * k) for u in sources]
        for j in range(k):
            for i in range(2 * k):
                for column in range(k):
                    start = difference[j].get(column, Complex(1.0 if j == column else 0.0))
                    difference[j][column] = start - self._control[j][i] * self._plant[i][column]
                for u in range(len(sources)):
                    right[j][u] = right[j][u] + self._control[j][i] * (read[u][i] - expected[i][u])
        issued = solve(difference, [_row(row) for row in right])
        answers = {}
        for pair in self._parts.case.compared:
            if pair.input in sources:
                u = list(sources).index(pair.input)
                total = self._rig.response(pair.sensor, pair.input) if pair.input in on_rig else Complex(0.0)
                for j, dynamometer in enumerate(self._parts.dynamometers):
                    acting = self._rig.response(pair.sensor, dynamometer.torque_input) * self._acting
                    total = total + acting * issued[j][u]
                answers[pair.input, pair.sensor] = total
        return answers


def _matrix(values: Iterator[Complex], rows: int, columns: int) -> Matrix:
    return [[next(values) for _ in range(columns)] for _ in range(rows)]


def _row(values: Sequence[Complex]) -> Complex:
    return joined([Complex(ca.SX(value.re), ca.SX(value.im)) for value in values])


def _linear(system: System, drawn: Mapping[str, ca.SX], s: Complex) -> LinearResponse:
    """A system at s with the drawn quantities of the rig that it has; what rig and vehicle share has one value."""
    model = compiled(system)
    values = [
        drawn.get(f"rig.{name}", drawn.get(f"vehicle.{name}", ca.SX(value)))
        for name, value in zip(model.parameters, model.p0.tolist(), strict=True)
    ]
    return LinearResponse(model, ca.vertcat(*values), s)


def _log_square(ratio: Complex) -> ca.SX:
    """|log z|², complex logarithm, principal value."""
    return (ca.log(ratio.re**2 + ratio.im**2) / 2) ** 2 + ca.atan2(ratio.im, ratio.re) ** 2
