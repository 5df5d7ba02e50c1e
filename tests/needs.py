"""What some tests ask of a machine."""

import pytest

from modelling.simulation.integrator.c_compiler import compiler

compiles = pytest.mark.skipif(compiler() is None, reason="no C compiler here")
