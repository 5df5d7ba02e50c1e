"""The tests of equations, modes, files and recordings under every Python that the classifiers name: ``nox``."""

import nox

PYTHONS = ("3.11", "3.12", "3.13")  # as in pyproject.toml; a Python that the machine lacks is skipped
TESTS = ("tests/modelling", "tests/recordings", "tests/files")
NEEDS = ("pytest", "pytest-timeout", "hypothesis", "h5py", "jsonschema", "npTDMS", "pandas", "pyarrow")


@nox.session(python=PYTHONS)
def tests(session: nox.Session) -> None:
    """Install what running needs, and test."""
    session.install("--only-binary", ":all:", *NEEDS)
    session.install("--editable", ".")
    session.run("python", "-m", "pytest", "-q", *(session.posargs or TESTS))
