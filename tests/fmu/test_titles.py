"""No title becomes code, ends a comment or breaks the XML."""

from xml.etree import ElementTree as ET

import pytest
from needs import compiles

from modelling.fmu.export import FILES, FLAGS, block, description, sources
from modelling.model_file import from_dict
from modelling.simulation import compiled as c_compiler
from modelling.simulation import compiled as c_library
from modelling.simulation.compiled import compile_library, compiler

DISC = {"inertias": {"a": {"J": 1.0}}, "inputs": {"torque": {"on": "a"}}}
TITLES = [
    "axle */ wheel",
    "*/ int run(void) { return 1; } /*",
    "a ??/\n b \\",
    "x\x00\x01\x1b]]>\u202e",
    "\ud800",
    "é" * 10**6,
]


@pytest.mark.parametrize("title", TITLES, ids=range(len(TITLES)))
def test_any_title_is_only_text(title):
    made = block([from_dict(DISC, "test")], title, "disc")
    first = sources(made, "disc", "2.0", "{0}")["model.h"].splitlines()[0]
    assert first.startswith("/* ")
    assert first.endswith(" in the order of the value references */")
    assert "*/" not in first[:-2]
    assert not set(first[3:-3]) & set("*\\?")
    assert ET.fromstring(description(made, "disc", "2.0", "{0}", 1e-3, "fmi2.c").encode()).get("modelName")


@compiles
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_sources_compile_without_a_warning_whatever_the_title(fmi):
    made = block([from_dict(DISC, "test")], "a ??/\n*/ int run(void) {\\", "disc")
    warnings = ("-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wno-unused-function", "-Wno-unused-parameter")
    flags = (*warnings, "-shared", "-fPIC", "-std=c11")
    assert compile_library(compiler(), flags, sources(made, "disc", fmi, "{0}"), FILES[fmi])


def test_the_command_line_of_the_compiler_holds_nothing_of_the_model(monkeypatch):
    calls = []
    monkeypatch.setattr(c_compiler, "_run", lambda command, *_: calls.append(command) or "")
    hostile = "evil -fplugin=x; $(touch evil)"
    made = block([from_dict(DISC | {"title": hostile}, "test")], hostile, hostile)
    for flags in (FLAGS, c_library.FLAGS):
        with pytest.raises(c_compiler.CompilerFault):
            compile_library("cc", flags, sources(made, "disc", "2.0", "{0}"), FILES["2.0"])
    assert len(calls) == 2
    assert not [word for call in calls for word in call if "evil" in word or "touch" in word]
