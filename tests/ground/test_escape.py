"""Text of a file is only text wherever it is put, whatever it holds."""

import ast
import re
import tomllib
from html.parser import HTMLParser
from pathlib import Path, PurePosixPath
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


TAG = re.compile(r"<[/!?]?[A-Za-z]")
LATEX_COMMAND = re.compile(r"\\(mathrm|begin|frac|text)\b|\$\$")
C_TEXT = re.compile(r"/\*|#define |static const ")
ESCAPING = {"html", "escape.html", "escape.latex", "c_comment", "c_string"}  # what may stand in such a text
NUMBERS = {"number", "percent", "_real", "repr", "int", "len"}
# pieces that are made of such texts themselves, or stand in the program: file, expression
PIECES = {
    ("matching/explore/page/drivetrain.py", "row"), ("matching/explore/page/drivetrain.py", "listed"),
    *(("matching/explore/page/elements.py", each) for each in ("label", "cells", "body", "level", "kind")),
    ("matching/explore/page/elements.py", "''.join(map(_cell, row))"),
    ("matching/explore/page/elements.py", "'<tr>' + ''.join(map(_cell, row))"),
    ("matching/explore/page/map_view.py", "limits"),
    ("matching/explore/page/match_result.py", "order"), ("matching/explore/page/match_result.py", "figures"),
    ("matching/explore/page/running.py", "monotonic() - begun"),  # written with the format .0f
    ("matching/explore/page/server.py", "frame"), ("matching/explore/page/server.py", "FRAME_PX"),
    ("matching/explore/page/validity.py", "embedded(image(picture))"),  # base64
    ("matching/report/common/mathml.py", "content"),  # by a writer of XML that escapes
    ("matching/report/curves/embedding.py", "part"),  # Bokeh's own library
    ("matching/report/diagnosis/page.py", "name"), ("matching/report/diagnosis/page.py", "name[2:]"),
    ("matching/report/match/fidelity_rows.py", "name[2:]"),
    *(("modelling/controller/c_source.py", each) for each in (
        "fixed.SAMPLES_IN_A_ROW", "torque_gone.REMEMBERED_SAMPLES", "torque_gone.AVERAGED_SAMPLES",
        "torque_gone.KEPT_SAMPLES", "controller.watched.carried_samples", "opened_shaft.IN_A_ROW", "opened",
        "', '.join(map(str, controller.torque_readings))",
        "', '.join(map(str, controller.speed_readings))", "name", "part",
        "', '.join((_real(value) for value in getattr(settings, part)))",
    )),
    ("modelling/equations/latex.py", "body"),
    ("modelling/fmu/description.py", "ET.tostring(root, encoding='unicode')"),
    ("modelling/fmu/export.py", "identifier"), ("modelling/fmu/export.py", "FILES['3.0']"),
    ("modelling/fmu/source.py", "name"), ("modelling/fmu/source.py", "value"), ("modelling/fmu/source.py", "what"),
    ("modelling/simulation/integrator/c_library.py", "source"),
    ("modelling/simulation/integrator/c_library.py", "processor"),
}  # fmt: skip
ROOT = Path(__file__).parents[2]
PROGRAM = sorted(path for room in ("modelling", "matching") for path in (ROOT / room).rglob("*.py"))


def put_into(text):
    """Expressions of an f-string, of ``%`` and of ``format`` that hold HTML, XML, LaTeX or C; none in other texts."""
    if isinstance(text, ast.JoinedStr):
        words = "\0".join(part.value for part in text.values if isinstance(part, ast.Constant))
        put = [part.value for part in text.values if isinstance(part, ast.FormattedValue)]
    elif isinstance(text, ast.BinOp) and isinstance(text.op, ast.Add | ast.Mod):
        sides = [side for side in (text.left, text.right) if isinstance(side, ast.Constant)]
        words = "\0".join(side.value for side in sides if isinstance(side.value, str))
        put = [side for side in (text.left, text.right) if side not in sides]
    elif isinstance(text, ast.Call) and isinstance(text.func, ast.Attribute) and text.func.attr == "format":
        words = text.func.value.value if isinstance(text.func.value, ast.Constant) else ""
        put = [*text.args, *(key.value for key in text.keywords)]
    else:
        return []
    return put if any(kind.search(words) for kind in (TAG, LATEX_COMMAND, C_TEXT)) else []


def test_every_text_of_html_xml_latex_and_c_escapes_what_it_holds():
    """Read from the program itself: a new one needs an escaping function, or a line in the list above."""
    open_ones, used = [], set()
    for path in PROGRAM:
        name, source = path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
        if not any(kind.search(source) for kind in (TAG, LATEX_COMMAND, C_TEXT)):
            continue
        for text in ast.walk(ast.parse(source)):
            for each in put_into(text):
                called = ast.unparse(each.func) if isinstance(each, ast.Call) else ""
                piece = (name, ast.unparse(each))
                used.add(piece)
                if called not in ESCAPING | NUMBERS and not isinstance(each, ast.JoinedStr) and piece not in PIECES:
                    open_ones.append(f"{name}:{text.lineno}: {piece[1]}")
    assert not open_ones
    assert used >= PIECES  # the list holds nothing that is gone


def test_templates_leave_out_escaping_only_for_what_is_escaped():
    """``|safe`` and ``Markup``: rows with escaped names, drawings and MathML of ours, and Bokeh's scripts."""
    templates = [*(ROOT / "matching" / "report").rglob("*.html"), *(ROOT / "matching" / "report").rglob("*.svg")]
    templates += (ROOT / "modelling").rglob("*.html")
    marked = {put.strip() for path in templates for put in re.findall(r"{{([^}]*)\|\s*safe", path.read_text("utf-8"))}
    assert marked == {"row.name", "drawing", "line", 'moving["library"]', 'moving["script"]', "moving[name]"}
    code = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in PROGRAM}
    assert {name for name, text in code.items() if "Markup(" in text} == {
        "matching/report/controller/diagram.py", "matching/report/drawing/svg.py",
    }  # fmt: skip
    assert {name for name, text in code.items() if "autoescape=False" in text} == {"modelling/controller/c_source.py"}
    for text in code.values():
        assert text.count("Environment(") == text.count("autoescape=")


def test_comments_and_names_in_the_header_of_a_controller_are_escaped():
    """Its template is C, which Jinja does not escape: every text it is given goes through ``c_comment``."""
    header = (ROOT / "modelling" / "controller" / "sources" / "controller.h.in").read_text(encoding="utf-8")
    put = {each.strip() for each in re.findall(r"{{(.*?)}}", header)}
    source = (ROOT / "modelling" / "controller" / "c_source.py").read_text(encoding="utf-8")
    assert put
    for name in ("title", "readings", "known", "dynamometers"):
        assert re.search(rf"\b{name}=(\[)?c_comment\(", source)
