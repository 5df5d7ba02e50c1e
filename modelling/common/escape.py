"""Text of a user's file → text that is only text where it is put: one function for each place.

Nothing that a file holds is written into C, XML, HTML, LaTeX, a figure or a path except through these. No command line
holds any of it: compilers are called with names of files that are fixed.
"""

import html as standard_html
import re
import unicodedata

LONGEST_COMMENT, LONGEST_FILE_NAME = 200, 80  # characters; a file's name may take 255 bytes, an ending included
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


def is_control(letter: str) -> bool:
    """Whether a character is a control character, a line or paragraph separator, half of a pair, or no character."""
    return unicodedata.category(letter) in ("Cc", "Cs", "Zl", "Zp") or letter in "\ufffe\uffff"


def _utf8(text: str) -> bytes:
    return text.encode("utf-8", "replace")
