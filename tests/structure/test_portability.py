"""Nothing needs POSIX where it need not, as far as the source shows it; tests/ground runs the program without it."""

import ast

import pytest
from structure.docstrings import tree
from structure.imports import modules

from modelling.fmu import export as build

ABSOLUTE = {
    "matching.cli": {"/proc/", "/proc/self/task/", "/tmp", "/var/tmp"}
}  # where there is fork, which is asked first


@pytest.fixture(scope="module")
def nodes():
    """Every call and every text of the program, by module."""
    kinds = ast.Call | ast.Constant
    return {name: [node for node in ast.walk(tree(name)) if isinstance(node, kinds)] for name in modules()}


def test_text_files_have_an_encoding(nodes):
    """Windows would take its own code page."""
    missing = []
    for name, parts in nodes.items():
        for node in parts:
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute | ast.Name):
                called = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
                keywords = {keyword.arg for keyword in node.keywords}
                if called in ("read_text", "write_text") and "encoding" not in keywords and len(node.args) < 2:
                    missing.append(f"{name}:{node.lineno}")
                if called == "open" and not _binary_or_other(node) and "encoding" not in keywords:
                    missing.append(f"{name}:{node.lineno}")
    assert missing == []


def _binary_or_other(node: ast.Call) -> bool:
    """Whether a call of open is in binary mode, or not that of a file: ``os.open``, ``webbrowser.open``."""
    if isinstance(node.func, ast.Attribute) and ast.unparse(node.func.value) in ("os", "self", "webbrowser", "archive"):
        return True
    texts = [part.value for part in [*node.args, *(k.value for k in node.keywords)] if isinstance(part, ast.Constant)]
    return any(isinstance(text, str) and "b" in text for text in texts)


def test_no_absolute_path_stands_in_the_program(nodes):
    found = {}
    for name, parts in nodes.items():
        texts = {node.value for node in parts if isinstance(node, ast.Constant) and isinstance(node.value, str)}
        roots = ("/tmp", "/var/", "/proc/", "/dev/", "/usr/", "/etc/", "/home/", "/opt/", "/bin/")
        if paths := {text for text in texts if text.startswith(roots)}:
            found[name] = paths
    assert found == ABSOLUTE


@pytest.mark.parametrize(
    ("system", "machine", "two", "three", "suffix"),
    [
        ("Linux", "x86_64", "linux64", "x86_64-linux", "so"),
        ("Windows", "AMD64", "win64", "x86_64-windows", "dll"),
        ("Darwin", "arm64", "aarch64-darwin", "aarch64-darwin", "dylib"),
        ("Darwin", "x86_64", "darwin64", "x86_64-darwin", "dylib"),
    ],
)
def test_binaries_of_an_fmu_are_named_as_the_standards_say(system, machine, two, three, suffix, monkeypatch):
    """FMI 2.0.4, 2.3; FMI 3.0.2, 2.5.1.4.1."""
    monkeypatch.setattr(build.platform, "system", lambda: system)
    monkeypatch.setattr(build.platform, "machine", lambda: machine)
    assert (build.folder("2.0"), build.folder("3.0")) == (two, three)
    assert build.SUFFIX[system.lower()] == suffix


def test_commands_to_copy_have_no_single_quotes(nodes):
    """The shell of Windows takes them for a part of the word."""
    found = []
    for name, parts in nodes.items():
        texts = [node.value for node in parts if isinstance(node, ast.Constant) and isinstance(node.value, str)]
        found += [f"{name}: {text}" for text in texts if "-e '." in text or "--tolerance '" in text]
    assert found == []
