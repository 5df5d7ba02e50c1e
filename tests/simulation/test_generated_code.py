"""What generated C calls in the place of the C library's own functions."""

import math
from itertools import product

import casadi as ca
from needs import compiles

from modelling.simulation.compiled import external

VALUES = (0.0, -0.0, 1.0, -1.0, 2.5, -1e300, 5e-324, math.inf, -math.inf, math.nan)


@compiles
def test_the_larger_and_the_smaller_are_those_of_the_c_library() -> None:
    x, y = ca.MX.sym("x"), ca.MX.sym("y")
    plain = ca.Function("ends_of_two", [x, y], [ca.fmax(x, y), ca.fmin(x, y)])
    made = external(plain)
    assert made.is_a("External")
    for a, b in product(VALUES, VALUES):
        larger, smaller = (float(part) for part in made(a, b))
        if math.isnan(a) or math.isnan(b):
            other = a if math.isnan(b) else b
            assert (larger, smaller) == (other, other) or (math.isnan(other) and math.isnan(larger + smaller))
        else:
            assert (larger, smaller) == (max(a, b), min(a, b))
        for got, expected in zip((larger, smaller), plain(a, b), strict=True):  # which calls the C library's
            assert got == float(expected) or (math.isnan(got) and math.isnan(float(expected)))
