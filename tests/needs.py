"""What some tests ask of a machine."""

import pytest

from modelling.simulation.compiled import compiler

compiles = pytest.mark.skipif(compiler() is None, reason="no C compiler here")
