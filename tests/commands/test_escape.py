"""Text of a file is only text wherever it is put, whatever it holds."""

import re
import tomllib
from html.parser import HTMLParser
from pathlib import PurePosixPath
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib import cbook

from modelling import escape
from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.toml import LONGEST_TITLE, title

# control characters, punctuation, marks of direction, halves of pairs, what is no character, and some beyond 16 bits
EVERY = "".join(map(chr, [*range(0x3000), *range(0xD7F0, 0xD810), *range(0xDFF0, 0xE010), *range(0xFE00, 0x10100)]))
HOSTILE = [
    EVERY, "*/ int run(void) { return 1; } /*", "??/\n#include </etc/passwd>\\\n", '"; system("x"); "',
    "]]><x y='\"'>&amp;", "<script>alert(1)</script>", "\u202etxt.c\u2066", "$\\frac{ $", "\\$ $",
    "}$$ \\input{/etc/passwd} %", "../../evil", "/etc", "..", "", ".", "a\0b", "-rf", "n" * 10**5,
]  # fmt: skip
ANY = st.text(st.characters(codec=None, exclude_categories=()), max_size=40)


def unescaped(literal):
    assert literal[0] == literal[-1] == '"'
    inside = re.sub(r"\\([0-7]{3})", "", literal[1:-1])
    assert not set(inside) & set('"\\?')
    assert all(32 <= ord(letter) < 127 for letter in literal)
    return re.sub(r"\\([0-7]{3})", lambda octal: chr(int(octal[1], 8)), literal[1:-1]).encode("latin-1")


class Reader(HTMLParser):
    def __init__(self, page):
        super().__init__(convert_charrefs=True)
        self.tags, self.attributes, self.text = [], [], ""
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data):
        self.text += data


def holds(text):
    assert re.fullmatch(r"[A-Za-z0-9 .,:;()_+=/-]{0,200}", escape.c_comment(text))
    assert unescaped(escape.c_string(text)) == text.encode("utf-8", "replace")
    assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,90}", escape.c_identifier(text))
    root = ET.Element("a", {"b": escape.xml(text)})
    root.text = escape.xml(text)
    back = ET.fromstring(ET.tostring(root, encoding="unicode").encode("utf-8"))
    assert back.get("b") == escape.xml(text)
    assert back.text == root.text.replace("\r\n", "\n").replace("\r", "\n") if text else not back.text
    page = Reader(f'<p title="{escape.html(text)}">{escape.html(text)}</p>')
    assert page.tags == ["p"]
    assert page.attributes == [("title", escape.xml(text))]
    assert page.text == escape.xml(text)
    assert not re.search(
        r"[{}$&#%^~<>_]", re.sub(r"\\(backslash|hat|sim|lt|gt)\{\}|\\[{}$&#_%]", "", escape.latex(text))
    )
    assert not cbook.is_math_text(escape.figure(text))
    assert escape.figure(text).replace(r"\$", "$") == escape.single_line(text)
    read = tomllib.loads(f"a = {escape.toml_string(text)}\nb = 1")
    assert read == {"a": text.encode("utf-8", "replace").decode(), "b": 1}
    shown = escape.terminal(text)
    assert len(shown) == len(text)
    controls = map(chr, [*range(9), *range(11, 32), *range(127, 160)])
    assert not set(shown) & {*controls, *"\u2028\u200f\u202e\u2066\ud800"}
    name = escape.file_name(text)
    assert PurePosixPath("out", name).parts == ("out", name)
    assert name[0] != "."
    assert len(name) <= 80
    assert not {"\0", "/", "\n"} & set(name)


@pytest.mark.parametrize("text", HOSTILE, ids=range(len(HOSTILE)))
def test_hostile_text_is_only_text(text):
    holds(text)


@given(ANY)
def test_any_text_is_only_text(text):
    holds(text)


@pytest.mark.parametrize("line", [*map(chr, [*range(32), *range(127, 160), 0x2028, 0x2029, 0xFFFE, 0xFFFF]), "\ud800"])
def test_titles_are_one_line_without_control_characters(line):
    with pytest.raises(InputError, match=f"character 3 .U.{ord(line):04X}. is a control character or a line end"):
        title({"title": f"a {line}b"}, "model.toml")


def test_titles_are_not_endless_and_others_are_kept():
    with pytest.raises(InputError, match=f"title: has {LONGEST_TITLE + 1} characters"):
        title({"title": "a" * (LONGEST_TITLE + 1)}, "model.toml")
    for line in ("$\\frac{ $ x", "<script>", "Prüfstand 2 — «Ω»", "轴", "*/", ""):
        assert title({"title": line}, "model.toml") == line


def test_a_model_in_a_notebook_shows_its_title_as_text():
    system = from_dict({"title": "<img src=x onerror=alert(1)>", "inertias": {"a": {"J": 1.0}}})
    page = system._repr_html_()
    assert page.startswith("<h4>&lt;img src=x onerror=alert(1)&gt;</h4>")
    assert Reader(page).tags == ["h4", "p", "img"]  # the drawing
