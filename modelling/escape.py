"""Text of a user's file → text that is only text where it is put: one function for each place.

Nothing that a file holds is put into C, XML, HTML, LaTeX, TOML, a figure, paths or a terminal except through these.
No command line holds any of it: compilers are called with names of files that are fixed.
"""

import html as standard_html
import re
import unicodedata

LONGEST_COMMENT, LONGEST_FILE_NAME = 200, 80  # characters; a file's name may take 255 bytes, an ending included
_DIRECTION = "\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
_LATEX = {letter: f"\\{letter}" for letter in "{}$&#_%"} | {
    "\\": r"\backslash{}", "^": r"\hat{}", "~": r"\sim{}", "<": r"\lt{}", ">": r"\gt{}",
}  # fmt: skip


def c_comment(text: str) -> str:
    """For inside of a C comment, blanks round it: ASCII letters, digits and what can neither end nor continue one."""
    return re.sub(r"[^A-Za-z0-9 .,:;()_+=/-]", "_", text[:LONGEST_COMMENT].replace("*", " "))


def c_string(text: str) -> str:
    """A C string literal, quotes included: what is not a plain character is written as the octal value of its byte."""
    plain = (chr(byte) if 32 <= byte < 127 and byte not in b'"\\?' else f"\\{byte:03o}" for byte in _utf8(text))
    return f'"{"".join(plain)}"'


def c_identifier(text: str) -> str:
    """A name in C, and of the files of an FMU: ASCII letters, digits and underscores, a letter first."""
    plain = re.sub(r"[^A-Za-z0-9_]+", "_", text[:LONGEST_FILE_NAME]).strip("_") or "model"
    return plain if plain[0].isalpha() else f"model_{plain}"


def xml(text: str) -> str:
    """For an XML writer that escapes: without what XML 1.0 cannot hold (control characters, surrogates, U+FFFE)."""
    return re.sub("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", text)


def html(text: str) -> str:
    """For HTML and SVG, attributes included; what XML cannot hold is replaced."""
    return standard_html.escape(xml(text))


def latex(text: str) -> str:
    """For ``\\mathrm{…}`` of LaTeX as browsers render it: nothing in it is a command, a brace or a comment."""
    return "".join(_LATEX.get(letter, letter) for letter in xml(text))


def toml_string(text: str) -> str:
    """A TOML string, quotes included; what cannot be seen is written by its number, halves of pairs are replaced."""
    return '"' + "".join(_in_toml(letter) for letter in _utf8(text).decode()) + '"'


def terminal(text: str) -> str:
    """Lines for a terminal: no sequence in them moves its cursor, and no mark of direction reorders a line."""
    return "".join("\ufffd" if letter in _DIRECTION or is_control(letter, but="\n\t") else letter for letter in text)


def figure(text: str) -> str:
    """For a text of Matplotlib, which reads what stands between two dollar signs as mathematics."""
    return single_line(text).replace("$", r"\$")


def file_name(text: str) -> str:
    """A part of a path: letters, digits, ``_``, ``-`` and ``.`` within; never empty, hidden or another folder."""
    plain = re.sub(r"[^\w.-]", "_", text[:LONGEST_FILE_NAME]).strip(".")
    return plain or "_"


def single_line(text: str) -> str:
    """Text in one line, control characters and line ends replaced."""
    return "".join("\ufffd" if is_control(letter) else letter for letter in text)


def is_control(letter: str, but: str = "") -> bool:
    """Whether a character is a control character, a line or paragraph separator, half of a pair, or no character."""
    return letter not in but and (unicodedata.category(letter) in ("Cc", "Cs", "Zl", "Zp") or letter in "\ufffe\uffff")


def _in_toml(letter: str) -> str:
    if letter in '"\\':
        return f"\\{letter}"
    return letter if letter.isprintable() else f"\\U{ord(letter):08x}"


def _utf8(text: str) -> bytes:
    return text.encode("utf-8", "replace")
