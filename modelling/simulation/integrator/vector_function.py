"""A CasADi function of scalars worked out for very many points at once: compiled with vector operations.

CasADi's own C works out one point after the other. Here each of its instructions becomes one operation on eight
neighbouring points, which the compiler makes of whatever this processor has (GCC's vector extensions, Clang's too).
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import casadi as ca
import numpy as np

from modelling.simulation.integrator.c_library import library_of

LANES = 8  # points an operation
# GCC ends wide registers' use before calls to the C library with the second option only; without it log, atan2 and
# the like are some ten times slower after operations on vectors
OPTIMISATION = "-O1 -fexpensive-optimizations"

_HEAD = """#include <math.h>
#include <string.h>
typedef double V __attribute__((vector_size(64), aligned(8)));
#define EACH(f, x) ({ V a = x, r; int n = 0; for (int l = 1; l < 8; l++) n += a[l] != a[0]; \
    if (n) for (int l = 0; l < 8; l++) r[l] = f(a[l]); else r = (V){0} + f(a[0]); r; })
#define BOTH(f, x, y) ({ V a = x, b = y, r; for (int l = 0; l < 8; l++) r[l] = f(a[l], b[l]); r; })
#define LOAD(n) ({ const double *p = in[n] + o * outer_step[n]; V r; \\
    if (inner_step[n]) memcpy(&r, p + i, sizeof r); else r = (V){0} + *p; r; })
#define STORE(n, x) { V r = x; memcpy(out + (n * outer + o) * inner + i, &r, sizeof r); }
void evaluate(long outer, long inner, const double *const *in, const long *outer_step, const long *inner_step,
    double *out)
{
    for (long o = 0; o < outer; o++) for (long i = 0; i < inner; i += 8) {
"""
_TAIL = "    }\n}\n"

# what each of CasADi's instructions is in C; a and b are its operands
_OPERATIONS = {
    ca.OP_ASSIGN: "{a}", ca.OP_ADD: "{a} + {b}", ca.OP_SUB: "{a} - {b}", ca.OP_MUL: "{a} * {b}",
    ca.OP_DIV: "{a} / {b}", ca.OP_NEG: "-{a}", ca.OP_SQ: "{a} * {a}", ca.OP_TWICE: "2.0 * {a}", ca.OP_INV: "1.0 / {a}",
    ca.OP_SQRT: "EACH(sqrt, {a})", ca.OP_EXP: "EACH(exp, {a})", ca.OP_LOG: "EACH(log, {a})",
    ca.OP_COS: "EACH(cos, {a})", ca.OP_SIN: "EACH(sin, {a})", ca.OP_ATAN2: "BOTH(atan2, {a}, {b})",
    ca.OP_FMAX: "BOTH(fmax, {a}, {b})", ca.OP_FMIN: "BOTH(fmin, {a}, {b})",
}  # fmt: skip


class VectorFunction:
    """A CasADi function whose inputs and outputs are columns of scalars, for arrays of points.

    Parameters
    ----------
    function : casadi.Function
        Of SX expressions, dense.
    """

    def __init__(self, function: ca.Function):
        self.function = function
        self.rows_out = sum(function.numel_out(i) for i in range(function.n_out()))
        source = _source(function)
        compiled = None if source is None else library_of(source, OPTIMISATION, ["evaluate"], this_processor=True)
        self._evaluate: Callable[..., None] | None = None if compiled is None else compiled.evaluate

    @property
    def compiled(self) -> bool:
        """Whether there was a compiler, and C for every instruction."""
        return self._evaluate is not None

    def __call__(self, *operands: np.ndarray) -> np.ndarray:
        """All outputs (y, o, b), below each other.

        Parameters
        ----------
        operands : ndarray (rows, o, b)
            One an input; o or b may be 1 where the input is the same along it.
        """
        shapes = {operand.shape[1:] for operand in operands}
        outer, inner = (max(shape[axis] for shape in shapes) for axis in (0, 1))
        if self._evaluate is None:
            return self._by_casadi(operands, outer, inner)
        padded = -(-inner // LANES) * LANES
        columns = [_padded(operand, padded) for operand in operands]
        out = np.empty((self.rows_out, outer, padded))
        starts = [operand.ctypes.data + i * operand.strides[0] for operand in columns for i in range(len(operand))]
        pointers = (ctypes.c_void_p * len(starts))(*starts)
        outer_step, inner_step = ((ctypes.c_long * len(starts))(*_steps(columns, axis)) for axis in (1, 2))
        counts = ctypes.c_long(outer), ctypes.c_long(padded)
        self._evaluate(*counts, pointers, outer_step, inner_step, ctypes.c_void_p(out.ctypes.data))
        return out[:, :, :inner]

    def _by_casadi(self, operands: tuple[np.ndarray, ...], outer: int, inner: int) -> np.ndarray:
        points = outer * inner
        full = [np.broadcast_to(x, (len(x), outer, inner)).reshape(len(x), points) for x in operands]
        results = self.function.map(points).call(full)
        return np.concatenate([np.asarray(result.full()) for result in results]).reshape(-1, outer, inner)


def _steps(operands: list[np.ndarray], axis: int) -> list[int]:
    """From one value of every input to the next along an axis; 0 where it is the same there."""
    steps = [x.strides[axis] // x.itemsize if x.shape[axis] > 1 else 0 for x in operands]
    return [step for x, step in zip(operands, steps, strict=True) for _ in x]


def _padded(operand: np.ndarray, inner: int) -> np.ndarray:
    """The operand (rows, o, b), contiguous along its last axis, of that many points there unless it is the same."""
    operand = np.ascontiguousarray(operand, dtype=float)
    missing = inner - operand.shape[2]
    if operand.shape[2] == 1 or not missing:
        return operand
    return np.concatenate([operand, np.repeat(operand[:, :, -1:], missing, axis=2)], axis=2)


def _source(function: ca.Function) -> str | None:
    """C of the function; None where it has an instruction that is not known here."""
    starts_in = np.cumsum([0, *(function.numel_in(i) for i in range(function.n_in()))])
    starts_out = np.cumsum([0, *(function.numel_out(i) for i in range(function.n_out()))])
    body: list[str] = []
    for k in range(function.n_instructions()):
        kind, read = function.instruction_id(k), function.instruction_input(k)
        made = function.instruction_output(k)
        if kind == ca.OP_OUTPUT:
            body.append(f"STORE({starts_out[made[0]] + made[1]}, w{read[0]})")
            continue
        if kind == ca.OP_CONST:
            value = f"(V){{0}} + {function.instruction_constant(k)!r}"
        elif kind == ca.OP_INPUT:
            value = f"LOAD({starts_in[read[0]] + read[1]})"
        elif kind in _OPERATIONS:
            a, b = (f"w{place}" for place in (read[0], read[-1]))
            value = _OPERATIONS[kind].format(a=a, b=b)
        else:
            return None
        body.append(f"w{made[0]} = {value};")
    declared = ", ".join(f"w{i}" for i in range(function.sz_w()))
    return _HEAD + f"        V {declared};\n" + "\n".join(body) + "\n" + _TAIL
