"""Which tests are run against a fault."""

import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from tests.mutants.coverage_map import PACKAGES, ROOT, Map
from tests.mutants.operators import Fault


def tests_for(fault: Fault, tests: Map) -> set[str]:
    """Tests that run the fault's statement; of a constant, those that run a line with its name or name it themselves.

    Where there is none (the line runs in another process only, or never), all tests that run any line of the file;
    where the file has constants alone, those that run a line with a name of it; where it runs in other processes alone,
    those of the test files that name its module, or one that names it.
    """
    if fault.constant:
        found = _of_name(fault.constant, tests) | asking(fault.constant, tests.tests)
    else:
        found = tests.of(fault.file, range(fault.lines[0], fault.lines[1] + 1))
    found = found or set().union(*tests.by_line[fault.file].values())
    found = found or set().union(*(_of_name(name, tests) for name in names_of(fault.file)))
    return found or {test for test in tests.tests if test.partition("::")[0] in naming(fault.file)}


def further_tests_for(fault: Fault, tests: Map) -> set[str]:
    """Tests that a fault survived by the first ones is tried with: all that run its statement or name its module.

    A line that a recorded test runs may be judged by another one that has it run in another process.
    """
    stem = Path(fault.file).stem
    return tests_for(fault, tests) | {
        test
        for test in tests.tests
        if (path := test.partition("::")[0]) in naming(fault.file) or Path(path).stem == f"test_{stem}"
    }


def _of_name(name: str, tests: Map) -> set[str]:
    """Tests that run a line with a name."""
    return set().union(*(tests.of(file, range(n, n + 1)) for file, n in lines_with(name)))


@cache
def naming(file: str, root: Path = ROOT) -> set[str]:
    """Test files that name the module of a file, or a module of the program that names it."""
    program = {other: "\n".join(lines) for other, lines in sources(root).items()}
    modules = {file, *(other for other, text in program.items() if _name(file).search(text))}
    texts = {path: path.read_text(encoding="utf-8") for path in (root / "tests").rglob("test_*.py")}
    return {
        str(path.relative_to(root))
        for path, text in texts.items()
        if any(_name(module).search(text) for module in modules)
    }


def _name(file: str) -> re.Pattern[str]:
    """How an import or a command line names the module of a file."""
    whole = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    package, _, name = whole.rpartition(".")
    return re.compile(rf"\b{re.escape(whole)}\b|\bfrom {re.escape(package)} import [^\n]*\b{re.escape(name)}\b")


def asking(name: str, names_of_tests: Iterable[str], root: Path = ROOT) -> set[str]:
    """Tests in whose file a name stands: what a class says of itself may be read by its test alone."""
    word = re.compile(rf"\b{re.escape(name)}\b")
    files = {one.partition("::")[0] for one in names_of_tests}
    inside = {file for file in files if (root / file).is_file() and word.search((root / file).read_text("utf-8"))}
    return {one for one in names_of_tests if one.partition("::")[0] in inside}


def names_of(file: str) -> list[str]:
    """Names that a file of the program assigns at its outermost level."""
    return re.findall(r"^(\w+)(?:: .+)? = ", "\n".join(sources()[file]), re.MULTILINE)


@cache
def lines_with(name: str) -> list[tuple[str, int]]:
    """Files and lines of the program that hold a name."""
    word = re.compile(rf"\b{re.escape(name)}\b")
    return [(file, n) for file, lines in sources().items() for n, line in enumerate(lines, 1) if word.search(line)]


@cache
def sources(root: Path = ROOT) -> dict[str, list[str]]:
    """The lines of every file of the program."""
    files = [path for package in PACKAGES for path in sorted((root / package).rglob("*.py"))]
    return {str(path.relative_to(root)): path.read_text(encoding="utf-8").splitlines() for path in files}
