"""No title becomes code, ends a comment or breaks the XML."""

from xml.etree import ElementTree as ET

import pytest

from modelling.fmu.block import block
from modelling.fmu.description import description
from modelling.fmu.source import sources
from modelling.model.files import from_dict

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
    assert not set(first[3:-3]) & set("*/\\?")
    assert ET.fromstring(description(made, "disc", "2.0", "{0}", 1e-3, "fmi2.c").encode()).get("modelName")
