"""What users read is kept in lists, ``tests/kept/words.json``: the words of terminal and pages, numbers left out.

A sentence that is lost, stands elsewhere or says something else fails; ``make kept`` renews the list. Numbers, dates,
checksums and places of files are masked: they differ between machines, and tests of their own know them. Where no
search decides, numbers are kept as well, in ``numbers.json``; whole lines of errors in ``lines.json``.
"""

import difflib
import re
from decimal import Decimal, InvalidOperation
from html.parser import HTMLParser

from kept_lists import kept

CHECKSUM = re.compile(r"\b(?=[0-9a-f]*[a-f])(?=[0-9a-f]*\d)[0-9a-f]{7,}\b")
NUMBER = re.compile(
    r"(?<![^\W\d_])[-−+]?∞|[-−+]?\d+(?:[.,:\d]*\d)?(?:[eE][-−+]?\d+)?(?:·10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?(?:\.dev\d+)?"
)
PASSING = re.compile(r"\d{4}-\d\d-\d\d|\d\d:\d\d(:\d\d)?|rigmatch [\d.]+\S*|#\d*")
SENTENCE = re.compile(r"(?<=[.:;]) ")
NOT_READ = ("script", "style", "svg", "math")
READ_ALOUD = ("title", "alt", "aria-label", "placeholder")  # attributes


class _Text(HTMLParser):
    """Words of a page in their order, those of its attributes among them."""

    def __init__(self) -> None:
        super().__init__()
        self.parts: list[str] = []
        self._within: list[str] = []

    def handle_starttag(self, tag, attributes):
        if tag in NOT_READ:
            self._within.append(tag)
        elif not self._within:
            self.parts += [value for name, value in attributes if name in READ_ALOUD and value]

    def handle_endtag(self, tag):
        if self._within and tag == self._within[-1]:
            self._within.pop()

    def handle_data(self, data):
        if not self._within:
            self.parts.append(data)


def words(text: str, *places: object) -> list[str]:
    """Sentences of a text or a page, numbers as ``#``, the given paths as ``PLACE``."""
    return SENTENCE.split(NUMBER.sub("#", _plain(text, *places)))


def numbers(text: str, *places: object) -> list[str]:
    """Numbers of a text or a page in their order, without dates, times of day and versions."""
    found = NUMBER.findall(PASSING.sub("", _plain(text, *places)))
    return [number.replace("−", "-") for number in found]


def _plain(text: str, *places: object) -> str:
    """What is read of a text or a page, in one line, without checksums and paths."""
    for place in sorted(map(str, places), key=len, reverse=True):
        text = text.replace(place, "PLACE")
    if text.lstrip().lower().startswith("<!doctype"):
        page = _Text()
        page.feed(text)
        text = " ".join(page.parts)
    return CHECKSUM.sub("#", " ".join(text.split()))


def same_words(name: str, text: str, *places: object) -> None:
    """Compare what users read with what is kept under the name; ``places`` are paths that differ from run to run."""
    present = words(text, *places)
    listed = kept("words.json", name, present)
    changes = [line for line in difflib.ndiff(listed, present) if line[0] in "-+"]
    assert not changes, f"{name}: kept (-) and present (+) words differ:\n" + "\n".join(changes)


def same_line(name: str, line: str, *places: object) -> None:
    """Compare one line, an error's above all, with what is kept under the name, to the letter but for the paths."""
    present = _plain(line, *places)
    listed = kept("lines.json", name, present)
    assert present == listed, f"{name}:\nkept:    {listed}\npresent: {present}"


def same_numbers(name: str, text: str, *places: object) -> None:
    """Compare the numbers that users read with what is kept under the name, but for one in the last digit."""
    present = numbers(text, *places)
    listed = kept("numbers.json", name, present)
    assert len(listed) == len(present), f"{name}: {len(listed)} numbers kept, {len(present)} present"
    wrong = [pair for pair in zip(listed, present, strict=True) if not _alike(*pair)]
    assert not wrong, f"{name}: kept and present numbers differ: {wrong}"


def _alike(before: str, present: str) -> bool:
    try:
        a, b = (Decimal(re.sub(r"·10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", _exponent, text)) for text in (before, present))
    except InvalidOperation:
        return before == present
    last = max(Decimal((0, (1,), int(value.as_tuple().exponent))) for value in (a, b))
    return abs(a - b) <= last


def _exponent(power: re.Match[str]) -> str:
    return "e" + power[1].translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
