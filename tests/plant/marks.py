"""What the truth plant asks of a machine."""

import pytest

from plant.engine import compiler

needs_compiler = pytest.mark.skipif(compiler() is None, reason="the truth plant needs a C compiler (cc, gcc or clang)")
